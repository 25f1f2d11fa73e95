//! Conditions that contradict themselves or each other: `x > 5 && x < 3` never holds, `x < 5 || x > 3`
//! always does, and a WARNING at `x > 9` beside an ERROR at `x > 5` never comes.
//!
//! Only comparisons that stand side by side are examined. Computed operands count as equal if they are
//! written alike.

use cel::common::ast::{Expr, IdedExpr, operators};

use super::compare::{Comparison, joined};

/// A contradiction, and the part of the condition that contains it.
pub(super) struct Contradiction {
    pub id: u64,
    pub text: String,
}

/// The first contradiction in a condition.
pub(super) fn contradiction(part: &IdedExpr) -> Option<Contradiction> {
    let Expr::Call(call) = &part.expr else { return None };
    let is_and = match &*call.func_name {
        operators::LOGICAL_AND => Some(true),
        operators::LOGICAL_OR => Some(false),
        _ => None,
    };
    if let Some(is_and) = is_and {
        let mut comparisons = Vec::new();
        joined(part, &call.func_name, &mut comparisons);
        for (index, second) in comparisons.iter().enumerate() {
            // No value satisfies both operands of `&&`; or no value fails both operands of `||`.
            let excluded = |first: &&Comparison| match is_and {
                true => first.excludes(second),
                false => first.negated().excludes(&second.negated()),
            };
            if let Some(first) = comparisons[..index].iter().find(excluded) {
                let (first, second_words) = (first.words(), second.words());
                let text = match is_and {
                    true => {
                        format!("`{first}` and `{second_words}` exclude each other: together they never hold")
                    }
                    false => {
                        format!("whatever fails `{first}` meets `{second_words}`: together they always hold")
                    }
                };
                return Some(Contradiction { id: second.id, text });
            }
        }
    }
    call.target.as_deref().into_iter().chain(&call.args).find_map(contradiction)
}

/// Whether the second holds whenever the first does, as far as their parts show.
pub(super) fn covers(error: &IdedExpr, warning: &IdedExpr) -> bool {
    let (warning, error) = (alternatives(warning), alternatives(error));
    let implies = |all: &[Comparison], wanted: &Comparison| {
        all.iter().any(|known| known.is(wanted) || known.excludes(&wanted.negated()))
    };
    warning.iter().all(|known| error.iter().any(|wanted| wanted.iter().all(|it| implies(known, it))))
}

/// The operands of the outer `||`, each as the operands of its `&&`.
fn alternatives(part: &IdedExpr) -> Vec<Vec<Comparison>> {
    match &part.expr {
        Expr::Call(call) if call.func_name == operators::LOGICAL_OR => {
            call.args.iter().flat_map(alternatives).collect()
        }
        _ => {
            let mut all = Vec::new();
            joined(part, operators::LOGICAL_AND, &mut all);
            vec![all]
        }
    }
}
