//! `telltale demo --fleet N`: a hub, simulated vehicles that tell it by the real line, and the console, on this machine.
//! The vehicles run real configurations in this process, without DDS.

mod cast;
pub mod hub;
mod past;
mod running;
mod simulated;
mod tape;
mod tunnel;

use std::fs;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout_at;

use super::{Args, load_config};
use crate::cli::print;
use crate::cli::process::log;
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::running::server::{self, reload, what_if};
use crate::cli::running::{console, vehicle::machine::Kind};
use crate::clock::Clock;
use crate::config::Loaded;
use crate::console::kept;
use crate::engine::model::{Model, Parts};
use crate::fleet::line;
use crate::msg::fields::Definitions;
use crate::record::writer::digest;
use crate::sim::machine::Departure;
use crate::store::{DEMO_CONSOLE_USERS, DemoSecrets, Role, Store};
use cast::{Fate, Member, members};
use hub::{Folder, Hub};
use running::Vehicle;
use tunnel::Tunnel;

/// More would need a faster machine than most.
pub const VEHICLES_MAX: u32 = 50;

/// As in a configuration that names none.
const KBIT_S_MAX: u32 = 512;

/// A copy of a vehicle is switched on when that has told of itself for a while.
const COPY_AFTER: Duration = Duration::from_secs(30);

/// From the request to end until vehicles no longer wait for the hub. The hub and the folder end after that.
const ENDED_WITHIN: Duration = Duration::from_millis(1500);

pub fn run(args: &Args, count: u32) -> anyhow::Result<ExitCode> {
    // A line that is cut is a part of the demo.
    log::start("error,async_nats=off");
    tokio::runtime::Runtime::new()
        .context("the async runtime cannot be started")?
        .block_on(fleet(args, count))
}

async fn fleet(args: &Args, count: u32) -> anyhow::Result<ExitCode> {
    let mut signal = ShutdownSignal::listen()?;
    server::check_plain(args.listen, false, args.insecure_http)?;
    let listener = server::bind(args.listen).await?;
    let metrics = args.metrics.bind().await?;
    let clock = Clock::start();
    let folder = Folder::make()?;
    let members = members(count);
    let ids: Vec<_> = members.iter().map(|it| it.id.clone()).collect();
    let mut hub = Hub::start(folder.path(), &ids, clock).await?;
    let store = Store::in_memory(clock, DemoSecrets::Accepted)?;
    store.add_demo_console_users().await?;
    let data = folder.path().join("console");
    let kept = kept::Store::open(&data, clock)?;
    print::text(&introduction(listener.local_addr()?, hub.process(), &members));

    let (end, ended) = watch::channel(None);
    let mut vehicles = JoinSet::new();
    let mut tunnels = JoinSet::new();
    for (vehicle, waits) in vehicles_of(members, &hub, &folder, clock, &mut tunnels).await? {
        vehicles.spawn(live(vehicle, waits, ended.clone()));
    }
    let (identity, hub_address) = (hub.console()?, hub.address());
    let console = console::Running {
        hub: hub_address,
        identity,
        store,
        kept,
        examiner: what_if::examiner(Definitions::default()),
        data,
        listener,
        tls: None,
        origins: Vec::new(),
        oidc: None,
        metrics,
        clock,
    };
    let requested = tokio::select! {
        requested = console.run(&mut signal) => requested?,
        () = hub.keep_alive() => unreachable!("it never returns"),
    };
    let until = requested + ENDED_WITHIN;
    end.send_replace(Some(until));
    // One that does not end has lost its line, and nobody waits for its goodbye.
    let _ = timeout_at(until.into(), vehicles.join_all()).await;
    drop(hub);
    Ok(ExitCode::SUCCESS)
}

/// The vehicles, with how long each waits until it is switched on.
async fn vehicles_of(
    members: Vec<Member>,
    hub: &Hub,
    folder: &Folder,
    clock: Clock,
    tunnels: &mut JoinSet<()>,
) -> anyhow::Result<Vec<(Vehicle, Duration)>> {
    let (shuttle, robot) = (load_config(Kind::Shuttle(Departure::Cleared))?, load_config(Kind::Robot)?);
    let config = |loaded: &Loaded| digest(&reload::texts(loaded));
    let configs = (config(&shuttle), config(&robot));
    let mut vehicles = Vec::new();
    for member in members {
        let (loaded, config) = match member.kind {
            Kind::Robot => (&robot, &configs.1),
            Kind::Shuttle(_) => (&shuttle, &configs.0),
        };
        let mut address = hub.address();
        if member.fate == Fate::Tunnels {
            let tunnel = Tunnel::open(hub.port()).await?;
            address = line::Hub { url: hub::url(tunnel.port()?), ..address };
            tunnels.spawn(tunnel.run());
        }
        let make = |member: &Member, folder_name: String| -> anyhow::Result<Vehicle> {
            let outbox = folder.path().join(folder_name);
            fs::create_dir(&outbox).with_context(|| format!("{} cannot be made", outbox.display()))?;
            Ok(Vehicle {
                loaded: named(loaded, member),
                member: member.clone(),
                config: config.clone(),
                hub: address.clone(),
                key_file: hub.key_file(&member.id),
                folder: outbox,
                kbit_s_max: KBIT_S_MAX,
                recordings: Vec::new(),
                clock,
            })
        };
        vehicles.push((make(&member, member.id.to_string())?, Duration::ZERO));
        if member.fate == Fate::Copied {
            let copy = Member { seed: member.seed + u64::from(VEHICLES_MAX), ..member.clone() };
            vehicles.push((make(&copy, format!("{}-copy", member.id))?, COPY_AFTER));
        }
    }
    Ok(vehicles)
}

/// The configuration of this vehicle: that of its kind, with its own name.
fn named(loaded: &Loaded, member: &Member) -> Loaded {
    let mut parts = Parts::clone(&loaded.model);
    parts.vehicle_id = member.id.as_str().into();
    parts.vehicle_name = member.name.clone();
    let mut loaded = loaded.clone();
    loaded.model = Arc::new(Model::new(parts).expect("the dependencies are those of a model"));
    loaded
}

async fn live(mut vehicle: Vehicle, waits: Duration, ended: watch::Receiver<Option<Instant>>) {
    tokio::time::sleep(waits).await;
    let is_copy = !waits.is_zero();
    let written = tokio::task::spawn_blocking(move || {
        // Only one of two has the past.
        if !is_copy && let Err(error) = vehicle.write_past() {
            tracing::error!("{} has no past: {error:#}", vehicle.member.id);
        }
        vehicle
    });
    let Ok(vehicle) = written.await else { return };
    if let Err(error) = vehicle.run(ended).await {
        tracing::error!("{error:#}");
    }
}

/// Prints the address, the users and what happens, on one screen.
fn introduction(address: SocketAddr, hub: u32, members: &[Member]) -> String {
    let url = server::url(address, false);
    let mut text = format!(
        "Telltale demo: a fleet of {} simulated vehicles, its hub and its console, on this computer alone.\n\n\
         \x20 Look      {url}\n\n  Log in\n",
        members.len()
    );
    for (name, role, secret) in DEMO_CONSOLE_USERS {
        let who = match role {
            Role::ControlRoom => "a control room",
            Role::Engineer => "a fleet engineer",
            Role::Authority | Role::Operator | Role::Developer => "an authority",
        };
        text += &format!("            {name:<10} {secret:<15} {who}\n");
    }
    text +=
        "\n  Faults come and go by themselves. Operators in the vehicles take note of them and drive on.\n\n";
    for member in members {
        let what = match member.fate {
            Fate::Tunnels => "drives through tunnels, where its line is cut for two minutes",
            Fate::Off => "is switched off when it has stopped",
            Fate::Copied => "shares its key with another one",
            Fate::None => continue,
        };
        text += &format!("            {:<10} {what}\n", member.id);
    }
    text += &format!(
        "\n  Hub       `kill {hub}` ends it. It comes back after 15 s.\n\n\
         \x20 End       Ctrl-C\n"
    );
    text
}
