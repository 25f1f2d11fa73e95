//! A connection to the hub, of a vehicle or a console: NATS over TLS, in a runtime of its own.

use std::time::Duration;

use async_nats::{Client, ConnectErrorKind, ConnectOptions, Event};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::watch;

use crate::identity::Identity;
use crate::line::{Hub, NoLine, inbox};

const CONNECTED_WITHIN: Duration = Duration::from_secs(10);

pub struct Connected {
    pub client: Client,
    /// Turns true with the first fault.
    pub is_cut: watch::Receiver<bool>,
    pub tasks: Tasks,
}

/// The runtime of one client. Its tasks end with it, also while the hub sends without end, and a panic in one ends no
/// other: the library panics at some of what a stranger may say in place of a hub.
#[derive(Debug)]
pub struct Tasks(Option<Runtime>);

impl Tasks {
    fn start() -> std::io::Result<Tasks> {
        let mut runtime = Builder::new_multi_thread();
        runtime.worker_threads(1).thread_name("fleet-hub").enable_all().build().map(Some).map(Tasks)
    }

    async fn run<T: Send + 'static>(&self, future: impl Future<Output = T> + Send + 'static) -> Option<T> {
        self.0.as_ref()?.spawn(future).await.ok()
    }
}

impl Drop for Tasks {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

/// What all connections have in common.
pub fn options(hub: &Hub, identity: &Identity, name: &str) -> ConnectOptions {
    ConnectOptions::with_nkey(identity.seed().to_owned())
        .name(format!("telltale {name}"))
        .add_root_certificates(hub.ca.clone())
        .require_tls(true)
        .ignore_discovered_servers()
        .custom_inbox_prefix(inbox(name))
        .connection_timeout(CONNECTED_WITHIN)
        .max_reconnects(1)
}

/// # Errors
/// The hub is not reached, is another one than the certificate says, or does not admit this identity.
pub async fn open(hub: &Hub, options: ConnectOptions) -> Result<Connected, NoLine> {
    let (cut, is_cut) = watch::channel(false);
    let options = options.event_callback(move |event| {
        if matches!(event, Event::Disconnected | Event::Closed) {
            cut.send_replace(true);
        }
        std::future::ready(())
    });
    let tasks = Tasks::start().map_err(|error| NoLine::Unreachable(error.to_string()))?;
    let url = hub.url.clone();
    let connected = tasks.run(async move { options.connect(url).await }).await;
    let connected = connected.ok_or_else(|| NoLine::Unreachable("what answers there is no hub".into()))?;
    let client = connected.map_err(|error| match error.kind() {
        ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => NoLine::Refused,
        _ => NoLine::Unreachable(error.to_string()),
    })?;
    Ok(Connected { client, is_cut, tasks })
}
