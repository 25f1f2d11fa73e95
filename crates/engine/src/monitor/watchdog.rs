//! Watchdogs: whether a target answers, and how soon; and what is measured of the computer.

use super::MonitorKind;
use super::words::{Words, cut, reason, span};
use crate::files::KeyframeError;
use crate::model::monitors::{Bands, ProbeTarget, ProcessMeasure, Resource, WatchdogSpec};
use crate::model::sample::ProbeOutcome;
use crate::state::State;
use crate::text::{Text, say};
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Watchdog {
    #[serde(skip)]
    misses_max: u32,
    /// Limits of the response time, in seconds; of a node, of its restarts.
    #[serde(skip)]
    bands: Bands,
    /// Whether it checks the QoS of a topic.
    #[serde(skip)]
    qos: bool,
    /// The measured quantity of the computer.
    #[serde(skip)]
    resource: Option<Resource>,
    /// Without any result for this long, nothing is known.
    #[serde(skip)]
    patience: Span,
    /// The time since which the module is relevant.
    since: Option<Timestamp>,
    last: Option<(Timestamp, ProbeOutcome)>,
    /// In a row.
    misses: u32,
    state: Option<State>,
}

/// All announcements but the last.
fn restarts(times: u32) -> f64 {
    f64::from(times.saturating_sub(1))
}

impl Watchdog {
    pub(super) fn new(spec: &WatchdogSpec, misses: u32, bands: Bands) -> Watchdog {
        let misses_max = misses.max(1);
        // A probe may begin one interval late and take one itself.
        let rounds = u64::from(misses_max) + 2;
        let patience = Span::from_nanos(spec.every.as_nanos().saturating_mul(rounds));
        Watchdog {
            misses_max,
            bands,
            qos: matches!(spec.target, ProbeTarget::Qos { .. }),
            resource: match &spec.target {
                ProbeTarget::System(resource) => Some(resource.clone()),
                _ => None,
            },
            patience: patience.max(Span::from_millis(1)),
            since: None,
            last: None,
            misses: 0,
            state: None,
        }
    }
}

impl MonitorKind for Watchdog {
    fn resume(&mut self, kept: Watchdog) -> Result<(), KeyframeError> {
        let Watchdog {
            misses_max: _,
            bands: _,
            qos: _,
            resource: _,
            patience: _,
            since,
            last,
            misses,
            state,
        } = kept;
        (self.since, self.last, self.misses, self.state) = (since, last, misses, state);
        Ok(())
    }

    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.since = relevant.then_some(now);
        (self.last, self.misses, self.state) = (None, 0, None);
    }

    fn take_probe(&mut self, outcome: &ProbeOutcome, now: Timestamp) {
        if self.since.is_none() {
            return;
        }
        match outcome {
            ProbeOutcome::Answered { after } => {
                (self.misses, self.state) = (0, Some(self.bands.judge(after.as_secs_f64())));
            }
            ProbeOutcome::Announced => (self.misses, self.state) = (0, Some(State::Ok)),
            ProbeOutcome::Measured(value) => (self.misses, self.state) = (0, Some(self.bands.judge(*value))),
            ProbeOutcome::Repeated { times } => {
                (self.misses, self.state) = (0, Some(self.bands.judge(restarts(*times))));
            }
            ProbeOutcome::Missed(_) | ProbeOutcome::Inactive { .. } => {
                self.misses = self.misses.saturating_add(1);
                if self.misses >= self.misses_max {
                    self.state = Some(State::Error);
                }
            }
            // A probe that cannot be sent does not show that the target is back.
            ProbeOutcome::Impossible(_) => self.state = self.state.max(Some(State::Unknown)),
        }
        self.last = Some((now, outcome.clone()));
    }

    /// Fewer misses than make an ERROR leave the state unchanged.
    fn judge(&mut self, now: Timestamp) -> Option<State> {
        if now >= self.late_at()? { self.state.max(Some(State::Unknown)) } else { self.state }
    }

    fn due(&self, _now: Timestamp) -> Option<Timestamp> {
        self.late_at()
    }

    fn words(&self, now: Timestamp) -> Words {
        let Some(late_at) = self.late_at() else {
            return Words::plain(say!(
                "not asked while it does not matter",
                "zählt zurzeit nicht, nicht gefragt"
            ));
        };
        if now >= late_at {
            return Words::plain(say!(
                "nobody asked it for {time}",
                "nicht gefragt seit {time}",
                time = span(self.patience)
            ));
        }
        match &self.last {
            None => Words::plain(say!("not asked yet", "noch nicht gefragt")),
            Some((_, ProbeOutcome::Announced)) if self.qos => Words::plain(say!(
                "all publishers and subscribers match",
                "alle Publisher und Subscriber passen zusammen"
            )),
            Some((_, ProbeOutcome::Missed(why))) if self.qos => Words::plain(say!(
                "publishers and subscribers never come together: {why}",
                "Publisher und Subscriber kommen nie zusammen: {why}",
                why = reason(why)
            )),
            Some((_, ProbeOutcome::Answered { after })) => {
                // In milliseconds for people, like the values beside it.
                let bands = self.bands.scaled(1e3);
                let millis = after.as_nanos() as f64 / 1e6;
                let message = if bands == Bands::default() {
                    say!("answers", "antwortet")
                } else {
                    say!(
                        "answers after {time}",
                        "antwortet nach {time}",
                        time = bands.say(millis, "ms".into())
                    )
                };
                Words { message, values: bands.values("answer_ms", millis) }
            }
            Some((_, ProbeOutcome::Announced)) => Words::plain(say!("is running", "läuft")),
            Some((_, ProbeOutcome::Repeated { times })) => Words {
                message: say!(
                    "announced {times} times: it crashed and was started again, or runs more than once",
                    "{times}-mal angekündigt: abgestürzt und neu gestartet, oder mehrfach gestartet",
                    times
                ),
                values: self.bands.values("restarts", restarts(*times)),
            },
            Some((_, ProbeOutcome::Measured(value))) => self.measured(*value),
            Some((_, ProbeOutcome::Missed(why))) if self.resource.is_some() => {
                Words::plain(say!("not running: {why}", "läuft nicht: {why}", why = cut(why)))
            }
            Some((_, ProbeOutcome::Impossible(why))) if self.resource.is_some() => {
                Words::plain(say!("cannot be read: {why}", "nicht lesbar: {why}", why = reason(why)))
            }
            Some((_, ProbeOutcome::Inactive { state })) => Words {
                message: say!(
                    "{state}, active wanted, {misses} of {all} in a row",
                    "{state}, erwartet active, {misses} von {all} in Folge",
                    state = &**state,
                    misses = self.misses.min(self.misses_max).to_string(),
                    all = self.misses_max
                ),
                values: vec![("misses", self.misses.to_string())],
            },
            Some((_, ProbeOutcome::Missed(why))) => Words {
                message: say!(
                    "no answer, {misses} of {all} in a row: {why}",
                    "keine Antwort, {misses} von {all} in Folge: {why}",
                    misses = self.misses.min(self.misses_max).to_string(),
                    all = self.misses_max,
                    why = cut(why)
                ),
                values: vec![("misses", self.misses.to_string())],
            },
            Some((_, ProbeOutcome::Impossible(why))) => {
                Words::plain(say!("it cannot be asked: {why}", "nicht zu fragen: {why}", why = &**why))
            }
        }
    }
}

impl Watchdog {
    fn measured(&self, value: f64) -> Words {
        let (name, unit, what) = match &self.resource {
            Some(Resource::Cpu) => ("cpu_percent", "%", say!("of the processor", "des Prozessors")),
            Some(Resource::Memory) => ("memory_percent", "%", say!("of the memory", "des Speichers")),
            Some(Resource::Disk { .. }) => ("disk_percent", "%", say!("of the disk", "der Platte")),
            Some(Resource::Temperature { .. }) => ("celsius", "°C", Text::default()),
            Some(Resource::Process { measure: Some(ProcessMeasure::Cpu), .. }) => {
                ("cpu_percent", "%", say!("of a core", "eines Kerns"))
            }
            Some(Resource::Process { .. }) => ("memory_mb", "MB", Text::default()),
            None => ("measured", "", Text::default()),
        };
        Words { message: self.bands.say_of(value, unit.into(), what), values: self.bands.values(name, value) }
    }

    fn late_at(&self) -> Option<Timestamp> {
        let since = self.since?;
        Some(self.last.as_ref().map_or(since, |(at, _)| *at) + self.patience)
    }
}
