//! The subcommands, in folders by what they are for, one in a file or folder: its `Args`, and `run`, which returns the exit
//! code. This module connects all others.
//!
//! Exit codes: 0; 1, the answer is no; 2, wrong usage or configuration.

mod administration;
mod api;
mod completions;
mod configuration;
mod evaluate;
pub mod fields;
mod junit;
mod learned;
mod moment;
mod print;
mod process;
mod recordings;
pub mod running;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use administration::{audit, data, fleet, tls, user};
use configuration::{check, diff, import, init, scenario};
use print::note;
use recordings::{history, incident, learn, replay};
use running::{demo, serve, sim, watch};

use crate::ros;
use crate::yaml::Problems;

/// The answer is no: an expectation fails, a chain is broken.
pub const EXIT_NO: u8 = 1;
/// Wrong usage or configuration, or standard output cannot be written. clap ends with the same code.
pub const EXIT_USAGE: u8 = 2;

#[derive(Debug, Parser)]
#[command(name = "telltale", version = crate::record::VERSION, about, max_term_width = 100)]
struct Cli {
    /// The form of the log of programs that run on, on standard error
    #[arg(long, value_name = "FORM", value_enum, default_value_t, global = true)]
    log: process::log::LogForm,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Args),
    Serve(serve::Args),
    Sim(sim::Args),
    Init(init::Args),
    Check(check::Args),
    Diff(diff::Args),
    Import(import::Args),
    Scenario(scenario::Args),
    Evaluate(evaluate::Args),
    User(user::Args),
    History(history::Args),
    Incident(incident::Args),
    Replay(replay::Args),
    Learn(learn::Args),
    Audit(audit::Args),
    Api(api::Args),
    Data(data::Args),
    Tls(tls::Args),
    Fleet(fleet::Args),
    Completions(completions::CompletionsArgs),
    Man(completions::ManArgs),
    Watch(watch::Args),
    /// The part of `serve`, `demo` and `sim` that speaks DDS; they start it.
    #[command(hide = true)]
    DdsProcess {
        parent: u32,
        megabytes: u64,
    },
    /// The hub of `demo --fleet`, which starts it.
    #[command(hide = true)]
    HubProcess {
        parent: u32,
        program: PathBuf,
    },
}

/// Runs the program with the arguments of the process. An error that no subcommand turned into
/// an answer is printed with its causes and counts as wrong usage or configuration.
pub fn main() -> ExitCode {
    let parsed = Cli::try_parse().map_err(|error| with_hint(error, std::env::args().nth(1).as_deref()));
    let Cli { log: form, command } = parsed.unwrap_or_else(|error| error.exit());
    process::log::choose(form);
    let result = match command {
        Command::Demo(args) => demo::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Sim(args) => sim::run(&args),
        Command::Init(args) => init::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Scenario(args) => scenario::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::User(args) => user::run(&args),
        Command::History(args) => history::run(&args),
        Command::Incident(args) => incident::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Learn(args) => learn::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::Api(args) => api::run(&args),
        Command::Data(args) => data::run(&args),
        Command::Tls(args) => tls::run(&args),
        Command::Fleet(args) => fleet::run(&args),
        Command::Completions(args) => completions::print(&args, Cli::command()),
        Command::Man(args) => completions::write_pages(&args, Cli::command()),
        Command::Watch(args) => watch::run(&args),
        Command::DdsProcess { parent, megabytes } => {
            process::log::start("warn");
            Ok(ros::dds_process(parent, megabytes))
        }
        Command::HubProcess { parent, program } => demo::fleet::hub::become_hub(parent, &program),
    };
    let code = result.unwrap_or_else(|error| {
        match error.downcast_ref::<Problems>() {
            Some(problems) => print::problems(problems),
            None => note!("telltale: {error:#}"),
        }
        ExitCode::from(EXIT_USAGE)
    });
    if print::has_failed() { ExitCode::from(EXIT_USAGE) } else { code }
}

/// Adds a hint to the error for a file that is given without its flag.
fn with_hint(mut error: clap::Error, command: Option<&str>) -> clap::Error {
    use clap::error::{ContextKind, ContextValue, ErrorKind};
    let argument = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(argument)) if !argument.starts_with('-') => argument.clone(),
        _ => return error,
    };
    if let (ErrorKind::UnknownArgument, Some(command @ ("serve" | "sim"))) = (error.kind(), command) {
        let hint = format!("name the configuration with its flag: `telltale {command} --config {argument}`");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint.into()]));
    }
    error
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    #[track_caller]
    fn refused(arguments: &[&str], expected: &str) {
        let all = ["telltale"].iter().chain(arguments);
        let error = super::Cli::try_parse_from(all).unwrap_err();
        let said = super::with_hint(error, arguments.first().copied()).to_string();
        assert!(said.contains(expected), "{said}");
    }

    #[test]
    fn a_slip_on_the_command_line_is_answered_with_what_to_write() {
        let file = "`telltale serve --config shuttle.yaml`";
        refused(&["serve", "shuttle.yaml"], file);
        refused(&["serve", "--config", "a.yaml", "shuttle.yaml"], file);
        refused(&["sim", "shuttle.yaml"], "`telltale sim --config shuttle.yaml`");
        let port = "write `127.0.0.1:8094` for this machine alone, `0.0.0.0:8094` for all";
        refused(&["serve", "--config", "a", "--listen", "8094"], port);
        refused(&["serve", "--config", "a", "--listen", ":8094"], port);
        refused(&["demo", "--listen", "8094"], port);
        refused(&["serve", "--config", "a", "--listen", "0.0.0.0"], "no port: write `0.0.0.0:8080`");
        refused(&["serve", "--config", "a", "--listen", "here"], "for example `127.0.0.1:8080`");
        assert!(super::Cli::try_parse_from(["telltale", "demo", "--listen", "localhost:8094"]).is_ok());
    }

    #[test]
    fn the_command_line_contradicts_itself_nowhere() {
        super::Cli::command().debug_assert();
    }
}
