//! `telltale demo`: everything on one machine, with a simulated shuttle in a DDS participant of its own.
//! Its configuration is part of the binary.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use tokio::sync::mpsc;

use super::server::{self, Server};
use super::shutdown_signal::ShutdownSignal;
use super::vehicle::{SWITCHES, Vehicle};
use super::{EXIT_USAGE, check, log};
use crate::clock::Clock;
use crate::config::{self, Loaded};
use crate::ros::{BridgeOptions, DOMAIN_MAX, DdsProcess};
use crate::sim::shuttle::{Departure, Fault};
use crate::store::{DEMO_USERS, DemoSecrets, Role, Store};
use crate::web::{DemoFaults, Enrolled, FaultSwitch};
use crate::yaml::Problems;

const CONFIG: &str = include_str!("../../config/shuttle.yaml");

/// Domains that hardly anybody uses. All their ports lie below those that Linux assigns by itself.
const DOMAINS: std::ops::RangeInclusive<u16> = 60..=99;

/// See it work: a simulated shuttle over real DDS on the loopback interface, and the display.
///
/// Nothing else is needed, nothing leaves this machine, nothing is kept.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale demo --listen 127.0.0.1:9000")]
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
    /// Let the shuttle leave every stop by itself, without an operator
    #[arg(long)]
    drive: bool,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("warn");
    let loaded = match load_config() {
        Ok(loaded) => loaded,
        Err(problems) => {
            check::report(&problems);
            return Ok(ExitCode::from(EXIT_USAGE));
        }
    };
    tokio::runtime::Runtime::new()
        .context("the async runtime cannot be started")?
        .block_on(demo(args, loaded))
}

async fn demo(args: &Args, loaded: Loaded) -> anyhow::Result<ExitCode> {
    let signal = ShutdownSignal::listen()?;
    server::check_plain(args.listen, false, args.insecure_http)?;
    let listener = server::bind(args.listen).await?;
    let dds_process = DdsProcess::Child { megabytes: DdsProcess::MEGABYTES };
    let options = BridgeOptions { dds_process, ..BridgeOptions::loopback(domain(args.domain)?) };
    let clock = Clock::start();
    let store = Store::in_memory(clock, DemoSecrets::Accepted)?;
    store.add_demo_users().await?;
    let departure = if args.drive { Departure::Alone } else { Departure::Cleared };
    let vehicle = Vehicle::open(&options, &loaded, departure, clock).await?;
    let (fault_sender, faults) = mpsc::channel(SWITCHES);
    let (switch, switches) = mpsc::channel(SWITCHES);
    let driving = tokio::spawn(vehicle.run(faults));
    tokio::spawn(forward(switches, fault_sender));
    let names = Fault::ALL.map(Fault::as_str).to_vec();
    print!("{}", introduction(listener.local_addr()?, options.domain, args.drive));
    let demo = Some(DemoFaults::new(names, switch));
    let server = Server {
        loaded,
        file: None,
        store,
        folder: None,
        options,
        listener,
        tls: None,
        enrolled: Enrolled::default(),
        origins: Vec::new(),
        demo,
        clock,
    };
    server.run(signal).await?;
    driving.await.context("the simulated shuttle failed")?;
    Ok(ExitCode::SUCCESS)
}

/// Hands the page's switches to the shuttle, which ends with the server's end of the channel.
async fn forward(mut switches: mpsc::Receiver<FaultSwitch>, faults: mpsc::Sender<(Fault, bool)>) {
    while let Some(switch) = switches.recv().await {
        if let Some(fault) = Fault::from_word(switch.name)
            && faults.send((fault, switch.active)).await.is_err()
        {
            return;
        }
    }
}

fn load_config() -> Result<Loaded, Problems> {
    config::parse("config/shuttle.yaml", CONFIG)
}

/// The given domain, or one that no participant on this machine uses.
fn domain(asked: Option<u16>) -> anyhow::Result<u16> {
    match asked {
        Some(domain) if domain <= DOMAIN_MAX => Ok(domain),
        Some(domain) => bail!("domain {domain} does not exist: ROS domains are 0 to {DOMAIN_MAX}"),
        None => DOMAINS.into_iter().find(|&domain| is_free(domain)).with_context(|| {
            let (first, last) = (DOMAINS.start(), DOMAINS.end());
            format!("the DDS domains {first} to {last} are all in use here; choose another one with --domain")
        }),
    }
}

/// Whether the port of a domain's first participant is free (RTPS 2.5, 9.6.2.3).
fn is_free(domain: u16) -> bool {
    UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 7400 + 250 * domain + 10)).is_ok()
}

/// Prints the address, the users and what can be tried, on one screen.
fn introduction(address: SocketAddr, domain: u16, alone: bool) -> String {
    let url = server::url(address, false);
    let mut text = format!(
        "Telltale demo: a simulated shuttle over real DDS, domain {domain}, on this machine alone.\n\n\
         \x20 Look      {url}\n\n  Log in\n"
    );
    for (name, role, secret) in DEMO_USERS {
        let (kind, sees) = match role {
            Role::Operator => ("PIN", "the display in the vehicle"),
            Role::Developer => ("password", "everything, behind the display"),
            Role::Authority => ("password", "everything, to read"),
        };
        text += &format!("            {name:<10} {kind:<8} {secret:<15} {sees}\n");
    }
    text += if alone {
        "\n  The shuttle leaves every stop by itself after 10 s and drives for about a minute.\n"
    } else {
        "\n  Drive     Log in as operator. Say that the shuttle stands at the Depot. When there is a goal,\n\
         \x20           clear it; it drives to the next stop, waits for the next clearance, and so on.\n"
    };
    text += &format!("\n  Faults    {url}/demo\n");
    for fault in Fault::ALL {
        text += &format!("            {:<18} {}\n", fault.as_str(), fault.about());
    }
    text += "\n  End       Ctrl-C\n";
    text
}

#[cfg(test)]
mod tests;
