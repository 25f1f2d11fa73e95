//! `telltale audit`: verifies and acknowledges the audit log, without a server.

use std::io::{BufRead as _, IsTerminal as _, stdin};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::{Context as _, bail};
use clap::Subcommand;

use crate::cli::EXIT_NO;
use crate::cli::print::say;
use crate::cli::process::data_folder::DataFolder;
use crate::clock::Clock;
use crate::store::audit::verify_audit_in;
use crate::store::{Acknowledged, DemoSecrets, Head, Store};

/// Look after the audit log of a vehicle.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale audit verify --data /var/lib/telltale\n  \
    telltale audit verify --data /var/lib/telltale --head 1200:5f0c...   # as the log of `serve` noted it\n  \
    telltale audit acknowledge --by carl --why 'restored from the backup of Monday' --data /var/lib/telltale")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    data: DataFolder,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say whether every record is as it was written and none is missing; exit code 1 if not, or if
    /// nothing proves that none is missing at the end
    ///
    /// It reads the database, with `audit.key` and `audit.head` beside it, and changes nothing. A program
    /// that can read and write all three can write another log: give the heads that `serve` noted in its log, and a
    /// copy of the key.
    Verify {
        /// A head that was noted elsewhere; may be repeated
        #[arg(long = "head", value_name = "NUMBER:HASH", value_parser = head)]
        heads: Vec<Head>,
        /// A copy of the key that was kept elsewhere [default: audit.key in the folder]
        #[arg(long, value_name = "FILE")]
        key: Option<PathBuf>,
    },
    /// Record that an authority has looked into what is wrong with the log: `verify` then accepts it
    ///
    /// It asks for the secret on the terminal, or reads a line of standard input. What is wrong afterwards,
    /// or is changed in what was acknowledged, is a breach again.
    Acknowledge {
        /// The name of a user with the role of an authority
        #[arg(long, value_name = "NAME")]
        by: String,
        /// What was found out, for those who read the log later
        #[arg(long, value_name = "WORDS")]
        why: String,
    },
}

fn head(text: &str) -> Result<Head, String> {
    Head::parse(text).ok_or_else(|| "a head is a number, a colon and 64 hexadecimal digits".to_owned())
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = args.data.path()?;
    match &args.command {
        Command::Verify { heads, key } => verify(&folder, heads, key.as_deref()),
        Command::Acknowledge { by, why } => acknowledge(&folder, by, why),
    }
}

/// Says whether the log in a data folder is as it was written and holds these heads.
pub fn verify(folder: &Path, heads: &[Head], key: Option<&Path>) -> anyhow::Result<ExitCode> {
    let verdict = verify_audit_in(folder, heads, key).context("the audit log cannot be verified")?;
    let code = match &verdict.breach {
        None if !verdict.foreign.is_empty() => {
            say!("BAD   in the database, and in no record of the log: {}", verdict.foreign.join(", "));
            say!(
                "      they cannot log in; `telltale user passwd` takes a user in, `telltale user remove` and"
            );
            say!("      `telltale user revoke` remove them");
            ExitCode::from(EXIT_NO)
        }
        Some(breach) => {
            say!("BAD   record {} {}", breach.number, breach.what);
            if verdict.breaches > 1 {
                say!("      there are {} more such places", verdict.breaches - 1);
            }
            say!("      {}", as_written(verdict.records));
            say!(
                "      the log of `serve` has an `audit head` for each record that matters: give the last with --head"
            );
            say!("      `telltale audit acknowledge` records that an authority has looked into it");
            ExitCode::from(EXIT_NO)
        }
        None => {
            say!("ok    {}", as_written(verdict.records));
            if heads.is_empty() {
                say!(
                    "      nothing here shows whether the database was put back together with its audit.head:"
                );
                say!(
                    "      an older copy of both fits. Give a head that the log of `serve` noted with --head"
                );
            }
            ExitCode::SUCCESS
        }
    };
    if let Some(Acknowledged { number, by, at_ms, count }) = &verdict.acknowledged {
        let at = UNIX_EPOCH + Duration::from_millis(u64::try_from(*at_ms).unwrap_or(0));
        let at = humantime::format_rfc3339_seconds(at);
        say!("      {by} has acknowledged {count} breaches before record {number}, at {at}");
    }
    say!("head  {}", verdict.head);
    Ok(code)
}

fn acknowledge(folder: &Path, by: &str, why: &str) -> anyhow::Result<ExitCode> {
    let store = Store::open_existing(folder, Clock::start(), DemoSecrets::Refused)?;
    let secret = if stdin().is_terminal() {
        rpassword::prompt_password("Secret: ")?
    } else {
        stdin().lock().lines().next().context("standard input ends before a line with the secret")??
    };
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_time().build().context("no async runtime")?;
    runtime.block_on(async {
        let Some(user) = store.authenticate(by, &secret).await? else {
            bail!("the name or the secret is wrong; nothing was acknowledged");
        };
        let count = store.acknowledge_breaches(&user, why).await?;
        store.close().await;
        match count {
            0 => say!("there is nothing to acknowledge"),
            1 => say!("acknowledged 1 breach"),
            _ => say!("acknowledged {count} breaches"),
        }
        Ok(ExitCode::SUCCESS)
    })
}

fn as_written(records: u64) -> String {
    match records {
        1 => "1 record is as it was written".to_owned(),
        count => format!("{count} records are as they were written"),
    }
}
