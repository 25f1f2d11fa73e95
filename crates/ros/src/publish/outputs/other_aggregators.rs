//! Finds other programs that publish what Telltale publishes: a reader of the aggregated diagnosis would get two
//! trees in turn, and a vehicle that Telltale holds might be released by another.

use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use super::{OutputTopic, offer};
use crate::Publisher;
use crate::engine_queue::stopped;
use telltale_clock::Clock;
use telltale_engine::discovery::{Discovery, Endpoint};
use telltale_engine::input::Input;
use telltale_engine::model::output::{Output, Publication};
use telltale_msg::received::Stamped;

/// The vendor id of our DDS library, with which a participant's id begins (RTPS 2.5, 9.3.1.5). Another
/// Telltale has the same.
const OUR_VENDOR: &str = "0112";

/// The other publishers of our topics.
#[derive(Clone)]
pub struct OtherAggregators {
    /// Topics and types of the aggregated diagnosis, and whether we publish beside others.
    topics: Arc<[(Box<str>, &'static str, bool)]>,
    /// Topics and types by which the vehicle is held, released and cleared.
    to_vehicle: Arc<[(Box<str>, &'static str)]>,
    own: String,
    discovery: watch::Receiver<Arc<Discovery>>,
}

impl OtherAggregators {
    pub fn new(
        publisher: &Publisher,
        topics: &[OutputTopic],
        discovery: watch::Receiver<Arc<Discovery>>,
    ) -> OtherAggregators {
        let is_aggregated = |it: &&OutputTopic| {
            matches!(it.publication, Publication::DiagnosticsAgg | Publication::TopLevelState)
        };
        let aggregated = topics.iter().filter(is_aggregated);
        let aggregated = aggregated.map(|it| (it.topic.clone(), offer(it.publication).0, it.beside_others));
        // A pose and a stage move nothing by themselves; other programs may say them too.
        let moves = |it: &&OutputTopic| {
            use Output::{Clearance, Deceleration, Hold, ManeuverStop};
            matches!(it.publication, Publication::Vehicle(Clearance | Deceleration | ManeuverStop | Hold))
        };
        let to_vehicle = topics.iter().filter(moves).map(|it| (it.topic.clone(), offer(it.publication).0));
        OtherAggregators {
            topics: aggregated.collect(),
            to_vehicle: to_vehicle.collect(),
            own: publisher.participant(),
            discovery,
        }
    }

    /// Whether nothing may be published on this topic now.
    pub fn silence(&self, topic: &str) -> bool {
        let seen = self.discovery.borrow();
        let found = self.topics.iter().find(|(known, ..)| **known == *topic);
        let Some((_, type_name, beside_others)) = found else { return false };
        !beside_others && others(&seen, topic, type_name, &self.own).any(|it| yields_to(&self.own, it))
    }

    /// The topic and the other publishers, for people; `None` if publishing beside them is configured.
    fn words(&self) -> Option<String> {
        let seen = self.discovery.borrow();
        let unwanted = self.topics.iter().filter(|(.., beside_others)| !beside_others);
        let who =
            unwanted.filter_map(|(topic, type_name, _)| first_other(&seen, topic, type_name, &self.own));
        list(who)
    }

    /// The topics and the other programs that speak to the vehicle, for people.
    fn voices(&self) -> Option<String> {
        let seen = self.discovery.borrow();
        list(
            self.to_vehicle
                .iter()
                .filter_map(|(topic, type_name)| first_other(&seen, topic, type_name, &self.own)),
        )
    }
}

fn list(words: impl Iterator<Item = String>) -> Option<String> {
    Some(words.collect::<Vec<_>>().join(", ")).filter(|words| !words.is_empty())
}

/// The topic and one of its other publishers.
fn first_other(seen: &Discovery, topic: &str, type_name: &str, own: &str) -> Option<String> {
    let other = others(seen, topic, type_name, own).min()?;
    let name = other.node.clone().unwrap_or_else(|| format!("participant {}", other.participant));
    Some(format!("{topic} by {name}"))
}

/// One of our own participants that was killed stays visible for a while.
fn others<'a>(
    seen: &'a Discovery,
    topic: &str,
    type_name: &str,
    own: &str,
) -> impl Iterator<Item = &'a Endpoint> {
    let topic = seen.topics.iter().find(|it| it.name == topic);
    let publishers = topic.into_iter().flat_map(|it| &it.publishers);
    publishers.filter(move |it| it.participant != own && !it.ours && it.type_name == type_name)
}

/// Yields to every other aggregator, and of two Telltales to the one with the smaller id: they see one
/// another while they are silent, and must not both be silent.
fn yields_to(own: &str, other: &Endpoint) -> bool {
    !other.participant.starts_with(OUR_VENDOR) || *other.participant < *own
}

/// Reports each change to the log and to the engine.
pub async fn tell(
    mut others: OtherAggregators,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
    mut end: watch::Receiver<bool>,
) {
    // An earlier participant may have reported a publisher that is gone.
    let mut told = Some(Some(String::new()));
    let mut told_voices = Some(Some(String::new()));
    loop {
        let voices = others.voices();
        if told_voices.as_ref() != Some(&voices) {
            if let Some(voices) = &voices {
                tracing::error!(
                    "another program tells the vehicle what Telltale tells it: {voices}. It may release a vehicle \
                     that is held here. End that program, or give it another domain (ROS_DOMAIN_ID)"
                );
            }
            let other = voices.as_deref().map(Box::from);
            let news = Stamped::new(Input::Voices { other }, clock.now());
            // A full queue is tried again with the next look of discovery, a second later.
            told_voices = inputs.try_send(news).is_ok().then_some(voices);
        }
        let words = others.words();
        if told.as_ref() != Some(&words) {
            if let Some(words) = &words {
                tracing::warn!(
                    "another program publishes the aggregated diagnosis: {words}. Telltale is silent there, or \
                     one of two Telltales. Where the other is wanted, write `publish: {{ diagnostics_agg: false, \
                     toplevel_state: false }}`; to publish beside it, `diagnostics_agg: {{ beside_others: true }}`"
                );
            }
            let other = words.as_deref().map(Box::from);
            let news = Stamped::new(Input::Aggregator { other }, clock.now());
            told = inputs.try_send(news).is_ok().then_some(words);
        }
        tokio::select! {
            () = stopped(&mut end) => return,
            changed = others.discovery.changed() => if changed.is_err() { return },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_two_telltales_goes_on_and_every_other_aggregator_is_left_alone() {
        let other = |participant: &str| Endpoint { participant: participant.into(), ..Endpoint::default() };
        for (own, theirs, expected) in [
            ("0112aa", "0112bb", false),
            ("0112bb", "0112aa", true),
            ("0112aa", "0110ff", true),
            ("0112aa", "010f00", true),
        ] {
            assert_eq!(yields_to(own, &other(theirs)), expected, "{own} and {theirs}");
        }
    }
}
