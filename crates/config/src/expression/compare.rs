//! Comparisons within a condition: their operands, and what two of them imply together.

use cel::common::ast::{CallExpr, Expr, IdedExpr, LiteralValue, operators};

/// A part of a condition with a truth value of its own.
#[derive(Debug, Clone)]
pub(super) struct Comparison {
    pub id: u64,
    /// The compared operand in a normal form: an input, or a computation with inputs.
    pub of: String,
    /// Whether it is an input without any computation.
    pub is_input: bool,
    pub sign: &'static str,
    pub with: ComparedWith,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum ComparedWith {
    Number(f64),
    Text(String),
    /// For a truth value: `==` is the part itself, `!=` its negation.
    True,
    /// Another part, in a normal form.
    Part(String),
}

/// The operands of one operator, each as a comparison.
pub(super) fn joined(part: &IdedExpr, operator: &str, found: &mut Vec<Comparison>) {
    match &part.expr {
        Expr::Call(call) if call.func_name == operator => {
            call.args.iter().for_each(|part| joined(part, operator, found));
        }
        _ => found.push(comparison(part)),
    }
}

/// All comparisons anywhere in a condition.
pub(super) fn all(part: &IdedExpr, found: &mut Vec<Comparison>) {
    let Expr::Call(call) = &part.expr else { return };
    if sign(&call.func_name).is_some() {
        found.push(comparison(part));
    }
    call.target.as_deref().into_iter().chain(&call.args).for_each(|part| all(part, found));
}

/// Each input that is looked for in a list, with each text of that list: `status in ["FULL", "CHARGING"]`.
pub(super) fn listed_texts(part: &IdedExpr, found: &mut Vec<(String, String)>) {
    let Expr::Call(call) = &part.expr else { return };
    if let (operators::IN, [of, list]) = (&*call.func_name, &call.args[..])
        && let (Expr::Ident(input), Expr::List(list)) = (&of.expr, &list.expr)
    {
        let text = |it: &IdedExpr| match literal(it)? {
            ComparedWith::Text(text) => Some((input.clone(), text)),
            _ => None,
        };
        found.extend(list.elements.iter().filter_map(text));
    }
    call.target.as_deref().into_iter().chain(&call.args).for_each(|part| listed_texts(part, found));
}

fn comparison(part: &IdedExpr) -> Comparison {
    let whole = || Comparison {
        id: part.id,
        of: written(part),
        is_input: matches!(part.expr, Expr::Ident(_)),
        sign: "==",
        with: ComparedWith::True,
    };
    let Expr::Call(call) = &part.expr else { return whole() };
    if let (operators::LOGICAL_NOT, [inner]) = (&*call.func_name, &call.args[..]) {
        return comparison(inner).negated();
    }
    let (Some(sign), [a, b]) = (sign(&call.func_name), &call.args[..]) else { return whole() };
    let (literal_a, literal_b) = (literal(a), literal(b));
    let (of, sign, with) = match (literal_a, literal_b) {
        (None, Some(with)) => (a, sign, with),
        (Some(with), None) => (b, mirrored(sign), with),
        // The alphabetically first operand comes first, so that `b < a` becomes `a > b`.
        _ if written(b) < written(a) => (b, mirrored(sign), ComparedWith::Part(written(a))),
        _ => (a, sign, ComparedWith::Part(written(b))),
    };
    let is_input = matches!(of.expr, Expr::Ident(_));
    Comparison { id: a.id, of: written(of), is_input, sign, with }.plain(of)
}

impl Comparison {
    /// `t == true` is `t`, `t != true` and `t == false` are `!t`.
    fn plain(self, of: &IdedExpr) -> Comparison {
        let is_true = match &self.with {
            ComparedWith::Part(part) if part == "true" => true,
            ComparedWith::Part(part) if part == "false" => false,
            _ => return self,
        };
        let inner = comparison(of);
        if is_true == (self.sign == "==") { inner } else { inner.negated() }
    }

    pub fn negated(&self) -> Comparison {
        let sign = match self.sign {
            "<" => ">=",
            "<=" => ">",
            ">" => "<=",
            ">=" => "<",
            "==" => "!=",
            _ => "==",
        };
        Comparison { sign, ..self.clone() }
    }

    /// Whether both have the same normal form.
    pub fn is(&self, other: &Comparison) -> bool {
        self.of == other.of && self.sign == other.sign && self.with == other.with
    }

    /// Whether no value satisfies both.
    pub fn excludes(&self, other: &Comparison) -> bool {
        if self.of != other.of {
            return false;
        }
        let (a, b) = (self.sign, other.sign);
        match (&self.with, &other.with) {
            (ComparedWith::Number(at), ComparedWith::Number(other)) => {
                // The boundaries of both, and values between them: if any value satisfies both, one of these
                // does.
                let (low, high) = (at.min(*other), at.max(*other));
                let tried = [f64::NEG_INFINITY, low, f64::midpoint(low, high), high, f64::INFINITY];
                !tried.iter().any(|&value| meets(value, a, *at) && meets(value, b, *other))
            }
            (ComparedWith::Text(one), ComparedWith::Text(other)) => match (a, b) {
                ("==", "==") => one != other,
                ("==", "!=") | ("!=", "==") => one == other,
                _ => false,
            },
            (ComparedWith::True, ComparedWith::True) => a != b,
            // One is less than, equal to or greater than the other.
            (ComparedWith::Part(one), ComparedWith::Part(other)) if one == other => {
                ![-1.0, 0.0, 1.0].iter().any(|&value| meets(value, a, 0.0) && meets(value, b, 0.0))
            }
            _ => false,
        }
    }

    pub fn words(&self) -> String {
        let (of, sign) = (&self.of, self.sign);
        match &self.with {
            ComparedWith::Number(value) => format!("{of} {sign} {value}"),
            ComparedWith::Text(text) => format!("{of} {sign} '{text}'"),
            ComparedWith::Part(part) => format!("{of} {sign} {part}"),
            ComparedWith::True if sign == "==" => of.clone(),
            ComparedWith::True if !of.contains(' ') => format!("!{of}"),
            ComparedWith::True => format!("!({of})"),
        }
    }
}

fn sign(function: &str) -> Option<&'static str> {
    Some(match function {
        operators::LESS => "<",
        operators::LESS_EQUALS => "<=",
        operators::GREATER => ">",
        operators::GREATER_EQUALS => ">=",
        operators::EQUALS => "==",
        operators::NOT_EQUALS => "!=",
        _ => return None,
    })
}

fn mirrored(sign: &'static str) -> &'static str {
    match sign {
        "<" => ">",
        "<=" => ">=",
        ">" => "<",
        ">=" => "<=",
        same => same,
    }
}

pub(super) fn meets(value: f64, sign: &str, limit: f64) -> bool {
    match sign {
        "<" => value < limit,
        "<=" => value <= limit,
        ">" => value > limit,
        ">=" => value >= limit,
        "==" => value.total_cmp(&limit).is_eq() || value.partial_cmp(&limit).is_some_and(|it| it.is_eq()),
        _ => value.partial_cmp(&limit).is_some_and(|it| it.is_ne()),
    }
}

fn literal(part: &IdedExpr) -> Option<ComparedWith> {
    match &part.expr {
        Expr::Literal(LiteralValue::String(text)) => Some(ComparedWith::Text(text.inner().to_owned())),
        Expr::Literal(LiteralValue::Boolean(_)) => Some(ComparedWith::Part(written(part))),
        Expr::Literal(literal) => number(literal).map(ComparedWith::Number),
        Expr::Call(call) if call.func_name == operators::NEGATE => match literal(call.args.first()?)? {
            ComparedWith::Number(value) => Some(ComparedWith::Number(-value)),
            _ => None,
        },
        _ => None,
    }
}

/// Every number is a double here, even one without a point.
fn number(literal: &LiteralValue) -> Option<f64> {
    match literal {
        LiteralValue::Double(value) => Some(*value.inner()),
        LiteralValue::Int(value) => Some(*value.inner() as f64),
        LiteralValue::UInt(value) => Some(*value.inner() as f64),
        _ => None,
    }
}

/// The normal form of a part, without the spaces and brackets of the file.
fn written(part: &IdedExpr) -> String {
    let inner = |part: &IdedExpr| match &part.expr {
        Expr::Call(call) if is_operator(call) => format!("({})", written(part)),
        _ => written(part),
    };
    match &part.expr {
        Expr::Ident(name) => name.clone(),
        Expr::Select(select) => format!("{}.{}", inner(&select.operand), select.field),
        Expr::Literal(LiteralValue::Boolean(value)) => value.inner().to_string(),
        Expr::Literal(LiteralValue::String(text)) => format!("'{}'", text.inner()),
        Expr::Literal(literal) => {
            number(literal).map_or_else(|| format!("{literal:?}"), |value| value.to_string())
        }
        Expr::List(list) => {
            let elements: Vec<String> = list.elements.iter().map(written).collect();
            format!("[{}]", elements.join(", "))
        }
        Expr::Call(call) => match (&*call.func_name, &call.args[..]) {
            (operators::CONDITIONAL, [a, b, c]) => format!("{} ? {} : {}", inner(a), inner(b), inner(c)),
            (operators::IN, [a, b]) => format!("{} in {}", inner(a), inner(b)),
            (name, [a]) if is_operator(call) => format!("{}{}", name.trim_matches('_'), inner(a)),
            (name, [a, b]) if is_operator(call) => {
                format!("{} {} {}", inner(a), name.trim_matches('_'), inner(b))
            }
            (name, args) => {
                let args: Vec<String> = args.iter().map(written).collect();
                let target = call.target.as_deref().map(|target| format!("{}.", inner(target)));
                let name = match name {
                    "math.@max" => "math.greatest",
                    "math.@min" => "math.least",
                    name => name,
                };
                format!("{}{name}({})", target.unwrap_or_default(), args.join(", "))
            }
        },
        other => format!("{other:?}"),
    }
}

fn is_operator(call: &CallExpr) -> bool {
    call.func_name.contains('_') && call.target.is_none() || call.func_name == operators::IN
}
