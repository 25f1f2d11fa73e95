//! Conditions of `expression` monitors: CEL over single values, checked when the file is read.
//!
//! Every number is a double, also one that is written without a point, so `x > 3` and `x * 2` mean
//! what they say. What CEL has for lists, maps and times is refused: an input is a number, a truth
//! value or a text, and what a condition costs is bounded by the length of its text.

use std::sync::{Arc, LazyLock};

use cel::common::ast::{CallExpr, Expr, IdedExpr, LiteralValue, SourceInfo, operators};
use cel::common::types::{CelBool, CelDouble, CelString};
use cel::common::value::CowVal;
use cel::context::VariableResolver;
use cel::{Context, Env, Value, extensions};

use crate::engine::monitor::spec::{Condition, ScalarKind};
use crate::engine::sample::FieldValue;
use crate::yaml::decode::did_you_mean;
use crate::yaml::{Log, Problem, Span, Spanned, suggest};

const TEXT_BYTES_MAX: usize = 1000;

/// What a condition may use.
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
/// Words of the language that cannot name an input.
const RESERVED: [&str; 6] = ["true", "false", "null", "in", "math", "double"];

/// The standard library without its macros.
static ENVIRONMENT: LazyLock<Arc<Env>> = LazyLock::new(|| {
    let mut env = Env::default().with_optional_support(false).with_stdlib();
    // It fails only where a name is taken, and this one is not.
    let _ = env.add_extension(extensions::math);
    Arc::new(env)
});

/// Whether conditions can name an input so.
pub(super) fn check_name(name: &Spanned<String>, log: &mut Log) {
    let word = name.value.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        && !name.value.starts_with(|c: char| c.is_ascii_digit());
    if !word || RESERVED.contains(&name.value.as_str()) {
        let problem = Problem::at(name.span, format!("`{}` cannot be the name of an input", name.value));
        log.push(problem.help("use letters, digits and `_`, for example `speed`"));
    }
}

/// A condition over inputs of these names.
pub(super) fn condition(text: &Spanned<String>, names: &[&str], log: &mut Log) -> Option<Condition> {
    let Spanned { value, span } = text;
    if value.len() > TEXT_BYTES_MAX {
        let problem = Problem::at(*span, format!("a condition of more than {TEXT_BYTES_MAX} bytes"));
        log.push(problem.help("let a node of your own diagnose this, and read its status"));
        return None;
    }
    let program = match ENVIRONMENT.compile(value) {
        Ok(program) => program,
        Err(errors) => {
            for error in &errors.errors {
                let (line, column) = error.pos;
                let at = offset(value, line, column);
                let problem = Problem::at(point(*span, value, at, 1), syntax(&error.msg));
                log.push(problem.help("for example `speed > 3 && !stopped`"));
            }
            return None;
        }
    };
    let mut expression = program.expression().clone();
    let known = vec![None; names.len()];
    let mut check = Check { text, names, known: &known, info: program.source_info(), log, good: true };
    let kind = check.walk(&mut expression);
    if check.good && !matches!(kind, None | Some(Kind::Truth)) {
        check.problem(expression.id, "a condition must be true or false", "compare it: `... > 0`");
    }
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    check.good.then(|| Condition::new(value, move |values| holds(&expression, &names, values)))
}

/// Why a condition that was read can have no answer for inputs of these kinds, and what to do; an
/// input of no known kind can be anything.
pub fn misfit(condition: &Condition, inputs: &[(&str, Option<ScalarKind>)]) -> Option<(String, String)> {
    let program = ENVIRONMENT.compile(&condition.text).ok()?;
    let text = Spanned { value: condition.text.to_string(), span: Span { file: 0, start: 0, end: 0 } };
    let names: Vec<&str> = inputs.iter().map(|(name, _)| *name).collect();
    let known: Vec<Option<Kind>> = inputs.iter().map(|(_, kind)| kind.map(Kind::of)).collect();
    let mut log = Log::default();
    let info = program.source_info();
    let mut check = Check { text: &text, names: &names, known: &known, info, log: &mut log, good: true };
    let mut expression = program.expression().clone();
    let kind = check.walk(&mut expression);
    if check.good && !matches!(kind, None | Some(Kind::Truth)) {
        check.problem(expression.id, "a condition must be true or false", "compare it: `... > 0`");
    }
    let problem = log.into_problems().into_iter().next();
    problem.map(|problem| (problem.message, problem.help.unwrap_or_default())).or_else(|| {
        let kinds: Option<Vec<ScalarKind>> = inputs.iter().map(|(_, kind)| *kind).collect();
        unanswered(condition, &kinds?).map(|why| (why.into(), "correct one of the parts".to_owned()))
    })
}

/// Why no values of these kinds have an answer, if so.
fn unanswered(condition: &Condition, kinds: &[ScalarKind]) -> Option<Box<str>> {
    let probe = |round: usize| -> Vec<FieldValue> {
        let value = |(position, kind): (usize, &ScalarKind)| match kind {
            ScalarKind::Number => FieldValue::Number([1.0, 0.0, -1.0, 1e6][(round + position) % 4]),
            ScalarKind::Bool => FieldValue::Bool((round >> (position % 2)).is_multiple_of(2)),
            // One that `double` takes, too.
            ScalarKind::Text => FieldValue::Text(["1", "", "a", "2.5"][(round + position) % 4].into()),
        };
        kinds.iter().enumerate().map(value).collect()
    };
    let mut why = None;
    for round in 0..8 {
        why = Some(condition.holds(&probe(round)).err()?);
    }
    why
}

/// The inputs that a condition names.
pub(super) fn named(condition: &Condition) -> Vec<String> {
    let mut names = Vec::new();
    if let Ok(program) = ENVIRONMENT.compile(&condition.text) {
        collect(program.expression(), &mut names);
    }
    names
}

fn collect(part: &IdedExpr, names: &mut Vec<String>) {
    match &part.expr {
        Expr::Ident(name) if !RESERVED.contains(&&**name) => names.push(name.clone()),
        Expr::Call(call) => {
            let target = call.target.as_deref().into_iter();
            target.chain(&call.args).for_each(|part| collect(part, names));
        }
        Expr::List(list) => list.elements.iter().for_each(|part| collect(part, names)),
        _ => {}
    }
}

/// The parser's words without the list of all that could have stood there.
fn syntax(message: &str) -> String {
    let message = message.trim_start_matches("Syntax error: ");
    let short = message.split(" expecting ").next().unwrap_or(message);
    let short = short.replace("'<EOF>'", "the end").replace('\n', " ");
    format!("this is no CEL: {short}")
}

fn holds(expression: &IdedExpr, names: &[String], values: &[FieldValue]) -> Result<bool, Box<str>> {
    let inputs = Inputs { names, values };
    let mut context = Context::with_env(ENVIRONMENT.clone());
    context.set_variable_resolver(&inputs);
    match Value::resolve(expression, &context) {
        Ok(Value::Bool(value)) => Ok(value),
        Ok(other) => Err(format!("the condition is neither true nor false: {other:?}").into()),
        Err(error) => Err(error.to_string().into()),
    }
}

struct Inputs<'a> {
    names: &'a [String],
    values: &'a [FieldValue],
}

impl VariableResolver for Inputs<'_> {
    fn resolve<'b>(&'b self, variable: &str) -> Option<CowVal<'b, 'b>> {
        let index = self.names.iter().position(|name| name == variable)?;
        match self.values.get(index)? {
            FieldValue::Number(value) => Some(CowVal::Owned(Box::new(CelDouble::from(*value)))),
            FieldValue::Bool(value) => Some(CowVal::Owned(Box::new(CelBool::from(*value)))),
            FieldValue::Text(text) => Some(CowVal::Owned(Box::new(CelString::from(&**text)))),
            FieldValue::Pose(_) | FieldValue::Absent | FieldValue::Unreadable(_) => None,
        }
    }
}

/// What a part of a condition is, where that can be told before there are values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Truth,
    Number,
    Text,
    List,
}

impl Kind {
    fn of(kind: ScalarKind) -> Kind {
        match kind {
            ScalarKind::Number => Kind::Number,
            ScalarKind::Bool => Kind::Truth,
            ScalarKind::Text => Kind::Text,
        }
    }

    fn as_str(self) -> &'static str {
        match self {
            Kind::Truth => "a truth value",
            Kind::Number => "a number",
            Kind::Text => "a text",
            Kind::List => "a list",
        }
    }
}

struct Check<'a> {
    text: &'a Spanned<String>,
    names: &'a [&'a str],
    /// What each input is, where that is known.
    known: &'a [Option<Kind>],
    info: &'a SourceInfo,
    log: &'a mut Log,
    good: bool,
}

impl Check<'_> {
    /// Makes doubles of all numbers on its way.
    fn walk(&mut self, part: &mut IdedExpr) -> Option<Kind> {
        let id = part.id;
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
                Some(Kind::List)
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

    fn literal(&mut self, id: u64, literal: &mut LiteralValue) -> Option<Kind> {
        let number = match literal {
            LiteralValue::Boolean(_) => return Some(Kind::Truth),
            LiteralValue::String(_) => return Some(Kind::Text),
            LiteralValue::Double(_) => return Some(Kind::Number),
            LiteralValue::Int(value) => *value.inner() as f64,
            LiteralValue::UInt(value) => *value.inner() as f64,
            LiteralValue::Null | LiteralValue::Bytes(_) => {
                self.problem(id, "no input is like this", "compare with a number, a truth value or a text");
                return None;
            }
        };
        *literal = LiteralValue::Double(CelDouble::from(number));
        Some(Kind::Number)
    }

    fn input(&mut self, id: u64, name: &str) -> Option<Kind> {
        if let Some(index) = self.names.iter().position(|known| *known == name) {
            return self.known[index];
        }
        let known = self.names.iter().copied();
        let help = suggest(name, known)
            .map_or_else(|| format!("the inputs are: {}", self.names.join(", ")), did_you_mean);
        self.problem(id, &format!("there is no input `{name}`"), &help);
        None
    }

    fn call(&mut self, id: u64, call: &mut CallExpr) -> Option<Kind> {
        let name = self.called(call);
        if !OPERATORS.contains(&&*name) && !FUNCTIONS.contains(&&*name) {
            let help = match &*name {
                operators::MODULO => "numbers are not whole here; compare with a limit".into(),
                operators::INDEX => "an input is one value: choose the element in the input's `field`".into(),
                _ => suggest(&name, FUNCTIONS)
                    .map_or_else(|| format!("the functions are: {}", FUNCTIONS.join(", ")), did_you_mean),
            };
            let what = name.trim_matches(|c| "_@".contains(c));
            self.problem(id, &format!("there is no function `{what}`"), &help);
            return None;
        }
        let target = call.target.as_deref_mut().filter(|_| !name.starts_with("math."));
        let parts = target.into_iter().chain(&mut call.args);
        let parts: Vec<(u64, Option<Kind>)> = parts.map(|part| (part.id, self.walk(part))).collect();
        let (taken, given) = signature(&name, &parts);
        for (&(id, kind), taken) in parts.iter().zip(taken) {
            if let (Some(taken), Some(kind)) = (taken, kind)
                && taken != kind
            {
                let text = format!("this is {}, not {}", kind.as_str(), taken.as_str());
                self.problem(id, &text, "correct one of the parts");
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
            // So the parser calls them once it has looked at what they are given.
            _ => match &*call.func_name {
                "math.@max" => "math.greatest".into(),
                "math.@min" => "math.least".into(),
                name => name.to_owned(),
            },
        }
    }

    fn problem(&mut self, id: u64, text: &str, help: &str) {
        self.good = false;
        let (start, stop) = self.info.offset_for(id).unwrap_or((0, 0));
        let length = (stop.saturating_sub(start) + 1) as usize;
        let span = point(self.text.span, &self.text.value, start as usize, length);
        self.log.push(Problem::at(span, text).help(help));
    }
}

/// What each part of a call must be, and what comes of it.
fn signature(name: &str, parts: &[(u64, Option<Kind>)]) -> (Vec<Option<Kind>>, Option<Kind>) {
    use operators as op;
    let all = |kind: Kind| vec![Some(kind); parts.len()];
    // What one part is, the others are too.
    let known = parts.iter().find_map(|(_, kind)| *kind);
    let alike = || vec![known; parts.len()];
    match name {
        op::LOGICAL_AND | op::LOGICAL_OR | op::LOGICAL_NOT => (all(Kind::Truth), Some(Kind::Truth)),
        op::EQUALS | op::NOT_EQUALS | op::GREATER | op::GREATER_EQUALS | op::LESS | op::LESS_EQUALS => {
            (alike(), Some(Kind::Truth))
        }
        op::IN => (vec![None, Some(Kind::List)], Some(Kind::Truth)),
        op::CONDITIONAL => {
            let of = parts.iter().skip(1).find_map(|(_, kind)| *kind);
            (vec![Some(Kind::Truth), of, of], of)
        }
        op::ADD => (alike(), known),
        "contains" | "startsWith" | "endsWith" => (all(Kind::Text), Some(Kind::Truth)),
        "math.isNaN" => (all(Kind::Number), Some(Kind::Truth)),
        "double" | "math.greatest" | "math.least" => (Vec::new(), Some(Kind::Number)),
        _ => (all(Kind::Number), Some(Kind::Number)),
    }
}

/// Byte of a line and a column, counted from 1 and 0 or 1 as the parser likes.
fn offset(text: &str, line: isize, column: isize) -> usize {
    let before: usize = text.split_inclusive('\n').take((line - 1).max(0) as usize).map(str::len).sum();
    (before + (column - 1).max(0) as usize).min(text.len())
}

/// A part of a text in the file. Where quotes or escapes shift it, the whole text.
fn point(span: Span, text: &str, at: usize, length: usize) -> Span {
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
