//! `telltale api`: the description of the interface for programs.

use std::process::ExitCode;

use clap::{Parser, ValueEnum};

use crate::{console, web};

/// Print the description of the interface for programs
///
/// A running server answers the same at `/api/v1/openapi.json` and below `/api/v1/schema/`.
#[derive(Debug, Parser)]
#[command(after_help = "Example:
    telltale api > openapi.json
    telltale api stream > stream.schema.json")]
pub struct Args {
    /// What to print
    #[arg(value_enum, default_value = "openapi")]
    what: What,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum What {
    /// The OpenAPI document: every route, what it takes and answers, and who may use it
    Openapi,
    /// The JSON Schema of `/api/v1/snapshot`
    Snapshot,
    /// The JSON Schema of the messages of `/api/v1/stream`
    Stream,
    /// The OpenAPI document of the console of a fleet
    Console,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let document = match args.what {
        What::Openapi => web::openapi(true),
        What::Snapshot => web::snapshot_schema(),
        What::Stream => web::stream_schema(),
        What::Console => console::http::openapi(true),
    };
    super::print::text(&(serde_json::to_string_pretty(&document)? + "\n"));
    Ok(ExitCode::SUCCESS)
}
