//! A connection to the hub, of a vehicle or a console: NATS through a [`Gate`].

use std::time::Duration;

use async_nats::{Client, ConnectErrorKind, ConnectOptions, Message};
use tokio::time::timeout;

use crate::gate::{Gate, Pace};
use crate::identity::Identity;
use crate::line::{Hub, NoLine, inbox};

/// What the hub says of a stored message in a header. The message itself may have one of the same name: the hub's is the last.
pub fn said_of<'a>(message: &'a Message, name: &str) -> Option<&'a str> {
    Some(message.headers.as_ref()?.get_last(name)?.as_str())
}

const CONNECTED_WITHIN: Duration = Duration::from_secs(10);

/// What all connections have in common.
pub fn options(identity: &Identity, name: &str) -> ConnectOptions {
    ConnectOptions::with_nkey(identity.seed().to_owned())
        .name(format!("telltale {name}"))
        .ignore_discovered_servers()
        .custom_inbox_prefix(inbox(name))
        .connection_timeout(CONNECTED_WITHIN)
        .max_reconnects(1)
}

/// The client is of use until the gate has ended.
///
/// # Errors
/// The hub is not reached, is another one than the certificate says, or does not admit this identity.
pub async fn open(hub: &Hub, pace: Pace, options: ConnectOptions) -> Result<(Client, Gate), NoLine> {
    let gate = match timeout(CONNECTED_WITHIN, Gate::open(hub, pace)).await {
        Ok(gate) => gate.map_err(|error| NoLine::Unreachable(error.to_string()))?,
        Err(_) => return Err(NoLine::Unreachable("the hub does not answer".into())),
    };
    // In a task of its own, so that a panic of the library ends this connection alone.
    let connecting = tokio::spawn(options.connect(gate.url())).await;
    let connected = connecting.map_err(|error| NoLine::Unreachable(error.to_string()))?;
    let client = connected.map_err(|error| match error.kind() {
        ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => NoLine::Refused,
        _ => NoLine::Unreachable(gate.why().unwrap_or_else(|| error.to_string())),
    })?;
    Ok((client, gate))
}
