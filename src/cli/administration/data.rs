//! `telltale data`: checks, repairs and restores the database of a vehicle.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Subcommand;
use serde_json::json;

use super::tls;
use crate::cli::EXIT_NO;
use crate::cli::print::{self, say};
use crate::cli::process::data_folder::{self, DataFolder};
use crate::clock::Clock;
use crate::store::{
    DataState, Exposed, HISTORY_FILE, Repaired, SavedHistory, check_data, exposed, repair, repair_history,
    restore,
};

/// Look through the database of a vehicle, repair it, or take a backup.
///
/// `serve` backs its database up once a day into `backups` in the data folder, looks the copy through,
/// and keeps seven. The history and the recordings are in no backup. If it finds its database damaged at a start, it shows the diagnosis all the same, lets
/// people log in as far as users can be read, and gives no clearance: then repair or restore it.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale data check --data /var/lib/telltale\n  \
    systemctl stop telltale\n  telltale data repair --data /var/lib/telltale\n  systemctl start telltale")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    data: DataFolder,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say whether the database, its history and backups are whole; exit code 1 if one is not
    ///
    /// It changes nothing, and a server may run meanwhile. A trigger, a view, a table or an index that is not
    /// Telltale's, and a changed or missing one, is damage too. `--json` prints an object with `ok`, `database` (its
    /// path), `damage` (text or null), `users` (a number or null), `history_damage` (text or null), `backups`,
    /// the newest first, each with `file`, `damage` and `users`, and `exposed`: the files that everybody on the
    /// machine can read or change, each with `file` and `mode` (octal, a text). Damaged backups and exposed
    /// files are warnings alone.
    Check {
        /// Print it for programs
        #[arg(long)]
        json: bool,
    },
    /// Make the database anew of all that can be read of it; no server may run on the folder
    ///
    /// Users and records of the audit log that cannot be read come from the newest backup. The old files are
    /// moved into a folder `damaged-TIME` beside it, and the audit log says what was done. A damaged history is
    /// made anew of what can be read of it.
    Repair,
    /// Put a backup in the place of the database; no server may run on the folder
    ///
    /// All sessions end. Users and tokens are as they were then, so users removed since then are back.
    /// The old files are moved into a folder `damaged-TIME` beside it, and the audit log says what was done.
    Restore {
        /// The backup [default: the newest that is whole]
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
    },
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = args.data.path()?;
    match &args.command {
        Command::Check { json } => check(&folder, *json),
        Command::Repair => {
            let _lock = lock(&folder)?;
            let state = check_data(&folder)?;
            let saved =
                repair_history(&folder, Clock::start().wall()).context("the history cannot be repaired")?;
            if let Some(SavedHistory { damage, records, kept }) = &saved {
                say!("repaired {} ({damage})", folder.join(HISTORY_FILE).display());
                say!("         {records} records; the old files are in {}", kept.display());
            }
            if state.damage.is_none() {
                if saved.is_none() {
                    say!("{} is whole; nothing was changed", state.database.display());
                }
                return Ok(ExitCode::SUCCESS);
            }
            let repaired = repair(&folder, Clock::start()).context("the database cannot be repaired")?;
            say!("repaired {}", state.database.display());
            tell(&repaired);
            Ok(ExitCode::SUCCESS)
        }
        Command::Restore { file } => {
            let _lock = lock(&folder)?;
            let (file, repaired) = restore(&folder, file.as_deref(), Clock::start())
                .context("no backup was put in the place of the database")?;
            say!("restored {}", file.display());
            tell(&repaired);
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// A folder that is misspelt must not become one.
fn lock(folder: &Path) -> anyhow::Result<Option<std::fs::File>> {
    std::fs::metadata(folder).with_context(|| format!("the data folder {}", folder.display()))?;
    data_folder::lock(folder)
}

fn tell(repaired: &Repaired) {
    let users = match repaired.users {
        1 => "1 user".to_owned(),
        users => format!("{users} users"),
    };
    say!("         {users}; look at them with `telltale user list`");
    for loss in &repaired.losses {
        say!("         {loss}");
    }
    say!("         the old files are in {}", repaired.kept.display());
}

fn check(folder: &Path, as_json: bool) -> anyhow::Result<ExitCode> {
    let state = check_data(folder)?;
    let exposed = exposed(folder, Some(&folder.join(tls::KEY)));
    let is_whole = state.damage.is_none() && state.history_damage.is_none();
    let code = if is_whole { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) };
    if as_json {
        print::json(&report(&state, &exposed));
        return Ok(code);
    }
    line(&state.database, state.damage.as_deref(), state.users);
    if state.history_damage.is_some() || folder.join(HISTORY_FILE).exists() {
        line(&folder.join(HISTORY_FILE), state.history_damage.as_deref(), None);
    }
    for backup in &state.backups {
        line(&backup.file, backup.damage.as_deref(), backup.users);
    }
    if state.backups.is_empty() {
        say!("      there is no backup yet; `serve` makes one a day");
    }
    if state.damage.is_some() {
        say!("      stop `telltale serve`, then `telltale data repair`, or `telltale data restore` for the");
        say!("      newest backup that is whole");
    }
    if state.damage.is_none() && state.history_damage.is_some() {
        say!("      stop `telltale serve`, then `telltale data repair`");
    }
    for file in exposed {
        say!("WARN  {file}");
    }
    Ok(code)
}

fn line(file: &Path, damage: Option<&str>, users: Option<u64>) {
    let users = users.map_or(String::new(), |users| format!(", users: {users}"));
    match damage {
        None => say!("ok    {}{users}", file.display()),
        Some(damage) => say!("BAD   {}: {}{users}", file.display(), damage.replace('\n', "; ")),
    }
}

fn report(state: &DataState, exposed: &[Exposed]) -> serde_json::Value {
    let backups =
        state.backups.iter().map(|it| json!({ "file": it.file, "damage": it.damage, "users": it.users }));
    let exposed = exposed.iter().map(|it| json!({ "file": it.path, "mode": format!("{:03o}", it.mode) }));
    json!({
        "ok": state.damage.is_none() && state.history_damage.is_none(),
        "database": state.database,
        "damage": state.damage,
        "users": state.users,
        "history_damage": state.history_damage,
        "backups": backups.collect::<Vec<_>>(),
        "exposed": exposed.collect::<Vec<_>>(),
    })
}
