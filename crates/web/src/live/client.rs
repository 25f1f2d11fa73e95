//! The server's end of a WebSocket: sends messages, and closes when the client does not read or the session
//! is over.

use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use tokio::time::timeout;

use telltale_store::Session;

/// A client that leaves this many pings in a row unanswered does not read.
const PINGS_UNANSWERED_MAX: u32 = 5;
/// Time for the socket to take one message; after it, the client counts as not reading.
const SEND_TIMEOUT: Duration = Duration::from_secs(5);
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// A socket and the session that it belongs to.
pub struct Client {
    pub socket: WebSocket,
    pub session: Session,
    pub pings_unanswered: u32,
}

impl Client {
    /// Sends a message, if there is one. Returns whether there was.
    pub async fn send_some(&mut self, text: Option<Utf8Bytes>) -> Result<bool, Ending> {
        let Some(text) = text else { return Ok(false) };
        self.send(Message::Text(text)).await.map(|()| true)
    }

    /// Sends one message, unless the session ends first.
    pub async fn send(&mut self, message: Message) -> Result<(), Ending> {
        if !self.session.is_open() {
            return Err(Ending::Revoked);
        }
        tokio::select! {
            biased;
            () = self.session.ended() => Err(Ending::Revoked),
            sent = timeout(SEND_TIMEOUT, self.socket.send(message)) => match sent {
                Ok(Ok(())) => Ok(()),
                Ok(Err(_)) => Err(Ending::Gone),
                Err(_) => Err(Ending::Unread),
            },
        }
    }

    pub async fn ping(&mut self) -> Result<(), Ending> {
        if self.pings_unanswered >= PINGS_UNANSWERED_MAX {
            return Err(Ending::Unread);
        }
        self.pings_unanswered += 1;
        self.send(Message::Ping(axum::body::Bytes::new())).await
    }

    /// Sends a close frame with the reason, and waits briefly for the client's own.
    pub async fn close(mut self, ending: Ending) {
        let (code, reason) = match ending {
            Ending::Revoked => (close_code::POLICY, "the session has ended"),
            Ending::Closing => (close_code::RESTART, "the server ends"),
            Ending::NoEngine => (close_code::ERROR, "the engine has ended"),
            Ending::Nonsense => (close_code::UNSUPPORTED, "not understood"),
            Ending::Flood => (close_code::POLICY, "too much was sent"),
            Ending::Unread => (close_code::AGAIN, "nobody reads"),
            Ending::Gone => return,
        };
        let close = Message::Close(Some(CloseFrame { code, reason: Utf8Bytes::from_static(reason) }));
        let goodbye = async {
            if self.socket.send(close).await.is_ok() {
                while let Some(Ok(_)) = self.socket.recv().await {}
            }
        };
        // A client that does not answer in time is left without a close frame.
        let _ = timeout(CLOSE_TIMEOUT, goodbye).await;
    }
}

/// Why a connection ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The session ended: its user must log in again.
    Revoked,
    /// The server ends; a new one may come.
    Closing,
    /// The engine ended; there is nothing to show.
    NoEngine,
    /// The client sent a message that the server does not know.
    Nonsense,
    /// The client sends more than it may.
    Flood,
    /// The client does not read.
    Unread,
    /// The client went away.
    Gone,
}
