//! Topics, readers and writers of the DDS library, with the quality of service that Telltale uses.

use rustdds::bytes::Bytes;
use rustdds::dds::CreateResult;
use rustdds::no_key::{DataWriter, SimpleDataReader};
use rustdds::policy::{Durability, History, Lifespan, Reliability, ResourceLimits};
use rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, Subscriber, Topic, TopicKind};

use super::raw_bytes::RawAdapter;
use crate::transport::quality::{Quality, Via};
use telltale_msg::sample_bytes::RawBody;

pub type RawWriter = DataWriter<Bytes, RawAdapter>;
pub type RawReader = SimpleDataReader<RawBody, RawAdapter>;

/// Also tells the library how many samples of the topic it keeps, which can only grow.
pub fn create_topic(
    participant: &DomainParticipant,
    name: &str,
    type_name: &str,
    depth: usize,
) -> CreateResult<Topic> {
    let depth = i32::try_from(depth).unwrap_or(i32::MAX);
    let limits = ResourceLimits { max_samples: depth, max_instances: 1, max_samples_per_instance: depth };
    let qos = QosPolicyBuilder::new().history(History::KeepLast { depth }).resource_limits(limits).build();
    participant.create_topic(name.to_owned(), type_name.to_owned(), &qos, TopicKind::NoKey)
}

pub fn reader(subscriber: &Subscriber, topic: &Topic, via: Via) -> CreateResult<RawReader> {
    subscriber.create_simple_datareader_no_key(topic, Some(asked(via)))
}

/// A topic that is published.
pub fn offered_topic(
    participant: &DomainParticipant,
    name: &str,
    type_name: &str,
    quality: Quality,
) -> CreateResult<Topic> {
    participant.create_topic(name.to_owned(), type_name.to_owned(), &offered(quality), TopicKind::NoKey)
}

pub fn writer(participant: &DomainParticipant, topic: &Topic, quality: Quality) -> CreateResult<RawWriter> {
    let qos = offered(quality);
    participant.create_publisher(&qos)?.create_datawriter_no_key(topic, Some(qos))
}

/// No deadline and no lifespan: each setting beyond a writer's offer prevents the match.
fn asked(via: Via) -> QosPolicies {
    let qos = QosPolicyBuilder::new();
    match via {
        Via::Reliable => qos.reliability(reliable()).durability(Durability::Volatile),
        Via::LastValue => qos.reliability(reliable()).durability(Durability::TransientLocal),
        Via::BestEffort => qos.best_effort().durability(Durability::Volatile),
    }
    .build()
}

pub fn offered(quality: Quality) -> QosPolicies {
    let (reliability, durability, depth) = match quality {
        Quality::Reliable | Quality::Command => (reliable(), Durability::Volatile, 10),
        Quality::BestEffort => (Reliability::BestEffort, Durability::Volatile, 10),
        Quality::LastValue => (reliable(), Durability::TransientLocal, 1),
        Quality::Reply => (reliable(), Durability::Volatile, 128),
        Quality::Log => (reliable(), Durability::TransientLocal, 100),
    };
    let qos = QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(durability)
        .history(History::KeepLast { depth });
    match quality {
        Quality::Log => qos.lifespan(Lifespan { duration: rustdds::Duration::from_secs(10) }),
        // A writer waits while so many samples are not acknowledged (else 8,192), and the library counts all that it
        // ever sent against a reader that has not acknowledged anything yet: one that never does would silence it. The
        // memory of the process bounds the samples that are kept for such a reader.
        Quality::LastValue | Quality::Command => qos.resource_limits(ResourceLimits {
            max_samples: i32::MAX,
            max_instances: 1,
            max_samples_per_instance: i32::MAX,
        }),
        Quality::Reliable | Quality::BestEffort | Quality::Reply => qos,
    }
    .build()
}

fn reliable() -> Reliability {
    Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_that_acknowledges_nothing_holds_back_no_message_for_the_vehicle() {
        for quality in [Quality::LastValue, Quality::Command] {
            let most = offered(quality).resource_limits().map(|limits| limits.max_samples);
            assert_eq!(most, Some(i32::MAX), "{quality:?}");
        }
    }
}
