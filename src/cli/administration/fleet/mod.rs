//! `telltale fleet`: the hub of a fleet, the vehicles that it admits, and its console.

mod export;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use clap::Subcommand;

use super::audit;
use super::tls::all_names;
use crate::cli::EXIT_NO;
use crate::cli::print::say;
use crate::cli::process::hub_folder::{CERTIFICATE, write_hub};
use crate::cli::running::console;
use crate::console::kept::{self, ToldHead};
use crate::console::state::time;
use crate::fleet::hub::{CONFIG_FILE, CONSOLE_KEY_FILE, DISK_BYTES, HubFolder, make_streams};
use crate::fleet::identity::Identity;
use crate::fleet::line::Hub;
use crate::fleet::message::VehicleId;
use crate::store::Head;

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
    Export(export::Args),
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
    /// Say whether the audit log of a vehicle is the one that it told the console of; exit code 1 if not
    ///
    /// A console keeps the heads of each vehicle's audit log as they were told, and a vehicle cannot change them there. They
    /// alone show a log that was shortened or told twice; with `--audit` each of them is looked up in the log itself.
    Verify {
        #[arg(value_parser = id)]
        id: VehicleId,
        /// The data folder of the console
        #[arg(long, value_name = "DIR")]
        data: PathBuf,
        /// The data folder of the vehicle, or a copy
        #[arg(long, value_name = "DIR")]
        audit: Option<PathBuf>,
        /// A copy of the vehicle's key that was kept elsewhere [default: audit.key in its folder]
        #[arg(long, value_name = "FILE", requires = "audit")]
        key: Option<PathBuf>,
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
        Command::Export(args) => export::run(args),
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
        Command::Verify { id, data, audit, key } => verify(id, data, audit.as_deref(), key.as_deref()),
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

fn verify(id: &VehicleId, data: &Path, audit: Option<&Path>, key: Option<&Path>) -> anyhow::Result<ExitCode> {
    let told = kept::Store::audit_heads(data, id)?;
    let (Some(first), Some(last)) = (told.first(), told.last()) else {
        bail!(
            "the console in {} was told of no audit log of {id}: look at the id and the folder",
            data.display()
        );
    };
    let at = |head: &ToldHead| time(head.stored_ms);
    let back: Vec<_> = told.windows(2).filter(|pair| pair[1].head.number <= pair[0].head.number).collect();
    for pair in &back {
        say!(
            "BAD   told record {} at {}, after record {}",
            pair[1].head.number,
            at(&pair[1]),
            pair[0].head.number
        );
    }
    if !back.is_empty() {
        say!("      {id} was given an older copy of its audit log, or another one");
    }
    say!("told  {} heads of {id}, from {} to {}", told.len(), at(first), at(last));
    say!("last  {}", last.head);
    let Some(audit) = audit else {
        say!("      give the vehicle's data folder with --audit to look them up in its log");
        return Ok(if back.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) });
    };
    let heads: Vec<Head> = told.iter().map(|it| it.head).collect();
    let looked_up = audit::verify(audit, &heads, key)?;
    Ok(if back.is_empty() { looked_up } else { ExitCode::from(EXIT_NO) })
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
            say!("nats-server cannot be told ({error}): send it two SIGHUPs, a second apart");
            Ok(ExitCode::from(EXIT_NO))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::console::state::Arrived;
    use crate::engine::time::Span;
    use crate::fleet::message::{AuditHead, Batch, Content, Epoch, Message};
    use crate::fleet::reading::Stream;
    use crate::store::audit::{Action, Record, TELLTALE, verify_audit_in};
    use crate::store::{DemoSecrets, Store};

    /// A vehicle with so many records in its audit log, and the head.
    async fn vehicle(records: usize) -> (tempfile::TempDir, Head) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Clock::start(), DemoSecrets::Refused).unwrap();
        for _ in 0..records {
            store.record(Record::of(Action::Start, TELLTALE), None).await;
        }
        store.close().await;
        let head = verify_audit_in(folder.path(), &[], None).unwrap().head;
        (folder, head)
    }

    #[tokio::test]
    async fn a_vehicle_that_writes_its_audit_log_anew_is_found_by_the_heads_that_it_told() {
        let (kept, forged) = (vehicle(3).await, vehicle(4).await);
        let console = tempfile::tempdir().unwrap();
        let id = VehicleId::new("a").unwrap();
        let verdict = |audit: Option<&Path>| verify(&id, console.path(), audit, None).ok();
        assert_eq!(verdict(None), None, "there is no console");
        let mut store = kept::Store::open(console.path(), Clock::start()).unwrap();
        assert_eq!(verdict(None), None, "nothing was told");
        let mut fleet = store.fleet().unwrap();
        let mut tell = |n: u64, record: u64, hash: &str| {
            let content = Content::AuditHead(AuditHead { record, hash: hash.to_owned() });
            let messages = vec![Message { epoch: Epoch { start: 1, nonce: 0 }, n, at: 0, content }];
            let batch = Ok(Batch { id: id.clone(), key: String::new(), sent: 0, messages });
            let arrived =
                Arrived { stream: Stream::Log, id: id.clone(), batch, stored_ms: 0, age: Span::ZERO };
            fleet.take(arrived, Clock::start().now());
            store.write(&kept::Changes::of(&mut fleet, &Clock::start())).unwrap();
        };
        tell(1, kept.1.number, &kept.1.hash.to_string());
        tell(1, kept.1.number, &kept.1.hash.to_string());
        tell(2, 9, "no hash");
        assert_eq!(kept::Store::audit_heads(console.path(), &id).unwrap().len(), 1);
        for audit in [None, Some(kept.0.path())] {
            assert_eq!(verdict(audit), Some(ExitCode::SUCCESS));
        }
        assert_eq!(verdict(Some(forged.0.path())), Some(ExitCode::from(EXIT_NO)));
        // It tells of the new log, with fewer records.
        tell(3, 1, &forged.1.hash.to_string());
        assert_eq!(verdict(None), Some(ExitCode::from(EXIT_NO)));
    }
}
