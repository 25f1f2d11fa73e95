//! The latest value of everything that a monitor looks at, and why one cannot be used.

use super::spec::{ValueSource, Watched};
use super::words::{cut, span};
use crate::engine::sample::{FieldValue, Pose};
use crate::engine::time::{Span, Timestamp};

/// By slot: the position of a source in its monitor.
#[derive(Debug, Clone)]
pub(super) struct Inputs {
    labels: Box<[Box<str>]>,
    latest: Box<[Option<(Timestamp, FieldValue)>]>,
    /// An older value is not used.
    max_age: Option<Span>,
}

/// Why there is no answer, and of which input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Doubt {
    slot: usize,
    what: What,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Missing,
    Old,
    Unreadable,
    NotANumber,
    Infinite,
    /// It is no number, or no pose.
    WrongKind(&'static str),
    NoRotation,
}

impl Inputs {
    /// Each source with the role that it has, which may be empty.
    pub(super) fn new<'a>(
        sources: impl Iterator<Item = (&'a str, &'a ValueSource)>,
        watched: &Watched,
        max_age: Option<Span>,
    ) -> Inputs {
        let label = |(role, source): (&str, &ValueSource)| -> Box<str> {
            let place = match source {
                ValueSource::Field { topic, field } => {
                    let topic = &watched.topics[topic.0 as usize];
                    format!("{} {}", topic.topic, topic.fields[*field as usize].path)
                }
                ValueSource::Key { status, key } => format!("{status}: {key}"),
            };
            if role.is_empty() { place.into() } else { format!("{role} ({place})").into() }
        };
        let labels: Box<[Box<str>]> = sources.map(label).collect();
        Inputs { latest: labels.iter().map(|_| None).collect(), labels, max_age }
    }

    /// Returns whether it is another value than before.
    pub(super) fn take(&mut self, slot: usize, value: &FieldValue, now: Timestamp) -> bool {
        match &mut self.latest[slot] {
            Some((received, known)) if known == value => {
                *received = now;
                false
            }
            known => {
                *known = Some((now, value.clone()));
                true
            }
        }
    }

    pub(super) fn len(&self) -> usize {
        self.latest.len()
    }

    pub(super) fn label(&self, slot: usize) -> &str {
        &self.labels[slot]
    }

    pub(super) fn any(&self) -> bool {
        self.latest.iter().any(Option::is_some)
    }

    pub(super) fn received(&self, slot: usize) -> Option<Timestamp> {
        self.latest[slot].as_ref().map(|(received, _)| *received)
    }

    /// What came last, whatever it is.
    pub(super) fn last(&self, slot: usize) -> Option<&FieldValue> {
        self.latest[slot].as_ref().map(|(_, value)| value)
    }

    /// A value that can be used: there, young enough, readable, and finite where it is a number.
    pub(super) fn value(&self, slot: usize, now: Timestamp) -> Result<&FieldValue, Doubt> {
        let doubt = |what| Err(Doubt { slot, what });
        let Some((received, value)) = &self.latest[slot] else { return doubt(What::Missing) };
        if self.max_age.is_some_and(|max_age| now.since(*received) > max_age) {
            return doubt(What::Old);
        }
        match value {
            FieldValue::Absent | FieldValue::Unreadable(_) => doubt(What::Unreadable),
            FieldValue::Number(number) if number.is_nan() => doubt(What::NotANumber),
            FieldValue::Number(number) if number.is_infinite() => doubt(What::Infinite),
            FieldValue::Pose(pose) => match fault(pose) {
                Some(what) => doubt(what),
                None => Ok(value),
            },
            value => Ok(value),
        }
    }

    pub(super) fn number(&self, slot: usize, now: Timestamp) -> Result<f64, Doubt> {
        match self.value(slot, now)? {
            FieldValue::Number(number) => Ok(*number),
            other => Err(Doubt { slot, what: What::WrongKind(if_not("a number", other)) }),
        }
    }

    pub(super) fn pose(&self, slot: usize, now: Timestamp) -> Result<Pose, Doubt> {
        match self.value(slot, now)? {
            FieldValue::Pose(pose) => Ok(*pose),
            other => Err(Doubt { slot, what: What::WrongKind(if_not("a pose", other)) }),
        }
    }

    /// When the next value becomes too old.
    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let max_age = self.max_age?;
        let old = |(received, _): &(Timestamp, FieldValue)| *received + max_age + Span::from_nanos(1);
        self.latest.iter().flatten().map(old).filter(|&at| at > now).min()
    }

    pub(super) fn say(&self, doubt: Doubt) -> String {
        let label = &self.labels[doubt.slot];
        match doubt.what {
            What::Missing => format!("nothing came yet of {label}"),
            What::Old => {
                let max_age = self.max_age.map_or(String::new(), span);
                format!("{label} is older than {max_age}")
            }
            What::Unreadable => match &self.latest[doubt.slot] {
                Some((_, FieldValue::Unreadable(why))) => format!("{label} cannot be read: {}", cut(why)),
                _ => format!("{label} cannot be read"),
            },
            What::NotANumber => format!("{label} is not a number"),
            What::Infinite => format!("{label} is infinite"),
            What::WrongKind(wanted) => format!("{label} is {wanted}"),
            What::NoRotation => format!("{label} has a rotation of length zero"),
        }
    }
}

fn if_not(wanted: &'static str, value: &FieldValue) -> &'static str {
    match (wanted, value) {
        ("a pose", FieldValue::Number(_)) => "a number where a pose is wanted",
        (_, FieldValue::Pose(_)) => "a pose where a number is wanted",
        ("a pose", FieldValue::Bool(_)) => "a boolean where a pose is wanted",
        (_, FieldValue::Bool(_)) => "a boolean where a number is wanted",
        ("a pose", _) => "text where a pose is wanted",
        _ => "text where a number is wanted",
    }
}

fn fault(pose: &Pose) -> Option<What> {
    let parts = [pose.x_m, pose.y_m, pose.z_m, pose.qx, pose.qy, pose.qz, pose.qw];
    let length = pose.qx * pose.qx + pose.qy * pose.qy + pose.qz * pose.qz + pose.qw * pose.qw;
    if parts.iter().any(|part| part.is_nan()) {
        Some(What::NotANumber)
    } else if parts.iter().any(|part| part.is_infinite()) || length.is_infinite() {
        Some(What::Infinite)
    } else if length < 1e-12 {
        Some(What::NoRotation)
    } else {
        None
    }
}
