//! `telltale fleet`: the hub of a fleet, the vehicles that it admits, and its console.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Subcommand;

use super::tls::all_names;
use crate::cli::EXIT_NO;
use crate::cli::print::say;
use crate::cli::process::hub_folder::{CERTIFICATE, write_hub};
use crate::cli::running::console;
use crate::fleet::hub::{CONFIG_FILE, CONSOLE_KEY_FILE, DISK_BYTES, HubFolder, make_streams};
use crate::fleet::identity::Identity;
use crate::fleet::line::Hub;
use crate::fleet::message::VehicleId;

/// Set up the hub of a fleet, say which vehicles it admits, and run its console
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale fleet hub-config hub --name hub.example\n  \
    (cd hub && nats-server -c nats-server.conf) &\n  \
    telltale fleet streams --dir hub --hub tls://hub.example:4222\n  \
    telltale fleet enrol shuttle-03 --dir hub")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Serve(Box<console::Args>),
    /// Write the configuration of nats-server 2.14 or later into a new folder, with a certificate and a key for consoles
    HubConfig {
        /// The folder
        dir: PathBuf,
        /// A name or an address of the hub for vehicles, beside those of this machine; may be repeated
        #[arg(long = "name", value_name = "HOST")]
        names: Vec<String>,
        /// Where nats-server listens
        #[arg(long, value_name = "ADDRESS:PORT", default_value = "0.0.0.0:4222", value_parser = crate::cli::running::server::address)]
        listen: std::net::SocketAddr,
        /// What logs and pieces of recordings take on the hub's disk, in GB
        #[arg(long, value_name = "GB", default_value_t = DISK_BYTES / 1_000_000_000, value_parser = clap::value_parser!(u64).range(1..=100_000))]
        disk: u64,
    },
    /// Make the streams of a hub that runs; streams that are there stay as they are
    Streams {
        #[command(flatten)]
        folder: Folder,
        /// The address of the hub
        #[arg(long, value_name = "URL", default_value = "tls://localhost:4222")]
        hub: String,
        /// As for `hub-config`
        #[arg(long, value_name = "GB", default_value_t = DISK_BYTES / 1_000_000_000, value_parser = clap::value_parser!(u64).range(1..=100_000))]
        disk: u64,
    },
    /// Admit a vehicle: makes the file with its private key, ID.nk
    Enrol {
        #[arg(value_parser = id)]
        id: VehicleId,
        #[command(flatten)]
        folder: Folder,
    },
    /// Admit a vehicle no more; its line is closed at once
    Revoke {
        #[arg(value_parser = id)]
        id: VehicleId,
        #[command(flatten)]
        folder: Folder,
    },
    /// List the vehicles that are admitted, with their public keys
    List {
        #[command(flatten)]
        folder: Folder,
    },
}

#[derive(Debug, clap::Args)]
struct Folder {
    /// The folder that `hub-config` made
    #[arg(long, value_name = "DIR", default_value = ".")]
    dir: PathBuf,
}

fn id(text: &str) -> Result<VehicleId, String> {
    VehicleId::new(text).ok_or_else(|| "use at most 64 small letters, digits, `_` and `-`".to_owned())
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.command {
        Command::Serve(args) => console::run(args),
        Command::HubConfig { dir, names, listen, disk } => hub_config(dir, names, *listen, *disk),
        Command::Streams { folder, hub, disk } => streams(&folder.dir, hub, *disk),
        Command::Enrol { id, folder } => enrol(id, &folder.dir),
        Command::Revoke { id, folder } => {
            let mut hub = HubFolder::open(&folder.dir)?;
            hub.revoke(id)?;
            say!("{id} is admitted no more");
            // Nobody takes this key any more, and a new one has the same file.
            let _ = std::fs::remove_file(key_file(&folder.dir, id));
            reload(&hub, &folder.dir)
        }
        Command::List { folder } => {
            for (id, key) in HubFolder::open(&folder.dir)?.vehicles() {
                say!("{id}  {key}");
            }
            Ok(ExitCode::SUCCESS)
        }
    }
}

fn hub_config(
    dir: &Path,
    names: &[String],
    listen: std::net::SocketAddr,
    disk: u64,
) -> anyhow::Result<ExitCode> {
    let names = all_names(names);
    write_hub(dir, &names, &listen.to_string(), disk * 1_000_000_000)?;
    let dir = dir.display();
    say!("made {dir}/{CONFIG_FILE}, with a certificate for {}", names.join(", "));
    say!("use  (cd {dir} && nats-server -c {CONFIG_FILE})");
    say!("then telltale fleet streams --dir {dir}");
    say!("and  telltale fleet enrol ID --dir {dir}");
    Ok(ExitCode::SUCCESS)
}

fn streams(dir: &Path, hub: &str, disk: u64) -> anyhow::Result<ExitCode> {
    let console = Identity::read(&dir.join(CONSOLE_KEY_FILE))?;
    let hub = Hub { url: hub.to_owned(), ca: dir.join(CERTIFICATE) };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(make_streams(&hub, &console, disk * 1_000_000_000))?;
    say!("the streams are there");
    Ok(ExitCode::SUCCESS)
}

fn key_file(dir: &Path, id: &VehicleId) -> PathBuf {
    dir.join(format!("{id}.nk"))
}

fn enrol(id: &VehicleId, dir: &Path) -> anyhow::Result<ExitCode> {
    let mut hub = HubFolder::open(dir)?;
    let key_file = key_file(dir, id);
    hub.enrol(id, &key_file)?;
    let (key, dir_shown) = (key_file.display(), dir.display());
    say!("{id} is admitted. Move {key} to the vehicle, copy {dir_shown}/{CERTIFICATE} there, and name both:");
    say!("  vehicle: {{ id: {id} }}");
    say!("  fleet: {{ hub: 'tls://HOST:4222', credentials: {id}.nk, ca: {CERTIFICATE} }}");
    reload(&hub, dir)
}

/// Lets a nats-server that runs take the change.
fn reload(hub: &HubFolder, dir: &Path) -> anyhow::Result<ExitCode> {
    match hub.reload() {
        Ok(true) => {
            say!("nats-server was told (SIGHUP)");
            Ok(ExitCode::SUCCESS)
        }
        Ok(false) => {
            say!("nats-server does not run in {}: it takes this at its start", dir.display());
            Ok(ExitCode::SUCCESS)
        }
        Err(error) => {
            say!("nats-server cannot be told ({error}): send it a SIGHUP");
            Ok(ExitCode::from(EXIT_NO))
        }
    }
}
