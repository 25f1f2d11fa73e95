//! `telltale audit`: the audit log, without a server.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Subcommand;

use super::{EXIT_NO, data};
use crate::store::Head;
use crate::store::audit::verify_audit_in;

/// Look after the audit log of a vehicle.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale audit verify --data /var/lib/telltale\n  \
    telltale audit verify --data /var/lib/telltale --head 1200:5f0c...   # as the log of `serve` noted it")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say whether every record is as it was written and none is missing; exit code 1 if not, or if
    /// nothing proves that none is missing at the end
    ///
    /// It reads the database and `audit.head` beside it and changes neither. Whoever can write both
    /// can write another log: give the heads that were noted elsewhere, such as by `serve` in its log.
    Verify {
        /// Folder of the database [default: $XDG_DATA_HOME/telltale or ~/.local/share/telltale]
        #[arg(long, value_name = "DIR")]
        data: Option<PathBuf>,
        /// A head that was noted elsewhere; may be repeated
        #[arg(long = "head", value_name = "NUMBER:HASH", value_parser = head)]
        heads: Vec<Head>,
    },
}

fn head(text: &str) -> Result<Head, String> {
    Head::parse(text).ok_or_else(|| "a head is a number, a colon and 64 hexadecimal digits".to_owned())
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Command::Verify { data, heads } = &args.command;
    let folder = data::folder(data.clone())?;
    let (verdict, is_noted) = verify_audit_in(&folder, heads).context("the audit log cannot be verified")?;
    if let Some(breach) = verdict.breach {
        println!("BAD   record {} {}", breach.number, breach.what);
        match verdict.records {
            1 => println!("      the 1 record before it is whole"),
            count => println!("      the {count} records before it are whole"),
        }
        return Ok(ExitCode::from(EXIT_NO));
    }
    if !is_noted && verdict.proven < verdict.head.number {
        println!("OPEN  {}, and nothing proves that there were no more", as_written(verdict.records));
        println!(
            "      audit.head is missing or no head, and no --head is given for what follows record {}",
            verdict.proven
        );
        println!("      look into the log of `serve` for the last `audit head` and give it with --head");
        println!("head  {}", verdict.head);
        return Ok(ExitCode::from(EXIT_NO));
    }
    println!("ok    {}", as_written(verdict.records));
    println!("head  {}", verdict.head);
    Ok(ExitCode::SUCCESS)
}

fn as_written(records: u64) -> String {
    match records {
        1 => "1 record is as it was written".to_owned(),
        count => format!("{count} records are as they were written"),
    }
}
