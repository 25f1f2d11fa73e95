//! The countermeasure on the page: the request to the vehicle, its causes, and whether the vehicle confirms
//! it.

use std::collections::HashSet;

use askama::Template;

use crate::engine::model::NodeId;
use crate::engine::model::countermeasure::RequestKind;
use crate::engine::snapshot::{Countermeasure, CountermeasureState};

use crate::web::view::{Fragment, View, html};

#[derive(Template)]
#[template(path = "partials/countermeasure.html")]
struct CountermeasureHtml {
    swap: bool,
    banner: Option<Banner>,
}

struct Banner {
    request: &'static str,
    state: &'static str,
    icon: &'static str,
    title: String,
    because: String,
    confirmed: &'static str,
}

pub fn countermeasure(view: &View<'_>) -> Fragment {
    let banner = view.snapshot.countermeasure().map(|it| of(view, it));
    let html = html(&CountermeasureHtml { swap: view.swap, banner });
    Fragment { id: "countermeasure".to_owned(), html }
}

/// Whether the banner is shown: the vehicle is asked to slow down or to stop.
pub fn has_banner(view: &View<'_>) -> bool {
    view.snapshot.countermeasure().is_some_and(|it| it.request.kind().moves())
}

/// Whether the operator may end what keeps the vehicle from driving.
pub fn waits_for_release(view: &View<'_>) -> bool {
    view.snapshot.release_refusals.is_empty()
}

fn of(view: &View<'_>, it: &Countermeasure) -> Banner {
    let steps = view.lang.steps();
    let mut statuses: HashSet<&str> = HashSet::new();
    // One status in several components is one cause.
    let mut is_first =
        |node: NodeId| view.snapshot.status_of(node).is_none_or(|status| statuses.insert(status));
    let nodes: Vec<NodeId> =
        it.causes.iter().map(|cause| cause.node).filter(|&node| is_first(node)).collect();
    let causes: Vec<String> = nodes.into_iter().map(|node| fault(view, node)).collect();
    let because = match (causes.first(), it.by_operator) {
        (Some(first), _) => {
            let others = match causes.len() - 1 {
                0 => String::new(),
                others => format!(", {}", view.lang.and_more(others)),
            };
            format!("{} {first}{others}", steps.because_of)
        }
        (None, true) => steps.asked_by_operator.to_owned(),
        (None, false) => String::new(),
    };
    let unheard = it.request.kind().output().is_some_and(|output| view.snapshot.unreached(output).is_some());
    let is_received = it.request.kind().output().is_none_or(|output| view.snapshot.is_listened_to(output));
    Banner {
        request: it.request.as_str(),
        state: it.state.as_str(),
        icon: match (it.state, it.request.kind()) {
            (CountermeasureState::Unconfirmed, _) => "error",
            (_, RequestKind::Decelerate) => "slow",
            _ => "stop",
        },
        title: match unheard {
            true => view.lang.unheard(it.request).to_owned(),
            false => view.lang.countermeasure(it.request, it.state),
        },
        because,
        confirmed: match it.state {
            CountermeasureState::Unconfirmed if unheard && view.drives() => steps.unheard,
            CountermeasureState::Unconfirmed if unheard => steps.unheard_standing,
            CountermeasureState::Unconfirmed if view.drives() => steps.unconfirmed,
            CountermeasureState::Unconfirmed => steps.unconfirmed_standing,
            _ if waits_for_release(view) && !it.causes.is_empty() => steps.held,
            CountermeasureState::Engaged => steps.engaged,
            CountermeasureState::Requested if is_received => steps.asked,
            CountermeasureState::Requested => steps.not_received_yet,
        },
    }
}

fn fault(view: &View<'_>, node: NodeId) -> String {
    match node {
        NodeId::Group(id) => view.group_name(id),
        NodeId::Module(id) => view.fault(id, view.snapshot.module(id).1.own),
    }
}
