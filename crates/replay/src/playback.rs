//! Shows a recording at any instant: it was run once to its end, and marks on the way lead back.

use std::sync::Arc;

use super::run::{Mark, Run, Taken};
use super::{Facts, Flows, Gaps, ReplayError};
use telltale_engine::input::Input;
use telltale_engine::module::system::SYSTEM_GROUP;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::{Record, Recorded};
use telltale_record::story::{Story, of_changes};
use telltale_record::summary::Summary;
use telltale_record::transition::Transition;
use telltale_record::writer::unix_ms;

/// The time between two marks of a short recording.
const MARK_EVERY: Span = Span::from_secs(10);
/// Of more marks than this each second one goes, and their distance doubles.
const MARKS_MAX: usize = 128;
/// Changes that are listed. Further ones are shown, but there is no step to them.
const CHANGES_MAX: usize = 100_000;

/// A recording that was run to its end once.
pub struct Playback {
    run: Run,
    facts: Facts,
    /// The beginning and the marks, each with the time of the last step before it.
    marks: Vec<(Timestamp, Mark)>,
    /// The time of the last step that was taken.
    taken: Timestamp,
    /// The instant that is shown.
    at: Timestamp,
    to: Timestamp,
    changes: Vec<Record>,
    flows: Arc<Flows>,
    gaps: Gaps,
    unheard: Vec<String>,
    unheard_sentences: Vec<String>,
}

impl Playback {
    /// Runs a recording to its end, and shows its first instant.
    ///
    /// # Errors
    /// It holds nothing, or has a configuration that this version cannot read.
    pub fn open(run: Run) -> Result<Playback, ReplayError> {
        Playback::open_while(run, &|| true)
    }

    /// The same. `go_on` is asked before each step.
    ///
    /// # Errors
    /// As there, or it was stopped.
    pub fn open_while(mut run: Run, go_on: &dyn Fn() -> bool) -> Result<Playback, ReplayError> {
        let facts = run.facts().clone();
        let (mut every, mut to) = (MARK_EVERY, None);
        let mut marks = vec![(Timestamp::ZERO, run.mark())];
        let mut changes = Vec::new();
        run.count_messages();
        while let Some(taken) = run.step()? {
            if !go_on() {
                return Err(ReplayError::Stopped);
            }
            to = to.max(Some(taken.at));
            if changes.len() < CHANGES_MAX {
                changes.extend(records(&taken).filter(|record| record.at >= facts.from));
            }
            let last = marks.last().map_or(Timestamp::ZERO, |(at, _)| *at);
            if taken.at.since(last) >= every {
                marks.push((taken.at, run.mark()));
            }
            if marks.len() > MARKS_MAX {
                let mut index = 0;
                marks.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                every = Span::from_nanos(every.as_nanos().saturating_mul(2));
            }
        }
        let to = to.ok_or(ReplayError::Empty)?.max(facts.from);
        let at = facts.from;
        let flows = Arc::new(run.take_flows());
        let gaps = run.gaps().clone();
        let (unheard, unheard_sentences) = (run.unheard_topics(), run.unheard());
        let mut playback = Playback {
            run,
            facts,
            marks,
            taken: to,
            at,
            to,
            changes,
            flows,
            gaps,
            unheard,
            unheard_sentences,
        };
        playback.go_to(at)?;
        Ok(playback)
    }

    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// The instant that is shown.
    pub fn at(&self) -> Timestamp {
        self.at
    }

    /// The last instant.
    pub fn to(&self) -> Timestamp {
        self.to
    }

    /// The changes from the first instant that is shown on, in order.
    pub fn changes(&self) -> &[Record] {
        &self.changes
    }

    /// The states at the first instant that is shown, and then the changes, in order.
    ///
    /// # Errors
    /// The vehicle took a configuration that this version cannot read.
    pub fn records(&mut self) -> Result<Vec<Record>, ReplayError> {
        let (at, from) = (self.at, self.facts.from);
        self.go_to(from)?;
        let present = self.snapshot().map(|first| Record::present(&first, false)).unwrap_or_default();
        self.go_to(at)?;
        // The group of what a recording of others leaves out has nothing to tell.
        let is_left_out = |record: &Record| match &record.what {
            Recorded::Shown { node, state: State::Ignore, .. } => {
                !self.facts.has_journal && **node == *SYSTEM_GROUP
            }
            _ => false,
        };
        // The first one says that the program started, which it did not then.
        let present = present.into_iter().skip(1).filter(|record| !is_left_out(record));
        let present = present.map(|record| Record { at: record.at.max(from), ..record });
        Ok(present.chain(self.changes.iter().cloned()).collect())
    }

    /// How many messages of each topic there are.
    pub fn flows(&self) -> &Arc<Flows> {
        &self.flows
    }

    /// The gaps of the recording.
    pub fn gaps(&self) -> &Gaps {
        &self.gaps
    }

    /// The topics that the configuration reads and the whole recording has no message of, but for those that the recorded
    /// configuration reads too: they were silent.
    pub fn unheard(&self) -> &[String] {
        &self.unheard
    }

    /// All of them, in sentences with those that may be meant.
    pub fn unheard_sentences(&self) -> &[String] {
        &self.unheard_sentences
    }

    /// The time of the first change of a node, the stage or an alarm after the shown instant, or before it.
    pub fn next_change(&self, forwards: bool) -> Option<Timestamp> {
        let is_step = |record: &&Record| !matches!(record.what, Recorded::Started { .. } | Recorded::Lost(_));
        let mut times = self.changes.iter().filter(is_step).map(|record| record.at);
        if forwards { times.find(|at| *at > self.at) } else { times.rfind(|at| *at < self.at) }
    }

    /// The instant of a millisecond, in nanoseconds since 1970: that of its last change, if it has one. Addresses and
    /// pages know no finer times, and lead to what is shown from this change on.
    pub fn instant_of(&self, unix_ns: u64) -> Timestamp {
        let (from, to) = (self.facts.at(unix_ns), self.facts.at(unix_ns.saturating_add(1_000_000)));
        let last = self.changes.iter().rfind(|record| (from..to).contains(&record.at));
        last.map_or(from, |record| record.at)
    }

    /// Shows this instant, or the nearest one that is recorded.
    ///
    /// # Errors
    /// The vehicle took a configuration that this version cannot read.
    pub fn go_to(&mut self, at: Timestamp) -> Result<(), ReplayError> {
        let at = at.clamp(self.facts.from, self.to);
        let nearest = self.marks.iter().rev().find(|(before, _)| *before <= at).or(self.marks.first());
        if let Some((before, mark)) = nearest
            && (self.taken > at || self.taken < *before)
        {
            self.run.go_to(mark);
            self.taken = *before;
        }
        while let Some(taken) = self.run.step_until(at)? {
            self.taken = taken.at;
        }
        self.at = at;
        Ok(())
    }

    /// The story of the recording, as the page of this incident shows it.
    ///
    /// # Errors
    /// The vehicle took a configuration that this version cannot read.
    pub fn story(&mut self, summary: &Summary) -> Result<Story, ReplayError> {
        let all = self.records()?;
        let at_ms = |record: &Record| unix_ms(self.facts.wall(record.at));
        Ok(of_changes(all.iter().map(|record| Transition::of(record, at_ms(record))), summary))
    }

    /// The picture of this instant; `None` if the recording lacks it.
    pub fn snapshot(&mut self) -> Option<Arc<Snapshot>> {
        // The engine takes no tick that it did not take then.
        let mut engine = self.run.engine()?.clone();
        if engine.now() < self.at {
            engine.handle(&Input::Tick, self.at);
        }
        Some(engine.snapshot())
    }
}

/// The changes of a step, with the names that were valid then.
fn records(taken: &Taken) -> impl Iterator<Item = Record> {
    taken.events.iter().filter_map(|event| Record::of(event.clone(), taken.snapshot_of(event)?))
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::collections::BTreeMap;

    use super::*;
    use crate::Recording;
    use telltale_engine::Engine;
    use telltale_engine::input::StatusArray;
    use telltale_engine::model::NodeId;
    use telltale_record::file::{IncidentFile, JOURNAL, KEYFRAMES};
    use telltale_record::journal::{Line, Took};

    const ZERO_NS: u64 = 1_800_000_000_000_000_000;
    const CONFIGURATION: &str =
        "vehicle: { id: v, stages: none }\ngroups: [{ id: a, modules: [{ id: m, status: m }] }]\n";

    /// A recording in which the module says these levels at these microseconds.
    fn playback(said: &[(u64, u8)]) -> Playback {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let path = folder.join("incident-1.mcap");
        let about = BTreeMap::from([("start_of_clock_ns".to_owned(), ZERO_NS.to_string())]);
        let mut file = IncidentFile::create(&path, about).unwrap();
        file.attach("configuration/v.yaml", "application/yaml", 1, CONFIGURATION.as_bytes()).unwrap();
        let loaded = telltale_config::parse("v.yaml", CONFIGURATION).unwrap_or_else(|it| panic!("{it}"));
        file.json(&KEYFRAMES, ZERO_NS, &Engine::begin(loaded.model, Timestamp::ZERO).keyframe()).unwrap();
        for &(us, level) in said {
            let mut array = StatusArray::default();
            array.push_status(level, "m", "as it is", "");
            let took = Took::Input(Cow::Owned(Input::Diagnostics(array)));
            let line = Line { at_ns: Timestamp::from_nanos(1000 * us), took, message: None, left_out: None };
            file.json(&JOURNAL, ZERO_NS + 1000 * us, &line).unwrap();
        }
        file.finish().unwrap();
        Playback::open(Run::recorded(Recording::open(&path).unwrap()).unwrap()).unwrap()
    }

    #[test]
    fn a_millisecond_is_that_of_its_last_change() {
        let mut playback = playback(&[(1_000_100, 0), (1_000_400, 2), (1_000_900, 0), (1_002_300, 2)]);
        let ms = |ms: u64| ZERO_NS + 1_000_000 * ms;
        let us = |us: u64| Timestamp::from_nanos(1000 * us);
        for (asked, found) in [
            (ms(1000), us(1_000_900)),
            (ms(1002), us(1_002_300)),
            // Nothing changes in it.
            (ms(1001), us(1_001_000)),
            (ms(2000), us(2_000_000)),
        ] {
            assert_eq!(playback.instant_of(asked), found, "{asked}");
        }
        for (asked, state) in [(999, "unknown"), (1000, "ok"), (1001, "ok"), (1002, "error")] {
            playback.go_to(playback.instant_of(ms(asked))).unwrap();
            let snapshot = playback.snapshot().unwrap();
            let Some(NodeId::Module(module)) = snapshot.node("a/m") else { panic!("it is a module") };
            assert_eq!(snapshot.module(module).1.state.as_str(), state, "{asked}");
        }
    }
}
