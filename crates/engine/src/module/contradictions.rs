//! The module `telltale/writers`: names that several writers report differently, or that a writer reports
//! without permission.

use crate::files::{count, pairs};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use super::system::SystemCheck;
use crate::Engine;
use crate::snapshot::Report;
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use crate::timers::TimerKey;

/// Names that are listed at once; for more, the message says that there are more.
const LISTED_MAX: usize = 64;
/// A dispute is shown for this long after its last occurrence.
const HOLD: Span = Span::from_secs(10);
/// The least time between two new texts: a flood must not change the page with every message.
const WRITE_EVERY: Span = Span::from_secs(1);
/// Bytes of a name in the message, enough to recognize it.
const NAME_BYTES_MAX: usize = 128;

/// A dispute about the writers of a name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Dispute {
    /// Two writers report different states, for longer than a moment.
    Contradiction { worse: (Arc<str>, State), better: (Arc<str>, State) },
    /// A writer that the configuration does not admit; its report does not count. The last one is named.
    NotAdmitted {
        who: Arc<str>,
        #[serde(deserialize_with = "count")]
        count: u64,
    },
    /// More writers than are kept apart.
    TooManyWriters,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Listed {
    dispute: Dispute,
    last: Timestamp,
}

/// By name and kind of dispute.
type Key = (Arc<str>, u8);

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Disputes {
    #[serde(with = "pairs")]
    listed: BTreeMap<Key, Listed>,
    /// The time of the last dispute that is not listed.
    more: Option<Timestamp>,
    /// The message is not up to date.
    changed: bool,
    written: Option<Timestamp>,
    /// The earliest time at which an entry expires.
    lapse: Option<Timestamp>,
}

impl Dispute {
    fn kind(&self) -> u8 {
        match self {
            Dispute::Contradiction { .. } => 0,
            Dispute::NotAdmitted { .. } => 1,
            Dispute::TooManyWriters => 2,
        }
    }

    fn say(&self, name: &str) -> Text {
        match self {
            Dispute::Contradiction { worse, better } => say!(
                "{name}: {a} says {worse}, {b} says {better}; the worse counts",
                "{name}: {a} meldet {worse}, {b} meldet {better}; das Schlechtere zählt",
                name,
                a = &*worse.0,
                worse = word(worse.1),
                b = &*better.0,
                better = word(better.1)
            ),
            Dispute::NotAdmitted { who, count } => say!(
                "{name}: {who} may not say it; statuses not counted: {count}",
                "{name}: {who} darf das nicht melden; nicht gezählte Meldungen: {count}",
                name,
                who = &**who,
                count
            ),
            Dispute::TooManyWriters => say!(
                "{name}: more writers than can be told apart; the worst count",
                "{name}: mehr Sender, als sich unterscheiden lassen; die schlechtesten zählen",
                name
            ),
        }
    }
}

fn word(state: State) -> Text {
    let (en, de) = match state {
        State::Ok => ("OK", "OK"),
        State::Warning => ("WARNING", "WARNUNG"),
        State::Error => ("ERROR", "FEHLER"),
        State::Unknown => ("UNKNOWN", "UNBEKANNT"),
        State::Ignore => ("IGNORE", "IGNORIERT"),
    };
    Text { en: en.into(), de: de.into() }
}

impl Disputes {
    /// Returns whether a further name is in dispute.
    fn note(&mut self, name: Arc<str>, dispute: Dispute, now: Timestamp) -> bool {
        self.lapse.get_or_insert(now + HOLD);
        let full = self.listed.len() >= LISTED_MAX;
        match self.listed.entry((name, dispute.kind())) {
            Entry::Occupied(mut known) => {
                let known = known.get_mut();
                known.last = now;
                match (&mut known.dispute, dispute) {
                    (Dispute::NotAdmitted { who, count }, Dispute::NotAdmitted { who: latest, .. }) => {
                        *who = latest;
                        *count += 1;
                        self.changed = true;
                    }
                    (before, after) => {
                        self.changed |= *before != after;
                        *before = after;
                    }
                }
                false
            }
            Entry::Vacant(_) if full => self.more.replace(now).is_none(),
            Entry::Vacant(free) => {
                free.insert(Listed { dispute, last: now });
                true
            }
        }
    }

    /// Removes expired entries.
    fn lapse(&mut self, now: Timestamp) {
        self.listed.retain(|_, it| it.last + HOLD > now);
        self.more = self.more.filter(|&last| last + HOLD > now);
        let last = self.listed.values().map(|it| it.last).chain(self.more).min();
        self.lapse = last.map(|last| last + HOLD);
    }

    fn report(&self) -> Report {
        let mut said = self.listed.iter().map(|((name, _), it)| {
            let name = &name[..name.floor_char_boundary(NAME_BYTES_MAX)];
            (name, it.dispute.say(name))
        });
        let Some((_, first)) = said.next() else { return Report::default() };
        let others = said.len() + usize::from(self.more.is_some());
        let others = if self.more.is_some() { format!("{others}+") } else { others.to_string() };
        let message = match &*others {
            "0" => first.clone(),
            _ => say!(
                "{first} (and {others} more)",
                "{first} (und {others} weitere)",
                first = first.clone(),
                others
            ),
        };
        let values = self.listed.iter().map(|((name, _), it)| {
            let name = &name[..name.floor_char_boundary(NAME_BYTES_MAX)];
            (Box::from(name), Box::from(it.dispute.say("").en.trim_start_matches([':', ' '])))
        });
        Report::of_engine(message, values.collect())
    }
}

impl Engine {
    pub(crate) fn note_dispute(&mut self, name: Arc<str>, dispute: Dispute) {
        let anew = self.disputes.note(name, dispute, self.now);
        let due = self.disputes.written.is_none_or(|written| self.now.since(written) >= WRITE_EVERY);
        if anew || self.disputes.changed && due {
            self.show_disputes();
        }
        self.arm_disputes();
    }

    /// Updates the message after time has passed.
    pub(crate) fn judge_disputes(&mut self) {
        self.disputes.lapse(self.now);
        self.show_disputes();
        self.arm_disputes();
    }

    /// Continues the disputes from before a reload.
    pub(crate) fn keep_disputes(&mut self, old: &mut Engine) {
        self.disputes = std::mem::take(&mut old.disputes);
        self.arm_disputes();
    }

    fn arm_disputes(&mut self) {
        if let Some(due) = self.disputes.lapse {
            self.timers.arm(TimerKey::Disputes, due);
        }
    }

    fn show_disputes(&mut self) {
        (self.disputes.changed, self.disputes.written) = (false, Some(self.now));
        let state = if self.disputes.listed.is_empty() { State::Ok } else { State::Warning };
        let id = self.net.system_module(SystemCheck::Writers);
        if self.is_left_out(id) && !self.take_back(id, state) {
            return;
        }
        if self.net.report(id, state, self.now) {
            self.net.mark_module(id);
        }
        self.views.set_said(id, self.disputes.report());
        self.views.note_heard(id);
    }
}
