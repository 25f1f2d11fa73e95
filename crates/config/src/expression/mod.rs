//! Conditions of `expression` monitors: CEL over single values, checked when the file is read.
//!
//! Every number is a double, even one without a point, so `x > 3` and `x * 2` work as expected. CEL's lists,
//! maps and times are refused: an input is a number, a truth value or a text, and the length of a condition's
//! text bounds its cost.

mod check;
mod compare;
mod each;
mod ranges;

use std::collections::BTreeSet;
use std::sync::{Arc, LazyLock};

use cel::common::ast::{Expr, IdedExpr};
use cel::common::types::{CelBool, CelDouble, CelString};
use cel::common::value::CowVal;
use cel::context::VariableResolver;
use cel::{Context, Env, Value, extensions};

use crate::decode::Spanned;
use check::{Check, PartType, offset, point};
use compare::ComparedWith;
use each::Quantifier;
use telltale_engine::model::monitors::{Condition, ScalarKind};
use telltale_engine::model::sample::{Elements, FieldValue};
use telltale_yaml::{Log, Problem, Span};

pub(super) const TEXT_BYTES_MAX: usize = 1000;

/// Reserved words of CEL, which cannot name an input.
const RESERVED: [&str; 6] = ["true", "false", "null", "in", "math", "double"];

/// The standard library without its macros.
static ENVIRONMENT: LazyLock<Arc<Env>> = LazyLock::new(|| {
    let mut env = Env::default().with_optional_support(false).with_stdlib();
    // It fails only if the name is taken, and this one is not.
    let _ = env.add_extension(extensions::math);
    Arc::new(env)
});

/// Checks that a condition can use this name of an input.
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
            if let Some((at, word)) = word_of_another_language(value) {
                let problem =
                    Problem::at(point(*span, value, at, word.len()), format!("CEL has no `{word}`"));
                log.push(problem.help("write `&&` for and, `||` for or, `!` for not"));
                return None;
            }
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
    let mut check = Check::new(text, names, &known, program.source_info(), log);
    check.condition(&mut expression);
    if check.good
        && let Some(wrong) = ranges::contradiction(program.expression())
    {
        check.problem(wrong.id, &wrong.text, "correct one of the two, or remove it");
    }
    let Check { taken, good, quantifiers, .. } = check;
    let taking: Vec<Option<ScalarKind>> = taken.iter().map(|kind| kind.and_then(PartType::scalar)).collect();
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    good.then(|| {
        let holds = move |values: &[FieldValue]| {
            fit(&names, &taken, values)?;
            holds(&expression, &quantifiers, &names, values)
        };
        Condition::new(value, holds).taking(taking)
    })
}

/// The error if two conditions assume different types for an input.
pub(super) fn conflict(names: &[&str], a: &Condition, b: &Condition) -> Option<String> {
    let mut taken = (0..names.len()).filter_map(|input| Some((input, a.takes(input)?, b.takes(input)?)));
    let (input, a, b) = taken.find(|(_, a, b)| a != b)?;
    let (a, b) = (PartType::of(a).as_str(), PartType::of(b).as_str());
    Some(format!("`{}` is taken for {a} in `warning` and for {b} in `error`", names[input]))
}

/// # Errors
///
/// An input does not have the type that the condition assumes: no comparison with it can be true.
fn fit(names: &[String], taken: &[Option<PartType>], values: &[FieldValue]) -> Result<(), Box<str>> {
    let is = |value: &FieldValue| match value {
        FieldValue::Number(_) => Some(PartType::Number),
        FieldValue::Bool(_) => Some(PartType::Truth),
        FieldValue::Text(_) => Some(PartType::Text),
        // All elements are of one kind.
        FieldValue::Elements(list) => match list.taken.first() {
            Some(FieldValue::Number(_)) => Some(PartType::Number),
            Some(FieldValue::Bool(_)) => Some(PartType::Truth),
            Some(FieldValue::Text(_)) => Some(PartType::Text),
            _ => None,
        },
        FieldValue::Pose(_)
        | FieldValue::Positions(_)
        | FieldValue::Transforms(_)
        | FieldValue::Content(_)
        | FieldValue::Absent
        | FieldValue::Unreadable(_) => None,
    };
    for ((name, taken), value) in names.iter().zip(taken).zip(values) {
        if let (Some(taken), Some(is)) = (taken, is(value))
            && *taken != is
        {
            return Err(format!("`{name}` is {}, not {}", is.as_str(), taken.as_str()).into());
        }
    }
    Ok(())
}

/// The reason why a condition can have no answer for inputs of these types, and a help; an input without a
/// known type can have any.
pub fn misfit(condition: &Condition, inputs: &[(&str, Option<ScalarKind>)]) -> Option<(String, String)> {
    let program = ENVIRONMENT.compile(&condition.text).ok()?;
    let text = Spanned { value: condition.text.to_string(), span: Span { file: 0, start: 0, end: 0 } };
    let names: Vec<&str> = inputs.iter().map(|(name, _)| *name).collect();
    let known: Vec<Option<PartType>> = inputs.iter().map(|(_, kind)| kind.map(PartType::of)).collect();
    let mut log = Log::default();
    let info = program.source_info();
    Check::new(&text, &names, &known, info, &mut log).condition(&mut program.expression().clone());
    let problem = log.into_problems().into_iter().next();
    problem.map(|problem| (problem.message, problem.help.unwrap_or_default().into())).or_else(|| {
        let kinds: Option<Vec<ScalarKind>> = inputs.iter().map(|(_, kind)| *kind).collect();
        unanswered(condition, &names, &kinds?).map(|why| (why.into(), "correct one of the parts".to_owned()))
    })
}

/// The reason why no values of these types have an answer, if there is one.
fn unanswered(condition: &Condition, names: &[&str], kinds: &[ScalarKind]) -> Option<Box<str>> {
    let probe = |round: usize| -> Vec<FieldValue> {
        let value = |(position, kind): (usize, &ScalarKind)| match kind {
            ScalarKind::Number => FieldValue::Number([1.0, 0.0, -1.0, 1e6][(round + position) % 4]),
            ScalarKind::Bool => FieldValue::Bool((round >> (position % 2)).is_multiple_of(2)),
            // A value that `double` accepts, too.
            ScalarKind::Text => FieldValue::Text(["1", "", "a", "2.5"][(round + position) % 4].into()),
        };
        let value = |(position, kind)| {
            let value = value((position, kind));
            let list = |value| FieldValue::Elements(Arc::new(Elements { taken: [value].into(), count: 1 }));
            if each::is_column(names[position]) { list(value) } else { value }
        };
        kinds.iter().enumerate().map(value).collect()
    };
    let mut why = None;
    for round in 0..8 {
        why = Some(condition.holds(&probe(round)).err()?);
    }
    why
}

/// Whether a WARNING never appears, because the ERROR holds whenever the WARNING does.
pub(super) fn is_covered(warning: &Condition, error: &Condition) -> bool {
    let parts = [warning, error].map(|condition| ENVIRONMENT.compile(&condition.text).ok());
    matches!(parts, [Some(warning), Some(error)] if ranges::covers(error.expression(), warning.expression()))
}

/// An input compared with a number: `percentage < 20`.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    pub input: String,
    pub sign: &'static str,
    pub number: f64,
}

/// Every comparison of an input with a number.
pub fn limits(condition: &Condition) -> Vec<Limit> {
    let limit = |it: compare::Comparison| match it.with {
        ComparedWith::Number(number) if it.is_input => Some(Limit { input: it.of, sign: it.sign, number }),
        _ => None,
    };
    comparisons(&condition.text).into_iter().filter_map(limit).collect()
}

/// The inputs that a condition compares with a text, each with the text: `status == "CHARGING"`, or in a list of them.
pub fn texts(condition: &str) -> Vec<(String, String)> {
    let text = |it: compare::Comparison| match it.with {
        ComparedWith::Text(text) if it.is_input => Some((it.of, text)),
        _ => None,
    };
    let mut found: Vec<_> = comparisons(condition).into_iter().filter_map(text).collect();
    if let Ok(program) = ENVIRONMENT.compile(condition) {
        compare::listed_texts(program.expression(), &mut found);
    }
    found
}

fn comparisons(condition: &str) -> Vec<compare::Comparison> {
    let mut found = Vec::new();
    if let Ok(program) = ENVIRONMENT.compile(condition) {
        compare::all(program.expression(), &mut found);
    }
    found
}

/// The inputs of a condition.
pub(super) fn named(condition: &Condition) -> Vec<String> {
    let mut names = Vec::new();
    if let Ok(program) = ENVIRONMENT.compile(&condition.text) {
        let mut members = Vec::new();
        each::members(program.expression(), None, &mut members);
        names.extend(members.iter().map(|(list, member)| each::column(list, member)));
        collect(program.expression(), None, &mut names);
    }
    names
}

/// The inputs apart from the elements of lists, which `variable` stands for.
fn collect(part: &IdedExpr, variable: Option<&str>, names: &mut Vec<String>) {
    match &part.expr {
        Expr::Ident(name) if !RESERVED.contains(&&**name) && variable != Some(name) => {
            names.push(name.clone());
        }
        Expr::Call(call) => match each::asks_for_all(call).and_then(|_| each::scope(call)) {
            Some((variable, _)) => {
                call.args.iter().skip(1).for_each(|part| collect(part, Some(variable), names));
            }
            None => {
                let target = call.target.as_deref().into_iter();
                target.chain(&call.args).for_each(|part| collect(part, variable, names));
            }
        },
        Expr::List(list) => list.elements.iter().for_each(|part| collect(part, variable, names)),
        _ => {}
    }
}

/// The lists of conditions, each with the members of its elements that are used, in order.
pub(super) fn members(texts: &[&Spanned<String>]) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    for text in texts.iter().filter(|text| text.value.len() <= TEXT_BYTES_MAX) {
        if let Ok(program) = ENVIRONMENT.compile(&text.value) {
            each::members(program.expression(), None, &mut found);
        }
    }
    let mut seen = BTreeSet::new();
    found.retain(|it| seen.insert(it.clone()));
    found
}

/// The name of the input with this member of each element of a list.
pub(super) fn column(list: &str, member: &str) -> String {
    each::column(list, member)
}

/// An `and`, `or` or `not` outside of quotes, and its place.
fn word_of_another_language(text: &str) -> Option<(usize, &'static str)> {
    let mut quote = None;
    let mut words = text.char_indices().filter(move |&(_, letter)| {
        match quote {
            Some(open) if letter == open => quote = None,
            Some(_) => {}
            None if matches!(letter, '\'' | '"') => quote = Some(letter),
            None => return true,
        }
        false
    });
    let is_part = |letter: char| letter.is_alphanumeric() || letter == '_';
    let begins = |at: usize| !text[..at].ends_with(is_part);
    words.find_map(|(at, _)| {
        let word = ["and", "or", "not"].into_iter().find(|word| {
            text[at..].get(..word.len()).is_some_and(|found| found.eq_ignore_ascii_case(word))
                && !text[at + word.len()..].starts_with(is_part)
        });
        word.filter(|_| begins(at)).map(|word| (at, word))
    })
}

/// The parser's message without the list of expected tokens.
fn syntax(message: &str) -> String {
    let message = message.trim_start_matches("Syntax error: ");
    let short = message.split(" expecting ").next().unwrap_or(message);
    let short = short.replace("'<EOF>'", "the end").replace('\n', " ");
    format!("this is no CEL: {short}")
}

fn holds(
    expression: &IdedExpr,
    quantifiers: &[Quantifier],
    names: &[String],
    values: &[FieldValue],
) -> Result<bool, Box<str>> {
    let answers = quantifiers.iter().map(|it| it.answer(names, values)).collect::<Result<Vec<bool>, _>>()?;
    evaluate(expression, &Inputs { names, values, answers: &answers, row: None })
}

fn evaluate(expression: &IdedExpr, inputs: &Inputs<'_>) -> Result<bool, Box<str>> {
    let mut context = Context::with_env(ENVIRONMENT.clone());
    context.set_variable_resolver(inputs);
    match Value::resolve(expression, &context) {
        Ok(Value::Bool(value)) => Ok(value),
        Ok(other) => Err(format!("the condition is neither true nor false: {other:?}").into()),
        Err(error) => Err(error.to_string().into()),
    }
}

struct Inputs<'a> {
    names: &'a [String],
    values: &'a [FieldValue],
    /// Of the quantifiers.
    answers: &'a [bool],
    /// The element that is looked at.
    row: Option<usize>,
}

impl VariableResolver for Inputs<'_> {
    fn resolve<'b>(&'b self, variable: &str) -> Option<CowVal<'b, 'b>> {
        if let Some(answer) = each::index_of(variable) {
            return Some(CowVal::Owned(Box::new(CelBool::from(*self.answers.get(answer)?))));
        }
        let index = self.names.iter().position(|name| name == variable)?;
        let value = match self.values.get(index)? {
            FieldValue::Elements(list) => list.taken.get(self.row?)?,
            value => value,
        };
        match value {
            FieldValue::Number(value) => Some(CowVal::Owned(Box::new(CelDouble::from(*value)))),
            FieldValue::Bool(value) => Some(CowVal::Owned(Box::new(CelBool::from(*value)))),
            FieldValue::Text(text) => Some(CowVal::Owned(Box::new(CelString::from(&**text)))),
            FieldValue::Pose(_)
            | FieldValue::Positions(_)
            | FieldValue::Transforms(_)
            | FieldValue::Elements(_)
            | FieldValue::Content(_)
            | FieldValue::Absent
            | FieldValue::Unreadable(_) => None,
        }
    }
}
