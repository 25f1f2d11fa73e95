//! `telltale incident`: lists, exports, verifies, keeps and removes the recorded incidents of a vehicle.

mod export;
mod list;
mod verify;

use std::fs;
use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};
use clap::Subcommand;
use humantime::format_rfc3339_seconds;
use tokio::time::timeout;

use crate::cli::EXIT_NO;
use crate::cli::print::{note, say};
use crate::cli::process::data_folder::DataFolder;
use crate::clock::Clock;
use crate::clock::unix_ms;
use crate::engine::time::Span;
use crate::record::proof::is_changed;
use crate::record::retention::{Held, Policy, Surplus, judged_ms, size, surplus_without_changed};
use crate::record::{folder, note_file};
use crate::store::audit::{Action, COMMAND_LINE, Record};
use crate::store::{DemoSecrets, Incidents, Store, StoreError};

/// The time for the disk to answer.
const ANSWERS_WITHIN: Duration = Duration::from_secs(10);

/// Look at the incidents that a vehicle recorded, and look after their recordings.
///
/// The recordings are MCAP files in the folder `incidents` of the data folder. A server may run on it
/// meanwhile. Exit code 1 if a recording is missing, damaged or not as it was recorded.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale incident list --data /var/lib/telltale\n  \
    telltale incident export 12 --data /var/lib/telltale --output fault.mcap\n  \
    telltale incident verify --data /var/lib/telltale")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    data: DataFolder,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// List incidents, the newest first
    ///
    /// `--json` prints the list that `GET /api/v1/incidents` answers.
    #[command(
        after_help = "Example:\n  telltale incident list --cause velodyne --since 2026-11-20 --data /var/lib/telltale"
    )]
    List(list::Args),
    /// Copy the recording of an incident, or write a report of it
    ///
    /// The report is one HTML file with everything that is known of the incident, to be read and printed anywhere.
    /// It is also written where the recording is gone.
    #[command(
        after_help = "Example:\n  telltale incident export 12 --output fault.mcap --data /var/lib/telltale\n  \
            telltale incident export 12 --report fault.html --data /var/lib/telltale"
    )]
    Export(export::Args),
    /// Say whether recordings are whole and as they were recorded; exit code 1 if one is not
    ///
    /// Each file is compared with its hash in the database and in the audit log, whose chain is verified as
    /// `telltale audit verify` does it, and read through for damage. What the database says of the incident, its note
    /// and whether it is kept are compared with the log as well.
    #[command(after_help = "Example:\n  telltale incident verify 12 13 --data /var/lib/telltale")]
    Verify {
        /// The incidents [default: all]
        #[arg(value_name = "ID")]
        ids: Vec<u64>,
    },
    /// Keep an incident whatever its age and size, or no longer
    ///
    /// A marked incident is kept from its mark on.
    #[command(after_help = "Example:\n  telltale incident keep 12 --data /var/lib/telltale")]
    Keep {
        #[arg(value_name = "ID")]
        id: u64,
        /// Keep it no longer
        #[arg(long)]
        off: bool,
    },
    /// Remove the oldest recordings that are too old or too much; nothing that is kept
    ///
    /// A recording that is not as it was recorded is evidence of that and stays, unless --changed says otherwise;
    /// exit code 1 if there is one.
    #[command(
        after_help = "Example:\n  telltale incident prune --dry-run --disk 5GB --keep 7d --data /var/lib/telltale"
    )]
    Prune {
        /// Only say what would be removed
        #[arg(long)]
        dry_run: bool,
        /// What all recordings may take on the disk
        #[arg(long, value_name = "BYTES", default_value = "10GB", value_parser = bytes)]
        disk: u64,
        /// The age up to which recordings stay
        #[arg(long, value_name = "TIME", default_value = "30d", value_parser = humantime::parse_duration)]
        keep: Duration,
        /// Judge the age by the clock of this computer, even if it is far ahead of the newest record
        ///
        /// Otherwise a clock that was set years ahead removes nothing. Use it where the vehicle stood for long.
        #[arg(long)]
        trust_clock: bool,
        /// Also remove recordings that are not as they were recorded
        #[arg(long)]
        changed: bool,
    },
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let data = args.data.path()?;
    match &args.command {
        Command::List(filter) => list::run(&data, filter),
        Command::Export(args) => export::run(&data, args),
        Command::Verify { ids } => verify::run(&data, ids),
        Command::Keep { id, off } => with_store(&data, async |store| {
            let record = Record::of(Action::IncidentKept, COMMAND_LINE);
            store.keep_incident(*id, !off, record).await?;
            if let Some(incident) = store.incident(*id).await?
                && let Err(error) = note_file::write(&folder::folder_in(&data), *id, &incident.beside())
            {
                note!("telltale: it is in the database alone, which may be lost: {error}");
            }
            match off {
                true => say!("incident {id} is kept no longer"),
                false => say!("incident {id} is kept"),
            }
            Ok(ExitCode::SUCCESS)
        }),
        Command::Prune { dry_run, disk, keep, trust_clock, changed } => {
            let keep = Span::from_nanos(u64::try_from(keep.as_nanos()).unwrap_or(u64::MAX));
            let pruning = Pruning {
                data: &data,
                policy: Policy { disk: *disk, keep, reserved: 0 },
                trust_clock: *trust_clock,
                changed: *changed,
            };
            if *dry_run { pruning.only_say() } else { pruning.run() }
        }
    }
}

/// Does something in the database of a data folder, which must exist.
fn with_store(
    data: &Path,
    work: impl AsyncFnOnce(&Store) -> Result<ExitCode, StoreError>,
) -> anyhow::Result<ExitCode> {
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_time().build().context("no async runtime")?;
    let store = Store::open_existing(data, Clock::start(), DemoSecrets::Refused)?;
    let done = runtime.block_on(async {
        let done = timeout(ANSWERS_WITHIN, work(&store)).await;
        let is_closed = timeout(ANSWERS_WITHIN, store.close()).await.is_ok();
        done.ok().filter(|_| is_closed)
    });
    match done {
        Some(done) => Ok(done?),
        None => bail!(
            "the disk of {} has not answered for {} s: look with `telltale incident list` once it answers",
            data.display(),
            ANSWERS_WITHIN.as_secs()
        ),
    }
}

/// What is to be removed.
struct Pruning<'a> {
    data: &'a Path,
    policy: Policy,
    trust_clock: bool,
    /// Also what is not as it was recorded.
    changed: bool,
}

impl Pruning<'_> {
    fn only_say(&self) -> anyhow::Result<ExitCode> {
        let incidents = Incidents::open(self.data)?;
        let held = incidents.held()?;
        let (surplus, code) = self.surplus(&held, &incidents)?;
        for it in held.iter().filter(|it| surplus.remove.contains(&it.id)) {
            say!("would remove incident {}, {}", it.id, size(it.bytes));
        }
        tell_rest(surplus.remove.len(), held.len(), surplus.bytes, surplus.is_over());
        Ok(code)
    }

    fn run(&self) -> anyhow::Result<ExitCode> {
        let recordings = folder::folder_in(self.data);
        // Hashes of large files take their time, which is no fault of the disk.
        let known = Incidents::open(self.data)?;
        let held = known.held()?;
        let (surplus, mut code) = self.surplus(&held, &known)?;
        drop(known);
        with_store(self.data, async |store| {
            let record = Record::of(Action::IncidentRemoved, COMMAND_LINE);
            let forgotten = store.forget_incidents(surplus.remove.clone(), record).await?;
            for it in &forgotten {
                let path = recordings.join(folder::file_name(it.id));
                let removed = fs::remove_file(&path);
                let beside = note_file::remove(&recordings, it.id);
                match removed {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => {
                        note!(
                            "telltale: incident {} is forgotten, but its file {} cannot be removed: {error}. Remove it by hand",
                            it.id,
                            path.display()
                        );
                        code = ExitCode::from(EXIT_NO);
                    }
                    _ => say!("removed incident {}, {}", it.id, size(it.bytes)),
                }
                if let Err(error) = beside {
                    note!("telltale: the file beside incident {} cannot be removed: {error}", it.id);
                }
            }
            tell_rest(forgotten.len(), held.len(), surplus.bytes, surplus.is_over());
            Ok(code)
        })
    }

    /// What has to go. What stays because it was changed is said.
    fn surplus(&self, held: &[Held], incidents: &Incidents) -> Result<(Surplus, ExitCode), StoreError> {
        let (records, floor) = (incidents.records()?, incidents.floor()?);
        let recordings = folder::folder_in(self.data);
        let now_ms = judged_at_ms(Clock::start().wall(), floor, self.trust_clock);
        let is_forged = |it: &Held| {
            let row = incidents.stored(it.id).ok().flatten();
            row.is_none_or(|row| records.contradiction(&row).is_some())
        };
        let is_evidence =
            |it: &Held| !self.changed && (is_changed(&recordings, it, &records.hashes) || is_forged(it));
        let (surplus, changed) = surplus_without_changed(held, &self.policy, now_ms, is_evidence);
        for id in &changed {
            note!(
                "telltale: incident {id} stays: {} is not as it was recorded, or what the database says of it, which is \
                 evidence of that. Look at it with `telltale incident verify {id}`, keep a copy of it, and add --changed \
                 to remove it",
                recordings.join(folder::file_name(*id)).display()
            );
        }
        let code = if changed.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) };
        Ok((surplus, code))
    }
}

fn tell_rest(removed: usize, all: usize, bytes: u64, is_over: bool) {
    let left = all - removed;
    let incidents = if left == 1 { "1 incident".to_owned() } else { format!("{left} incidents") };
    say!("{incidents} left, {}", size(bytes));
    if is_over {
        say!(
            "that is too much, but the rest is kept, still recorded or not as it was recorded: \
             `telltale incident keep ID --off` releases one"
        );
    }
}

/// Reads `10GB`, `500 MB` or a number of bytes.
fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || "write a number of bytes, for example `10GB` or `500MB`".to_owned();
    let digits = text.find(|it: char| !it.is_ascii_digit()).unwrap_or(text.len());
    let number: u64 = text[..digits].parse().map_err(|_| wrong())?;
    let unit = match text[digits..].trim() {
        "" | "B" => 1,
        "kB" => 1_000,
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        "TB" => 1_000_000_000_000,
        _ => return Err(wrong()),
    };
    number.checked_mul(unit).ok_or_else(wrong)
}

fn now_ms() -> i64 {
    unix_ms(Clock::start().wall())
}

/// The time by which ages are judged, by the rule of a server that starts now.
fn judged_at_ms(wall: SystemTime, floor: SystemTime, trust_clock: bool) -> i64 {
    let judged_ms = judged_ms(unix_ms(wall), unix_ms(floor), Span::ZERO);
    if trust_clock || judged_ms == unix_ms(wall) {
        return unix_ms(wall);
    }
    note!(
        "telltale: the clock says {}, far ahead of the newest record, {}: nothing is removed for its age by it. \
         Set the clock, or, if it is right, add --trust-clock",
        format_rfc3339_seconds(wall),
        format_rfc3339_seconds(floor)
    );
    judged_ms
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::retention::surplus;

    #[test]
    fn sizes_are_read_and_written_with_their_units() {
        for (text, number) in
            [("0", 0), ("12", 12), ("12B", 12), ("500 MB", 500_000_000), ("10GB", 10_000_000_000)]
        {
            assert_eq!(bytes(text), Ok(number), "{text}");
        }
        for wrong in ["", "GB", "1.5GB", "-1", "1XB", "99999999999TB"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            [999, 1500, 2_500_000, 10_000_000_000].map(size),
            ["999 B", "1.5 kB", "2.5 MB", "10.0 GB"]
        );
    }

    #[test]
    fn a_clock_that_is_years_ahead_removes_nothing_for_its_age() {
        let day = Duration::from_secs(24 * 3600);
        let newest = Clock::start().wall();
        let held = |id, age: Duration| Held {
            id,
            since_ms: unix_ms(newest - age),
            finished: true,
            ..Held::default()
        };
        let all = [held(1, 40 * day), held(2, day)];
        let removed = |ahead: Duration, trust_clock| {
            surplus(&all, &Policy::default(), judged_at_ms(newest + ahead, newest, trust_clock)).remove
        };
        assert_eq!(removed(Duration::ZERO, false), [1]);
        assert_eq!(removed(1000 * day, false), [1]);
        assert_eq!(removed(1000 * day, true), [1, 2]);
    }
}
