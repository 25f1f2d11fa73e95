//! `telltale user`: manages users and the tokens of programs.

use std::io::{self, BufRead, IsTerminal, stdin};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};
use tokio::task::spawn_blocking;
use tokio::time::{sleep, timeout};

use crate::cli::EXIT_NO;
use crate::cli::print::{self, note, say};
use crate::cli::process::data_folder::{self, DataFolder};
use crate::clock::Clock;
use crate::store::{DemoSecrets, Role, Store, TOKEN_LIFE_DAYS, User};

/// The time for the disk to answer.
const ANSWERS_WITHIN: Duration = Duration::from_secs(10);
/// The time for a running server to take in a change.
const TAKEN_IN_WITHIN: Duration = Duration::from_secs(5);
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Add, list, change and remove the users of a vehicle or of a fleet's console, and the tokens of programs.
///
/// A server that runs on the same data folder takes a change in within a second. Each command that
/// changes something says whether it has; exit code 1 if it has not within 5 s.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale user add anna --role operator --data /var/lib/telltale\n  \
    telltale user token dora --label dashboard --data /var/lib/telltale\n  \
    telltale user list --data /var/lib/telltale")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    data: DataFolder,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Add a user; the secret is asked twice on the terminal, or read from two lines of standard input
    ///
    /// Operators may have a PIN of 6 digits or more, which works at the vehicle's own displays;
    /// passwords have 12 characters or more. A name has letters, digits, '.', '_' and '-'.
    #[command(after_help = "Example:\n  telltale user add anna --role operator --data /var/lib/telltale")]
    Add {
        name: String,
        #[arg(long)]
        role: RoleWord,
    },
    /// List all users with their roles
    ///
    /// `--json` prints a list of objects with `name`, `role` and `created` (RFC 3339), also where there are none.
    #[command(after_help = "Examples:\n  telltale user list --data /var/lib/telltale\n  \
        telltale user list --json --data /var/lib/telltale")]
    List {
        /// Print them for programs
        #[arg(long)]
        json: bool,
    },
    /// Give a user another secret, which ends its sessions and tokens
    #[command(after_help = "Example:\n  telltale user passwd anna --data /var/lib/telltale")]
    Passwd { name: String },
    /// Give a user another role and a secret that fits it, which ends its sessions and tokens
    #[command(after_help = "Example:\n  telltale user role dora --role authority --data /var/lib/telltale")]
    Role {
        name: String,
        #[arg(long)]
        role: RoleWord,
    },
    /// Remove a user, which ends its sessions and tokens
    #[command(after_help = "Example:\n  telltale user remove anna --data /var/lib/telltale")]
    Remove { name: String },
    /// Make a token with which a program acts as this user, who is no operator; it is printed this once
    ///
    /// Programs send it as `Authorization: Bearer TOKEN`. An operator acts at a display, by hand, and has none.
    #[command(
        after_help = "Example:\n  telltale user token dora --label dashboard --data /var/lib/telltale\n  \
        curl -H \"Authorization: Bearer $TOKEN\" http://127.0.0.1:8080/api/v1/snapshot"
    )]
    Token {
        name: String,
        /// What it is for, to know it by later
        #[arg(long, value_name = "WORDS", default_value = "")]
        label: String,
        /// How long it is valid
        #[arg(long, value_name = "N", default_value_t = TOKEN_LIFE_DAYS, value_parser = clap::value_parser!(u32).range(1..=3650))]
        days: u32,
    },
    /// List the tokens of programs, without their secrets
    #[command(after_help = "Example:\n  telltale user tokens --data /var/lib/telltale")]
    Tokens,
    /// Take a token back; programs that are connected with it are cut off
    #[command(after_help = "Example:\n  telltale user revoke 3 --data /var/lib/telltale")]
    Revoke { number: i64 },
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RoleWord {
    /// Sits in the vehicle and answers for it
    Operator,
    /// Sees everything and may change what is diagnosed
    Developer,
    /// Watches the vehicles at a fleet's console
    #[value(name = "control_room")]
    ControlRoom,
    /// Looks into the faults of a fleet at its console
    Engineer,
    /// May read everything and touch nothing
    Authority,
}

/// The result of a change.
#[derive(Debug)]
enum Seen {
    TakenIn,
    NoServer,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = args.data.path()?;
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_time().build().context("no async runtime")?;
    let done = runtime.block_on(manage(&args.command, &folder));
    // A disk that hangs has threads wait for it. Nobody waits for them.
    runtime.shutdown_background();
    done
}

async fn manage(command: &Command, folder: &Path) -> anyhow::Result<ExitCode> {
    // Only the first user makes a database: a folder that is misspelt must not become one.
    let open = if matches!(command, Command::Add { .. }) { Store::open } else { Store::open_existing };
    let place = folder.to_owned();
    let opening = spawn_blocking(move || open(&place, Clock::start(), DemoSecrets::Refused));
    let Ok(store) = timeout(ANSWERS_WITHIN, opening).await else {
        return Ok(no_answer(folder, "nothing was changed"));
    };
    let store = store??;
    let secret = if command.needs_secret() { read_secret()? } else { String::new() };
    let unsure = if command.changes() {
        "whether the change was made is not known; look with `telltale user list` and `telltale user tokens` \
         once it answers"
    } else {
        "nothing was changed"
    };
    let Ok(obeyed) = timeout(ANSWERS_WITHIN, obey(command, &store, &secret)).await else {
        return Ok(no_answer(folder, unsure));
    };
    let mut code = ExitCode::SUCCESS;
    if obeyed.is_ok() && command.changes() {
        code = tell_whether_seen(&store, folder).await?;
    }
    if timeout(ANSWERS_WITHIN, store.close()).await.is_err() {
        let unsure = "the end of the audit log may not be noted";
        return obeyed.map(|()| no_answer(folder, unsure));
    }
    obeyed.map(|()| code)
}

/// Prints whether the server on this folder has taken in the last change.
async fn tell_whether_seen(store: &Store, folder: &Path) -> anyhow::Result<ExitCode> {
    let Ok(change) = timeout(ANSWERS_WITHIN, store.last_user_change()).await else {
        return Ok(no_answer(folder, "whether a server has taken the change in is not known"));
    };
    let change = change.context("the change is written; whether a server has taken it in cannot be told")?;
    let mut trouble = None;
    let seen = timeout(TAKEN_IN_WITHIN, look_for(store, folder, change, &mut trouble)).await;
    let folder = folder.display();
    match seen {
        Ok(Seen::TakenIn) => {
            note!("the server that runs on {folder} has taken the change in");
            return Ok(ExitCode::SUCCESS);
        }
        Ok(Seen::NoServer) => {
            note!("no server runs on {folder}; the next one that starts reads the change");
            return Ok(ExitCode::SUCCESS);
        }
        Err(_) => {}
    }
    let within = TAKEN_IN_WITHIN.as_secs();
    match trouble {
        Some(error) => note!(
            "telltale: the change is written, but no server has taken it in within {within} s, and whether \
             one runs on {folder} cannot be told: {error}. If one runs, restart it: sessions and tokens that \
             the change ends may still work there"
        ),
        None => note!(
            "telltale: the change is written, but the server that runs on {folder} has not taken it in \
             within {within} s: sessions and tokens that the change ends may still work. Look at the storage \
             of the group telltale on its display, and restart it"
        ),
    }
    Ok(ExitCode::from(EXIT_NO))
}

/// Waits until a server has taken the change in, or no server runs. `trouble` gets the last error.
async fn look_for(store: &Store, folder: &Path, change: i64, trouble: &mut Option<io::Error>) -> Seen {
    loop {
        let place = folder.to_owned();
        let is_held = spawn_blocking(move || data_folder::is_locked(&place)).await;
        *trouble = match is_held.unwrap_or_else(|error| Err(error.into())) {
            Ok(false) => return Seen::NoServer,
            Ok(true) => None,
            Err(error) => Some(error),
        };
        match store.is_taken_in(change).await {
            Ok(true) => return Seen::TakenIn,
            Ok(false) => {}
            Err(error) => *trouble = Some(io::Error::other(error)),
        }
        sleep(LOOK_EVERY).await;
    }
}

fn no_answer(folder: &Path, what: &str) -> ExitCode {
    let within = ANSWERS_WITHIN.as_secs();
    note!("telltale: the disk of {} has not answered for {within} s: {what}", folder.display());
    ExitCode::from(EXIT_NO)
}

impl Command {
    fn needs_secret(&self) -> bool {
        matches!(self, Command::Add { .. } | Command::Passwd { .. } | Command::Role { .. })
    }

    fn changes(&self) -> bool {
        !matches!(self, Command::List { .. } | Command::Tokens)
    }
}

async fn obey(command: &Command, store: &Store, secret: &str) -> anyhow::Result<()> {
    match command {
        Command::Add { name, role } => {
            store.add_user(name, (*role).into(), secret).await?;
            say!("added {name}");
        }
        Command::List { json: true } => drop(print::json(&json(&store.users().await?))),
        Command::List { json: false } => list(store).await?,
        Command::Passwd { name } => {
            store.change_secret(name, secret).await?;
            say!("changed the secret of {name}");
        }
        Command::Role { name, role } => {
            store.change_role(name, (*role).into(), secret).await?;
            say!("changed the role of {name}");
        }
        Command::Remove { name } => {
            store.remove_user(name).await?;
            say!("removed {name}");
        }
        Command::Token { name, label, days } => {
            let token = store.add_token(name, label, *days).await?;
            note!("the token of {name}; it is not shown again:");
            say!("{}", token.as_str());
        }
        Command::Tokens => tokens(store).await?,
        Command::Revoke { number } => {
            store.revoke_token(*number).await?;
            say!("revoked token {number}");
        }
    }
    Ok(())
}

async fn tokens(store: &Store) -> anyhow::Result<()> {
    for token in store.tokens().await? {
        let expires = humantime::format_rfc3339_seconds(token.expires);
        let (number, role) = (token.number, token.role.as_str());
        say!("{number:>4}  {role:<9}  until {expires}  {}  {}", token.user, token.label);
    }
    Ok(())
}

/// Behind a user whom another program wrote into the database.
const FOREIGN: &str =
    "  (in no record of the audit log, so cannot log in: `telltale user passwd` takes it in)";

async fn list(store: &Store) -> anyhow::Result<()> {
    let users = store.users().await?;
    if users.is_empty() {
        note!("there are no users; add one with `telltale user add NAME --role operator`");
    }
    for user in users {
        let created = humantime::format_rfc3339_seconds(user.created);
        let foreign = if user.is_known { "" } else { FOREIGN };
        say!("{:<9}  {created}  {}{foreign}", user.role.as_str(), user.name);
    }
    Ok(())
}

fn json(users: &[User]) -> serde_json::Value {
    let user = |user: &User| {
        let created = humantime::format_rfc3339_seconds(user.created).to_string();
        let known = user.is_known;
        serde_json::json!({ "name": user.name, "role": user.role.as_str(), "created": created, "known": known })
    };
    users.iter().map(user).collect()
}

/// Asks for a new secret twice: nobody sees what they type.
fn read_secret() -> anyhow::Result<String> {
    let (first, second) = if stdin().is_terminal() {
        (rpassword::prompt_password("Secret: ")?, rpassword::prompt_password("Once more: ")?)
    } else {
        let mut lines = stdin().lock().lines();
        let mut line = || {
            lines
                .next()
                .context("standard input ends before two lines with the secret")?
                .context("standard input cannot be read")
        };
        (line()?, line()?)
    };
    if first != second {
        bail!("the two secrets are not the same; nothing was changed");
    }
    Ok(first)
}

impl From<RoleWord> for Role {
    fn from(word: RoleWord) -> Role {
        match word {
            RoleWord::Operator => Role::Operator,
            RoleWord::Developer => Role::Developer,
            RoleWord::ControlRoom => Role::ControlRoom,
            RoleWord::Engineer => Role::Engineer,
            RoleWord::Authority => Role::Authority,
        }
    }
}
