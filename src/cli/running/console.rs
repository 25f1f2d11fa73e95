//! `telltale fleet serve`: runs the console of a fleet.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::timeout_at;

use super::server::metrics::{MetricsFlags, MetricsListener};
use super::server::{self, CLOSED_WITHIN, RECORDED_WITHIN, what_if};
use crate::cli::fields::DefinitionFlags;
use crate::cli::process::hub_flags::HubFlags;
use crate::cli::process::oidc_flags::OidcFlags;
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::process::{async_runtime, data_folder, log};
use crate::clock::Clock;
use crate::console::follow::Shared;
use crate::console::http::{Console, router};
use crate::console::oidc::{self, Oidc};
use crate::console::{kept, recordings};
use crate::fleet::identity::Identity;
use crate::fleet::line::Hub;
use crate::metrics;
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{DemoSecrets, Store, exposed};
use crate::web::{Examiner, Tls, serve_router};

/// Run the console of a fleet: all vehicles that tell the hub, the worst first
///
/// It reads what lies at the hub and acts on no vehicle. Users are added with `telltale user add` on its data folder, with
/// the roles `control_room`, `engineer` and `authority`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale user add anna --role control_room --data console\n  \
    telltale fleet serve --hub tls://hub.example:4222 --credentials hub/console.nk --data console")]
pub struct Args {
    #[command(flatten)]
    hub: HubFlags,
    /// The folder of users, sessions, the audit log, and the last states of all vehicles
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Where browsers find the console
    #[arg(long, value_name = "ADDR", default_value = server::LISTEN, value_parser = server::address)]
    listen: SocketAddr,
    /// Another address by which browsers reach it, through a proxy or by name; may be repeated
    #[arg(long = "origin", value_name = "URL")]
    origins: Vec<String>,
    /// The certificate for TLS, PEM, the server's own first
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The key of the certificate, PEM
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Plain HTTP may leave this machine: everybody on the way can read and change it
    #[arg(long, conflicts_with = "tls_cert")]
    insecure_http: bool,
    #[command(flatten)]
    oidc: OidcFlags,
    #[command(flatten)]
    metrics: MetricsFlags,
    #[command(flatten)]
    definitions: DefinitionFlags,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("info");
    async_runtime::start()?.block_on(serve(args))
}

async fn serve(args: &Args) -> anyhow::Result<ExitCode> {
    let mut signal = ShutdownSignal::listen()?;
    let clock = Clock::start();
    let oidc = args.oidc.read()?;
    let (hub, identity) = args.hub.read()?;
    let tls = match (&args.tls_cert, &args.tls_key) {
        (Some(certificate), Some(key)) => Some(Tls::load(certificate, key)?),
        _ => None,
    };
    server::check_plain(args.listen, tls.is_some(), args.insecure_http)?;
    let listener = server::bind(args.listen).await?;
    let metrics = args.metrics.bind().await?;
    let _lock = data_folder::lock(&args.data)?;
    let store = Store::open_or_read(&args.data, clock, DemoSecrets::Refused)?;
    for file in exposed(&args.data, args.tls_key.as_deref()) {
        tracing::warn!("{file}");
    }
    if oidc.is_none() && matches!(store.has_users().await, Ok(false)) {
        let data = args.data.display();
        tracing::warn!(
            "there are no users yet, so nobody can log in. Add one, while this runs: \
             telltale user add NAME --role control_room --data {data}"
        );
    }
    let kept = kept::Store::open(&args.data, clock)?;
    let origins = args.origins.clone();
    let data = args.data.clone();
    let examiner = what_if::examiner(args.definitions.definitions());
    let running =
        Running { hub, identity, store, kept, examiner, data, listener, tls, origins, oidc, metrics, clock };
    running.run(&mut signal).await?;
    Ok(ExitCode::SUCCESS)
}

/// Everything that a console runs with.
pub struct Running {
    pub hub: Hub,
    pub identity: Identity,
    /// Users, sessions and the audit log.
    pub store: Store,
    pub kept: kept::Store,
    /// Reads the configurations of what-ifs.
    pub examiner: Examiner,
    /// The data folder.
    pub data: PathBuf,
    pub listener: TcpListener,
    pub tls: Option<Tls>,
    /// Addresses by which browsers reach it, beside that of the listener.
    pub origins: Vec<String>,
    /// The issuer at which people log in too.
    pub oidc: Option<oidc::Settings>,
    pub metrics: Option<MetricsListener>,
    pub clock: Clock,
}

impl Running {
    /// Runs it until the end is requested. Returns when that was.
    ///
    /// # Errors
    /// An origin is none, or what was kept cannot be read.
    pub async fn run(self, signal: &mut ShutdownSignal) -> anyhow::Result<Instant> {
        let Running {
            hub,
            identity,
            store,
            kept,
            examiner,
            data,
            listener,
            tls,
            origins,
            oidc,
            metrics,
            clock,
        } = self;
        let shared = Shared::new(kept.fleet()?, clock);
        let address = listener.local_addr().context("the listener has no address")?;
        let origins = server::known_origins(address, tls.is_some(), &origins)?;
        store.record(Record::of(Action::Start, TELLTALE), None).await;

        let following = tokio::spawn(shared.clone().follow(hub, identity));
        let fetching = tokio::spawn(shared.clone().fetch(data.join(recordings::FOLDER), store.clone()));
        let (end, ended) = watch::channel(false);
        let keeping = tokio::spawn(shared.clone().keep(kept, ended));
        let written = shared.clone();
        let metrics = metrics.map(|it| it.serve(Arc::new(move || metrics::console::text(&written))));
        tracing::info!("the console is at {}", server::url(address, tls.is_some()));
        let console = Console::new(shared, store.clone(), &data, origins, tls.is_some());
        let oidc = oidc.map(|settings| Arc::new(Oidc::new(settings, clock)));
        // An issuer that is away is said in the log, and asked again at a login.
        let asking = oidc.clone().map(|oidc| tokio::spawn(async move { oidc.issuer().await.is_ok() }));
        let console = console.with_what_ifs(&data, examiner).with_oidc(oidc);
        let requested = serve_router(listener, tls, router(console), clock, signal.requested()).await;

        following.abort();
        fetching.abort();
        if let Some(asking) = asking {
            asking.abort();
        }
        if let Some(metrics) = metrics {
            metrics.abort();
        }
        end.send_replace(true);
        let recorded = store.record(Record::of(Action::End, TELLTALE), None);
        if timeout_at((requested + RECORDED_WITHIN).into(), recorded).await != Ok(true) {
            tracing::error!("the end is not recorded");
        }
        let closed = async { tokio::join!(keeping, store.close()) };
        if timeout_at((requested + CLOSED_WITHIN).into(), closed).await.is_err() {
            tracing::error!("the disk does not answer: what it was given last may be lost");
        }
        Ok(requested)
    }
}
