//! The requests to the vehicle in words: what it is asked for, because of what, and whether it confirms it.

use std::collections::HashSet;

use crate::engine::model::NodeId;
use crate::engine::snapshot::{Countermeasure, CountermeasureState, Moving};

use crate::web::view::View;

/// The requests by which the vehicle slows down or stops, the strongest first.
pub fn moving<'a>(view: &View<'a>) -> impl Iterator<Item = &'a Countermeasure> + use<'a> {
    let strongest = view.snapshot.countermeasure();
    let first = move |it: &&Countermeasure| strongest.is_some_and(|strongest| std::ptr::eq(*it, strongest));
    let all = view.snapshot.countermeasures.iter();
    let (first, rest): (Vec<_>, Vec<_>) = all.filter(|it| it.request.kind().moves()).partition(first);
    first.into_iter().chain(rest)
}

/// Whether the vehicle is asked to slow down or to stop.
pub fn has_banner(view: &View<'_>) -> bool {
    moving(view).next().is_some()
}

/// Whether the operator may end what keeps the vehicle from driving.
pub fn waits_for_release(view: &View<'_>) -> bool {
    view.snapshot.release_refusals.is_empty()
}

/// Whether nobody receives the request.
pub fn is_unheard(view: &View<'_>, it: &Countermeasure) -> bool {
    it.request.kind().output().is_some_and(|output| view.snapshot.unreached(output).is_some())
}

/// Whether the vehicle must be taken over: the request has not reached it, or it does not confirm it.
pub fn fails(it: &Countermeasure) -> bool {
    it.state == CountermeasureState::Unconfirmed
}

/// Whether the vehicle confirms it.
pub fn is_engaged(it: &Countermeasure) -> bool {
    it.state == CountermeasureState::Engaged
}

/// Every request with its causes: `Slowing down, 1 m/s². LiDAR data missing.` Requests of the same causes share
/// the name of the cause. A vehicle that stands neither slows down nor stops: `Held. LiDAR data missing.`
pub fn sentences(view: &View<'_>) -> String {
    let mut found: Vec<(String, String)> = Vec::new();
    for it in moving(view) {
        let stands = view.snapshot.motion.moving == Moving::No;
        let what = match () {
            () if is_unheard(view, it) => view.lang.unheard(it.request).to_owned(),
            () if stands && is_engaged(it) => view.lang.steps().held.to_owned(),
            () => view.lang.countermeasure(it.request, it.state),
        };
        let because = because(view, it);
        match found.iter_mut().find(|(_, of)| *of == because) {
            Some((all, _)) if all.ends_with(&what) => {}
            Some((all, _)) => *all = format!("{all}. {what}"),
            None => found.push((what, because)),
        }
    }
    let sentence = |(what, because): &(String, String)| match because.as_str() {
        "" => format!("{what}."),
        because => format!("{what}. {because}."),
    };
    found.iter().map(sentence).collect::<Vec<_>>().join(" ")
}

/// How far the requests have got, for the action bar.
pub fn progress(view: &View<'_>, it: &Countermeasure) -> &'static str {
    let steps = view.lang.steps();
    let is_received = it.request.kind().output().is_none_or(|output| view.snapshot.is_listened_to(output));
    match it.state {
        CountermeasureState::Unconfirmed if is_unheard(view, it) => steps.unheard,
        CountermeasureState::Unconfirmed => steps.unconfirmed,
        CountermeasureState::Engaged => steps.engaged,
        CountermeasureState::Requested if is_received => steps.asked,
        CountermeasureState::Requested => steps.not_received_yet,
    }
}

/// The causes of a request: the first by its name, the others counted; `Over: LiDAR data missing` if none is left.
pub fn because(view: &View<'_>, it: &Countermeasure) -> String {
    let steps = view.lang.steps();
    let mut statuses: HashSet<&str> = HashSet::new();
    // One status in several components is one cause.
    let mut is_first =
        |node: NodeId| view.snapshot.status_of(node).is_none_or(|status| statuses.insert(status));
    let nodes: Vec<NodeId> =
        it.causes.iter().map(|cause| cause.node).filter(|&node| is_first(node)).collect();
    let over = if it.causes.iter().any(|cause| cause.present) { "" } else { steps.over };
    let named = |causes: String| match over {
        "" => causes,
        over => format!("{over}: {causes}"),
    };
    match (nodes.split_first(), it.by_operator) {
        (Some((&first, [])), _) => named(fault(view, first)),
        (Some((&first, others)), _) => {
            named(format!("{}, {}", fault(view, first), view.lang.and_more(others.len())))
        }
        (None, true) => steps.asked_by_operator.to_owned(),
        (None, false) => String::new(),
    }
}

fn fault(view: &View<'_>, node: NodeId) -> String {
    match node {
        NodeId::Group(id) => view.group_name(id),
        NodeId::Module(id) => view.fault(id, view.snapshot.module(id).1.own),
    }
}
