//! Conditions over the elements of a list: `goals.exists(goal, goal.status == 6)`, `goals.all(...)`.
//!
//! Each member that such a condition uses is an input of its own, with one value of each element: a column. Its name
//! has brackets, so no condition can write it.

use cel::common::ast::{CallExpr, Expr, IdedExpr};

use super::{Inputs, evaluate};
use telltale_engine::model::sample::{Elements, FieldValue};

/// Such parts of one condition; each costs as much as there are elements.
pub(super) const QUANTIFIERS_MAX: usize = 4;

/// A part of a condition about each element of a list. In the condition, its answer stands in its place.
#[derive(Debug, Clone)]
pub(super) struct Quantifier {
    pub is_all: bool,
    pub list: String,
    /// The condition of one element, over columns and other inputs.
    pub body: IdedExpr,
}

/// The name of a column: `goals[].status`; `goals[]` has the elements themselves.
pub(super) fn column(list: &str, member: &str) -> String {
    let dot = if member.is_empty() { "" } else { "." };
    format!("{list}[]{dot}{member}")
}

pub(super) fn is_column(name: &str) -> bool {
    name.contains("[]")
}

pub(super) fn is_column_of(name: &str, list: &str) -> bool {
    name.strip_prefix(list).is_some_and(|rest| rest.starts_with("[]"))
}

/// The name that stands for the answer of a quantifier.
pub(super) fn placeholder(index: usize) -> String {
    format!("@{index}")
}

pub(super) fn index_of(placeholder: &str) -> Option<usize> {
    placeholder.strip_prefix('@')?.parse().ok()
}

/// Whether a call asks for the elements of a list, and if so for all of them.
pub(super) fn asks_for_all(call: &CallExpr) -> Option<bool> {
    match &*call.func_name {
        _ if call.target.is_none() => None,
        "exists" => Some(false),
        "all" => Some(true),
        _ => None,
    }
}

/// The variable of the elements, and the list.
pub(super) fn scope(call: &CallExpr) -> Option<(&str, &str)> {
    let (Some(IdedExpr { expr: Expr::Ident(list), .. }), [IdedExpr { expr: Expr::Ident(variable), .. }, _]) =
        (call.target.as_deref(), &call.args[..])
    else {
        return None;
    };
    Some((variable, list))
}

/// The member of an element that a part names: `status` of `goal.status`, empty for `goal` itself.
pub(super) fn member(part: &IdedExpr, variable: &str) -> Option<String> {
    match &part.expr {
        Expr::Ident(name) if *name == variable => Some(String::new()),
        Expr::Select(select) if !select.test => {
            let outer = member(&select.operand, variable)?;
            Some(if outer.is_empty() { select.field.clone() } else { format!("{outer}.{}", select.field) })
        }
        _ => None,
    }
}

/// The lists of a condition, each with a member that is used.
pub(super) fn members(part: &IdedExpr, around: Option<(&str, &str)>, found: &mut Vec<(String, String)>) {
    if let Some((variable, list)) = around
        && let Some(member) = member(part, variable)
    {
        found.push((list.to_owned(), member));
        return;
    }
    match &part.expr {
        Expr::Call(call) => {
            let inner = asks_for_all(call).and_then(|_| scope(call));
            let skipped = if inner.is_some() { 1 } else { 0 };
            let target = call.target.as_deref().filter(|_| inner.is_none());
            let parts = target.into_iter().chain(call.args.iter().skip(skipped));
            parts.for_each(|part| members(part, inner.or(around), found));
        }
        Expr::List(list) => list.elements.iter().for_each(|part| members(part, around, found)),
        _ => {}
    }
}

impl Quantifier {
    /// # Errors
    ///
    /// No element settles it, and one has no answer, or not all elements are known.
    pub fn answer(&self, names: &[String], values: &[FieldValue]) -> Result<bool, Box<str>> {
        let columns = names.iter().zip(values).filter(|(name, _)| is_column_of(name, &self.list));
        let lists: Vec<&Elements> = columns
            .filter_map(
                |(_, value)| if let FieldValue::Elements(list) = value { Some(&**list) } else { None },
            )
            .collect();
        let Some(shortest) = lists.iter().min_by_key(|list| list.taken.len()) else {
            return Err(format!("`{}` is no list", self.list).into());
        };
        let mut why = None;
        for row in 0..shortest.taken.len() {
            match evaluate(&self.body, &Inputs { names, values, answers: &[], row: Some(row) }) {
                Ok(holds) if holds != self.is_all => return Ok(holds),
                Ok(_) => {}
                Err(error) => why = why.or(Some(error)),
            }
        }
        match why {
            Some(why) => Err(why),
            None if shortest.is_cut() => {
                let (looked, count) = (shortest.taken.len(), shortest.count);
                Err(format!("only {looked} of {count} elements are known").into())
            }
            None => Ok(self.is_all),
        }
    }
}
