//! The latest values of a monitor's inputs, and why one cannot be used.

use super::words::{cut, reason, span};
use crate::files::KeyframeError;
use crate::model::monitors::{ValueSource, Watched};
use crate::model::quantity::Quantity;
use crate::model::sample::{FieldValue, Pose, Positions};
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// The reason for an unreadable KeyValue that the status does not have.
pub(crate) const NO_SUCH_KEY: &str = "the status has no such key";

/// By slot: the position of a source in its monitor.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Inputs {
    #[serde(skip)]
    labels: Box<[Text]>,
    #[serde(skip)]
    quantities: Box<[Option<Quantity>]>,
    latest: Box<[Option<(Timestamp, FieldValue)>]>,
    /// An older value is not used.
    #[serde(skip)]
    max_age: Option<Span>,
}

/// The reason why there is no answer, and the input that causes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct UnusableInput {
    slot: usize,
    pub(super) fault: InputFault,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum InputFault {
    Missing,
    Old,
    Unreadable,
    NotANumber,
    Infinite,
    WrongKind { wanted: ValueKind, is: ValueKind },
    NoRotation,
}

impl UnusableInput {
    /// Whether it is about one of these inputs.
    pub(super) fn is_of(self, inputs: &Inputs) -> bool {
        self.slot < inputs.len()
    }

    /// Whether the only reason is the age of the input.
    pub(super) fn is_age(self) -> bool {
        self.fault == InputFault::Old
    }
}

impl Inputs {
    /// Each source with its role, which may be empty.
    pub(super) fn new<'a>(
        sources: impl Iterator<Item = (Text, &'a ValueSource)>,
        watched: &Watched,
        max_age: Option<Span>,
    ) -> Inputs {
        let label = |(role, source): (Text, &ValueSource)| -> Text {
            let place = match source {
                ValueSource::Field { topic, field } => {
                    let topic = &watched.topics[topic.0 as usize];
                    let path = &topic.fields[*field as usize].path;
                    if path.is_empty() { topic.topic.to_string() } else { format!("{} {path}", topic.topic) }
                }
                ValueSource::Key { status, key, .. } => format!("{status}: {key}"),
            };
            if role.en.is_empty() {
                place.into()
            } else {
                say!("{role} ({place})", "{role} ({place})", role, place)
            }
        };
        let (labels, quantities): (Vec<Text>, Vec<_>) =
            sources.map(|it| (Quantity::of(it.1, watched), it)).map(|(of, it)| (label(it), of)).unzip();
        let (labels, quantities) = (labels.into_boxed_slice(), quantities.into_boxed_slice());
        Inputs { quantities, latest: labels.iter().map(|_| None).collect(), labels, max_age }
    }

    /// Goes on with the state of a keyframe.
    pub(super) fn resume(&mut self, kept: Inputs) -> Result<(), KeyframeError> {
        let Inputs { labels: _, quantities: _, latest, max_age: _ } = kept;
        KeyframeError::unless_same("inputs of a monitor", latest.len(), self.latest.len())?;
        self.latest = latest;
        Ok(())
    }

    /// Returns whether the value changed. One that came late takes no time from the one before.
    pub(super) fn take(&mut self, slot: usize, value: &FieldValue, at: Timestamp) -> bool {
        let at = self.latest[slot].as_ref().map_or(at, |(before, _)| at.max(*before));
        match &mut self.latest[slot] {
            Some((received, known)) if known == value => {
                *received = at;
                false
            }
            known => {
                *known = Some((at, value.clone()));
                true
            }
        }
    }

    /// As if nothing had come.
    pub(super) fn forget(&mut self, slot: usize) {
        self.latest[slot] = None;
    }

    pub(super) fn len(&self) -> usize {
        self.latest.len()
    }

    pub(super) fn label(&self, slot: usize) -> Text {
        self.labels[slot].clone()
    }

    pub(super) fn quantity(&self, slot: usize) -> Option<&Quantity> {
        self.quantities[slot].as_ref()
    }

    /// The quantity of all inputs, if it is the same.
    pub(super) fn common_quantity(&self) -> Option<&Quantity> {
        let first = self.quantities.first()?;
        first.as_ref().filter(|_| self.quantities.iter().all(|it| it == first))
    }

    pub(super) fn any(&self) -> bool {
        self.latest.iter().any(Option::is_some)
    }

    pub(super) fn received(&self, slot: usize) -> Option<Timestamp> {
        self.latest[slot].as_ref().map(|(received, _)| *received)
    }

    /// When the last value was published, if its message had one.
    pub(super) fn told(&self, slot: usize) -> Option<Timestamp> {
        self.last(slot).filter(|&value| *value != FieldValue::Absent).and_then(|_| self.received(slot))
    }

    /// The last value of any kind.
    pub(super) fn last(&self, slot: usize) -> Option<&FieldValue> {
        self.latest[slot].as_ref().map(|(_, value)| value)
    }

    /// A usable value: present, recent enough, readable, and finite if it is a number.
    pub(super) fn value(&self, slot: usize, now: Timestamp) -> Result<&FieldValue, UnusableInput> {
        let unusable = |fault| Err(UnusableInput { slot, fault });
        let Some((received, value)) = &self.latest[slot] else { return unusable(InputFault::Missing) };
        if self.max_age.is_some_and(|max_age| now.since(*received) > max_age) {
            return unusable(InputFault::Old);
        }
        match value {
            FieldValue::Absent | FieldValue::Unreadable(_) => unusable(InputFault::Unreadable),
            FieldValue::Number(number) if number.is_nan() => unusable(InputFault::NotANumber),
            FieldValue::Number(number) if number.is_infinite() => unusable(InputFault::Infinite),
            FieldValue::Pose(pose) => match fault(pose) {
                Some(fault) => unusable(fault),
                None => Ok(value),
            },
            FieldValue::Positions(positions) => match astray(positions) {
                Some(fault) => unusable(fault),
                None => Ok(value),
            },
            value => Ok(value),
        }
    }

    pub(super) fn number(&self, slot: usize, now: Timestamp) -> Result<f64, UnusableInput> {
        match self.value(slot, now)? {
            FieldValue::Number(number) => Ok(*number),
            other => Err(wrong_kind(slot, ValueKind::Number, other)),
        }
    }

    pub(super) fn pose(&self, slot: usize, now: Timestamp) -> Result<Pose, UnusableInput> {
        match self.value(slot, now)? {
            FieldValue::Pose(pose) => Ok(*pose),
            other => Err(wrong_kind(slot, ValueKind::Pose, other)),
        }
    }

    fn text(&self, slot: usize) -> Option<&str> {
        match self.last(slot)? {
            FieldValue::Text(text) => Some(cut(text)),
            FieldValue::Number(_)
            | FieldValue::Bool(_)
            | FieldValue::Pose(_)
            | FieldValue::Positions(_)
            | FieldValue::Transforms(_)
            | FieldValue::Elements(_)
            | FieldValue::Content(_)
            | FieldValue::Absent
            | FieldValue::Unreadable(_) => None,
        }
    }

    pub(super) fn positions(&self, slot: usize, now: Timestamp) -> Result<&Positions, UnusableInput> {
        match self.value(slot, now)? {
            FieldValue::Positions(positions) => Ok(positions),
            other => Err(wrong_kind(slot, ValueKind::Positions, other)),
        }
    }

    /// The time at which the next value becomes too old.
    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let max_age = self.max_age?;
        let old = |(received, _): &(Timestamp, FieldValue)| *received + max_age + Span::from_nanos(1);
        self.latest.iter().flatten().map(old).filter(|&at| at > now).min()
    }

    pub(super) fn say(&self, unusable: UnusableInput) -> Text {
        let label = self.label(unusable.slot);
        match unusable.fault {
            InputFault::Missing => nothing_yet(label),
            InputFault::Old => {
                let max_age = self.max_age.map_or("".into(), span);
                say!("{label} is older than {max_age}", "{label} älter als {max_age}", label, max_age)
            }
            InputFault::Unreadable => match &self.latest[unusable.slot] {
                Some((_, FieldValue::Unreadable(why))) if **why == *NO_SUCH_KEY => say!(
                    "{label} cannot be read: the status has no such key",
                    "{label} nicht lesbar: der Status hat diesen Schlüssel nicht",
                    label
                ),
                Some((_, FieldValue::Unreadable(why))) => say!(
                    "{label} cannot be read: {why}",
                    "{label} nicht lesbar: {why}",
                    label,
                    why = reason(why)
                ),
                _ => say!("{label} cannot be read", "{label} nicht lesbar", label),
            },
            InputFault::NotANumber => {
                say!("{label} is not a number", "{label} ist keine Zahl", label)
            }
            InputFault::Infinite => say!("{label} is infinite", "{label} ist unendlich", label),
            // The text itself is the explanation: a unit, a word.
            InputFault::WrongKind { wanted: ValueKind::Number, is: ValueKind::Words }
                if self.text(unusable.slot).is_some() =>
            {
                say!(
                    "{label} is \"{text}\", text where a number is wanted",
                    "{label} ist \"{text}\", Text, wo eine Zahl erwartet wird",
                    label,
                    text = self.text(unusable.slot).unwrap_or_default()
                )
            }
            InputFault::WrongKind { wanted, is } => say!(
                "{label} is {is} where {wanted} is wanted",
                "{label} ist {is}, erwartet {wanted}",
                label,
                is = is.say(),
                wanted = wanted.say()
            ),
            InputFault::NoRotation => say!(
                "{label} has a rotation of length zero",
                "{label} hat eine Drehung der Länge null",
                label
            ),
        }
    }
}

pub(super) fn nothing_yet(label: Text) -> Text {
    say!("nothing came yet of {label}", "noch nichts gekommen von {label}", label)
}

/// The kind of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ValueKind {
    Number,
    Pose,
    Positions,
    Bool,
    Words,
}

impl ValueKind {
    fn say(self) -> Text {
        match self {
            ValueKind::Number => say!("a number", "eine Zahl"),
            ValueKind::Pose => say!("a pose", "eine Pose"),
            ValueKind::Positions => say!("a list", "eine Liste"),
            ValueKind::Bool => say!("a boolean", "ein Wahrheitswert"),
            ValueKind::Words => say!("text", "Text"),
        }
    }
}

fn wrong_kind(slot: usize, wanted: ValueKind, value: &FieldValue) -> UnusableInput {
    let is = match value {
        FieldValue::Number(_) => ValueKind::Number,
        FieldValue::Pose(_) => ValueKind::Pose,
        FieldValue::Positions(_) => ValueKind::Positions,
        FieldValue::Bool(_) => ValueKind::Bool,
        FieldValue::Text(_)
        | FieldValue::Transforms(_)
        | FieldValue::Elements(_)
        | FieldValue::Content(_)
        | FieldValue::Absent
        | FieldValue::Unreadable(_) => ValueKind::Words,
    };
    UnusableInput { slot, fault: InputFault::WrongKind { wanted, is } }
}

fn astray(positions: &Positions) -> Option<InputFault> {
    let mut parts = positions.taken.iter().flat_map(|position| [position.x_m, position.y_m]);
    let worst = parts.find(|part| !part.is_finite())?;
    Some(if worst.is_nan() { InputFault::NotANumber } else { InputFault::Infinite })
}

fn fault(pose: &Pose) -> Option<InputFault> {
    let parts = [pose.x_m, pose.y_m, pose.z_m, pose.qx, pose.qy, pose.qz, pose.qw];
    let length = pose.qx * pose.qx + pose.qy * pose.qy + pose.qz * pose.qz + pose.qw * pose.qw;
    if parts.iter().any(|part| part.is_nan()) {
        Some(InputFault::NotANumber)
    } else if parts.iter().any(|part| part.is_infinite()) || length.is_infinite() {
        Some(InputFault::Infinite)
    } else if length < 1e-12 {
        Some(InputFault::NoRotation)
    } else {
        None
    }
}
