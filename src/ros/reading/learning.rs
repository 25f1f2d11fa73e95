//! Topics whose type the configuration leaves out: they wait for a publisher, and are then read with its
//! type.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use tokio::sync::mpsc;

use crate::clock::Clock;
use crate::engine::input::{Input, ReceptionTrouble, TroubleKind};
use crate::engine::model::sample::PublisherReport;
use crate::engine::time::{Span, Timestamp};
use crate::msg::messages;
use crate::msg::received::Stamped;
use crate::msg::subscription::{Learned, Subscription};
use crate::ros::library::Participant;

/// A topic is reported to have no publisher only after discovery had this time.
const DISCOVERY: Span = Span::from_secs(5);

/// The topics of a configuration that have no type yet, each once.
pub struct Learning {
    waiting: BTreeMap<String, Waiting>,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
}

struct Waiting {
    subscription: Arc<Subscription>,
    searching_until: Timestamp,
    /// The types that were reported last; the engine counts one that it cannot take.
    said: Option<BTreeSet<String>>,
}

impl Learning {
    pub fn new(inputs: mpsc::Sender<Stamped>, clock: Clock) -> Learning {
        Learning { waiting: BTreeMap::new(), inputs, clock }
    }

    /// Waits for the types of these topics only.
    pub fn follow(&mut self, untyped: Vec<Arc<Subscription>>) {
        let searching_until = self.clock.now() + DISCOVERY;
        let waiting = untyped.into_iter().map(|subscription| {
            let waiting = Waiting { subscription, searching_until, said: None };
            (waiting.subscription.dds_topic.clone(), waiting)
        });
        self.waiting = waiting.collect();
    }

    /// The topics that can be read now and could not be read before.
    pub fn look(&mut self, participant: &Participant) -> Vec<Arc<Subscription>> {
        if self.waiting.is_empty() {
            return Vec::new();
        }
        let mut types: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        let seen = participant.seen();
        for topic in self.waiting.keys() {
            for writer in seen.writers_of(topic) {
                let type_name = messages::ros_type_name(&writer.type_name);
                types.entry(topic.clone()).or_default().insert(type_name);
            }
        }
        drop(seen);
        self.take(&types)
    }

    fn take(&mut self, types: &BTreeMap<String, BTreeSet<String>>) -> Vec<Arc<Subscription>> {
        let now = self.clock.now();
        let none = BTreeSet::new();
        let mut learned = Vec::new();
        for (topic, waiting) in &mut self.waiting {
            let found = types.get(topic).unwrap_or(&none);
            let why = match found.iter().collect::<Vec<_>>()[..] {
                [] if now < waiting.searching_until => continue,
                [] => None,
                [one] => match waiting.subscription.learn(one) {
                    Ok(Learned { subscription, missing }) => {
                        if missing.is_empty() || say_missing(&self.inputs, waiting, &missing, now) {
                            learned.push(Arc::new(subscription));
                        }
                        continue;
                    }
                    Err(why) => Some(format!("published as {one}: {why}")),
                },
                _ => {
                    let names: Vec<&str> = found.iter().map(String::as_str).collect();
                    Some(format!("published as {}: name one with `type`", names.join(" and ")))
                }
            };
            if waiting.said.as_ref() != Some(found) && say(&self.inputs, waiting, found, why, now) {
                waiting.said = Some(found.clone());
            }
        }
        self.waiting.retain(|topic, _| !learned.iter().any(|it| it.dds_topic == *topic));
        learned
    }
}

/// Reports the fields of a newly learned type that cannot be read. Returns whether the queue had room.
fn say_missing(
    inputs: &mpsc::Sender<Stamped>,
    waiting: &Waiting,
    missing: &[String],
    received: Timestamp,
) -> bool {
    let topic = (*waiting.subscription.topic).into();
    let (count, text) = (missing.len() as u64, missing.join("; ").into());
    let trouble = ReceptionTrouble { topic, kind: TroubleKind::WrongType, count, text };
    inputs.try_send(Stamped::new(Input::Reception(trouble), received)).is_ok()
}

/// Reports that a topic cannot be read. Returns whether the queue had room; otherwise it is tried again.
fn say(
    inputs: &mpsc::Sender<Stamped>,
    waiting: &Waiting,
    found: &BTreeSet<String>,
    why: Option<String>,
    received: Timestamp,
) -> bool {
    let topic = &waiting.subscription.topic;
    let trouble = why.map(|text| {
        let (kind, text) = (TroubleKind::WrongType, text.into());
        Input::Reception(ReceptionTrouble { topic: (**topic).into(), kind, count: 1, text })
    });
    let names: Vec<&str> = found.iter().map(String::as_str).collect();
    let news = waiting.subscription.watched().map(|source| {
        let other_type = (!names.is_empty()).then(|| names.join(", ").into());
        Input::Topic(PublisherReport { source: source.clone(), publishers: 0, other_type })
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
    use crate::config;
    use crate::msg::fields::Definitions;
    use crate::msg::subscription::Plan;

    fn learning(room: usize) -> (Learning, mpsc::Receiver<Stamped>) {
        let text = "
vehicle: { stages: none }
groups: [{ id: g, modules: [{ id: m, monitor: { value: { topic: /x, field: data, error_above: 1 } } }] }]
";
        let model = config::parse("c", text).unwrap().model;
        let plan = Plan::of(&model, &Definitions::default()).unwrap();
        let (inputs, received) = mpsc::channel(room);
        let mut learning = Learning::new(inputs, Clock::start());
        learning.follow(plan.subscriptions.iter().filter(|it| it.is_untyped()).cloned().collect());
        (learning, received)
    }

    fn published(types: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
        let types = types.iter().map(|&name| name.to_owned()).collect();
        BTreeMap::from([("rt/x".to_owned(), types)])
    }

    #[tokio::test]
    async fn the_one_type_is_learned_and_two_are_said_once() {
        let (mut learning, mut received) = learning(8);
        assert!(
            learning.take(&BTreeMap::new()).is_empty() && received.try_recv().is_err(),
            "somebody may come"
        );
        let two = published(&["std_msgs/msg/Float64", "std_msgs/msg/Int32"]);
        assert!(learning.take(&two).is_empty() && learning.take(&two).is_empty());
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert!(
            trouble.kind == TroubleKind::WrongType && trouble.text.contains("name one with `type`"),
            "{trouble:?}"
        );
        let Input::Topic(news) = received.try_recv().unwrap().input else { panic!() };
        assert_eq!(news.other_type.as_deref(), Some("std_msgs/msg/Float64, std_msgs/msg/Int32"));
        assert!(received.try_recv().is_err(), "once");
        let learned = learning.take(&published(&["std_msgs/msg/Float64"]));
        assert_eq!((&*learned[0].type_name, learning.waiting.is_empty()), ("std_msgs/msg/Float64", true));
    }

    #[tokio::test]
    async fn a_type_without_a_definition_is_said_and_counted() {
        let (mut learning, mut received) = learning(8);
        assert_eq!(learning.take(&published(&["my_msgs/msg/Thing"])).len(), 1);
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert!(trouble.text.contains("my_msgs/msg/Thing"), "{trouble:?}");
    }

    #[tokio::test]
    async fn what_a_learned_type_does_not_have_is_said_once_and_the_rest_is_read() {
        let (mut learning, mut received) = learning(1);
        assert_eq!(learning.take(&published(&["std_msgs/msg/Header"])).len(), 1);
        let Input::Reception(trouble) = received.try_recv().unwrap().input else { panic!() };
        assert_eq!(&*trouble.text, "std_msgs/msg/Header has no field `data`");
        assert!(learning.waiting.is_empty() && received.try_recv().is_err());
    }

    #[tokio::test]
    async fn what_finds_no_room_is_said_later() {
        let (mut learning, mut received) = learning(1);
        let two = published(&["a/msg/A", "b/msg/B"]);
        learning.take(&two);
        assert!(received.try_recv().is_err(), "both or none");
    }
}
