//! `telltale user`: who may log in.

use std::io::{BufRead, IsTerminal, stdin};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};

use super::data;
use crate::clock::Clock;
use crate::store::{DemoSecrets, Role, Store};

/// Add, list, change and remove the users of a vehicle.
///
/// A server that runs on the same data folder notices within a second.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  telltale user add anna --role operator\n  telltale user list --data /var/lib/telltale"
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    /// Folder of the database [default: $XDG_DATA_HOME/telltale or ~/.local/share/telltale]
    #[arg(long, value_name = "DIR", global = true)]
    data: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Add a user; the secret is asked twice on the terminal, or read from two lines of standard input
    ///
    /// Operators may have a PIN of 6 digits or more; passwords have 12 characters or more.
    Add {
        name: String,
        #[arg(long)]
        role: RoleWord,
    },
    /// List all users with their roles
    List,
    /// Give a user another secret, which ends its sessions
    Passwd { name: String },
    /// Remove a user, which ends its sessions
    Remove { name: String },
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RoleWord {
    /// Sits in the vehicle and answers for it
    Operator,
    /// Sees everything and may change what is diagnosed
    Developer,
    /// May read everything and touch nothing
    Authority,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = data::folder(args.data.clone())?;
    let runtime = tokio::runtime::Builder::new_current_thread().build().context("no async runtime")?;
    runtime.block_on(async {
        let store = Store::open(&folder, Clock::start(), DemoSecrets::Refused)?;
        match &args.command {
            Command::Add { name, role } => {
                store.add_user(name, (*role).into(), &read_secret()?).await?;
                println!("added {name}");
            }
            Command::List => list(&store).await?,
            Command::Passwd { name } => {
                store.change_secret(name, &read_secret()?).await?;
                println!("changed the secret of {name}");
            }
            Command::Remove { name } => {
                store.remove_user(name).await?;
                println!("removed {name}");
            }
        }
        Ok(ExitCode::SUCCESS)
    })
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let users = store.users().await?;
    if users.is_empty() {
        eprintln!("there are no users; add one with `telltale user add NAME --role operator`");
    }
    for user in users {
        let created = humantime::format_rfc3339_seconds(user.created);
        println!("{:<9}  {created}  {}", user.role.as_str(), user.name);
    }
    Ok(())
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
            RoleWord::Authority => Role::Authority,
        }
    }
}
