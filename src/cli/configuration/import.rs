//! `telltale import`: the configuration of another diagnosis as one of Telltale.

use std::io::stdin;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;

use crate::cli::EXIT_NO;
use crate::cli::print::{self, note};
use crate::config;
use crate::config::describe::words::counted;
use crate::onboarding::import::{Imported, Lookup, import};
use crate::yaml::{Problems, Sources};

/// Turn diagnostic_aggregator's analyzers.yaml or an Autoware diagnostic graph into a configuration.
///
/// The configuration goes to standard output, with comments where something means another thing. What differs
/// goes to standard error, each with its file, line and what to do: `warning` for another meaning, `error` for
/// what could not be carried over.
///
/// Several files are the parameter files of one node, as ROS 2 is given them: sections of the node and of patterns
/// such as `/**` are put together, and what comes later counts.
///
/// Exit codes: 0 where all was carried over; 1 where something was not, beside a configuration that is useful
/// without it; 2 where the file is neither of both or has nothing to import.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  telltale import analyzers.yaml -o robot.yaml && telltale check robot.yaml\n  \
    telltale import analyzers.yaml site.yaml --node /robot/analyzers > robot.yaml\n  \
    telltale import autoware-main.yaml --package my_graphs=./my_graphs > shuttle.yaml"
)]
pub struct Args {
    /// The file to import, or the parameter files of one node; `-` reads standard input
    #[arg(value_name = "FILE", required = true, num_args = 1..=FILES_MAX)]
    files: Vec<PathBuf>,
    /// Write the configuration into this file instead
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// The folder of a package, for `$(find-pkg-share NAME)`; others are searched in AMENT_PREFIX_PATH
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = pair)]
    packages: Vec<(String, String)>,
    /// The value of `$(var NAME)` in paths of a graph
    #[arg(long = "var", value_name = "NAME=VALUE", value_parser = pair)]
    variables: Vec<(String, String)>,
    /// The aggregator's node, where the files have the parameters of several nodes
    #[arg(long, value_name = "NAME")]
    node: Option<String>,
}

/// Files of parameters beyond this many are surely a mistake.
const FILES_MAX: usize = 100;

fn pair(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE")?;
    Ok((name.to_owned(), value.to_owned()))
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut sources = Sources::default();
    let read = args.files.iter().map(|path| match path.as_os_str() == "-" {
        true => sources.read_from("standard input", stdin().lock()),
        false => sources.read(path),
    });
    let imported = match read.collect::<Result<Vec<u16>, _>>() {
        Ok(files) => import(sources, &files, &lookup(args))?,
        Err(problem) => return Err(Problems::new(sources, vec![problem]).into()),
    };
    if let Some(findings) = &imported.findings {
        print::problems(findings);
    }
    match &args.output {
        Some(path) => {
            std::fs::write(path, &imported.text).with_context(|| {
                format!("{} cannot be written: check the folder and its permissions", path.display())
            })?;
        }
        None => drop(print::text(&imported.text)),
    }
    let wrong = config::parse("the result", &imported.text).err();
    wrong.iter().for_each(print::problems);
    if wrong.is_some() {
        note!("telltale: this is a fault of `telltale import`; please report it, with the file");
    } else {
        note!("{}", summary(&imported));
    }
    Ok(if imported.lost > 0 || wrong.is_some() { ExitCode::from(EXIT_NO) } else { ExitCode::SUCCESS })
}

fn lookup(args: &Args) -> Lookup {
    let prefixes = std::env::var_os("AMENT_PREFIX_PATH").unwrap_or_default();
    Lookup {
        packages: args.packages.iter().map(|(name, folder)| (name.clone(), whole(folder))).collect(),
        prefixes: std::env::split_paths(&prefixes).filter(|path| !path.as_os_str().is_empty()).collect(),
        variables: args.variables.clone(),
        node: args.node.clone(),
    }
}

/// A path that does not depend on the folder of a graph.
fn whole(folder: &str) -> PathBuf {
    std::path::absolute(folder).unwrap_or_else(|_| folder.into())
}

fn summary(imported: &Imported) -> String {
    let of = format!("imported {}", imported.format);
    match imported.lost {
        0 => format!("{of}: everything was carried over"),
        lost => format!("{of}: {} could not be carried over, see above", counted(lost, "thing")),
    }
}
