//! The course of a run as strips of segments, for a figure.

use super::scenario::{Figure, IgnoreReason, Outcome, SignalChange, Transition};
use telltale_engine::state::State;
use telltale_picture::figure::{MovedAlarm, Panel};
use telltale_picture::strips::{Segment, Strip, attribute, look, merged};

/// The strips of a scenario's figure.
pub fn panel(title: &str, figure: &Figure, outcome: &Outcome) -> Panel {
    let nodes = figure.nodes.iter().map(|name| node_strip(name, figure, outcome));
    let signals = figure.signals.iter().map(|name| signal_strip(name, figure, outcome));
    let strips: Vec<Strip> = nodes.chain(signals).collect();
    let moved = outcome.moved.iter().filter(|moved| (figure.from..=figure.to).contains(&moved.at));
    let moved = moved.filter_map(|it| MovedAlarm::between(it.at, &it.symptom, &it.cause, &strips)).collect();
    Panel {
        title: title.to_owned(),
        from: figure.from,
        to: figure.to,
        zero: figure.zero.clone(),
        strips,
        moved,
    }
}

fn node_strip(name: &str, figure: &Figure, outcome: &Outcome) -> Strip {
    let changes: Vec<&Transition> =
        outcome.transitions.iter().filter(|change| *change.node == *name).collect();
    let mut segments = Vec::new();
    for (index, change) in changes.iter().enumerate() {
        let next = changes.get(index + 1);
        segments.push(Segment {
            from: change.at,
            to: next.map_or(figure.to, |next| next.at),
            look: look(change.state, change.why == IgnoreReason::Masked),
            own: (change.state == State::Ignore).then_some(change.own),
            cause: change.causes.first().cloned(),
            said: None,
        });
    }
    segments.retain(|segment| segment.from < segment.to);
    attribute(&mut segments);
    Strip::of_node(name, &figure.nodes, cut(merged(segments), figure))
}

fn signal_strip(name: &str, figure: &Figure, outcome: &Outcome) -> Strip {
    let changes: Vec<&SignalChange> = outcome.signals.iter().filter(|change| *change.name == *name).collect();
    let segment = |(index, change): (usize, &&SignalChange)| {
        let to = changes.get(index + 1).map_or(figure.to, |next| next.at);
        Segment::of_signal(change.at, to, change.value)
    };
    let segments = changes.iter().enumerate().map(segment).filter(|segment| segment.from < segment.to);
    Strip::of_signal(name, cut(merged(segments.collect()), figure))
}

fn cut(segments: Vec<Segment>, figure: &Figure) -> Vec<Segment> {
    let cut = |segment: Segment| Segment {
        from: segment.from.max(figure.from),
        to: segment.to.min(figure.to),
        ..segment
    };
    segments.into_iter().map(cut).filter(|segment| segment.from < segment.to).collect()
}
