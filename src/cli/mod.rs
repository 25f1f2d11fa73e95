//! One file per subcommand: its `Args`, and `run`, which returns the exit code. Wires the rooms.
//!
//! Exit codes: 0; 1, the answer is no; 2, wrong usage or configuration.

mod audit;
mod check;
mod data;
mod dds;
mod demo;
mod ending;
pub mod fields;
mod graph;
mod log;
mod outputs;
pub mod reload;
mod scenario;
mod serve;
mod sim;
mod station;
mod tls;
mod user;
mod vehicle;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The answer is no: an expectation fails, a chain is broken.
pub const EXIT_NO: u8 = 1;
/// Wrong usage or configuration. clap ends with the same code.
pub const EXIT_USAGE: u8 = 2;

#[derive(Debug, Parser)]
#[command(name = "telltale", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Args),
    Serve(serve::Args),
    Sim(sim::Args),
    Check(check::Args),
    Scenario(scenario::Args),
    User(user::Args),
    Audit(audit::Args),
    Tls(tls::Args),
}

/// Runs the program with the arguments of the process. An error that no subcommand turned into
/// an answer is printed with its causes and counts as wrong usage or configuration.
pub fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Demo(args) => demo::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Sim(args) => sim::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Scenario(args) => scenario::run(&args),
        Command::User(args) => user::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::Tls(args) => tls::run(&args),
    };
    result.unwrap_or_else(|error| {
        eprintln!("telltale: {error:#}");
        ExitCode::from(EXIT_USAGE)
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_contradicts_itself_nowhere() {
        super::Cli::command().debug_assert();
    }
}
