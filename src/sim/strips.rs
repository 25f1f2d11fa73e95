//! The course of a run as strips of segments, for a figure.

use super::scenario::{Figure, Outcome, Transition, Why};
use crate::engine::state::State;
use crate::engine::time::Timestamp;
use crate::picture::strips::{Look, Segment, Strip, look, merged, owe};

/// One scenario in a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    pub title: String,
    pub from: Timestamp,
    pub to: Timestamp,
    /// The zero of the axis, and the event there.
    pub zero: Option<(Timestamp, String)>,
    pub strips: Vec<Strip>,
    /// From the strip of the symptom to the strip of its cause.
    pub moved: Vec<Arrow>,
}

/// An alarm that moved, by positions of strips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrow {
    pub at: Timestamp,
    pub symptom: usize,
    pub cause: usize,
}

/// The strips of a scenario's figure.
pub fn panel(title: &str, figure: &Figure, outcome: &Outcome) -> Panel {
    let nodes = figure.nodes.iter().map(|name| node_strip(name, figure, outcome));
    let signals = figure.signals.iter().map(|name| signal_strip(name, figure, outcome));
    let strips: Vec<Strip> = nodes.chain(signals).collect();
    let moved = outcome.moved.iter().filter(|moved| (figure.from..=figure.to).contains(&moved.at));
    let moved = moved.filter_map(|it| arrow(it.at, &it.symptom, &it.cause, &strips)).collect();
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
            look: look(change.state, change.why == Why::Masked),
            own: (change.state == State::Ignore).then_some(change.own),
            cause: change.causes.first().cloned(),
            said: None,
        });
    }
    segments.retain(|segment| segment.from < segment.to);
    owe(&mut segments);
    // The strip of the next outer group shows the rest of the name.
    let around = name.rsplit_once('/').filter(|(group, _)| figure.nodes.iter().any(|node| node == group));
    Strip {
        name: name.to_owned(),
        label: around.map_or(name, |(_, last)| last).to_owned(),
        inner: around.is_some(),
        segments: cut(merged(segments), figure),
    }
}

fn signal_strip(name: &str, figure: &Figure, outcome: &Outcome) -> Strip {
    let changes: Vec<_> = outcome.signals.iter().filter(|change| *change.name == *name).collect();
    let segment = |(index, change): (usize, &&_)| {
        let change: &super::scenario::SignalChange = change;
        Segment {
            from: change.at,
            to: changes.get(index + 1).map_or(figure.to, |next| next.at),
            look: match change.value {
                Some(true) => Look::True,
                Some(false) => Look::False,
                None => Look::NotKnown,
            },
            own: None,
            cause: None,
            said: None,
        }
    };
    let segments = changes.iter().enumerate().map(segment).filter(|segment| segment.from < segment.to);
    Strip {
        name: name.to_owned(),
        label: name.to_owned(),
        inner: false,
        segments: cut(merged(segments.collect()), figure),
    }
}

fn cut(segments: Vec<Segment>, figure: &Figure) -> Vec<Segment> {
    let cut = |segment: Segment| Segment {
        from: segment.from.max(figure.from),
        to: segment.to.min(figure.to),
        ..segment
    };
    segments.into_iter().map(cut).filter(|segment| segment.from < segment.to).collect()
}

/// From the strip of the symptom, or of the innermost shown group around it, to the strip of the cause.
pub fn arrow(at: Timestamp, symptom: &str, cause: &str, strips: &[Strip]) -> Option<Arrow> {
    let nearest = |name: &str| {
        let contains = |strip: &Strip| {
            name.strip_prefix(&strip.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        let found = strips.iter().enumerate().filter(|(_, strip)| contains(strip));
        found.max_by_key(|(_, strip)| strip.name.len()).map(|(index, _)| index)
    };
    let (symptom, cause) = (nearest(symptom)?, nearest(cause)?);
    (symptom != cause).then_some(Arrow { at, symptom, cause })
}
