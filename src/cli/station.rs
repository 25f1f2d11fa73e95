//! What `serve` and `demo` share: the engine, the DDS bridge and the web server, from start to end.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;

use anyhow::{Context as _, anyhow};
use tokio::net::TcpListener;
use tokio::sync::{oneshot, watch};

use super::ending::Ending;
use super::{dds, reload};
use crate::clock::Clock;
use crate::config::Loaded;
use crate::engine::input::{OperatorAction, Response};
use crate::engine::model::Model;
use crate::engine::record::Record;
use crate::ros::{self, Bridge, BridgeOptions};
use crate::runtime::{self, Command, Link};
use crate::store::{History, Store};
use crate::web::{self, AppState, DemoFaults, Origins, Settings};

/// Where browsers find the display unless told otherwise: this machine alone.
pub const LISTEN: &str = "127.0.0.1:8080";

/// Everything that a running display is made of.
pub struct Station {
    pub loaded: Loaded,
    /// The file that it was read from, to read it again.
    pub file: Option<PathBuf>,
    pub store: Store,
    /// The folder of the history; without one it is kept in memory.
    pub folder: Option<PathBuf>,
    pub options: BridgeOptions,
    pub listener: TcpListener,
    /// Addresses by which browsers reach it, beside that of the listener.
    pub origins: Vec<String>,
    pub demo: Option<DemoFaults>,
    pub clock: Clock,
}

impl Station {
    /// Runs until the program is asked to end.
    ///
    /// # Errors
    /// What keeps it from starting: DDS, the database, an origin that is none.
    pub async fn run(self, mut ending: Ending) -> anyhow::Result<()> {
        let Station { loaded, file, store, folder, options, listener, origins, demo, clock } = self;
        let address = listener.local_addr().context("the listener has no address")?;
        let listens_to = dds::describe(&options);
        let (history, records) = open_history(folder.as_deref(), clock).unzip();
        let link = runtime::start_recorded(loaded.model.clone(), clock, records);
        let reloads = file
            .map(|file| {
                let definitions = options.definitions.clone();
                reload::start(file, loaded.clone(), definitions, link.reloads.clone())
            })
            .transpose()?;
        let rereads = reloads.as_ref().map(|reloads| reloads.requests.clone());
        let bridge = ros::start(options, &loaded.model, link.inputs.clone(), clock).await?;
        let discovery = Some(bridge.discovery());
        let settings = Settings {
            origins: known_origins(address, &origins)?,
            secure: false,
            demo,
            rereads,
            history,
            discovery,
        };
        restore_operator(&store, &link).await?;
        tracing::info!("the display is on {}; it listens to {listens_to}", url(address));
        {
            let serving = web::serve(listener, AppState::new(link, store, clock, settings), ending.asked());
            let running = reloads.map(|reloads| reloads.running);
            while_serving(serving, &bridge, running).await?;
        }
        tracing::info!("ending");
        tokio::select! {
            () = bridge.shutdown() => {}
            () = ending.asked() => {}
        }
        Ok(())
    }
}

/// The history is no reason not to start: without it, its page says so.
fn open_history(folder: Option<&Path>, clock: Clock) -> Option<(History, SyncSender<Vec<Record>>)> {
    let opened = folder.map_or_else(|| History::in_memory(clock), |folder| History::open(folder, clock));
    opened.inspect_err(|error| tracing::error!("nothing will be recorded: {error}")).ok()
}

/// Serves until the end, and lets the bridge follow the configuration. The engine runs by it already:
/// what the bridge says anew would be forgotten by an engine that changes later.
async fn while_serving(
    serving: impl Future<Output = std::io::Result<()>>,
    bridge: &Bridge,
    mut running: Option<watch::Receiver<Loaded>>,
) -> anyhow::Result<()> {
    let mut serving = std::pin::pin!(serving);
    loop {
        let next = tokio::select! {
            served = &mut serving => return Ok(served?),
            next = changed(&mut running) => next,
        };
        if let Err(error) = bridge.follow(&next) {
            tracing::error!("the old topics are read still: {error}");
        }
    }
}

/// The model of the next configuration that is taken; never, where there is none to come.
async fn changed(running: &mut Option<watch::Receiver<Loaded>>) -> Arc<Model> {
    if let Some(running) = running
        && running.changed().await.is_ok()
    {
        return running.borrow_and_update().model.clone();
    }
    std::future::pending().await
}

/// Listens for browsers.
///
/// # Errors
/// Why that is not possible, and what to do.
pub async fn bind(address: SocketAddr) -> anyhow::Result<TcpListener> {
    TcpListener::bind(address).await.map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => {
            anyhow!(
                "{address} is in use, perhaps by another telltale. End that, or choose another with --listen"
            )
        }
        ErrorKind::AddrNotAvailable => {
            anyhow!("this machine has no address {}. Choose one that it has with --listen", address.ip())
        }
        ErrorKind::PermissionDenied => {
            anyhow!("port {} is for the system alone. Choose one above 1023 with --listen", address.port())
        }
        _ => anyhow::Error::new(error).context(format!("nothing can listen on {address}")),
    })
}

/// Where a browser on this machine finds the display.
pub fn url(address: SocketAddr) -> String {
    let host = match address.ip() {
        ip if ip.is_unspecified() => "localhost".to_owned(),
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    };
    format!("http://{host}:{}", address.port())
}

fn known_origins(address: SocketAddr, more: &[String]) -> anyhow::Result<Origins> {
    let mut origins = Origins::of_listener(address, false);
    for origin in more {
        origins.add(origin).context("--origin")?;
    }
    Ok(origins)
}

/// Who sat in the operator's seat and has an open session sits there again: a restart in the
/// middle of a drive must not leave the vehicle without a display.
async fn restore_operator(store: &Store, link: &Link) -> anyhow::Result<()> {
    let Some(operator) = store.seated_operator().await? else { return Ok(()) };
    let (reply, answer) = oneshot::channel();
    let action = OperatorAction::Login { name: operator.as_str().into() };
    let ended = "the engine has ended";
    link.commands.send(Command { action, reply }).await.context(ended)?;
    match answer.await.context(ended)? {
        Response::Done => tracing::info!("{operator} is the operator still"),
        Response::Refused(reasons) => tracing::warn!("{operator} cannot be the operator again: {reasons:?}"),
    }
    Ok(())
}
