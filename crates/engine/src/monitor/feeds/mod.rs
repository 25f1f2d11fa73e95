//! Passes messages, probe results and KeyValues to the monitors that watch them.

mod keys;
mod topic_fault;
mod windows;

use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

use super::{Monitor, MonitorKind, WORDS_EVERY, Words};
use crate::files::KeyframeError;
use crate::model::monitors::{MonitorSpec, Source, TopicId, TopicSpec, ValueSource, WatchdogSpec};
use crate::model::sample::{FieldValue, Probe, PublisherReport, Sample};
use crate::model::{Model, ModuleId, Policy};
use crate::signals::SignalSample;
use crate::state::State;
use crate::time::{Span, Timestamp};
use topic_fault::Judged;
use windows::Blocked;

/// All monitors and their inputs. A keyframe has what does not follow from the configuration, and is not about one
/// input that is over.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Watching {
    #[serde(rename = "monitors")]
    pub(crate) watches: Vec<Watch>,
    /// By [`ModuleId`], for declared modules.
    #[serde(skip)]
    of_module: Vec<Option<u32>>,
    /// By [`TopicId`].
    topics: Vec<WatchedTopic>,
    #[serde(skip)]
    topic_names: HashMap<Box<str>, u32>,
    /// Each probe with its monitors.
    #[serde(skip)]
    probes: Vec<(Arc<WatchdogSpec>, Vec<u32>)>,
    #[serde(skip)]
    statuses: HashMap<Arc<str>, WatchedStatus>,
    /// The modules that count the modules of their group, each with its monitor and the number of nested groups.
    #[serde(skip)]
    counts: Vec<(ModuleId, u32, usize)>,
    /// Names of the present array, kept to save allocations.
    #[serde(skip)]
    touched: Vec<Arc<str>>,
    /// Monitors to judge, kept to save allocations.
    #[serde(skip)]
    pub(crate) judge: Vec<u32>,
    /// Modules that became relevant or ceased to be.
    pub(crate) turned: Vec<ModuleId>,
    /// After a start or a reload, the time until which discovery may not have found every publisher.
    pub(crate) searching_until: Option<Timestamp>,
}

/// The use of a monitor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Module(ModuleId),
    /// The condition of the signal of this position.
    Signal(usize),
}

impl Default for Purpose {
    fn default() -> Purpose {
        Purpose::Signal(0)
    }
}

/// A monitor, and its published judgement.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Watch {
    #[serde(skip)]
    pub(crate) purpose: Purpose,
    monitor: Monitor,
    #[serde(skip)]
    topics: Box<[TopicId]>,
    #[serde(skip)]
    by_the_clock: bool,
    /// Its inputs come over DDS.
    #[serde(skip)]
    from_dds: bool,
    said: Option<State>,
    /// The time at which time alone changes its state, or somewhat earlier.
    due: Option<Timestamp>,
    /// The time at which its message was last written.
    worded: Option<Timestamp>,
    /// The measured values may have changed since then.
    pending: bool,
    running: bool,
    blocked: Option<Blocked>,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct WatchedTopic {
    #[serde(skip)]
    spec: Arc<TopicSpec>,
    /// In the order of the monitors, then of their slots.
    #[serde(skip)]
    readers: Vec<FieldWatcher>,
    /// The publishers, from discovery; without them nothing is concluded.
    news: Option<Publishers>,
    /// A message came, so the topic has a publisher whatever discovery reports.
    heard: bool,
    /// Its publishers left, and no message came since.
    left: bool,
    /// Before the first report of discovery: the time until which it may not have found every publisher.
    searched_until: Option<Timestamp>,
}

/// The times of publication are known to this.
pub(super) const TOGETHER: Span = Span::from_secs(1);

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Publishers {
    publishers: u32,
    other_type: Option<Box<str>>,
    #[serde(default)]
    transient_local: bool,
    #[serde(default)]
    best_effort: bool,
}

/// What publishers do for a reader that lost a message, or comes later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keeping {
    /// Nothing: one of them is best effort.
    BestEffort,
    Volatile,
    TransientLocal,
}

impl Publishers {
    /// Nothing is known without publishers.
    fn keeping(&self) -> Option<Keeping> {
        (self.publishers > 0).then_some(match (self.best_effort, self.transient_local) {
            (true, _) => Keeping::BestEffort,
            (false, true) => Keeping::TransientLocal,
            (false, false) => Keeping::Volatile,
        })
    }
}

#[derive(Debug, Clone)]
struct FieldWatcher {
    watch: u32,
    slot: u32,
    /// `None`: the message itself.
    field: Option<u32>,
}

/// A status with watched KeyValues.
#[derive(Debug, Clone, Default)]
struct WatchedStatus {
    keys: Vec<KeyWatcher>,
    /// The position of the worst status of this name in the present array.
    position: Option<usize>,
}

#[derive(Debug, Clone)]
struct KeyWatcher {
    watch: u32,
    slot: u32,
    key: Arc<str>,
    unit: Option<Arc<str>>,
    as_text: bool,
}

/// The result of judging a monitor.
#[derive(Debug)]
pub(crate) struct Judgement {
    pub(crate) state: Option<State>,
    /// Whether the state changed.
    pub(crate) changed: bool,
    pub(crate) words: Option<Words>,
    /// The message only tells that an input is too old.
    pub(crate) aged: bool,
    /// The time of the next judgement.
    pub(crate) due: Option<Timestamp>,
}

impl Watch {
    /// Returns whether that ends a search for publishers.
    fn found(&mut self, slot: usize, now: Timestamp) -> bool {
        let found = self.monitor.found(slot, now);
        if found {
            self.due = None;
        }
        found
    }

    /// A message that is not counted still shows that there is a publisher. Returns whether the time of a
    /// judgement changed.
    fn late(&mut self, slot: usize, now: Timestamp) -> bool {
        let found = self.found(slot, now);
        let begins = self.monitor.late(now);
        if begins {
            self.due = None;
        }
        found || begins
    }
}

impl Watching {
    pub(crate) fn new(model: &Model) -> Watching {
        let topic = |spec: &Arc<TopicSpec>| WatchedTopic { spec: spec.clone(), ..WatchedTopic::default() };
        let names = model.watched.topics.iter().zip(0..).map(|(spec, index)| (spec.topic.clone(), index));
        let mut watching = Watching {
            topics: model.watched.topics.iter().map(topic).collect(),
            topic_names: names.collect(),
            probes: model.watched.watchdogs.iter().map(|spec| (spec.clone(), Vec::new())).collect(),
            of_module: vec![None; model.modules.len()],
            ..Watching::default()
        };
        for (index, module) in model.modules.iter().enumerate() {
            let spec = module.monitor.other();
            if let Some((spec, mut monitor)) =
                spec.and_then(|it| Some((it, Monitor::new(it, &model.watched)?)))
            {
                monitor.follow(&module.policy);
                let (id, watch) = (ModuleId(index as u32), watching.watches.len() as u32);
                watching.of_module[index] = Some(watch);
                if matches!(spec, MonitorSpec::Count { .. }) {
                    let nested =
                        model.groups.iter().filter(|group| group.parent == Some(module.group)).count();
                    watching.counts.push((id, watch, nested));
                }
                watching.add(Purpose::Module(ModuleId(index as u32)), spec, monitor);
            }
        }
        for (index, signal) in model.signals.iter().enumerate() {
            let spec = signal.source.condition();
            if let Some((spec, monitor)) = spec.and_then(|it| Some((it, Monitor::new(it, &model.watched)?))) {
                watching.add(Purpose::Signal(index), spec, monitor);
            }
        }
        watching
    }

    fn add(&mut self, purpose: Purpose, spec: &MonitorSpec, monitor: Monitor) {
        let watch = self.watches.len() as u32;
        let (mut topics, mut from_dds) = (Vec::new(), false);
        for (slot, source) in (0..).zip(spec.clone().sources()) {
            from_dds = true;
            let (topic, field) = match source {
                Source::Messages(topic) => (*topic, None),
                Source::Value(ValueSource::Field { topic, field }) => (*topic, Some(*field)),
                Source::Value(ValueSource::Key { status, key, unit }) => {
                    let (key, unit) = (key.clone(), unit.clone());
                    let reader =
                        KeyWatcher { watch, slot, key, unit, as_text: monitor.wants_words(slot as usize) };
                    self.statuses.entry(status.clone()).or_default().keys.push(reader);
                    continue;
                }
                Source::Probe(probe) => {
                    let (spec, readers) = &mut self.probes[probe.0 as usize];
                    from_dds = spec.target.asks_dds();
                    readers.push(watch);
                    continue;
                }
            };
            self.topics[topic.0 as usize].readers.push(FieldWatcher { watch, slot, field });
            topics.push(topic);
        }
        self.watches.push(Watch {
            purpose,
            monitor,
            topics: topics.into(),
            by_the_clock: spec.about().by_the_clock,
            from_dds,
            said: None,
            due: None,
            worded: None,
            pending: false,
            running: false,
            blocked: None,
        });
    }

    /// The id of the topic of a message that was read for this configuration.
    fn topic(&self, source: &Arc<TopicSpec>) -> Option<TopicId> {
        let index = *self.topic_names.get(&source.topic)?;
        let spec = &self.topics[index as usize].spec;
        (Arc::ptr_eq(spec, source) || spec == source).then_some(TopicId(index))
    }

    /// Takes a message and adds the monitors to judge. Returns its topic, or `None` if it was read for another
    /// configuration.
    pub(crate) fn take_sample(
        &mut self,
        sample: &Sample,
        now: Timestamp,
        judge: &mut Vec<u32>,
    ) -> Option<TopicId> {
        let id = self.topic(&sample.source)?;
        let (topic, at) = (&mut self.topics[id.0 as usize], now - sample.delay);
        if sample.values.len() != topic.spec.fields.len() {
            return None;
        }
        // Then somebody publishes it, whatever the message is about.
        let is_found = (topic.heard, topic.left) != (true, false);
        (topic.heard, topic.left) = (true, false);
        for reader in &topic.readers {
            let (watch, slot) = (&mut self.watches[reader.watch as usize], reader.slot as usize);
            match reader.field.map(|field| &sample.values[field as usize]) {
                None if sample.late => {
                    if watch.late(slot, now) {
                        judge.push(reader.watch);
                    }
                    continue;
                }
                None => {
                    watch.found(slot, now);
                    watch.monitor.take_message(slot, sample, at);
                }
                // The kept messages of several publishers come in any order.
                Some(_)
                    if sample.late && watch.monitor.told(slot).is_some_and(|last| at + TOGETHER < last) =>
                {
                    continue;
                }
                Some(FieldValue::Absent) if !is_found => continue,
                Some(FieldValue::Absent) => {}
                Some(value) => {
                    watch.found(slot, now);
                    watch.monitor.take_field(slot, value, sample, at);
                }
            }
            watch.pending = true;
            if judge.last() != Some(&reader.watch) {
                judge.push(reader.watch);
            }
        }
        Some(id)
    }

    /// Takes a report of discovery; `None` if it is about a topic of another configuration.
    pub(crate) fn take_news(
        &mut self,
        news: &PublisherReport,
        now: Timestamp,
        judge: &mut Vec<u32>,
    ) -> Option<()> {
        let id = self.topic(&news.source)?;
        let topic = &mut self.topics[id.0 as usize];
        topic.left |= news.publishers == 0;
        let returned = topic.left && news.publishers > 0;
        let PublisherReport { source: _, publishers, other_type, transient_local, best_effort, anew } =
            news.clone();
        let news = topic.news.insert(Publishers { publishers, other_type, transient_local, best_effort });
        let keeping = news.keeping();
        judge.extend(topic.readers.iter().map(|reader| reader.watch));
        judge.dedup();
        for reader in &topic.readers {
            let watch = &mut self.watches[reader.watch as usize];
            watch.found(reader.slot as usize, now);
            if returned || anew {
                watch.monitor.returned(reader.slot as usize, now);
            }
            watch.monitor.publishers(reader.slot as usize, keeping, now);
            watch.pending = true;
        }
        Some(())
    }

    pub(crate) fn take_probe(&mut self, probe: &Probe, now: Timestamp, judge: &mut Vec<u32>) -> Option<()> {
        let same = |spec: &Arc<WatchdogSpec>| Arc::ptr_eq(spec, &probe.source) || *spec == probe.source;
        let (_, readers) = self.probes.iter().find(|(spec, _)| same(spec))?;
        for &index in readers {
            let watch = &mut self.watches[index as usize];
            watch.monitor.take_probe(&probe.outcome, now);
            watch.pending = true;
            judge.push(index);
        }
        Some(())
    }

    /// Judges a monitor at `now`. Its message is written when the state changes, otherwise rarely.
    pub(crate) fn judge(&mut self, index: u32, policy: &Policy, now: Timestamp) -> Judgement {
        let Judged { judged, topic_fault, state } = self.look(index, policy, now);
        let watch = &mut self.watches[index as usize];
        let changed = std::mem::replace(&mut watch.said, state) != state;
        let words_due = watch.worded.filter(|_| watch.pending).map(|worded| worded + WORDS_EVERY);
        let write = changed || (watch.pending && words_due.is_none_or(|due| due <= now));
        if write {
            watch.worded = Some(now);
            watch.pending = watch.monitor.moves(now);
        }
        // Further messages of one topic only postpone the effect of time, which need not be computed each time.
        let put_off = matches!(watch.monitor, Monitor::Frequency(_)) && !changed;
        if !put_off || watch.due.is_none_or(|due| due <= now) {
            watch.due = watch.monitor.due(now);
        }
        let watch = &self.watches[index as usize];
        let words = write.then(|| {
            let words = watch.monitor.words(now);
            if watch.by_the_clock && judged.is_none() {
                words
            } else {
                let beside = watch.by_the_clock || judged.is_some() && judged == state;
                self.say(topic_fault, beside, words)
            }
        });
        let words_due = watch.worded.filter(|_| watch.pending).map(|worded| worded + WORDS_EVERY);
        let due = [words_due, watch.due].into_iter().flatten().filter(|&due| due > now).min();
        let aged = topic_fault.is_none() && watch.monitor.is_aged(now);
        Judgement { state, changed, words, aged, due }
    }

    /// Whether the condition of a signal holds, and the time of its oldest input; `None` while an input is
    /// unknown.
    pub(crate) fn condition(&mut self, index: u32, now: Timestamp) -> Option<SignalSample> {
        let Monitor::Expression(expression) = &mut self.watches[index as usize].monitor else { return None };
        let is = match expression.judge(now)? {
            State::Error => true,
            State::Ok => false,
            State::Unknown | State::Warning | State::Ignore => return None,
        };
        Some(SignalSample { is, at: expression.oldest()? })
    }

    pub(crate) fn by_the_clock(&self, index: u32) -> bool {
        self.watches[index as usize].by_the_clock
    }

    /// Whether the reports of a module come over DDS; a status does.
    pub(crate) fn hears_dds(&self, id: ModuleId) -> bool {
        let index = self.of_module.get(id.0 as usize).copied().flatten();
        index.is_none_or(|index| self.watches[index as usize].from_dds)
    }

    /// Continues a monitor with the same meaning from before a reload, by its module's policy of now.
    pub(crate) fn keep(&mut self, id: ModuleId, policy: &Policy, old: &Watching, before: ModuleId) {
        let index =
            |watching: &Watching, id: ModuleId| watching.of_module.get(id.0 as usize).copied().flatten();
        let Some((index, before)) = index(self, id).zip(index(old, before)) else { return };
        let before = &old.watches[before as usize];
        let watch = &mut self.watches[index as usize];
        watch.monitor = before.monitor.clone();
        watch.monitor.follow(policy);
        (watch.said, watch.worded) = (before.said, before.worded);
        (watch.pending, watch.running, watch.blocked) = (before.pending, before.running, before.blocked);
    }

    /// Continues the inputs of a condition with the same meaning from before a reload.
    pub(crate) fn keep_condition(&mut self, signal: usize, old: &Watching, before: usize) {
        let of = |watch: &Watch, signal| watch.purpose == Purpose::Signal(signal);
        let Some(before) = old.watches.iter().find(|watch| of(watch, before)) else { return };
        if let Some(watch) = self.watches.iter_mut().find(|watch| of(watch, signal)) {
            watch.monitor = before.monitor.clone();
        }
    }

    /// The modules that count the modules of their group, each with its monitor and the number of nested groups.
    pub(crate) fn counts(&self) -> impl Iterator<Item = (ModuleId, u32, usize)> {
        self.counts.iter().copied()
    }

    /// Sets the number of modules that a monitor has counted. Returns whether it has to be judged.
    pub(crate) fn set_count(&mut self, index: u32, found: u32, now: Timestamp) -> bool {
        let watch = &mut self.watches[index as usize];
        let Monitor::Count(count) = &mut watch.monitor else { return false };
        let changed = count.set(found, now);
        if changed {
            (watch.worded, watch.pending) = (None, true);
        }
        changed
    }

    /// Keeps the reports of discovery about topics that stay, and the remaining time of the search for
    /// publishers.
    pub(crate) fn keep_topics(&mut self, old: &Watching) {
        for topic in &mut self.topics {
            let before = old.topic_names.get(&topic.spec.topic).map(|&index| &old.topics[index as usize]);
            if let Some(same) = before.filter(|before| before.spec.type_name == topic.spec.type_name) {
                (topic.news, topic.heard, topic.left) = (same.news.clone(), same.heard, same.left);
                topic.searched_until = same.searched_until;
            }
        }
    }

    /// Goes on with the state of a keyframe.
    pub(crate) fn resume(&mut self, kept: Watching) -> Result<(), KeyframeError> {
        let Watching { watches, topics, turned, searching_until, .. } = kept;
        KeyframeError::unless_same("monitors", watches.len(), self.watches.len())?;
        KeyframeError::unless_same("topics", topics.len(), self.topics.len())?;
        if turned.iter().any(|id| id.0 as usize >= self.of_module.len()) {
            return Err(KeyframeError::new("a monitor turns for a module that does not exist"));
        }
        (self.turned, self.searching_until) = (turned, searching_until);
        for (watch, kept) in self.watches.iter_mut().zip(watches) {
            let Watch { monitor, said, due, worded, pending, running, blocked, .. } = kept;
            watch.monitor.resume(monitor)?;
            (watch.said, watch.due, watch.worded) = (said, due, worded);
            (watch.pending, watch.running, watch.blocked) = (pending, running, blocked);
        }
        for (topic, kept) in self.topics.iter_mut().zip(topics) {
            let (spec, readers) = (topic.spec.clone(), std::mem::take(&mut topic.readers));
            *topic = WatchedTopic { spec, readers, ..kept };
        }
        Ok(())
    }

    /// Discovery searches for all publishers until then.
    pub(crate) fn search_until(&mut self, until: Timestamp) {
        self.searching_until = Some(until);
        self.topics.iter_mut().for_each(|topic| topic.searched_until = Some(until));
    }
}
