//! `telltale incident list`: a table of incidents, or JSON.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::cli::print::{self, note, say};
use crate::clock::unix_ms;
use crate::record::retention::size;
use crate::store::{INCIDENTS_PAGE_MAX, Incident, IncidentFilter, Incidents};
use crate::web::incidents::listed;

/// Causes that are named in a line.
const CAUSES_MAX: usize = 3;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Those whose cause has this in its name
    #[arg(long, value_name = "TEXT", default_value = "")]
    cause: String,
    /// Those with a cause in this group
    #[arg(long, value_name = "NAME", default_value = "")]
    group: String,
    /// Those that began in this stage
    #[arg(long, value_name = "NAME", default_value = "")]
    stage: String,
    /// Those that somebody marked
    #[arg(long)]
    marked: bool,
    /// Those that are kept
    #[arg(long)]
    kept: bool,
    /// Those that lasted at this time or later, in UTC
    #[arg(long, value_name = "TIME", value_parser = time)]
    since: Option<SystemTime>,
    /// Those that began at this time or earlier, in UTC
    #[arg(long, value_name = "TIME", value_parser = time)]
    until: Option<SystemTime>,
    /// Those with a smaller number: the next page
    #[arg(long, value_name = "ID")]
    before: Option<u64>,
    /// At most so many
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=i64::from(INCIDENTS_PAGE_MAX)))]
    count: u32,
    /// Print them for programs
    #[arg(long)]
    json: bool,
}

/// Reads a time, or a day.
fn time(text: &str) -> Result<SystemTime, String> {
    let day = format!("{text}T00:00:00Z");
    humantime::parse_rfc3339_weak(text)
        .or_else(|_| humantime::parse_rfc3339_weak(&day))
        .map_err(|_| "write a time as 2026-11-20T12:00:00Z, or a day as 2026-11-20".to_owned())
}

pub fn run(data: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let filter = IncidentFilter {
        cause: args.cause.clone(),
        group: args.group.clone(),
        stage: args.stage.clone(),
        marked: args.marked.then_some(true),
        kept: args.kept.then_some(true),
        since_ms: args.since.map(unix_ms),
        until_ms: args.until.map(unix_ms),
        before: args.before,
        count: args.count,
        ..IncidentFilter::default()
    };
    let found = Incidents::open(data)?.list(&filter)?;
    if args.json {
        let list: serde_json::Value = found.iter().map(listed).collect();
        print::json(&list);
        return Ok(ExitCode::SUCCESS);
    }
    if found.is_empty() {
        note!("there is no such incident");
    }
    found.iter().for_each(|incident| say!("{}", line(incident)));
    if let Some(last) = found.last().filter(|_| found.len() == args.count as usize) {
        note!("older ones: --before {}", last.summary.id);
    }
    Ok(ExitCode::SUCCESS)
}

fn line(incident: &Incident) -> String {
    let summary = &incident.summary;
    let since = UNIX_EPOCH + Duration::from_millis(u64::try_from(summary.since_ms).unwrap_or(0));
    let since = humantime::format_rfc3339_seconds(since);
    let length = match summary.until_ms {
        Some(until_ms) => format!("{} s", until_ms.saturating_sub(summary.since_ms) / 1000),
        None => "lasts".to_owned(),
    };
    let causes = summary.causes();
    let mut what: Vec<String> = causes.iter().take(CAUSES_MAX).map(|&it| it.to_owned()).collect();
    if causes.len() > CAUSES_MAX {
        what.push(format!("and {} more", causes.len() - CAUSES_MAX));
    }
    if what.is_empty() {
        what.extend(summary.triggers.first().map(|it| it.kind.replace('_', " ")));
    }
    let flags = [
        (summary.is_marked(), "marked"),
        (incident.kept, "kept"),
        (summary.storm, "storm"),
        (summary.recording.interrupted, "interrupted"),
        (summary.recording.gone, "gone"),
        (summary.until_ms.is_some() && !summary.recording.finished, "unfinished"),
    ];
    let flags = flags.iter().filter(|(is_set, _)| *is_set).map(|(_, word)| format!("[{word}]"));
    let words: Vec<String> = std::iter::once(what.join(", ")).chain(flags).collect();
    let bytes = size(summary.recording.bytes);
    format!("{:>6}  {since}  {length:>7}  {bytes:>9}  {}", summary.id, words.join(" "))
}
