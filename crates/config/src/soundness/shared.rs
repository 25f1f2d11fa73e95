//! Finds statuses that two groups take: a filter of one takes everything that a filter of the other does.

use std::collections::HashSet;

use super::judge::Judge;
use super::{Finding, FindingKind};
use crate::resolve::filters::covers;
use telltale_engine::model::filter::{Filter, Match};
use telltale_engine::model::{GroupId, NodeId};

/// Pairs of filters that are compared.
const PAIRS_MAX: usize = 1_000_000;

pub(super) fn look(judge: &Judge<'_>) -> Vec<Finding> {
    let groups = (0..).map(GroupId).zip(&judge.model.groups);
    let filters: Vec<(GroupId, &Match)> =
        groups.flat_map(|(id, group)| group.filters.iter().map(move |it| (id, it))).collect();
    let pairs = (0..filters.len()).flat_map(|at| (at + 1..filters.len()).map(move |later| (at, later)));
    let (mut found, mut pairs_said) = (Vec::new(), HashSet::new());
    for (at, later) in pairs.take(PAIRS_MAX) {
        let ((first, one), (second, other)) = (filters[at], filters[later]);
        let Some(shared) = shared(one, other).filter(|_| first != second) else { continue };
        let (first, node) = (NodeId::Group(first), NodeId::Group(second));
        // One sentence for each two groups.
        if pairs_said.insert((first, node)) {
            let what = FindingKind::SharedStatuses { first, statuses: named(shared) };
            found.push(Finding { node, what, example: None });
        }
    }
    found
}

/// The one of two filters whose names the other takes too. With exceptions an entry leaves names for others.
fn shared<'m>(one: &'m Match, other: &'m Match) -> Option<&'m Filter> {
    let takes_all = |all: &Match, some: &Match| match &some.filter {
        Filter::Name(name) => all.takes(name) && some.takes(name),
        filter => all.except.is_empty() && covers(&all.filter, filter),
    };
    match (takes_all(one, other), takes_all(other, one)) {
        (true, _) => Some(&other.filter),
        (false, true) => Some(&one.filter),
        (false, false) => None,
    }
}

/// As it may be written.
fn named(filter: &Filter) -> String {
    let (key, text) = match filter {
        Filter::Name(text) => ("name", &**text),
        Filter::Namespace(text) => ("namespace", &**text),
        Filter::Contains(text) => ("contains", &**text),
        Filter::Regex(regex) => {
            let whole = regex.as_str();
            let inner = whole.strip_prefix(r"\A(?:").and_then(|it| it.strip_suffix(r")\z"));
            ("regex", inner.unwrap_or(whole))
        }
    };
    format!("{key}: '{}'", text.replace('\'', "''"))
}
