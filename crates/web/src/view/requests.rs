//! The requests to the vehicle in words: what it is asked for, because of what, and whether it confirms it.

use std::collections::HashSet;

use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{Countermeasure, CountermeasureState, Moving};
use telltale_engine::state::State;

use crate::view::View;

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

/// Whether the vehicle confirms it, or is known to listen.
fn is_received(view: &View<'_>, it: &Countermeasure) -> bool {
    is_engaged(it) || it.request.kind().output().is_none_or(|output| view.snapshot.is_listened_to(output))
}

/// Whether the vehicle must be taken over: the request has not reached it, or it does not confirm it.
pub fn fails(it: &Countermeasure) -> bool {
    it.state == CountermeasureState::Unconfirmed
}

/// Whether the vehicle confirms it.
pub fn is_engaged(it: &Countermeasure) -> bool {
    it.state == CountermeasureState::Engaged
}

/// The words for a request, with its cause.
pub struct Sentence {
    pub what: String,
    /// Since when, with the word before the time.
    pub since: Option<(&'static str, String)>,
    pub because: String,
}

/// The operator's own stop first, then every request with its causes: `Slowing down. LiDAR data missing.`
/// Requests of the same causes share the name of the cause. A vehicle that stands neither slows down nor stops: it is
/// held, and since when.
pub fn sentences(view: &View<'_>) -> Vec<Sentence> {
    let stop = view.snapshot.stop_requested_since().map(|since| Sentence {
        what: view.words.stop_asked.to_owned(),
        since: Some(("", view.wall_since(since))),
        because: String::new(),
    });
    let mut found: Vec<Sentence> = Vec::new();
    for it in moving(view) {
        let stands = view.snapshot.motion.moving == Moving::No;
        let what = match () {
            () if is_unheard(view, it) => view.lang.unheard_request(it.request.kind()).to_owned(),
            () if stands && !fails(it) && is_received(view, it) => view.words.held.to_owned(),
            () => {
                let done = it.state == CountermeasureState::Engaged;
                view.lang.countermeasure(it.request.kind(), done, !it.causes.is_empty()).to_owned()
            }
        };
        let since = (stands || is_resumed(it)).then(|| (view.words.since, view.wall_since(it.since)));
        // The stop itself says since when.
        let since = since.filter(|_| it.by_operator.is_none());
        let because = because(view, it);
        match found.iter_mut().find(|other| other.because == because) {
            Some(other) if other.what.ends_with(&what) => {}
            Some(other) => {
                other.what = format!("{}. {what}", other.what);
                other.since = since.or_else(|| other.since.take());
            }
            None => found.push(Sentence { what, since, because }),
        }
    }
    stop.into_iter().chain(found).collect()
}

/// Whether it is from before a restart.
fn is_resumed(it: &Countermeasure) -> bool {
    !it.since.before.is_zero()
}

/// How far the requests have got, for the action bar.
pub fn progress(view: &View<'_>, it: &Countermeasure) -> &'static str {
    match it.state {
        CountermeasureState::Unconfirmed if is_unheard(view, it) => view.words.unheard,
        CountermeasureState::Unconfirmed => view.words.unconfirmed,
        CountermeasureState::Engaged => view.words.engaged,
        CountermeasureState::Requested if is_received(view, it) => view.words.asked,
        CountermeasureState::Requested => view.words.not_received_yet,
    }
}

/// The causes of a request: the first by its name, the others counted; `Over: LiDAR data missing` if none is left.
fn because(view: &View<'_>, it: &Countermeasure) -> String {
    let mut statuses: HashSet<&str> = HashSet::new();
    // One status in several components is one cause.
    let mut is_first =
        |node: NodeId| view.snapshot.status_of(node).is_none_or(|status| statuses.insert(status));
    let nodes: Vec<NodeId> =
        it.causes.iter().map(|cause| cause.node).filter(|&node| is_first(node)).collect();
    let Some((&first, others)) = nodes.split_first() else { return String::new() };
    let causes = match (fault(view, it, first), others) {
        (first, []) => first,
        (first, others) => format!("{first}, {}", view.lang.and_more(others.len())),
    };
    if it.causes.iter().any(|cause| cause.present) {
        causes
    } else {
        format!("{}: {causes}", view.words.over)
    }
}

/// The fault that a cause has, or had when the request was made before a restart: nothing is heard of it yet then.
fn fault(view: &View<'_>, it: &Countermeasure, node: NodeId) -> String {
    let id = match node {
        NodeId::Group(id) => return view.group_name(id),
        NodeId::Module(id) => id,
    };
    let (_, module) = view.snapshot.module(id);
    if is_resumed(it) && module.received.is_none() && !module.silent && module.own == State::Unknown {
        return format!("{}, {}", view.fault(id, State::Error), view.words.not_heard_again);
    }
    view.fault(id, module.own)
}
