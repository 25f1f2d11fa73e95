//! `telltale serve`: runs the display of a vehicle.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;

use super::server::metrics::MetricsFlags;
use super::server::{self, NextConfigurations, Server};
use crate::cli::configuration::init::unconfigured;
use crate::cli::fields;
use crate::cli::process::data_folder::{self, DataFolder};
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::process::{async_runtime, dds, log};
use crate::clock::Clock;
use crate::config::{self, Loaded};
use crate::ros::{BridgeOptions, Transport};
use crate::store::Caller;
use crate::store::{DemoSecrets, Store, exposed};
use crate::web::{Enrolled, Network, Origins, Proxies, Tls, VehicleDisplay};

/// Listen to a vehicle's diagnostics and show them in browsers.
///
/// SIGHUP reads the configuration again: with an error in it the old one stays, otherwise it is
/// taken whole, and the log says what is different. Modules that stay keep their state.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  telltale serve --config config/shuttle.yaml --data /var/lib/telltale\n  \
    telltale serve --config config/shuttle.yaml --listen 0.0.0.0:8443 --origin https://shuttle-1.example:8443 \\\n    \
    --tls-cert /etc/telltale/cert.pem --tls-key /etc/telltale/key.pem\n\n\
    Before the first start: telltale user add NAME --role operator --data DIR"
)]
pub struct Args {
    /// The configuration of the vehicle
    ///
    /// Without one, every status that is heard is shown, by node; `telltale init` writes a first configuration.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where browsers find the display
    #[arg(long, value_name = "ADDR", default_value = server::LISTEN, value_parser = server::address)]
    listen: SocketAddr,
    /// Another address by which browsers reach it, through a proxy or by name; may be repeated
    ///
    /// Behind a proxy on this machine every browser looks like a display on it: give `--display none`
    /// or the display's own address, or all of them count as the vehicle's own, with a PIN.
    #[arg(long = "origin", value_name = "URL")]
    origins: Vec<String>,
    #[command(flatten)]
    data: DataFolder,
    /// The certificate for TLS, PEM, the server's own first
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The key of the certificate, PEM
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Plain HTTP may leave this machine: everybody on the way can read and change it
    #[arg(long, conflicts_with = "tls_cert")]
    insecure_http: bool,
    /// One of the vehicle's own displays: an address, `loopback` or `none`; may be repeated [default: loopback]
    ///
    /// Operators may log in with a PIN there, and a flood of requests from elsewhere does not delay it. Every
    /// other address counts as elsewhere; without `loopback`, this machine too.
    #[arg(long = "display", value_name = "IP")]
    displays: Vec<VehicleDisplay>,
    /// A proxy, or a network of proxies, whose `X-Forwarded-For` is trusted; may be repeated
    ///
    /// The address of a browser behind it is the last one in that header that belongs to no trusted proxy. A
    /// browser that it does not name, and the proxy itself, count as elsewhere: no PIN will do there.
    #[arg(long = "trusted-proxy", value_name = "CIDR")]
    proxies: Vec<Network>,
    #[command(flatten)]
    metrics: MetricsFlags,
    #[command(flatten)]
    dds: dds::DdsFlags,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("info");
    let definitions = args.dds.definitions.definitions();
    let examined = match &args.config {
        Some(file) => config::examine(file),
        None => unconfigured::examined(),
    };
    let loaded = fields::whole(examined, |loaded| definitions.with(&loaded.message_folders))?;
    async_runtime::start()?.block_on(serve(args, loaded))
}

async fn serve(args: &Args, loaded: Loaded) -> anyhow::Result<ExitCode> {
    let signal = ShutdownSignal::listen()?;
    if loaded.is_shuttle_unsaid() {
        tracing::warn!(
            "the configuration does not say what it is for, so the vehicle counts as a shuttle: it begins locked, and nothing \
             is judged before an operator logs in. Write `vehicle: {{ stages: none }}` for a machine that is no shuttle, or \
             the signal `active`, which says whether a shuttle drives"
        );
    }
    let mut options = args.dds.resolve()?;
    options.definitions = options.definitions.with(&loaded.message_folders);
    say_whom_ros_believes(&options);
    let clock = Clock::start();
    let tls = tls(args)?;
    let enrolled = Enrolled::new(args.displays.clone()).behind(Proxies::new(args.proxies.clone()));
    warn_of_proxy(args, &enrolled);
    server::check_plain(args.listen, tls.is_some(), args.insecure_http)?;
    let listener = server::bind(args.listen).await?;
    let metrics = args.metrics.bind().await?;
    let folder = args.data.path()?;
    let _lock = data_folder::lock(&folder)?;
    let store = Store::open_or_read(&folder, clock, DemoSecrets::Refused)?;
    for file in exposed(&folder, args.tls_key.as_deref()) {
        tracing::warn!("{file}");
    }
    say_if_nobody_can_log_in(&store, &folder).await;
    let origins = args.origins.clone();
    let next = Some(match args.config.clone() {
        Some(file) => NextConfigurations::File(file),
        None => NextConfigurations::Drafts(unconfigured::drafts(options.clone()).await?),
    });
    let folder = Some(folder);
    Server {
        loaded,
        next,
        store,
        folder,
        options,
        listener,
        tls,
        enrolled,
        origins,
        demo: None,
        metrics,
        clock,
    }
    .run(signal)
    .await?;
    Ok(ExitCode::SUCCESS)
}

/// Reads the certificate and its key, and compares them with the names by which browsers reach the server.
fn tls(args: &Args) -> anyhow::Result<Option<Tls>> {
    let (Some(certificate), Some(key)) = (&args.tls_cert, &args.tls_key) else { return Ok(None) };
    let tls = Tls::load(certificate, key)?;
    for origin in &args.origins {
        if let Some(host) = Origins::secure_host(origin) {
            tls.check_name(&host).with_context(|| format!("--origin {origin}"))?;
        }
    }
    Ok(Some(tls))
}

/// Logs that ROS 2 is not authenticated (`docs/security.md`): nobody should have to find that out.
fn say_whom_ros_believes(options: &BridgeOptions) {
    let network = match options.transport {
        Transport::Dds => "DDS is not authenticated",
        Transport::Zenoh => "Zenoh is not authenticated unless its router asks for certificates",
    };
    tracing::info!(
        "{network}: every program that can send to domain {} can publish diagnostics and signals under any \
         name. Keep its network apart, and name who may say a status with `writers`",
        options.domain
    );
}

/// Warns about a proxy on this machine: every browser then comes from the loopback interface and looks like
/// the display in the vehicle. Also warns of a display whose address is a trusted proxy's.
fn warn_of_proxy(args: &Args, enrolled: &Enrolled) {
    if let Some(named) = enrolled.display_of_proxy() {
        tracing::warn!(
            "`--display {named}` is the address of a trusted proxy, so it counts as elsewhere: no PIN will do \
             there. Let the proxy on this machine come from another address, such as 127.0.0.2, and trust that one"
        );
    }
    let is_proxied = |origin: &&String| {
        let is_secure = Origins::secure_host(origin).is_some();
        let beyond = Origins::host(origin).is_some_and(|host| !is_local(&host));
        beyond && (args.listen.ip().is_loopback() || is_secure && args.tls_cert.is_none())
    };
    if let Some(origin) = args
        .origins
        .iter()
        .find(is_proxied)
        .filter(|_| enrolled.caller(Ipv4Addr::LOCALHOST.into()) == Caller::Vehicle)
        && args.proxies.is_empty()
    {
        tracing::warn!(
            "{origin} is reached through a proxy: if that runs on this machine, every browser behind it looks \
             like the display in the vehicle, and a PIN will do there. Give --trusted-proxy with the address of \
             the proxy, or --display none, or the address of the display"
        );
    }
}

fn is_local(host: &str) -> bool {
    let ip = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host.eq_ignore_ascii_case("localhost") || ip.is_ok_and(|ip| ip.is_loopback())
}

async fn say_if_nobody_can_log_in(store: &Store, data: &Path) {
    // Of a damaged database it was said already what to do.
    if matches!(store.has_users().await, Ok(false)) {
        tracing::warn!(
            "there are no users yet, so nobody can log in. Add one, while this runs: \
             telltale user add NAME --role operator --data {}",
            data.display()
        );
    }
}
