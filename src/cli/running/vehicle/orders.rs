//! The subscriptions of a simulated machine: the topics on which Telltale addresses a vehicle.

use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::sync::mpsc;

use crate::clock::Clock;
use crate::config::publishing::Publishing;
use crate::engine::input::Input;
use crate::engine::model::monitors::{FieldKind, FieldSpec, TopicSpec, Watched};
use crate::engine::model::sample::FieldValue;
use crate::engine::model::{FieldSource, Model, Parts, SignalSource, SignalSpec, StageModel};
use crate::engine::text::Text;
use crate::engine::time::{Span, Timestamp};
use crate::msg::messages::encode::{ACCEL_STAMPED, POSE_WITH_COVARIANCE_STAMPED};
use crate::msg::messages::{BOOL, GidSize};
use crate::msg::sample_bytes::Guid;
use crate::ros::{self, Bridge, BridgeError, BridgeOptions};
use crate::runtime::Stamped;
use crate::sim::machine::Order;

const CLEAR: &str = "clear";
const STOP: &str = "stop";
const HOLD: &str = "hold";

/// Its name in the graph of ROS 2.
const NODE: &str = "simulated_machine";

/// How long another's `true` on the topic of the hold stands against a `false`: it is repeated each second.
const HOLD_STANDS: Span = Span::from_secs(3);

/// Publishers of `true` that are remembered. With more of them the oldest goes.
const HOLDERS_MAX: usize = 64;

/// Orders that may wait for the shuttle; it takes them at once.
const QUEUE: usize = 256;

/// Listens over DDS, as a vehicle of its own.
pub struct Orders {
    bridge: Bridge,
    inputs: mpsc::Receiver<Stamped>,
    holders: Holders,
}

/// The writers whose last word is that the machine is held, and when. Such a writer wins over all that release it.
#[derive(Debug, Default)]
struct Holders(BTreeMap<Guid, Timestamp>);

impl Holders {
    /// Whether the machine is to obey this word of `writer`.
    fn obey(&mut self, writer: Guid, held: bool, now: Timestamp) -> bool {
        self.0.retain(|_, said| now < *said + HOLD_STANDS);
        if !held {
            self.0.remove(&writer);
            return self.0.is_empty();
        }
        if self.0.len() >= HOLDERS_MAX
            && let Some(oldest) = self.0.iter().min_by_key(|(_, said)| **said).map(|(writer, _)| *writer)
        {
            self.0.remove(&oldest);
        }
        self.0.insert(writer, now);
        true
    }
}

impl Orders {
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn listen(
        options: &BridgeOptions,
        publishing: &Publishing,
        clock: Clock,
    ) -> Result<Orders, BridgeError> {
        let (sender, inputs) = mpsc::channel(QUEUE);
        let options = BridgeOptions { node: NODE, ..options.clone() };
        let bridge = ros::start(options, &model(publishing), sender, clock).await?;
        Ok(Orders { bridge, inputs, holders: Holders::default() })
    }

    /// The next order; never, if the bridge has ended.
    pub async fn next(&mut self) -> Order {
        loop {
            match self.inputs.recv().await {
                Some(stamped) => {
                    let writer = stamped.message.as_ref().map(|message| message.writer).unwrap_or_default();
                    match order(&stamped.input) {
                        Some(Order::Hold(held)) if !self.holders.obey(writer, held, stamped.received) => {}
                        Some(order) => return order,
                        None => {}
                    }
                }
                None => std::future::pending().await,
            }
        }
    }

    /// How long a gid is where it listens, if anybody told.
    pub fn gid_size(&self) -> Option<GidSize> {
        *self.bridge.gid_size().borrow()
    }

    pub async fn shutdown(self) {
        self.bridge.shutdown().await;
    }
}

/// What an input asks of the machine.
pub fn order(input: &Input) -> Option<Order> {
    match input {
        Input::Signal { name, value } if **name == *CLEAR => Some(Order::Clear(*value)),
        Input::Signal { name, value } if **name == *STOP => Some(Order::Stop(*value)),
        Input::Signal { name, value } if **name == *HOLD => Some(Order::Hold(*value)),
        Input::Sample(sample) => match sample.values.first()? {
            FieldValue::Pose(pose) => Some(Order::Localize(*pose)),
            // A deceleration is an acceleration backwards.
            FieldValue::Number(mps2) => Some(Order::Decelerate(-mps2)),
            _ => None,
        },
        _ => None,
    }
}

/// The bridge reads what a model names: here, levels as signals and the rest as what is watched.
pub fn model(publishing: &Publishing) -> Model {
    let signal = |name: &str, topic: &Option<Box<str>>| {
        let source = FieldSource { topic: topic.clone()?, type_name: BOOL.into(), field: "data".into() };
        let source = SignalSource::Field(source);
        Some(SignalSpec::new(name, source))
    };
    let watched = |topic: Option<&str>, type_name: &str, path: &str, kind| {
        let fields = vec![FieldSpec::new(path, kind)];
        Some(Arc::new(TopicSpec { topic: topic?.into(), type_name: type_name.into(), stamp: false, fields }))
    };
    let pose = publishing.initialpose.as_deref();
    let deceleration = publishing.deceleration_request.as_ref().map(|periodic| &*periodic.topic);
    let topics = [
        watched(pose, POSE_WITH_COVARIANCE_STAMPED, "pose.pose", FieldKind::Pose),
        watched(deceleration, ACCEL_STAMPED, "accel.linear.x", FieldKind::Scalar),
    ];
    let signals = [
        signal(CLEAR, &publishing.clearance),
        signal(STOP, &publishing.maneuver_stop_request),
        signal(HOLD, &publishing.hold),
    ];
    let parts = Parts {
        vehicle_name: Text::plain("Simulated shuttle"),
        signals: signals.into_iter().flatten().collect(),
        watched: Watched { topics: topics.into_iter().flatten().collect(), ..Watched::default() },
        ..Parts::empty("shuttle", StageModel::None)
    };
    Model::new(parts).unwrap_or_else(|_| unreachable!("nothing in it depends on anything"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_holds_the_machine_wins_over_all_that_release_it_until_that_one_does() {
        let (telltale, other) = ([1; 16], [2; 16]);
        let mut holders = Holders::default();
        let mut says = |writer, held, millis| holders.obey(writer, held, Timestamp::from_millis(millis));
        assert!(says(other, false, 0), "nobody holds it");
        assert!(says(telltale, true, 100));
        for second in 1..60 {
            assert!(says(telltale, true, second * 1_000 + 100));
            assert!(!says(other, false, second * 1_000 + 600), "another releases it at {second} s");
        }
        assert!(says(telltale, false, 60_000));
        // A writer that is gone does not hold it for ever: another start of its program releases it.
        assert!(says(telltale, true, 61_000));
        assert!(!says(other, false, 63_999));
        assert!(says(other, false, 64_000));
    }

    #[test]
    fn a_flood_of_publishers_is_bounded_and_holds() {
        let mut holders = Holders::default();
        for number in 0..=255 {
            assert!(holders.obey([number; 16], true, Timestamp::from_millis(number.into())));
        }
        assert_eq!(holders.0.len(), HOLDERS_MAX);
        assert!(!holders.obey([7; 16], false, Timestamp::from_millis(300)));
    }
}
