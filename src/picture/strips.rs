//! States over time as strips of segments, as in Fig. 6 of the paper. Figures of scenarios and the page of
//! the timeline draw them.

use std::sync::Arc;

use crate::engine::event::Said;
use crate::engine::state::State;
use crate::engine::time::{Span, Timestamp};
use crate::engine::view::record::Stretch;

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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    Ok,
    Warning,
    Error,
    /// An ERROR of a symptom that was there before its cause showed itself.
    Owed,
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
        Look::Owed,
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
    owe(&mut segments);
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

/// An ERROR that turns into waiting for a cause is attributed to that cause (`ENGINE.md` 6).
pub fn owe(segments: &mut [Segment]) {
    for index in 1..segments.len() {
        if (segments[index - 1].look, segments[index].look) == (Look::Error, Look::Masked) {
            segments[index - 1].look = Look::Owed;
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
        Look::Owed => "owed",
        Look::Masked => "masked",
        Look::NotRelevant => "not-relevant",
        Look::Unknown => "unknown",
        Look::True => "true",
        Look::False => "false",
        Look::NotKnown => "not-known",
    }
}

/// The smallest of 1, 2, 5, 10, ... milliseconds that leaves few enough ticks.
pub fn tick_step(whole: Span) -> Span {
    let steps = (0..15).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_u64.pow(power)));
    let wide = |millis: &u64| whole.as_millis() / millis < TICKS_MAX;
    Span::from_millis(steps.into_iter().find(wide).unwrap_or(u64::MAX / 2))
}

/// The first instant not before `from` that is a whole number of steps from `zero`.
pub fn first_tick(from: Timestamp, zero: Timestamp, step: Span) -> Timestamp {
    let step = step.as_nanos().max(1);
    let offset = zero.as_nanos() % step;
    let behind = from.as_nanos().saturating_sub(offset).div_ceil(step);
    Timestamp::from_nanos(offset + behind * step)
}
