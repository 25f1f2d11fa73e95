//! The requests to the vehicle in words: what it is asked for, because of what, and whether it confirms it.

use std::collections::HashSet;

use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{Countermeasure, CountermeasureCause, CountermeasureState, Moving, Reason};
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
/// held, since when, and because of what, in one sentence.
pub fn sentences(view: &View<'_>) -> Vec<Sentence> {
    let stop = view.snapshot.stop_requested_since().map(|since| Sentence {
        what: view.words.stop_asked.to_owned(),
        since: Some(("", view.wall_since(since))),
        because: String::new(),
    });
    let stands = view.snapshot.motion.moving == Moving::No;
    let holds = |it: &&Countermeasure| stands && !is_unheard(view, it) && !fails(it) && is_received(view, it);
    let (holding, others): (Vec<_>, Vec<_>) = moving(view).partition(holds);
    let mut found: Vec<Sentence> = Vec::new();
    for it in others {
        let what = if is_unheard(view, it) {
            view.lang.unheard_request(it.request.kind()).to_owned()
        } else {
            let done = it.state == CountermeasureState::Engaged;
            view.lang.countermeasure(it.request.kind(), done, !it.causes.is_empty()).to_owned()
        };
        let since = (stands || is_resumed(it)).then(|| (view.words.since, view.wall_since(it.since)));
        // The stop itself says since when.
        let since = since.filter(|_| it.by_operator.is_none());
        let because = because(view, &[it]);
        match found.iter_mut().find(|other| other.because == because) {
            Some(other) if other.what.ends_with(&what) => {}
            Some(other) => {
                other.what = format!("{}. {what}", other.what);
                other.since = since.or_else(|| other.since.take());
            }
            None => found.push(Sentence { what, since, because }),
        }
    }
    stop.into_iter().chain(found).chain(held(view, &holding)).collect()
}

/// What holds the vehicle, in one sentence. The operator's own stop has one already.
fn held(view: &View<'_>, holding: &[&Countermeasure]) -> Option<Sentence> {
    let for_a_cause = holding.iter().any(|it| it.by_operator.is_none() || !it.causes.is_empty());
    let since = holding.iter().filter(|it| it.by_operator.is_none()).map(|it| view.wall_since(it.since));
    for_a_cause.then(|| Sentence {
        what: view.words.held.to_owned(),
        since: since.min().map(|at| (view.words.since, at)),
        because: because(view, holding),
    })
}

/// Whether nothing is left of any cause: what was an ERROR may be a WARNING now.
pub fn causes_are_gone(view: &View<'_>) -> bool {
    let left = |cause: &CountermeasureCause| match cause.node {
        NodeId::Group(_) => cause.present,
        NodeId::Module(id) => cause.present || view.snapshot.module(id).1.own == State::Warning,
    };
    !moving(view).flat_map(|it| it.causes.iter()).any(left)
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

/// The causes of requests: the first by its name, the others that are still there counted, as the list of faults shows
/// them; `Over: LiDAR data missing` if none is left.
fn because(view: &View<'_>, requests: &[&Countermeasure]) -> String {
    let (mut nodes, mut statuses) = (HashSet::new(), HashSet::new());
    // A cause of two requests is one, and so is one status in several components.
    let mut is_first = |node: NodeId| {
        let status = view.snapshot.status_of(node);
        nodes.insert(node) && status.is_none_or(|status| statuses.insert(status))
    };
    let mut all: Vec<(&Countermeasure, &CountermeasureCause)> =
        requests.iter().flat_map(|it| it.causes.iter().map(|cause| (*it, cause))).collect();
    // What is still there is named before what is over.
    all.sort_by_key(|(_, cause)| !cause.present);
    all.retain(|(_, cause)| is_first(cause.node));
    let Some((&(it, first), others)) = all.split_first() else { return String::new() };
    let name = fault(view, it, first);
    if !first.present {
        return format!("{}: {name}", view.words.over);
    }
    let is_masked = |cause: &CountermeasureCause| {
        matches!(view.snapshot.shown(cause.node).1, Some(Reason::Masked { .. }))
    };
    match others.iter().filter(|(_, cause)| cause.present && !is_masked(cause)).count() {
        0 => name,
        others => format!("{name} ({})", view.lang.and_more_faults(others)),
    }
}

/// The fault that a cause has, or had: a WARNING that is left of it is another one. After a restart nothing is heard of
/// it yet.
fn fault(view: &View<'_>, it: &Countermeasure, cause: &CountermeasureCause) -> String {
    let id = match cause.node {
        NodeId::Group(id) => return view.group_name(id),
        NodeId::Module(id) => id,
    };
    let (_, module) = view.snapshot.module(id);
    if is_resumed(it) && module.received.is_none() && !module.silent && module.own == State::Unknown {
        return format!("{}, {}", view.fault(id, State::Error), view.words.not_heard_again);
    }
    view.fault(id, if cause.present { module.own } else { State::Error })
}
