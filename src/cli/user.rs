//! `telltale user`: who may log in, and which programs may read.

use std::io::{BufRead, IsTerminal, stdin};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};

use super::data;
use crate::clock::Clock;
use crate::store::{DemoSecrets, Role, Store, TOKEN_LIFE_DAYS};

/// Add, list, change and remove the users of a vehicle, and the tokens of programs.
///
/// A server that runs on the same data folder notices within a second.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale user add anna --role operator --data /var/lib/telltale\n  \
    telltale user token dora --label dashboard --data /var/lib/telltale\n  \
    telltale user list --data /var/lib/telltale")]
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
    /// Operators may have a PIN of 6 digits or more, which works at the vehicle's own displays;
    /// passwords have 12 characters or more. A name has letters, digits, '.', '_' and '-'.
    #[command(after_help = "Example:\n  telltale user add anna --role operator --data /var/lib/telltale")]
    Add {
        name: String,
        #[arg(long)]
        role: RoleWord,
    },
    /// List all users with their roles
    #[command(after_help = "Example:\n  telltale user list --data /var/lib/telltale")]
    List,
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
    /// Make a token with which a program acts as a developer or an authority; it is printed this once
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
    /// Take a token back; whoever is connected with it is cut off
    #[command(after_help = "Example:\n  telltale user revoke 3 --data /var/lib/telltale")]
    Revoke { number: i64 },
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
        // Only the first user makes a database: a folder that is misspelt must not become one.
        let open =
            if matches!(args.command, Command::Add { .. }) { Store::open } else { Store::open_existing };
        let store = open(&folder, Clock::start(), DemoSecrets::Refused)?;
        let done = obey(&args.command, &store).await;
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn obey(command: &Command, store: &Store) -> anyhow::Result<()> {
    match command {
        Command::Add { name, role } => {
            store.add_user(name, (*role).into(), &read_secret()?).await?;
            println!("added {name}");
        }
        Command::List => list(store).await?,
        Command::Passwd { name } => {
            store.change_secret(name, &read_secret()?).await?;
            println!("changed the secret of {name}");
        }
        Command::Role { name, role } => {
            store.change_role(name, (*role).into(), &read_secret()?).await?;
            println!("changed the role of {name}");
        }
        Command::Remove { name } => {
            store.remove_user(name).await?;
            println!("removed {name}");
        }
        Command::Token { name, label, days } => {
            let token = store.add_token(name, label, *days).await?;
            eprintln!("the token of {name}; it is not shown again:");
            println!("{}", token.as_str());
        }
        Command::Tokens => tokens(store).await?,
        Command::Revoke { number } => {
            store.revoke_token(*number).await?;
            println!("revoked token {number}");
        }
    }
    Ok(())
}

async fn tokens(store: &Store) -> anyhow::Result<()> {
    for token in store.tokens().await? {
        let expires = humantime::format_rfc3339_seconds(token.expires);
        let (number, role) = (token.number, token.role.as_str());
        println!("{number:>4}  {role:<9}  until {expires}  {}  {}", token.user, token.label);
    }
    Ok(())
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
