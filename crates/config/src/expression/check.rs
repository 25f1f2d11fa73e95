//! Checks a condition: its permitted parts, and the types that it assumes for its inputs.

use cel::common::ast::{CallExpr, Expr, IdedExpr, LiteralValue, SourceInfo, operators};
use cel::common::types::CelDouble;

use super::each::{self, QUANTIFIERS_MAX, Quantifier};
use crate::decode::Spanned;
use telltale_engine::model::monitors::ScalarKind;
use telltale_yaml::decode::did_you_mean;
use telltale_yaml::{Log, Problem, Span, suggest};

/// The operators and functions that a condition may use.
const OPERATORS: [&str; 16] = [
    operators::CONDITIONAL,
    operators::LOGICAL_AND,
    operators::LOGICAL_OR,
    operators::LOGICAL_NOT,
    operators::SUBSTRACT,
    operators::ADD,
    operators::MULTIPLY,
    operators::DIVIDE,
    operators::EQUALS,
    operators::NOT_EQUALS,
    operators::GREATER_EQUALS,
    operators::LESS_EQUALS,
    operators::GREATER,
    operators::LESS,
    operators::NEGATE,
    operators::IN,
];
const FUNCTIONS: [&str; 14] = [
    "contains",
    "startsWith",
    "endsWith",
    "double",
    "math.abs",
    "math.sign",
    "math.sqrt",
    "math.floor",
    "math.ceil",
    "math.round",
    "math.trunc",
    "math.greatest",
    "math.least",
    "math.isNaN",
];
/// The type of a part of a condition, if it is known without values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PartType {
    Truth,
    Number,
    Text,
    List,
}

impl PartType {
    pub(super) fn of(kind: ScalarKind) -> PartType {
        match kind {
            ScalarKind::Number => PartType::Number,
            ScalarKind::Bool => PartType::Truth,
            ScalarKind::Text => PartType::Text,
        }
    }

    /// `None`: no input has this type.
    pub(super) fn scalar(self) -> Option<ScalarKind> {
        match self {
            PartType::Number => Some(ScalarKind::Number),
            PartType::Truth => Some(ScalarKind::Bool),
            PartType::Text => Some(ScalarKind::Text),
            PartType::List => None,
        }
    }

    pub(super) fn as_str(self) -> &'static str {
        match self {
            PartType::Truth => "a truth value",
            PartType::Number => "a number",
            PartType::Text => "a text",
            PartType::List => "a list",
        }
    }
}

pub(super) struct Check<'a> {
    text: &'a Spanned<String>,
    names: &'a [&'a str],
    /// The known type of each input.
    known: &'a [Option<PartType>],
    /// The type that the condition assumes for each input, from its use.
    pub(super) taken: Vec<Option<PartType>>,
    /// The `exists` and `all` of the condition. The condition reads their answers as values.
    pub(super) quantifiers: Vec<Quantifier>,
    /// The variable and the list of the part about elements that is looked at.
    scope: Option<(String, String)>,
    info: &'a SourceInfo,
    log: &'a mut Log,
    pub(super) good: bool,
}

impl<'a> Check<'a> {
    pub(super) fn new(
        text: &'a Spanned<String>,
        names: &'a [&'a str],
        known: &'a [Option<PartType>],
        info: &'a SourceInfo,
        log: &'a mut Log,
    ) -> Check<'a> {
        let (taken, quantifiers) = (vec![None; names.len()], Vec::new());
        Check { text, names, known, taken, quantifiers, scope: None, info, log, good: true }
    }

    /// Checks the whole condition, and turns all numbers into doubles.
    pub(super) fn condition(&mut self, whole: &mut IdedExpr) {
        let kind = self.walk(whole);
        self.take(whole, PartType::Truth);
        if self.good && !matches!(kind, None | Some(PartType::Truth)) {
            self.problem(whole.id, "a condition must be true or false", "compare it: `... > 0`");
        }
    }

    /// A part is used as this type. If it is an input, that is its assumed type.
    fn take(&mut self, part: &IdedExpr, kind: PartType) {
        let Expr::Ident(name) = &part.expr else { return };
        let Some(input) = self.names.iter().position(|known| *known == name) else { return };
        match self.taken[input].replace(kind) {
            Some(before) if before != kind => {
                let text = format!(
                    "`{name}` is taken for {} here and for {} elsewhere",
                    kind.as_str(),
                    before.as_str()
                );
                self.problem(part.id, &text, "give each its own input, or compare it with one kind of value");
            }
            _ => {}
        }
    }

    fn walk(&mut self, part: &mut IdedExpr) -> Option<PartType> {
        let id = part.id;
        if let Some((variable, list)) = &self.scope
            && let Some(member) = each::member(part, variable)
        {
            let name = each::column(list, &member);
            part.expr = Expr::Ident(name.clone());
            return self.input(id, &name);
        }
        if matches!(&part.expr, Expr::Call(call) if each::asks_for_all(call).is_some()) {
            return self.quantifier(part);
        }
        match &mut part.expr {
            Expr::Literal(literal) => self.literal(id, literal),
            Expr::Ident(name) => {
                let name = name.clone();
                self.input(id, &name)
            }
            Expr::Call(call) => self.call(id, call),
            Expr::List(list) => {
                list.elements.iter_mut().for_each(|element| {
                    self.walk(element);
                });
                Some(PartType::List)
            }
            Expr::Select(_) => {
                self.problem(id, "an input has no members", "name the field in the input's `field`");
                None
            }
            _ => {
                self.problem(id, "this is not supported", "an input is a number, a truth value or a text");
                None
            }
        }
    }

    fn literal(&mut self, id: u64, literal: &mut LiteralValue) -> Option<PartType> {
        let number = match literal {
            LiteralValue::Boolean(_) => return Some(PartType::Truth),
            LiteralValue::String(_) => return Some(PartType::Text),
            LiteralValue::Double(_) => return Some(PartType::Number),
            LiteralValue::Int(value) => *value.inner() as f64,
            LiteralValue::UInt(value) => *value.inner() as f64,
            LiteralValue::Null | LiteralValue::Bytes(_) => {
                self.problem(id, "no input is like this", "compare with a number, a truth value or a text");
                return None;
            }
        };
        *literal = LiteralValue::Double(CelDouble::from(number));
        Some(PartType::Number)
    }

    fn input(&mut self, id: u64, name: &str) -> Option<PartType> {
        if let Some(index) = self.names.iter().position(|known| *known == name) {
            return self.known[index];
        }
        if self.names.iter().any(|known| each::is_column_of(known, name)) {
            let help = format!("ask for its elements: `{name}.exists(it, it.status == 6)`");
            self.problem(id, &format!("`{name}` is a list here"), &help);
            return None;
        }
        let known = self.written_names().into_iter();
        let help = suggest(name, known).map_or_else(|| self.inputs(), did_you_mean);
        self.problem(id, &format!("there is no input `{name}`"), &help);
        None
    }

    fn inputs(&self) -> String {
        match &self.written_names()[..] {
            [] => "name what the condition uses under `inputs`".to_owned(),
            names => format!("the inputs are: {}", names.join(", ")),
        }
    }

    /// The inputs as the file names them.
    fn written_names(&self) -> Vec<&'a str> {
        let mut names: Vec<&str> =
            self.names.iter().map(|name| name.split("[]").next().unwrap_or_default()).collect();
        names.dedup();
        names
    }

    /// `goals.exists(goal, goal.status == 6)`; what stands for its answer takes its place.
    fn quantifier(&mut self, part: &mut IdedExpr) -> Option<PartType> {
        const WRITE: &str = "write `goals.exists(goal, goal.status == 6)`, or `all` for every element";
        let id = part.id;
        let Expr::Call(call) = &mut part.expr else { return None };
        let (is_all, scope) = (each::asks_for_all(call) == Some(true), each::scope(call));
        let Some((variable, list)) = scope.map(|(variable, list)| (variable.to_owned(), list.to_owned()))
        else {
            self.problem(id, "`exists` and `all` take an input, a name and a condition", WRITE);
            return None;
        };
        let names = self.names;
        let is_input = |name: &str| names.contains(&name);
        if self.scope.is_some() || self.quantifiers.len() == QUANTIFIERS_MAX {
            let text = format!("a condition asks for at most {QUANTIFIERS_MAX} lists, one after the other");
            self.problem(id, &text, "let a second module judge the other one");
            return None;
        }
        if is_input(&variable) {
            let text = format!("`{variable}` is an input already");
            self.problem(id, &text, "give the element another name");
            return None;
        }
        if !self.names.iter().any(|known| each::is_column_of(known, &list)) {
            match is_input(&list) {
                true => self.problem(
                    id,
                    &format!("nothing is asked of an element of `{list}`, or it is no list"),
                    WRITE,
                ),
                false => {
                    self.input(id, &list);
                }
            }
            return None;
        }
        let mut body = call.args.pop()?;
        self.scope = Some((variable, list.clone()));
        let kind = self.walk(&mut body);
        self.take(&body, PartType::Truth);
        self.scope = None;
        if self.good && !matches!(kind, None | Some(PartType::Truth)) {
            self.problem(
                body.id,
                "the condition on an element must be true or false",
                "compare it: `... > 0`",
            );
        }
        part.expr = Expr::Ident(each::placeholder(self.quantifiers.len()));
        self.quantifiers.push(Quantifier { is_all, list, body });
        Some(PartType::Truth)
    }

    fn call(&mut self, id: u64, call: &mut CallExpr) -> Option<PartType> {
        let name = self.called(call);
        if !OPERATORS.contains(&&*name) && !FUNCTIONS.contains(&&*name) {
            let help = match &*name {
                operators::MODULO => "numbers are not whole here; compare with a limit".into(),
                "not" | "and" | "or" => "write `&&` for and, `||` for or, `!` for not".into(),
                operators::INDEX => "an input is one value: choose the element in the input's `field`".into(),
                _ => suggest(&name, FUNCTIONS)
                    .map_or_else(|| format!("the functions are: {}", FUNCTIONS.join(", ")), did_you_mean),
            };
            let what = name.trim_matches(|c| "_@".contains(c));
            self.problem(id, &format!("there is no function `{what}`"), &help);
            return None;
        }
        let target = call.target.as_deref_mut().filter(|_| !name.starts_with("math."));
        let mut parts: Vec<&mut IdedExpr> = target.into_iter().chain(&mut call.args).collect();
        let kinds: Vec<Option<PartType>> = parts.iter_mut().map(|part| self.walk(part)).collect();
        let (taken, given) = signature(&name, &kinds);
        for ((part, kind), taken) in parts.iter().zip(&kinds).zip(taken) {
            match (taken, kind) {
                (Some(taken), Some(kind)) if taken != *kind => {
                    let text = format!("this is {}, not {}", kind.as_str(), taken.as_str());
                    self.problem(part.id, &text, "correct one of the parts");
                }
                (Some(taken), None) => self.take(part, taken),
                _ => {}
            }
        }
        if let [part, list] = &parts[..] {
            element_kinds(list).for_each(|kind| self.take(part, kind));
        }
        let computed = parts.iter().any(|part| is_computed(part));
        let is_number = |part: &&mut IdedExpr| element_kinds(part).any(|kind| kind == PartType::Number);
        if computed && (kinds.contains(&Some(PartType::Number)) || parts.iter().any(is_number)) {
            match &*name {
                operators::EQUALS | operators::NOT_EQUALS => compare_by_difference(call),
                operators::IN => compare_with_each(call),
                _ => {}
            }
        }
        given
    }

    /// The function's name: `math.abs` is written as if `math` had a member.
    fn called(&self, call: &CallExpr) -> String {
        match call.target.as_deref() {
            Some(IdedExpr { expr: Expr::Ident(space), .. }) if !self.names.contains(&&**space) => {
                format!("{space}.{}", call.func_name)
            }
            // The parser gives them this name after it has checked their arguments.
            _ => match &*call.func_name {
                "math.@max" => "math.greatest".into(),
                "math.@min" => "math.least".into(),
                name => name.to_owned(),
            },
        }
    }

    pub(super) fn problem(&mut self, id: u64, text: &str, help: &str) {
        self.good = false;
        let (start, stop) = self.info.offset_for(id).unwrap_or((0, 0));
        let length = (stop.saturating_sub(start) + 1) as usize;
        let span = point(self.text.span, &self.text.value, start as usize, length);
        self.log.push(Problem::at(span, text).help(help));
    }
}

/// The types of a list's elements, once its numbers are doubles, as far as they are known.
fn element_kinds(list: &IdedExpr) -> impl Iterator<Item = PartType> {
    let elements = if let Expr::List(list) = &list.expr { &list.elements[..] } else { &[] };
    elements.iter().filter_map(|element| match &element.expr {
        Expr::Literal(LiteralValue::Boolean(_)) => Some(PartType::Truth),
        Expr::Literal(LiteralValue::String(_)) => Some(PartType::Text),
        Expr::Literal(LiteralValue::Double(_)) => Some(PartType::Number),
        Expr::Call(call) => signature(&call.func_name, &[]).1,
        _ => None,
    })
}

/// Turns `a == b` into `math.abs(a - b) <= 0`, and `!=` into `> 0`: NaN, as from 0 / 0, then has no answer,
/// instead of being different from everything.
fn compare_by_difference(call: &mut CallExpr) {
    let part = |id, expr| IdedExpr { id, expr };
    let of = |target: Option<IdedExpr>, name: &str, args| {
        Expr::Call(CallExpr { target: target.map(Box::new), func_name: name.to_owned(), args })
    };
    let args = std::mem::take(&mut call.args);
    let id = args.first().map_or(0, |first| first.id);
    let difference = part(id, of(None, operators::SUBSTRACT, args));
    let distance = part(id, of(Some(part(id, Expr::Ident("math".into()))), "abs", vec![difference]));
    let zero = part(id, Expr::Literal(LiteralValue::Double(CelDouble::from(0.0))));
    let is_equal = call.func_name == operators::EQUALS;
    call.func_name = if is_equal { operators::LESS_EQUALS } else { operators::GREATER }.to_owned();
    call.args = vec![distance, zero];
}

/// Turns `a in [b, c]` into `a == b || a == c`, compared by their differences.
fn compare_with_each(call: &mut CallExpr) {
    let [of, IdedExpr { expr: Expr::List(list), id }] = &call.args[..] else { return };
    let id = *id;
    let equals = |element: &IdedExpr| {
        let (func_name, args) = (operators::EQUALS.to_owned(), vec![of.clone(), element.clone()]);
        let mut equal = CallExpr { target: None, func_name, args };
        compare_by_difference(&mut equal);
        equal
    };
    let either = |a, b| CallExpr {
        target: None,
        func_name: operators::LOGICAL_OR.to_owned(),
        args: [a, b].map(|it| IdedExpr { id, expr: Expr::Call(it) }).into(),
    };
    if let Some(any) = list.elements.iter().map(equals).reduce(either) {
        *call = any;
    }
}

/// Whether the number may be the result of a calculation, which may be NaN.
fn is_computed(part: &IdedExpr) -> bool {
    match &part.expr {
        Expr::Call(_) => true,
        Expr::List(list) => list.elements.iter().any(is_computed),
        _ => false,
    }
}

/// The types of a call's parts, and of its result.
fn signature(name: &str, parts: &[Option<PartType>]) -> (Vec<Option<PartType>>, Option<PartType>) {
    use operators as op;
    let all = |kind: PartType| vec![Some(kind); parts.len()];
    // If one part has a known type, the others have the same.
    let known = parts.iter().find_map(|kind| *kind);
    let alike = || vec![known; parts.len()];
    match name {
        op::LOGICAL_AND | op::LOGICAL_OR | op::LOGICAL_NOT => (all(PartType::Truth), Some(PartType::Truth)),
        op::EQUALS | op::NOT_EQUALS | op::GREATER | op::GREATER_EQUALS | op::LESS | op::LESS_EQUALS => {
            (alike(), Some(PartType::Truth))
        }
        op::IN => (vec![None, Some(PartType::List)], Some(PartType::Truth)),
        op::CONDITIONAL => {
            let of = parts.iter().skip(1).find_map(|kind| *kind);
            (vec![Some(PartType::Truth), of, of], of)
        }
        op::ADD => (alike(), known),
        "contains" | "startsWith" | "endsWith" => (all(PartType::Text), Some(PartType::Truth)),
        "math.isNaN" => (all(PartType::Number), Some(PartType::Truth)),
        "double" | "math.greatest" | "math.least" => (Vec::new(), Some(PartType::Number)),
        _ => (all(PartType::Number), Some(PartType::Number)),
    }
}

/// The byte of a line and a column; the parser counts them from 1 and from 0 or 1.
pub(super) fn offset(text: &str, line: isize, column: isize) -> usize {
    let before: usize = text.split_inclusive('\n').take((line - 1).max(0) as usize).map(str::len).sum();
    (before + (column - 1).max(0) as usize).min(text.len())
}

/// A part of a text in the file; the whole text if quotes or escapes shift it.
pub(super) fn point(span: Span, text: &str, at: usize, length: usize) -> Span {
    let written = (span.end - span.start) as usize;
    let quote = match written.checked_sub(text.len()) {
        Some(0) => 0,
        Some(2) => 1,
        _ => return span,
    };
    let at = text.floor_char_boundary(at.min(text.len().saturating_sub(1)));
    let end = text.ceil_char_boundary((at + length.max(1)).min(text.len()));
    Span { start: span.start + (quote + at) as u32, end: span.start + (quote + end) as u32, ..span }
}
