//! What goes to the engine, and the message that it was made of. The engine takes the input; who records takes
//! the message too, in the order in which the engine took its inputs.

use std::sync::Arc;
use std::time::SystemTime;

use super::sample_bytes::{Guid, RawBody};
use crate::engine::input::Input;
use crate::engine::time::Timestamp;

/// A message as it was received. All inputs that were made of it share it.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// As ROS names it: `/diagnostics`.
    pub topic: Arc<str>,
    /// `package/msg/Name`.
    pub type_name: Arc<str>,
    pub writer: Guid,
    /// The writer's own number of it.
    pub sequence: i64,
    /// When it was published by the publisher's wall clock, if it says.
    pub source: Option<SystemTime>,
    /// When it was received by this machine's wall clock.
    pub received: SystemTime,
    pub body: RawBody,
}

impl Message {
    /// The bytes of its body.
    pub fn len(&self) -> usize {
        self.body.as_ref().map_or(0, |(body, _)| body.len())
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An input with the instant of its receipt on the monotonic clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Stamped {
    pub input: Input,
    pub received: Timestamp,
    /// The message that it was made of, if it was one. One that means nothing to the engine, such as an
    /// unreadable one, comes with [`Input::Tick`].
    pub message: Option<Arc<Message>>,
}

impl Stamped {
    /// An input that is no message.
    pub fn new(input: Input, received: Timestamp) -> Stamped {
        Stamped { input, received, message: None }
    }
}
