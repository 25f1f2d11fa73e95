//! The transforms along a chain of frames: a link that does not come, a link that is old, a frame with two parents.
//! Only frames of the configuration are remembered, so other frames need no memory.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::MonitorKind;
use super::inputs::nothing_yet;
use super::latency::{StampFault, age};
use super::words::{Words, cut, reason, span};
use crate::files::KeyframeError;
use crate::model::Policy;
use crate::model::monitors::{Bands, TF_MEMORY, TfLink};
use crate::model::sample::{FieldValue, Sample, Transform};
use crate::state::State;
use crate::text::{Text, say};
use crate::time::{Span, Timestamp};

/// Parents of a frame beside the wanted one that are remembered.
const OTHERS_MAX: usize = 2;

/// Slot 2n has the transforms of link n that are sent again and again, slot 2n + 1 those that are sent once.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Tf {
    links: Box<[Link]>,
    #[serde(skip)]
    bands: Bands,
    #[serde(skip)]
    missing: Missing,
    /// Since when its module is relevant, or it began anew.
    since: Option<Timestamp>,
}

/// The state of a transform that does not come: as a silent topic, this state after this time.
#[derive(Debug, Clone, Copy)]
struct Missing {
    state: State,
    after: Span,
}

impl Default for Missing {
    fn default() -> Missing {
        Missing { state: State::Unknown, after: Span::from_nanos(u64::MAX) }
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Link {
    #[serde(skip)]
    parent: Arc<str>,
    #[serde(skip)]
    child: Arc<str>,
    /// The youngest transform from the wanted parent.
    moving: Option<Heard>,
    /// It came as static, so it holds for good, unless it moves too.
    fixed: bool,
    others: Vec<Other>,
    /// The last message about the frame could not be read.
    unreadable: Option<Box<str>>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Heard {
    at: Timestamp,
    /// Its age when it came.
    lag: Span,
    doubt: Option<StampFault>,
    /// A message with the same stamp brings no younger transform, however far in the future the stamp lies.
    #[serde(default)]
    stamp_ns: Option<i64>,
    /// Since this monitor began anew; before the first new one an age within the limits says nothing.
    is_new: bool,
}

/// Another parent than the wanted one.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Other {
    parent: Box<str>,
    at: Timestamp,
    fixed: bool,
}

impl Tf {
    pub(super) fn new(links: &[TfLink], bands: Bands) -> Tf {
        let link = |link: &TfLink| Link {
            parent: link.parent.clone(),
            child: link.child.clone(),
            moving: None,
            fixed: false,
            others: Vec::new(),
            unreadable: None,
        };
        Tf { links: links.iter().map(link).collect(), bands, missing: Missing::default(), since: None }
    }

    /// The state of a missing link, from the policy of the module.
    pub(super) fn follow(&mut self, policy: &Policy) {
        self.missing = Missing { state: policy.stale, after: policy.timeout };
    }
}

impl MonitorKind for Tf {
    fn resume(&mut self, kept: Tf) -> Result<(), KeyframeError> {
        let Tf { links, bands: _, missing: _, since } = kept;
        self.since = since;
        KeyframeError::unless_same("transforms of a monitor", links.len(), self.links.len())?;
        for (link, kept) in self.links.iter_mut().zip(links) {
            let Link { parent: _, child: _, moving, fixed, mut others, unreadable } = kept;
            others.truncate(OTHERS_MAX);
            (link.moving, link.fixed, link.others, link.unreadable) = (moving, fixed, others, unreadable);
        }
        Ok(())
    }

    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.since = None;
        if relevant {
            self.begin_anew(now);
        }
    }

    /// Ages count from now on. A static transform is sent once and stays.
    fn begin_anew(&mut self, now: Timestamp) -> bool {
        self.since = Some(now);
        for link in &mut self.links {
            if let Some(moving) = &mut link.moving {
                *moving = Heard::unaged(now);
            }
            link.others.retain(|other| other.fixed);
            link.unreadable = None;
        }
        true
    }

    /// A link that only ages since then shows nothing, in a WARNING either.
    fn is_proven(&self) -> bool {
        self.links.iter().all(|link| link.moving.is_none_or(|moving| moving.is_new))
    }

    fn take_field(&mut self, slot: usize, value: &FieldValue, sample: &Sample, at: Timestamp) {
        // Its age is that of its stamp.
        let now = at + sample.delay;
        let (link, fixed) = (&mut self.links[slot / 2], slot % 2 == 1);
        match value {
            FieldValue::Transforms(list) => {
                link.unreadable = None;
                list.iter().for_each(|transform| link.take(transform, fixed, sample, now));
            }
            FieldValue::Unreadable(why) => link.unreadable = Some(why.clone()),
            _ => {}
        }
    }

    /// The topic of static transforms has a publisher where one of them is wanted.
    fn needs_publisher(&self, slot: usize) -> bool {
        let link = &self.links[slot / 2];
        if slot % 2 == 1 { link.fixed } else { link.moving.is_some() || !link.fixed }
    }

    /// Until a missing link has used up its time, only ERRORs of other links count.
    fn judge(&mut self, now: Timestamp) -> Option<State> {
        let bands = &self.bands;
        let (mut worst, mut is_open) = (State::Ok, false);
        for link in &mut self.links {
            link.others.retain(|other| other.is_known(now));
            match link.state(bands, now) {
                Some(state) => worst = worst.max(state),
                None => is_open = true,
            }
        }
        match self.since {
            _ if !is_open || worst == State::Error => Some(worst),
            Some(since) if now >= since + self.missing.after => Some(worst.max(self.missing.state)),
            _ => None,
        }
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let next = self.links.iter().flat_map(|link| link.turns(&self.bands));
        let missing = self.since.map(|since| since + self.missing.after);
        next.chain(missing).filter(|&at| at > now).min()
    }

    fn words(&self, now: Timestamp) -> Words {
        let states: Vec<Option<State>> = self.links.iter().map(|link| link.state(&self.bands, now)).collect();
        let all = || self.links.iter().zip(&states);
        let failed = all().find(|(_, state)| **state == Some(State::Error));
        let open = || all().find(|(_, state)| state.is_none());
        // Of equal ones the oldest, or the first.
        let worst = || all().rev().max_by_key(|(link, state)| (**state, link.moving_age(now)));
        let Some((link, state)) = failed.or_else(open).or_else(worst) else { return Words::default() };
        let oldest = self.links.iter().filter_map(|link| link.moving_age(now)).max();
        let values = oldest.map_or(Vec::new(), |age| self.bands.values("age_s", age.as_secs_f64()));
        Words { message: link.say(*state, &self.bands, now), values }
    }
}

impl Other {
    fn is_known(&self, now: Timestamp) -> bool {
        self.fixed || self.at + TF_MEMORY >= now
    }
}

impl Link {
    fn take(&mut self, transform: &Transform, fixed: bool, sample: &Sample, now: Timestamp) {
        if *transform.parent != *self.parent {
            self.take_other(&transform.parent, fixed, now);
        } else if fixed {
            self.fixed = true;
        } else if sample.late {
            // It shows that there is one. Its age is that of our beginning.
            self.moving.get_or_insert(Heard::unaged(now));
        } else {
            let heard = Heard::of(transform, sample, now);
            // tf2 goes by the newest stamp, not by the last message.
            let is_no_older = |known: &Heard| {
                let is_same = known.stamp_ns == heard.stamp_ns;
                known.is_new && known.doubt.is_none() && (is_same || known.age(now) < heard.lag)
            };
            if heard.doubt.is_some() || !self.moving.as_ref().is_some_and(is_no_older) {
                self.moving = Some(heard);
            }
        }
    }

    fn take_other(&mut self, parent: &str, fixed: bool, now: Timestamp) {
        if let Some(known) = self.others.iter_mut().find(|it| *it.parent == *parent) {
            (known.at, known.fixed) = (now, known.fixed || fixed);
            return;
        }
        if self.others.len() >= OTHERS_MAX {
            let passing = (0..self.others.len()).filter(|&at| !self.others[at].fixed);
            let Some(oldest) = passing.min_by_key(|&at| self.others[at].at) else { return };
            self.others.remove(oldest);
        }
        self.others.push(Other { parent: parent.into(), at: now, fixed });
    }

    /// `None` while it did not come.
    fn state(&self, bands: &Bands, now: Timestamp) -> Option<State> {
        if self.two_parents(now).is_some() {
            return Some(State::Error);
        }
        let unreadable = self.unreadable.as_ref().map(|_| State::Unknown);
        let moving = self.moving.as_ref().and_then(|moving| match moving.doubt {
            Some(_) => Some(State::Unknown),
            None => Some(judge(bands, moving.age(now))).filter(|state| moving.is_new || *state != State::Ok),
        });
        let fixed = match &self.moving {
            _ if !self.fixed => None,
            None => Some(State::Ok),
            // The static one would hide that the other one has ended.
            Some(_) => Some(State::Warning),
        };
        moving.max(fixed).max(unreadable)
    }

    fn two_parents(&self, now: Timestamp) -> Option<[&str; 2]> {
        let is_known = |moving: &Heard| moving.is_new && moving.at + TF_MEMORY >= now;
        let wanted = (self.fixed || self.moving.as_ref().is_some_and(is_known)).then_some(&*self.parent);
        let others = self.others.iter().filter(|other| other.is_known(now)).map(|other| &*other.parent);
        let mut parents = wanted.into_iter().chain(others);
        Some([parents.next()?, parents.next()?])
    }

    /// The times at which its state may change without a message.
    fn turns(&self, bands: &Bands) -> impl Iterator<Item = Timestamp> {
        let limits = [bands.warning_above, bands.error_above].into_iter().flatten().map(nanos);
        let too_old = self.moving.into_iter().flat_map(move |moving| {
            let left = move |limit: u64| limit.saturating_sub(moving.lag.as_nanos());
            limits.clone().map(move |limit| moving.at + Span::from_nanos(left(limit)))
        });
        let of_others = self.others.iter().filter(|other| !other.fixed).map(|other| other.at + TF_MEMORY);
        let of_wanted = self.moving.filter(|_| !self.others.is_empty()).map(|it| it.at + TF_MEMORY);
        too_old.chain(of_others).chain(of_wanted).map(|at| at + Span::from_nanos(1))
    }

    fn moving_age(&self, now: Timestamp) -> Option<Span> {
        self.moving.filter(|moving| moving.doubt.is_none()).map(|moving| moving.age(now))
    }

    fn say(&self, state: Option<State>, bands: &Bands, now: Timestamp) -> Text {
        let label = format!("{} -> {}", cut(&self.parent), cut(&self.child));
        if let Some([one, other]) = self.two_parents(now) {
            return say!(
                "{child} has two parents: {one} and {other}",
                "{child} hat zwei Eltern-Frames: {one} und {other}",
                child = cut(&self.child),
                one = cut(one),
                other = cut(other)
            );
        }
        if let Some(why) = self.unreadable.as_ref().filter(|_| state == Some(State::Unknown)) {
            return say!(
                "{label} cannot be read: {why}",
                "{label} nicht lesbar: {why}",
                label,
                why = reason(why)
            );
        }
        let Some(state) = state else {
            return match self.others.last() {
                Some(other) if self.moving.is_none() => say!(
                    "the parent of {child} is {other}, not {parent}",
                    "{child} hängt unter {other}, nicht unter {parent}",
                    child = cut(&self.child),
                    other = cut(&other.parent),
                    parent = cut(&self.parent)
                ),
                _ => nothing_yet(label.into()),
            };
        };
        match self.moving {
            Some(Heard { doubt: Some(doubt), .. }) => {
                say!("{label}: {doubt}", "{label}: {doubt}", label, doubt = doubt.say())
            }
            Some(moving) if self.fixed && judge(bands, moving.age(now)) < State::Error => say!(
                "{label} comes on /tf and on /tf_static",
                "{label} kommt auf /tf und auf /tf_static",
                label
            ),
            Some(_) if state > State::Ok => {
                let limit = if state == State::Error { bands.error_above } else { bands.warning_above };
                let limit = span(Span::from_nanos(limit.map_or(0, nanos)));
                say!("{label} is older than {limit}", "{label} älter als {limit}", label, limit)
            }
            Some(moving) => {
                let age = bands.say_of(moving.age(now).as_secs_f64(), "s".into(), say!("old", "alt"));
                say!("{label}: {age}", "{label}: {age}", label, age)
            }
            None => say!("{label}: static", "{label}: statisch", label),
        }
    }
}

impl Heard {
    /// A stamp of the future is that of a localization which predicts.
    fn of(transform: &Transform, sample: &Sample, now: Timestamp) -> Heard {
        let (lag, doubt) = match age(transform.stamp_ns, sample.received_wall_ns) {
            Ok(seconds) => (Span::from_nanos(nanos(seconds)), None),
            Err(StampFault::Future(_)) => (Span::ZERO, None),
            Err(doubt) => (Span::ZERO, Some(doubt)),
        };
        Heard { at: now, lag, doubt, stamp_ns: transform.stamp_ns, is_new: true }
    }

    /// Without an age yet: it counts from now on.
    fn unaged(now: Timestamp) -> Heard {
        Heard { at: now, lag: Span::ZERO, doubt: None, stamp_ns: None, is_new: false }
    }

    fn age(&self, now: Timestamp) -> Span {
        Span::from_nanos(now.since(self.at).as_nanos().saturating_add(self.lag.as_nanos()))
    }
}

/// Exactly: the next judgement is due one nanosecond above a limit.
fn judge(bands: &Bands, age: Span) -> State {
    let above = |limit: Option<f64>| limit.is_some_and(|limit| age.as_nanos() > nanos(limit));
    if above(bands.error_above) {
        State::Error
    } else if above(bands.warning_above) {
        State::Warning
    } else {
        State::Ok
    }
}

fn nanos(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
