//! The server of `serve` and `demo`: starts and ends the engine, the DDS bridge and the web server.

mod fleet;
pub mod learn;
mod left_over;
pub mod metrics;
mod other_diagnostics;
pub mod outputs;
mod recording;
pub mod reload;
mod services;
mod timekeeping;
mod trends;
mod watchdog;
pub mod what_if;

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::timeout_at;

use self::fleet::Telling;
use self::metrics::MetricsListener;
use self::recording::Recording;
use self::reload::Reloads;
use self::services::Serving;
use self::timekeeping::Watched;
use self::watchdog::Watchdog;
use crate::cli::process::dds;
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::clock::Clock;
use crate::config::Loaded;
use crate::engine::input::Input;
use crate::engine::model::Model;
use crate::engine::view::record::Record as Happening;
use crate::record::feed::Turns;
use crate::ros::publish::outputs::Outputs;
use crate::ros::{self, Bridge, BridgeOptions};
use crate::runtime::{self, Followers, Link, Stamped, Written};
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{History, Store, TemporaryFolder};
use crate::web::{self, AppState, DemoFaults, Enrolled, Origins, Settings, Tls};

/// Reads `ADDRESS:PORT`.
///
/// # Errors
/// What to write instead.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    let host = text.strip_prefix("localhost").map(|rest| format!("127.0.0.1{rest}"));
    let text = host.as_deref().unwrap_or(text);
    text.parse().map_err(|_| {
        let port = text.strip_prefix(':').unwrap_or(text).parse::<u16>();
        match (port, text.trim_matches(['[', ']']).parse::<IpAddr>()) {
            (Ok(port), _) => {
                format!(
                    "a port alone: write `127.0.0.1:{port}` for this machine alone, `0.0.0.0:{port}` for all"
                )
            }
            (_, Ok(ip)) => format!("no port: write `{}`", SocketAddr::new(ip, 8080)),
            _ => "write an address with its port, for example `127.0.0.1:8080`".to_owned(),
        }
    })
}

/// The address of the display if none is given: this machine alone.
pub const LISTEN: &str = "127.0.0.1:8080";

/// The steps of the end, each within its time from the signal on, so that none takes the time of the next. The pages
/// and the vehicle's state go before (`web::serve`); after all of them, and a quarter of a second for a busy computer to
/// stop the threads, the program ends by force (`ShutdownSignal`).
pub const RECORDED_WITHIN: Duration = Duration::from_millis(1800);
const INCIDENT_WITHIN: Duration = Duration::from_millis(2050);
pub const CLOSED_WITHIN: Duration = Duration::from_millis(2250);

/// What a display is started with.
pub struct Server {
    pub loaded: Loaded,
    /// Without it the configuration stays.
    pub next: Option<NextConfigurations>,
    pub store: Store,
    /// The folder of the history; without one it is kept in memory.
    pub folder: Option<PathBuf>,
    pub options: BridgeOptions,
    pub listener: TcpListener,
    /// Without it browsers come over plain HTTP.
    pub tls: Option<Tls>,
    /// The vehicle's own displays, where a PIN suffices.
    pub enrolled: Enrolled,
    /// Addresses by which browsers reach it, beside that of the listener.
    pub origins: Vec<String>,
    pub demo: Option<DemoFaults>,
    pub metrics: Option<MetricsListener>,
    pub clock: Clock,
}

/// Where further configurations come from.
pub enum NextConfigurations {
    /// The file, which is read again when somebody asks for it.
    File(PathBuf),
    /// Texts that are taken one after the other.
    Drafts(mpsc::Receiver<String>),
}

impl Server {
    /// Runs until the program is asked to end.
    ///
    /// # Errors
    /// If DDS or the database cannot be started, or an origin is wrong.
    pub async fn run(mut self, mut signal: ShutdownSignal) -> anyhow::Result<()> {
        let (clock, secure) = (self.clock, self.tls.is_some());
        let address = self.listener.local_addr().context("the listener has no address")?;
        let (history, records) = open_history(self.folder.as_deref(), clock).unzip();
        let (feed, turns) = recording::queue(&self.loaded, clock);
        let link = resume(&self.loaded.model, &self.store, clock, Followers { records, feed }).await?;
        let trends = history.clone().map(|history| trends::keep(&link, history));
        TemporaryFolder::remove_left_over();
        let recordings = recording::Folder::of(self.folder.as_deref())?;
        let incidents = recordings.path().to_owned();
        let origins = known_origins(address, secure, &self.origins)?;
        let (loaded, reloads) = (self.loaded.clone(), link.reloads.clone());
        let (rereads, running) = match self.next.take() {
            None => (None, None),
            Some(NextConfigurations::Drafts(texts)) => (None, Some(reload::follow(texts, loaded, reloads)?)),
            Some(NextConfigurations::File(file)) => {
                let definitions = self.options.definitions.clone();
                let Reloads { requests, running } = reload::start(file, loaded, definitions, reloads)?;
                (Some(requests), Some(running))
            }
        };
        let (parts, calls) = self.start_parts(&link, turns, recordings).await?;
        self.store.record(Record::of(Action::Start, TELLTALE).on(crate::record::VERSION), None).await;
        let tasks = self.start_tasks(&link, &parts);
        let settings = Settings {
            enrolled: self.enrolled,
            demo: self.demo,
            rereads,
            written: Some(parts.written.subscribe()),
            history: history.clone(),
            discovery: Some(parts.bridge.discovery()),
            working: vec![parts.bridge.working(), parts.outputs.working()],
            recordings: Some(incidents),
            what_if: Some(what_if::examiner(self.options.definitions.clone())),
            learner: Some(learn::learner(self.options.definitions.clone())),
            marker: parts.recording.as_ref().map(Recording::marker),
            recording: parts.recording.as_ref().map(Recording::state),
            ..Settings::plain(origins, secure)
        };
        let listens_to = dds::describe(&self.options);
        let status = format!("the display is on {}; it listens to {listens_to}", url(address, secure));
        tracing::info!("{status}");
        let (engine, ending) = (link.inputs.clone(), link.ending.clone());
        let app = AppState::new(link, self.store.clone(), clock, settings);
        let metrics = self.metrics.map(|metrics| {
            let app = app.clone();
            metrics.serve(Arc::new(move || crate::metrics::text(&app)))
        });
        let watchdog = Watchdog::start(&status, app.clone());
        // It ends with the services, and nothing that it does is cut off.
        app.live().map(|live| tokio::spawn(services::answer(calls, live)));
        let serving = web::serve(self.listener, self.tls, app.clone(), signal.requested());
        let requested = tokio::select! {
            requested = while_serving(serving, &parts, running, &app.store) => requested?,
            () = engine.closed() => bail!(
                "the diagnosis has ended by a fault of this program, which is logged above: nothing is \
                 shown any more. Start it again, and report the fault"
            ),
        };
        tracing::info!("ending");
        if let Some(watchdog) = watchdog {
            watchdog.end();
        }
        tasks.iter().chain(&metrics).for_each(JoinHandle::abort);
        let by = requested + RECORDED_WITHIN;
        let (recording, ()) = tokio::join!(parts.end(by, &mut signal), record_end(&self.store, by));
        ending.end();
        if let Some(recording) = recording {
            recording.end(requested + INCIDENT_WITHIN).await;
        }
        close(history, trends, self.store, requested + CLOSED_WITHIN).await;
        Ok(())
    }

    async fn start_parts(
        &self,
        link: &Link,
        turns: Option<Turns>,
        folder: recording::Folder,
    ) -> anyhow::Result<(Parts, services::Calls)> {
        let Server { loaded, store, options, clock, .. } = self;
        let recording = match turns {
            Some(turns) => {
                let (definitions, is_demo) = (options.definitions.clone(), self.demo.is_some());
                let around = recording::Around { folder, definitions, is_demo };
                recording::start(loaded, turns, link, store, around, *clock).await?
            }
            None => None,
        };
        let bridge = ros::start(options.clone(), &loaded.model, link.inputs.clone(), *clock).await?;
        let outputs = outputs::start(options, &loaded.publishing, link, &bridge, *clock).await?;
        let (services, calls) = services::start(options, &loaded.services, &bridge, *clock);
        let telling = fleet::start(loaded, link, store, self.folder.as_deref(), *clock);
        let (written, _) = watch::channel(reload::written(loaded));
        Ok((Parts { bridge, outputs, services, recording, telling, written }, calls))
    }

    /// What goes on beside the pages.
    fn start_tasks(&self, link: &Link, parts: &Parts) -> [JoinHandle<()>; 3] {
        let Server { loaded, store, clock, .. } = self;
        let hosts = self.origins.iter().filter_map(|origin| Origins::secure_host(origin)).collect();
        let watched = Watched {
            recording: parts.recording.as_ref().map(|it| it.watched(parts.bridge.unrecorded())),
            fleet: parts.telling.as_ref().map(Telling::status),
        };
        let (tls, floor, inputs) = (self.tls.clone(), store.floor(), link.inputs.clone());
        [
            tokio::spawn(tell_of_storage(store.clone(), inputs.clone(), *clock)),
            tokio::spawn(timekeeping::watch(tls, hosts, floor, watched, inputs, *clock)),
            tokio::spawn(other_diagnostics::say(loaded.model.clone(), parts.bridge.discovery())),
        ]
    }
}

/// What follows each new configuration.
struct Parts {
    bridge: Bridge,
    outputs: Outputs,
    services: Serving,
    recording: Option<Recording>,
    telling: Option<Telling>,
    /// The configuration as the pages show it.
    written: watch::Sender<Arc<Written>>,
}

impl Parts {
    /// Says goodbye on DDS and to the fleet. What comes then is recorded still, until the engine ends.
    async fn end(self, by: Instant, signal: &mut ShutdownSignal) -> Option<Recording> {
        let Parts { bridge, outputs, services, recording, telling, .. } = self;
        let on_dds = async {
            let said = async { tokio::join!(bridge.shutdown(), outputs.shutdown(), services.shutdown()) };
            tokio::select! {
                said = timeout_at(by.into(), said) => {
                    if said.is_err() {
                        tracing::warn!("the processes of DDS or Zenoh do not end in time");
                    }
                }
                _ = signal.requested() => {}
            }
        };
        let to_the_fleet = async {
            if let Some(telling) = telling {
                telling.end(by).await;
            }
        };
        tokio::join!(on_dds, to_the_fleet);
        recording
    }
}

async fn record_end(store: &Store, by: Instant) {
    let recording = store.record(Record::of(Action::End, TELLTALE), None);
    if timeout_at(by.into(), recording).await != Ok(true) {
        tracing::error!("the end is not recorded");
    }
}

/// Waits until everything is on the disk.
async fn close(history: Option<History>, trends: Option<JoinHandle<()>>, store: Store, by: Instant) {
    let written = async {
        if let Some(history) = history {
            history.written().await;
        }
        if let Some(trends) = trends {
            // It cannot panic, and nobody aborts it.
            let _ = trends.await;
        }
    };
    if timeout_at(by.into(), async { tokio::join!(written, store.close()) }).await.is_err() {
        tracing::error!("the disk does not answer: what it was given last may be lost");
    }
}

/// Opens the history. Without one the server starts all the same, and the page of the history says so.
fn open_history(folder: Option<&Path>, clock: Clock) -> Option<(History, SyncSender<Vec<Happening>>)> {
    let opened = folder.map_or_else(|| History::in_memory(clock), |folder| History::open(folder, clock));
    opened.inspect_err(|error| tracing::error!("nothing will be recorded: {error}")).ok()
}

/// Serves until the end, and lets everything follow each new configuration. The engine runs by it already:
/// an engine that changed later would forget what the bridge reports anew.
async fn while_serving(
    serving: impl Future<Output = std::io::Result<Instant>>,
    parts: &Parts,
    mut running: Option<watch::Receiver<Loaded>>,
    store: &Store,
) -> anyhow::Result<Instant> {
    let mut serving = std::pin::pin!(serving);
    loop {
        let next = tokio::select! {
            served = &mut serving => return Ok(served?),
            next = changed(&mut running) => next,
        };
        parts.written.send_replace(reload::written(&next));
        parts.outputs.follow(outputs::topics(&next.publishing));
        parts.services.follow(&next.services);
        if let Some(recording) = &parts.recording {
            recording.follow(&next);
        }
        if let Some(telling) = &parts.telling {
            telling.follow(&next);
        }
        // Nobody is served while this waits, so it waits for no disk.
        store.note(Record::of(Action::Configuration, TELLTALE).on("another configuration is taken"));
        if let Err(error) = parts.bridge.follow(&next.model) {
            tracing::error!("the old topics are read still: {error}");
        }
    }
}

/// Waits for the next configuration that is taken.
async fn changed(running: &mut Option<watch::Receiver<Loaded>>) -> Loaded {
    if let Some(running) = running
        && running.changed().await.is_ok()
    {
        return running.borrow_and_update().clone();
    }
    std::future::pending().await
}

/// Listens for browsers.
///
/// # Errors
/// Why that fails, and what to do.
pub async fn bind(address: SocketAddr) -> anyhow::Result<TcpListener> {
    bind_as(address, "--listen").await
}

/// The same for the address of this flag.
async fn bind_as(address: SocketAddr, flag: &str) -> anyhow::Result<TcpListener> {
    TcpListener::bind(address).await.map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => {
            anyhow!(
                "{address} is in use, perhaps by another telltale. End that, or choose another with {flag}"
            )
        }
        ErrorKind::AddrNotAvailable => {
            anyhow!("this machine has no address {}. Choose one that it has with {flag}", address.ip())
        }
        ErrorKind::PermissionDenied => {
            anyhow!("port {} is for the system alone. Choose one above 1023 with {flag}", address.port())
        }
        _ => anyhow::Error::new(error).context(format!("nothing can listen on {address}")),
    })
}

/// The address at which a browser on this machine finds the display.
pub fn url(address: SocketAddr, secure: bool) -> String {
    let host = match address.ip() {
        ip if ip.is_unspecified() => "localhost".to_owned(),
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    };
    let scheme = if secure { "https" } else { "http" };
    format!("{scheme}://{host}:{}", address.port())
}

/// The addresses by which browsers reach a listener.
///
/// # Errors
/// One of those that were given is none.
pub fn known_origins(address: SocketAddr, secure: bool, more: &[String]) -> anyhow::Result<Origins> {
    let mut origins = Origins::of_listener(address, secure);
    for origin in more {
        origins.add(origin).context("--origin")?;
    }
    Ok(origins)
}

/// Reports the faults of the storage to the engine.
async fn tell_of_storage(store: Store, inputs: mpsc::Sender<Stamped>, clock: Clock) {
    let mut faults = store.fault();
    drop(store);
    loop {
        let fault = faults.borrow_and_update().as_deref().map(Box::from);
        let news = Stamped::new(Input::Storage { fault }, clock.now());
        if inputs.send(news).await.is_err() || faults.changed().await.is_err() {
            return;
        }
    }
}

/// Refuses plain HTTP beyond this machine, which shows secrets and sessions to everybody on the way, unless
/// the flag `--insecure-http` is given.
///
/// # Errors
/// What to do instead.
pub fn check_plain(address: SocketAddr, has_tls: bool, insecure: bool) -> anyhow::Result<()> {
    if has_tls || insecure || address.ip().is_loopback() {
        return Ok(());
    }
    bail!(
        "{address} is beyond this machine, and plain HTTP shows secrets to everybody on the way. Give a \
         certificate with --tls-cert and --tls-key (`telltale tls self-signed` makes one), listen on \
         127.0.0.1, or ask for plain HTTP by name with --insecure-http"
    )
}

/// Starts the engine where the last run ended: a restart during a drive must not leave the vehicle without a
/// display. The states of modules are unknown until they are heard.
async fn resume(
    model: &Arc<Model>,
    store: &Store,
    clock: Clock,
    followers: Followers,
) -> anyhow::Result<Link> {
    let Some(restored) = store.recall().await? else {
        return Ok(runtime::start_followed(model.clone(), clock, followers));
    };
    let (stage, alarms) = (restored.stage.as_str(), restored.alarms.len());
    let operator = restored.operator.as_deref().unwrap_or("nobody");
    tracing::info!("going on: the vehicle was {stage}, the operator is {operator}, {alarms} alarms are open");
    Ok(runtime::resume(model.clone(), &restored, clock, followers))
}
