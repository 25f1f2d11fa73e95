//! An input for the engine together with the message from which it was made. The engine takes the input; a
//! recorder takes the message too, in the order in which the engine took its inputs.

use std::sync::Arc;
use std::time::SystemTime;

use super::sample_bytes::{Guid, RawBody};
use telltale_engine::input::Input;
use telltale_engine::time::Timestamp;

/// A received message. All inputs that were made from it share it.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// By its ROS name: `/diagnostics`.
    pub topic: Arc<str>,
    /// `package/msg/Name`.
    pub type_name: Arc<str>,
    pub writer: Guid,
    /// The sequence number that the writer gave it.
    pub sequence: i64,
    /// The time of publication by the publisher's wall clock, if the message has it.
    pub source: Option<SystemTime>,
    /// When it was received, by this machine's wall clock.
    pub received: SystemTime,
    pub body: RawBody,
    /// Bytes of its body that are not kept: a recording has only its stamps and its size. 0: it is whole.
    pub left_out: usize,
    /// Its writer keeps it for late readers (transient local): it counts until the next one.
    pub kept: bool,
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
    /// The message from which it was made, if there is one. A message without a meaning for the engine,
    /// such as an unreadable one, comes with [`Input::Tick`].
    pub message: Option<Arc<Message>>,
}

impl Stamped {
    /// An input without a message.
    pub fn new(input: Input, received: Timestamp) -> Stamped {
        Stamped { input, received, message: None }
    }
}
