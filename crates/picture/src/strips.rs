//! States over time as strips of segments, as in Fig. 6 of the paper.

use std::sync::Arc;

use telltale_engine::event::Said;
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Stretch;

const TICKS_MAX: u64 = 9;

/// One node or signal over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// The whole name.
    pub name: String,
    pub label: String,
    /// Stands below the strip of the group that contains it.
    pub inner: bool,
    /// Without gaps; the time before a node exists has no segment.
    pub segments: Vec<Segment>,
}

impl Strip {
    /// The strip of a node. Below the strip of the group around it, it is called by the rest of its name.
    pub fn of_node(name: &str, shown: &[String], segments: Vec<Segment>) -> Strip {
        let around = name.rsplit_once('/').filter(|(group, _)| shown.iter().any(|node| node == group));
        let label = around.map_or(name, |(_, last)| last).to_owned();
        Strip { name: name.to_owned(), label, inner: around.is_some(), segments }
    }

    pub fn of_signal(name: &str, segments: Vec<Segment>) -> Strip {
        Strip { name: name.to_owned(), label: name.to_owned(), inner: false, segments }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    pub from: Timestamp,
    pub to: Timestamp,
    pub look: Look,
    /// The state that the node reports behind an IGNORE.
    pub own: Option<State>,
    /// The cause that masks it, or to which its earlier ERROR is attributed.
    pub cause: Option<Arc<str>>,
    /// The module's message when it began.
    pub said: Option<Said>,
}

impl Segment {
    /// Of a signal.
    pub fn of_signal(from: Timestamp, to: Timestamp, value: Option<bool>) -> Segment {
        let look = match value {
            Some(true) => Look::True,
            Some(false) => Look::False,
            None => Look::NotKnown,
        };
        Segment { from, to, look, own: None, cause: None, said: None }
    }

    /// The state that the node reports behind an IGNORE, if it is worse than OK.
    pub fn own_fault(&self) -> Option<State> {
        self.own.filter(|own| *own > State::Ok)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    Ok,
    Warning,
    Error,
    /// An ERROR of a symptom that was there before its cause showed itself.
    Attributed,
    Masked,
    NotRelevant,
    Unknown,
    /// Of a signal.
    True,
    False,
    NotKnown,
}

impl Look {
    pub const ALL: [Look; 10] = [
        Look::Ok,
        Look::Warning,
        Look::Error,
        Look::Attributed,
        Look::Masked,
        Look::NotRelevant,
        Look::Unknown,
        Look::True,
        Look::False,
        Look::NotKnown,
    ];
}

/// The look of a node's state; an ignored node is masked, or not relevant.
pub fn look(state: State, is_masked: bool) -> Look {
    match state {
        State::Ignore if is_masked => Look::Masked,
        State::Ignore => Look::NotRelevant,
        State::Ok => Look::Ok,
        State::Warning => Look::Warning,
        State::Unknown => Look::Unknown,
        State::Error => Look::Error,
    }
}

/// A moment of a history, in milliseconds since 1970.
pub fn stamp(ms: i64) -> Timestamp {
    Timestamp::from_millis(u64::try_from(ms).unwrap_or(0))
}

/// The history of a node.
pub fn recorded(stretches: &[Stretch]) -> Vec<Segment> {
    let segment = |stretch: &Stretch| Segment {
        from: stamp(stretch.from_ms),
        to: stamp(stretch.to_ms),
        look: look(stretch.state, stretch.cause.is_some()),
        own: (stretch.state == State::Ignore).then_some(stretch.own),
        cause: stretch.cause.clone(),
        said: stretch.said.clone(),
    };
    let mut segments: Vec<Segment> = stretches.iter().map(segment).collect();
    attribute(&mut segments);
    merged(segments)
}

/// Joins neighbours that look the same; the first one's words stay.
pub fn merged(segments: Vec<Segment>) -> Vec<Segment> {
    let mut merged: Vec<Segment> = Vec::new();
    for segment in segments {
        match merged.last_mut() {
            Some(last)
                if (last.look, last.own, &last.cause) == (segment.look, segment.own, &segment.cause) =>
            {
                last.to = segment.to;
            }
            _ => merged.push(segment),
        }
    }
    merged
}

/// An ERROR that lasts and turns into waiting for a cause is attributed to that cause: the cause explains it. One that
/// ended is not.
pub fn attribute(segments: &mut [Segment]) {
    for index in 1..segments.len() {
        let is_explained = segments[index].look == Look::Masked && segments[index].own == Some(State::Error);
        if segments[index - 1].look == Look::Error && is_explained {
            segments[index - 1].look = Look::Attributed;
            segments[index - 1].cause = segments[index].cause.clone();
        }
    }
}

/// The name of a look in stylesheets.
pub fn class(look: Look) -> &'static str {
    match look {
        Look::Ok => "ok",
        Look::Warning => "warning",
        Look::Error => "error",
        Look::Attributed => "attributed",
        Look::Masked => "masked",
        Look::NotRelevant => "not-relevant",
        Look::Unknown => "unknown",
        Look::True => "true",
        Look::False => "false",
        Look::NotKnown => "not-known",
    }
}

/// Time along a strip, in the unit of its drawing.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    pub from: Timestamp,
    pub to: Timestamp,
    pub left: f64,
    pub width: f64,
}

impl Axis {
    /// Where an instant stands.
    pub fn x(&self, at: Timestamp) -> f64 {
        let whole = self.to.since(self.from).as_nanos().max(1) as f64;
        let after = match at >= self.from {
            true => at.since(self.from).as_nanos() as f64,
            false => -(self.from.since(at).as_nanos() as f64),
        };
        self.left + self.width * after / whole
    }

    /// Marks in whole steps from `zero`.
    pub fn ticks(&self, zero: Timestamp) -> impl Iterator<Item = Timestamp> {
        let (step, to) = (tick_step(self.to.since(self.from)), self.to);
        let next = move |at: &Timestamp| Some(*at + step);
        std::iter::successors(Some(first_tick(self.from, zero, step)), next).take_while(move |at| *at <= to)
    }
}

/// The smallest of 1, 2, 5, 10, ... milliseconds that leaves few enough ticks.
fn tick_step(whole: Span) -> Span {
    let steps = (0..15).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_u64.pow(power)));
    let wide = |millis: &u64| whole.as_millis() / millis < TICKS_MAX;
    Span::from_millis(steps.into_iter().find(wide).unwrap_or(u64::MAX / 2))
}

/// The first instant not before `from` that is a whole number of steps from `zero`.
fn first_tick(from: Timestamp, zero: Timestamp, step: Span) -> Timestamp {
    let step = step.as_nanos().max(1);
    let offset = zero.as_nanos() % step;
    let behind = from.as_nanos().saturating_sub(offset).div_ceil(step);
    Timestamp::from_nanos(offset + behind * step)
}
