//! The topics that one participant reads: those of the configuration, and those that are only recorded.
//!
//! Anybody can announce a topic. One without a message takes nothing from others: no type, and no place in a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use tokio::sync::watch;
use tokio::task::{JoinError, JoinSet};

use super::learning::Learning;
use super::topic::{Orders, Topic, TopicContext, TopicState, Trial};
use crate::discovery::graph::OwnParticipants;
use crate::engine_queue::End;
use crate::transport::Found;
use crate::transport::ids::{self, PREFIX, Prefix};
use crate::transport::places;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages;
use telltale_msg::subscription::{Plan, Subscription};

/// Topics that are read for recordings alone, at most.
const RECORDED_MAX: usize = 256;
/// Topics and types that are not read at present, and whose messages are remembered.
const MEMORIES_MAX: usize = 256;
/// A topic without a message keeps its place for so long where others wait for one.
const TRIAL: Span = Span::from_secs(5);
/// A topic keeps its place for so long after its last message where others wait for one.
const SILENT: Span = Span::from_secs(60);
/// A topic that gave its place to others waits for so long before another gives way to it.
const AGAIN_AFTER: Span = Span::from_secs(20);
/// So many topics get a place at once: the DDS process makes a reader for each, and does nothing else meanwhile.
const ADDED_MAX: usize = 64;

/// A topic and its type, by their names on the wire.
pub type Key = (String, String);

/// The result of a task that reads a topic.
pub type Ended = Result<(Key, TopicState, End), JoinError>;

/// State that a participant leaves to the next one.
#[derive(Default)]
pub struct Carryover {
    states: BTreeMap<Key, TopicState>,
}

impl Carryover {
    /// Forgets what the plan does not read any more.
    pub fn keep_what_is_read(&mut self, plan: &Plan) {
        let is_wanted = |known: &Key| {
            let same = |it: &Subscription| key(it) == *known || it.is_untyped() && it.dds_topic == known.0;
            plan.subscriptions.iter().any(|wanted| same(wanted))
        };
        let mut room = RECORDED_MAX;
        let mut is_recorded = |(topic, type_name): &Key| {
            let is_recorded = room > 0 && only_recorded(plan, topic, type_name).is_some();
            room -= usize::from(is_recorded);
            is_recorded
        };
        self.states.retain(|known, _| is_wanted(known) || is_recorded(known));
    }
}

/// The tasks that read, and the channels for their orders.
pub struct Topics {
    pub tasks: JoinSet<(Key, TopicState, End)>,
    running: BTreeMap<Key, Running>,
    /// Those that were told to end, and whether they are only recorded.
    ending: BTreeMap<Key, bool>,
    /// Topics whose type the configuration leaves out.
    learning: Learning,
    around: TopicContext,
    /// Topics that had a place in the recording and no message, and when that ended.
    tried: BTreeMap<Key, Timestamp>,
}

struct Running {
    news: watch::Sender<u64>,
    subscription: watch::Sender<Arc<Subscription>>,
    trial: Arc<Trial>,
    since: Timestamp,
}

impl Topics {
    pub fn start(around: TopicContext, plan: &Plan, carried: &mut Carryover) -> Topics {
        let learning = Learning::new(around.inputs.clone(), around.clock);
        let mut topics = Topics {
            tasks: JoinSet::new(),
            running: BTreeMap::new(),
            ending: BTreeMap::new(),
            learning,
            around,
            tried: BTreeMap::new(),
        };
        for subscription in &topics.typed(plan) {
            topics.add(subscription, Arc::default(), carried);
        }
        topics
    }

    /// The topics of a plan that can be read at once. The types of the others must be learned; types that
    /// were learned before stay.
    fn typed(&mut self, plan: &Plan) -> Vec<Arc<Subscription>> {
        let (untyped, mut typed): (Vec<_>, Vec<_>) =
            plan.subscriptions.iter().cloned().partition(|subscription| subscription.is_untyped());
        for subscription in &untyped {
            for (_, dds_type) in self.running.keys().filter(|(topic, _)| *topic == subscription.dds_topic) {
                let learned = subscription.learn(&messages::ros_type_name(dds_type));
                // A missing definition is reported where the type is learned, so that is done again.
                if let Ok(learned) = learned.map_err(drop)
                    && learned.missing.is_empty()
                {
                    typed.push(Arc::new(learned.subscription));
                }
            }
        }
        let kept: BTreeSet<Key> = typed.iter().map(|subscription| key(subscription)).collect();
        self.learning.follow(untyped, &kept);
        typed
    }

    /// Reads the topics whose type publishers have announced now, and decides for the type that has
    /// messages.
    pub fn learn(&mut self, carried: &mut Carryover) {
        let running = &self.running;
        let before = |key: &Key| carried.states.get(key).and_then(TopicState::heard);
        let last = |key: &Key| running.get(key).map_or_else(|| before(key), |it| it.trial.last());
        let learned = self.learning.look(&self.around.participant, last);
        for key in &learned.over {
            self.end(key);
        }
        for (subscription, is_quiet) in &learned.new {
            self.add(subscription, Arc::new(Trial::new(*is_quiet)), carried);
        }
    }

    /// Reads the topics that are published now and that the plan only records. Telltale's own participants are
    /// left out: a reader of its outputs would count as a listener. Returns whether there are more of them than places.
    pub fn record(&mut self, plan: &Plan, siblings: &OwnParticipants, carried: &mut Carryover) -> bool {
        if !plan.records_more() {
            return false;
        }
        let mut found = self.to_record(plan, siblings);
        let recorded = self.recorded();
        let mut room = RECORDED_MAX.saturating_sub(recorded.len());
        let are_too_many = recorded.len() + found.len() > RECORDED_MAX;
        let now = self.around.clock.now();
        let waiting: BTreeSet<Key> = found.iter().map(|(it, _)| key(it)).collect();
        self.tried.retain(|key, _| waiting.contains(key));
        let had_its_turn = self.tried.values().filter(|at| now.since(**at) < AGAIN_AFTER).count();
        let others = found.len().saturating_sub(had_its_turn + room);
        for key in giving_way(&recorded, others, now) {
            self.end(&key);
            self.tried.insert(key, now);
            room += 1;
        }
        // Of each participant in turn, and those that never had a place before those that had one long ago.
        found.sort_by_key(|(it, _)| self.tried.get(&key(it)).copied());
        for subscription in places::in_turn(found).into_iter().take(room.min(ADDED_MAX)) {
            self.add(&Arc::new(subscription), Arc::default(), carried);
        }
        are_too_many
    }

    /// The topics that are read for the recording.
    fn recorded(&self) -> Vec<Recorded> {
        let seen = self.around.participant.seen();
        let is_published =
            |(topic, type_name): &Key| seen.writers_of(topic).any(|it| it.type_name == *type_name);
        let is_recorded = |it: &Running| it.subscription.borrow().recorded_every().is_some();
        let of = |(key, it): (&Key, &Running)| Recorded {
            key: key.clone(),
            since: it.since,
            is_published: is_published(key),
            last: it.trial.last(),
        };
        self.running.iter().filter(|(_, it)| is_recorded(it)).map(of).collect()
    }

    /// The topics that are to be recorded and are not read, each once, and the participants that announce it.
    fn to_record(&self, plan: &Plan, siblings: &OwnParticipants) -> Vec<(Subscription, BTreeSet<Prefix>)> {
        let own = self.around.participant.guid();
        let seen = self.around.participant.seen();
        let is_new = |found: &&Found| {
            let key = (found.topic.clone(), found.type_name.clone());
            let is_known = || self.running.contains_key(&key) || self.ending.contains_key(&key);
            found.guid[..PREFIX] != own[..PREFIX] && !siblings.has(&found.guid) && !is_known()
        };
        let mut new: BTreeMap<Key, (Subscription, BTreeSet<Prefix>)> = BTreeMap::new();
        for found in seen.writers().filter(is_new) {
            let Some(subscription) = only_recorded(plan, &found.topic, &found.type_name) else { continue };
            let (_, by) = new.entry(key(&subscription)).or_insert((subscription, BTreeSet::new()));
            by.insert(ids::prefix(&found.guid));
        }
        new.into_values().collect()
    }

    fn add(&mut self, subscription: &Arc<Subscription>, trial: Arc<Trial>, carried: &mut Carryover) {
        let key = key(subscription);
        // Its task would be told to end by the one that replaces it.
        if self.running.contains_key(&key) || self.ending.contains_key(&key) {
            return;
        }
        let state = carried.states.remove(&key).unwrap_or_else(|| TopicState::new(subscription));
        let topic = Topic::new(subscription.clone(), self.around.clone(), state, trial.clone());
        let (news, discovered) = watch::channel(0);
        let (change, changed) = watch::channel(subscription.clone());
        let since = self.around.clock.now();
        self.running.insert(key.clone(), Running { news, subscription: change, trial, since });
        self.tasks.spawn(async move {
            let (state, end) = topic.run(Orders { discovered, subscription: changed }).await;
            (key, state, end)
        });
    }

    /// Tells a task to end: it gets no more orders.
    fn end(&mut self, key: &Key) {
        if let Some(running) = self.running.remove(key) {
            let is_recorded = running.subscription.borrow().recorded_every().is_some();
            self.ending.insert(key.clone(), is_recorded);
            if self.running.keys().all(|(topic, _)| *topic != key.0) {
                self.around.paces.forget(&key.0);
            }
        }
    }

    /// Keeps what an ended task leaves. Returns why the participant must end: no task may end that was not told to.
    pub fn ended(&mut self, ended: Ended, carried: &mut Carryover) -> Option<End> {
        let (key, state, end) = match ended {
            Ok(left) => left,
            Err(panic) => return Some(End::Lost(format!("the task of a topic failed: {panic}"))),
        };
        let told = self.ending.remove(&key);
        if is_remembered(told, state.heard().is_some(), carried.states.len()) {
            carried.states.insert(key.clone(), state);
        }
        match end {
            End::Stopped if told.is_some() => None,
            End::Stopped => {
                Some(End::Lost(format!("{} is no longer read, and nobody asked for that", key.0)))
            }
            end => Some(end),
        }
    }

    /// Waits for the end of all tasks, which are told to end.
    pub async fn close(mut self, carried: &mut Carryover) {
        while let Some(ended) = self.tasks.join_next().await {
            self.ended(ended, carried);
        }
    }

    /// Reads the topics of another configuration: topics that stay are read on without a gap.
    ///
    /// # Errors
    /// That needs a new participant.
    pub async fn follow(&mut self, plan: &Plan, carried: &mut Carryover) -> Result<(), End> {
        let mut subscriptions = self.typed(plan);
        let recorded =
            self.running.keys().filter_map(|(topic, type_name)| only_recorded(plan, topic, type_name));
        subscriptions.extend(recorded.map(Arc::new));
        let wanted: BTreeSet<Key> = subscriptions.iter().map(|subscription| key(subscription)).collect();
        let gone = self.running.keys().filter(|key| !wanted.contains(*key)).cloned().collect::<Vec<_>>();
        for key in &gone {
            self.end(key);
        }
        while !self.ending.is_empty()
            && let Some(ended) = self.tasks.join_next().await
        {
            if let Some(end) = self.ended(ended, carried) {
                return Err(end);
            }
        }
        for subscription in &subscriptions {
            if let Some(running) = self.running.get(&key(subscription)) {
                running.subscription.send_replace(subscription.clone());
            } else if gone.iter().any(|(topic, _)| *topic == subscription.dds_topic) {
                return Err(End::Rebuild(format!("{} has another type now", subscription.topic)));
            } else {
                self.add(subscription, Arc::default(), carried);
            }
        }
        Ok(())
    }

    pub fn tell_all(&self) {
        for running in self.running.values() {
            running.news.send_modify(|count| *count += 1);
        }
    }
}

/// The subscription that only records this topic and type, by their names on the wire. None for a name that no ROS
/// topic has: its subscription would be of another topic.
fn only_recorded(plan: &Plan, dds_topic: &str, dds_type: &str) -> Option<Subscription> {
    let topic = dds_topic.strip_prefix("rt").filter(|topic| is_topic_name(topic))?;
    let is_same = |it: &Subscription| it.dds_topic == *dds_topic && it.dds_type == *dds_type;
    plan.recorded(topic, &messages::ros_type_name(dds_type)).filter(is_same)
}

/// Whether it is `/a` or `/a/b`, without an empty part.
fn is_topic_name(name: &str) -> bool {
    name.strip_prefix('/').is_some_and(|parts| parts.split('/').all(|part| !part.is_empty()))
}

fn key(subscription: &Subscription) -> Key {
    (subscription.dds_topic.clone(), subscription.dds_type.clone())
}

/// Whether the state of an ended task is kept beside so many others. `told` as in [`Topics::ending`]. A type that was
/// sent is not taken for a new one when its last message comes again. Anybody can send types and topics without end.
fn is_remembered(told: Option<bool>, has_data: bool, others: usize) -> bool {
    told.is_none_or(|is_recorded| !is_recorded && has_data && others < MEMORIES_MAX)
}

/// A topic that is read for the recording.
struct Recorded {
    key: Key,
    since: Timestamp,
    is_published: bool,
    /// When its last message came.
    last: Option<Timestamp>,
}

/// Those that make room for so many others: first what nobody publishes any more, then what had no message in its time,
/// then what has been silent for longest.
fn giving_way(recorded: &[Recorded], others: usize, now: Timestamp) -> Vec<Key> {
    let is_silent = |it: &Recorded| match it.last {
        None => now.since(it.since) >= TRIAL,
        Some(last) => now.since(last) >= SILENT,
    };
    let mut found: Vec<&Recorded> = recorded.iter().filter(|it| !it.is_published || is_silent(it)).collect();
    found.sort_by_key(|it| (it.is_published, it.last, it.since, &it.key));
    found.iter().take(others.min(ADDED_MAX)).map(|it| it.key.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_config as config;
    use telltale_msg::fields::Definitions;

    #[test]
    fn what_nobody_publishes_any_more_gives_way_and_what_is_sent_stays() {
        let start = Timestamp::ZERO;
        let topic = |name: &str, is_published, last| Recorded {
            key: (name.to_owned(), "type".to_owned()),
            since: start,
            is_published,
            last,
        };
        let (sent, later) = (Some(start), Some(start + TRIAL));
        let recorded = [
            topic("later", true, later),
            topic("sent", true, sent),
            topic("announced", true, None),
            topic("left", false, sent),
        ];
        let names = |others, now| {
            giving_way(&recorded, others, now).into_iter().map(|(name, _)| name).collect::<Vec<_>>()
        };
        assert_eq!(names(9, start), ["left"]);
        assert_eq!(names(1, start + TRIAL), ["left"]);
        assert_eq!(names(9, start + TRIAL), ["left", "announced"]);
        assert_eq!(names(9, start + SILENT), ["left", "announced", "sent"]);
        assert_eq!(names(9, start + SILENT + TRIAL), ["left", "announced", "sent", "later"]);
    }

    #[test]
    fn topics_that_were_only_recorded_leave_nothing_and_others_leave_a_bounded_number() {
        assert!(is_remembered(None, false, MEMORIES_MAX), "the next participant reads it on");
        assert!(is_remembered(Some(false), true, MEMORIES_MAX - 1));
        assert!(!is_remembered(Some(false), true, MEMORIES_MAX));
        assert!(!is_remembered(Some(false), false, 0) && !is_remembered(Some(true), true, 0));
    }

    #[test]
    fn only_names_that_ros_gives_are_recorded_each_as_itself() {
        let text = "
vehicle: { stages: none }
recording: { topics: [{ topic: '/*' }] }
groups: [{ id: g, modules: [{ id: m, status: s }] }]
";
        let model = config::parse("c", text).unwrap().model;
        let plan = Plan::of(&model, &Definitions::default()).unwrap();
        let long = format!("rt/{}", "x".repeat(900));
        let names = [
            ("rt/camera", true),
            ("rt/a/b", true),
            (long.as_str(), true),
            ("", false),
            ("rt", false),
            ("rt/", false),
            ("rt//", false),
            ("rt///", false),
            ("rt//a", false),
            ("rt/a/", false),
            ("rt/a//b", false),
            ("rta", false),
            ("rq/a", false),
            ("/a", false),
        ];
        for (name, expected) in names {
            let found = only_recorded(&plan, name, "std_msgs::msg::dds_::String_");
            assert_eq!(found.is_some(), expected, "{name:?}");
            assert!(found.is_none_or(|it| it.dds_topic == name), "{name:?}");
        }
    }
}
