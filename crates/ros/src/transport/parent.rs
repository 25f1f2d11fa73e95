//! The socket between the process of a transport and the program, which is its parent.

use futures_util::StreamExt as _;
use tokio::io::AsyncWriteExt as _;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

use super::wire::{self, Frame, Order};

/// Orders, in frames.
pub type Orders = FramedRead<OwnedReadHalf, LengthDelimitedCodec>;

/// The next orders. `None` if the program is gone or sends nonsense.
pub async fn next(orders: &mut Orders) -> Option<Vec<Order>> {
    wire::orders(&orders.next().await?.ok()?.freeze()).ok()
}

/// The messages to the parent. Writing waits if the parent does not read.
pub struct ToParent {
    socket: OwnedWriteHalf,
    pub frame: Frame,
    /// Samples, which follow the description of their writers.
    pub samples: Frame,
}

impl ToParent {
    pub fn new(socket: OwnedWriteHalf) -> ToParent {
        ToParent { socket, frame: Frame::new(), samples: Frame::new() }
    }

    pub async fn send(&mut self) -> Result<(), String> {
        for frame in [&mut self.frame, &mut self.samples] {
            if !frame.is_empty() {
                self.socket.write_all(&frame.take()).await.map_err(|error| error.to_string())?;
            }
        }
        Ok(())
    }
}
