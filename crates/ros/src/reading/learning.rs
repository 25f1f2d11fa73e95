//! Topics whose type the configuration leaves out: they wait for a publisher, and are read with its type. Where several
//! types are announced, each is read until there is a message of one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use tokio::sync::mpsc;

use super::topics::Key;
use crate::transport::Participant;
use crate::transport::ids::{self, Prefix};
use crate::transport::places;
use telltale_clock::Clock;
use telltale_engine::input::{Input, ReceptionTrouble, TroubleKind};
use telltale_engine::model::sample::PublisherReport;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages;
use telltale_msg::received::Stamped;
use telltale_msg::subscription::{Learned, Subscription};

/// A topic is reported to have no publisher only after discovery had this time.
const DISCOVERY: Span = Span::from_secs(5);

/// Types of one topic that are read at once until there is a message of one.
const TYPES_MAX: usize = 8;
/// Types that have had a message and keep their places while others are tried: of a topic that is sent seldom.
const HEARD_MAX: usize = TYPES_MAX / 2;
/// A type without a message makes room after this time for others that are announced.
const TRIAL: Span = Span::from_secs(5);

/// The types of a topic, and the participants that announce each.
type Announced = BTreeMap<String, BTreeSet<Prefix>>;

/// The topics of a configuration that have no type, each once.
pub struct Learning {
    topics: BTreeMap<String, Untyped>,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
}

struct Untyped {
    subscription: Arc<Subscription>,
    searching_until: Timestamp,
    /// The types that were reported last; the engine counts one that it cannot take.
    said: Option<BTreeSet<String>>,
    /// The types by which it is read, and since when.
    tried: BTreeMap<String, (Key, Timestamp)>,
    /// When a type ended that made room for others.
    made_room: BTreeMap<String, Timestamp>,
    /// The announced types that cannot be read, and why: they take no turn of others.
    refused: BTreeMap<String, String>,
    /// The type that has messages.
    chosen: Option<String>,
}

/// The topics to read from now on, and those to leave.
#[derive(Debug, Default)]
pub struct News {
    /// With whether nothing is said of it before its first message.
    pub new: Vec<(Arc<Subscription>, bool)>,
    pub over: Vec<Key>,
}

impl Learning {
    pub fn new(inputs: mpsc::Sender<Stamped>, clock: Clock) -> Learning {
        Learning { topics: BTreeMap::new(), inputs, clock }
    }

    /// Learns the types of these topics only. Those that are `kept` are read on.
    pub fn follow(&mut self, untyped: Vec<Arc<Subscription>>, kept: &BTreeSet<Key>) {
        let searching_until = self.clock.now() + DISCOVERY;
        let mut before = std::mem::take(&mut self.topics);
        let topics = untyped.into_iter().map(|subscription| {
            let (mut tried, chosen) = before
                .remove(&subscription.dds_topic)
                .map_or_else(Default::default, |known| (known.tried, known.chosen));
            tried.retain(|_, (key, _)| kept.contains(key));
            let chosen = chosen.filter(|chosen| tried.contains_key(chosen));
            let topic = subscription.dds_topic.clone();
            let (made_room, refused) = Default::default();
            (topic, Untyped { subscription, searching_until, said: None, tried, made_room, refused, chosen })
        });
        self.topics = topics.collect();
    }

    /// The topics that can be read now and could not be read before, and those that are no longer read because there are
    /// messages of another type.
    pub fn look(&mut self, participant: &Participant, last: impl Fn(&Key) -> Option<Timestamp>) -> News {
        if self.topics.is_empty() {
            return News::default();
        }
        let is_searching = participant.is_searching();
        let mut types: BTreeMap<String, Announced> = BTreeMap::new();
        let seen = participant.seen();
        for topic in self.topics.keys() {
            for writer in seen.writers_of(topic) {
                let type_name = messages::ros_type_name(&writer.type_name);
                let by = types.entry(topic.clone()).or_default().entry(type_name).or_default();
                by.insert(ids::prefix(&writer.guid));
            }
        }
        drop(seen);
        self.take(&types, is_searching, last)
    }

    fn take(
        &mut self,
        types: &BTreeMap<String, Announced>,
        is_searching: bool,
        last: impl Fn(&Key) -> Option<Timestamp>,
    ) -> News {
        let now = self.clock.now();
        let none = Announced::new();
        let mut news = News::default();
        for (topic, untyped) in &mut self.topics {
            let found = types.get(topic).unwrap_or(&none);
            untyped.choose(found, now, &last, &mut news.over);
            if untyped.chosen.is_some() {
                continue;
            }
            let is_ambiguous = found.len() > 1 && untyped.tried.is_empty();
            let why = match found.len() {
                0 if now < untyped.searching_until || is_searching || !untyped.tried.is_empty() => {
                    continue;
                }
                _ if is_ambiguous => {
                    let names: Vec<&str> = found.keys().map(String::as_str).collect();
                    Some(format!("published as {}: name one with `type`", names.join(" and ")))
                }
                _ => None,
            };
            for type_name in untyped.next_types(found, now, &last, &mut news.over) {
                let is_quiet = is_ambiguous || !untyped.tried.is_empty();
                match untyped.subscription.learn(&type_name) {
                    Ok(Learned { subscription, missing }) => {
                        if is_quiet || missing.is_empty() || say_missing(&self.inputs, untyped, &missing, now)
                        {
                            let key = (subscription.dds_topic.clone(), subscription.dds_type.clone());
                            untyped.tried.insert(type_name, (key, now));
                            news.new.push((Arc::new(subscription), is_quiet));
                        }
                    }
                    Err(error) => {
                        let why = format!("published as {type_name}: {error}");
                        untyped.refused.insert(type_name, why);
                    }
                }
            }
            // While a type is read, its reader says what there is to say.
            let is_said = untyped.tried.is_empty() || is_ambiguous;
            untyped.refused.retain(|name, _| found.contains_key(name));
            let why = why.or_else(|| untyped.refused.values().next().cloned());
            let names: BTreeSet<&str> = found.keys().map(String::as_str).collect();
            let is_new = untyped.said.as_ref().is_none_or(|said| !said.iter().eq(&names));
            if is_said
                && is_new
                && (found.is_empty() || why.is_some())
                && say(&self.inputs, untyped, &names, why, now)
            {
                untyped.said = Some(names.into_iter().map(str::to_owned).collect());
            }
        }
        news
    }
}

impl Untyped {
    /// Decides for the first type that is sent. It is tried again with the others once it is not sent any more.
    fn choose(
        &mut self,
        found: &Announced,
        now: Timestamp,
        last: impl Fn(&Key) -> Option<Timestamp>,
        over: &mut Vec<Key>,
    ) {
        let is_sent = |key: &Key| last(key).is_some_and(|at| now.since(at) < TRIAL);
        let is_chosen = |name: &String| match self.tried.get(name) {
            Some((key, _)) if found.contains_key(name) => found.len() == 1 || is_sent(key),
            _ => found.is_empty(),
        };
        if self.chosen.as_ref().is_some_and(is_chosen) {
            return;
        }
        let is_found =
            |(name, (key, _)): &(&String, &(Key, Timestamp))| found.contains_key(*name) && is_sent(key);
        self.chosen = self.tried.iter().find(is_found).map(|(name, _)| name.clone());
        if let Some(chosen) = &self.chosen {
            over.extend(
                self.tried.iter().filter(|(name, _)| *name != chosen).map(|(_, (key, _))| key.clone()),
            );
            self.tried.retain(|name, _| name == chosen);
        }
    }

    /// The types to read by, too: the few that had a message last, then of each participant in turn, and those that were
    /// never tried before the others.
    fn next_types(
        &mut self,
        found: &Announced,
        now: Timestamp,
        last: impl Fn(&Key) -> Option<Timestamp>,
        over: &mut Vec<Key>,
    ) -> Vec<String> {
        self.made_room.retain(|name, _| found.contains_key(name));
        let heard = |name: &String| {
            last(&(self.subscription.dds_topic.clone(), messages::dds_type_name(name)?))
                .map(|at| (at, name.clone()))
        };
        let mut heard: Vec<(Timestamp, String)> = found.keys().filter_map(heard).collect();
        heard.sort();
        let keeping: BTreeSet<String> =
            heard.into_iter().rev().take(HEARD_MAX).map(|(_, name)| name).collect();
        let is_other =
            |(name, _): &(&String, _)| !self.tried.contains_key(*name) && !self.refused.contains_key(*name);
        let mut others: Vec<(&String, BTreeSet<Prefix>)> =
            found.iter().filter(is_other).map(|(name, by)| (name, by.clone())).collect();
        others.sort_by_key(|(name, _)| self.made_room.get(*name).copied());
        let mut others = places::in_turn(others);
        // A new participant begins anew with all types.
        others.sort_by_key(|name| !keeping.contains(*name));
        let room = TYPES_MAX.saturating_sub(self.tried.len());
        let too_many = others.len().saturating_sub(room);
        let gives_way = |(name, (_, since)): &(&String, &(Key, Timestamp))| {
            now.since(*since) >= TRIAL && !keeping.contains(*name)
        };
        let silent = self.tried.iter().filter(gives_way);
        let mut silent: Vec<(Timestamp, String)> =
            silent.map(|(name, (_, since))| (*since, name.clone())).collect();
        silent.sort();
        silent.truncate(too_many);
        let room = room + silent.len();
        let others = others.into_iter().take(room).cloned().collect();
        for (_, name) in silent {
            over.extend(self.tried.remove(&name).map(|(key, _)| key));
            self.made_room.insert(name, now);
        }
        others
    }
}

/// Reports the fields of a newly learned type that cannot be read. Returns whether the queue had room.
fn say_missing(
    inputs: &mpsc::Sender<Stamped>,
    untyped: &Untyped,
    missing: &[String],
    received: Timestamp,
) -> bool {
    let topic = (*untyped.subscription.topic).into();
    let (count, text) = (missing.len() as u64, missing.join("; ").into());
    let trouble = ReceptionTrouble { topic, kind: TroubleKind::WrongType, count, text };
    inputs.try_send(Stamped::new(Input::Reception(trouble), received)).is_ok()
}

/// Reports that a topic cannot be read. Returns whether the queue had room; otherwise it is tried again.
fn say(
    inputs: &mpsc::Sender<Stamped>,
    untyped: &Untyped,
    found: &BTreeSet<&str>,
    why: Option<String>,
    received: Timestamp,
) -> bool {
    let topic = &untyped.subscription.topic;
    let trouble = why.map(|text| {
        let (kind, text) = (TroubleKind::WrongType, text.into());
        Input::Reception(ReceptionTrouble { topic: (**topic).into(), kind, count: 1, text })
    });
    let names: Vec<&str> = found.iter().copied().collect();
    let news = untyped.subscription.watched().map(|source| {
        let other_type = (!names.is_empty()).then(|| names.join(", ").into());
        Input::Topic(PublisherReport {
            source: source.clone(),
            publishers: 0,
            other_type,
            transient_local: false,
            best_effort: false,
            anew: false,
        })
    });
    let said: Vec<Input> = trouble.into_iter().chain(news).collect();
    let Ok(room) = inputs.try_reserve_many(said.len()) else { return false };
    for (permit, input) in room.zip(said) {
        permit.send(Stamped::new(input, received));
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_config as config;
    use telltale_msg::fields::Definitions;
    use telltale_msg::subscription::Plan;

    fn learning(room: usize) -> (Learning, mpsc::Receiver<Stamped>) {
        let text = "
vehicle: { stages: none }
groups: [{ id: g, modules: [{ id: m, monitor: { value: { topic: /x, field: data, error_above: 1 } } }] }]
";
        let model = config::parse("c", text).unwrap().model;
        let plan = Plan::of(&model, &Definitions::default()).unwrap();
        let (inputs, received) = mpsc::channel(room);
        let mut learning = Learning::new(inputs, Clock::start());
        let untyped = plan.subscriptions.iter().filter(|it| it.is_untyped()).cloned().collect();
        learning.follow(untyped, &BTreeSet::new());
        (learning, received)
    }

    /// All announced by one participant.
    fn published(types: &[&str]) -> BTreeMap<String, Announced> {
        let types = types.iter().map(|&name| (name.to_owned(), BTreeSet::from([[1; 12]]))).collect();
        BTreeMap::from([("rt/x".to_owned(), types)])
    }

    fn forged(count: usize, name: &str) -> Vec<String> {
        (0..count).map(|number| format!("a/msg/{name}{number:03}")).collect()
    }

    const NOBODY: fn(&Key) -> Option<Timestamp> = |_| None;

    fn names(news: &News) -> Vec<(&str, bool)> {
        news.new.iter().map(|(it, is_quiet)| (&*it.type_name, *is_quiet)).collect()
    }

    #[tokio::test]
    async fn the_one_type_is_read_and_two_are_read_quietly_and_said_once() {
        let (mut learning, mut received) = learning(8);
        let none = learning.take(&BTreeMap::new(), false, NOBODY);
        assert!(none.new.is_empty() && received.try_recv().is_err(), "somebody may come");
        let two = published(&["std_msgs/msg/Float64", "std_msgs/msg/Int32"]);
        let news = learning.take(&two, false, NOBODY);
        assert_eq!(names(&news), [("std_msgs/msg/Float64", true), ("std_msgs/msg/Int32", true)]);
        assert!(learning.take(&two, false, NOBODY).new.is_empty());
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert!(
            trouble.kind == TroubleKind::WrongType && trouble.text.contains("name one with `type`"),
            "{trouble:?}"
        );
        let Input::Topic(news) = received.try_recv().unwrap().input else { panic!() };
        assert_eq!(news.other_type.as_deref(), Some("std_msgs/msg/Float64, std_msgs/msg/Int32"));
        assert!(received.try_recv().is_err(), "once");
        let (mut learning, _received) = super::tests::learning(8);
        let news = learning.take(&published(&["std_msgs/msg/Float64"]), false, NOBODY);
        assert_eq!(names(&news), [("std_msgs/msg/Float64", false)]);
    }

    #[tokio::test]
    async fn a_type_without_a_message_gives_way_to_the_one_that_is_sent() {
        let (mut learning, mut received) = learning(8);
        learning.take(&published(&["std_msgs/msg/Int32"]), false, NOBODY);
        let two = published(&["std_msgs/msg/Float64", "std_msgs/msg/Int32"]);
        let news = learning.take(&two, false, NOBODY);
        assert_eq!(names(&news), [("std_msgs/msg/Float64", true)]);
        let now = learning.clock.now();
        let is_float = |key: &Key| key.1.contains("Float64").then_some(now);
        let news = learning.take(&two, false, is_float);
        assert_eq!(news.over, [("rt/x".to_owned(), "std_msgs::msg::dds_::Int32_".to_owned())]);
        // Whatever is announced later takes nothing from it.
        let three = published(&["std_msgs/msg/Bool", "std_msgs/msg/Float64", "std_msgs/msg/Int32"]);
        let news = learning.take(&three, false, |_| Some(now));
        assert!(news.new.is_empty() && news.over.is_empty(), "{news:?}");
        // Its publisher ends, and another type is sent.
        let news = learning.take(&published(&["std_msgs/msg/Int32"]), false, is_float);
        assert_eq!(names(&news), [("std_msgs/msg/Int32", true)]);
        assert!(received.try_recv().is_err());
    }

    #[tokio::test]
    async fn one_message_of_another_type_takes_nothing_for_long() {
        let (clock, hand) = Clock::standing();
        let (mut learning, _received) = learning(8);
        learning.clock = clock;
        let start = learning.clock.now();
        let is_int = |key: &Key| key.1.contains("Int32").then_some(start);
        learning.take(&published(&["std_msgs/msg/Int32"]), false, NOBODY);
        let two = published(&["std_msgs/msg/Float64", "std_msgs/msg/Int32"]);
        assert!(learning.take(&two, false, is_int).new.is_empty());
        hand.advance(TRIAL);
        let news = learning.take(&two, false, is_int);
        assert_eq!(names(&news), [("std_msgs/msg/Float64", true)]);
        let now = learning.clock.now();
        let both = |key: &Key| Some(if key.1.contains("Int32") { start } else { now });
        let news = learning.take(&two, false, both);
        assert_eq!(news.over, [("rt/x".to_owned(), "std_msgs::msg::dds_::Int32_".to_owned())]);
    }

    #[tokio::test]
    async fn of_many_types_each_gets_its_turn() {
        let (clock, hand) = Clock::standing();
        let (mut learning, _received) = learning(64);
        learning.clock = clock;
        let mut forged = forged(30, "T");
        forged.push("std_msgs/msg/Float64".to_owned());
        let all = published(&forged.iter().map(String::as_str).collect::<Vec<_>>());
        let mut read = Vec::new();
        for _ in 0..6 {
            let news = learning.take(&all, false, NOBODY);
            read.extend(names(&news).iter().map(|(name, _)| (*name).to_owned()));
            let topic = &learning.topics["rt/x"];
            assert!(topic.tried.len() <= TYPES_MAX && topic.made_room.len() <= forged.len());
            hand.advance(TRIAL);
        }
        assert!(read.contains(&"std_msgs/msg/Float64".to_owned()), "{read:?}");
    }

    #[tokio::test]
    async fn a_type_that_is_sent_seldom_keeps_its_place_however_many_are_announced() {
        let (clock, hand) = Clock::standing();
        let (mut learning, _received) = learning(64);
        learning.clock = clock;
        let seldom = "std_msgs/msg/Float64";
        learning.take(&published(&[seldom]), false, NOBODY);
        let forged = forged(40, "T");
        let mut all = published(&forged.iter().map(String::as_str).collect::<Vec<_>>());
        all.get_mut("rt/x").unwrap().insert(seldom.to_owned(), BTreeSet::from([[2; 12]]));
        let heard = learning.clock.now();
        for _ in 0..12 {
            hand.advance(TRIAL);
            let news = learning.take(&all, false, |key| key.1.contains("Float64").then_some(heard));
            assert!(learning.topics["rt/x"].tried.contains_key(seldom), "{news:?}");
        }
    }

    #[tokio::test]
    async fn types_that_had_one_message_each_keep_no_turn_of_a_new_one() {
        let (clock, hand) = Clock::standing();
        let (mut learning, _received) = learning(64);
        learning.clock = clock;
        let sent = forged(60, "T");
        let mut all = published(&sent.iter().map(String::as_str).collect::<Vec<_>>());
        let heard = learning.clock.now();
        let last = |key: &Key| key.1.starts_with('a').then_some(heard);
        hand.advance(TRIAL);
        learning.take(&all, false, last);
        let new = "std_msgs/msg/Float64";
        all.get_mut("rt/x").unwrap().insert(new.to_owned(), BTreeSet::from([[2; 12]]));
        hand.advance(TRIAL);
        let news = learning.take(&all, false, last);
        assert!(names(&news).contains(&(new, true)), "{news:?}");
    }

    #[tokio::test]
    async fn a_stranger_with_many_types_delays_the_type_of_another_by_nothing() {
        let (mut learning, _received) = learning(1024);
        // Their names make no ROS type: nothing can be read.
        let strange: Vec<String> = (0..200).map(|number| format!("A{number:03}")).collect();
        for types in [forged(200, "T"), strange] {
            let mut all = published(&types.iter().map(String::as_str).collect::<Vec<_>>());
            let true_type = ("std_msgs/msg/Float64".to_owned(), BTreeSet::from([[2; 12]]));
            all.get_mut("rt/x").unwrap().extend([true_type]);
            let news = learning.take(&all, false, NOBODY);
            assert!(names(&news).contains(&("std_msgs/msg/Float64", true)), "{news:?}");
            learning.topics.values_mut().for_each(|it| it.tried.clear());
        }
    }

    #[tokio::test]
    async fn types_that_cannot_be_read_take_no_turn() {
        let (mut learning, _received) = learning(8);
        let strange: Vec<String> = (0..TYPES_MAX).map(|number| format!("A{number:03}")).collect();
        let mut types: Vec<&str> = strange.iter().map(String::as_str).collect();
        types.push("std_msgs/msg/Float64");
        let all = published(&types);
        assert!(learning.take(&all, false, NOBODY).new.is_empty());
        assert_eq!(names(&learning.take(&all, false, NOBODY)), [("std_msgs/msg/Float64", true)]);
    }

    #[tokio::test]
    async fn a_type_without_a_definition_is_said_and_counted() {
        let (mut learning, mut received) = learning(8);
        assert_eq!(learning.take(&published(&["my_msgs/msg/Thing"]), false, NOBODY).new.len(), 1);
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert!(trouble.text.contains("my_msgs/msg/Thing"), "{trouble:?}");
    }

    #[tokio::test]
    async fn what_a_learned_type_does_not_have_is_said_once_and_the_rest_is_read() {
        let (mut learning, mut received) = learning(1);
        assert_eq!(learning.take(&published(&["std_msgs/msg/Header"]), false, NOBODY).new.len(), 1);
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert_eq!(&*trouble.text, "std_msgs/msg/Header has no field `data`");
        assert!(received.try_recv().is_err());
    }

    #[tokio::test]
    async fn what_finds_no_room_is_said_later() {
        let (mut learning, mut received) = learning(1);
        let two = published(&["a/msg/A", "b/msg/B"]);
        learning.take(&two, false, NOBODY);
        assert!(received.try_recv().is_err(), "both or none");
    }
}
