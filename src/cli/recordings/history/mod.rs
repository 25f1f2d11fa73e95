//! `telltale history`: draws what a vehicle showed, or sums it up, from its history.

mod sums;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;

use crate::cli::EXIT_NO;
use crate::cli::print::note;
use crate::cli::process::data_folder::DataFolder;
use crate::clock::unix_ms;
use crate::picture::figure::{self, MovedAlarm, Panel};
use crate::picture::strips::{Segment, Strip, merged, recorded, stamp};
use crate::store::{HistoryQuery, NodePast, Past, PastEvent, Period, past_in};

/// Draw what a vehicle showed around a moment, as the figures of scenarios are drawn, or sum up its alarms.
///
/// With `--stats` it says how many alarms there were in the last seven days or between `--since` and `--until`: an hour
/// and of which nodes, for how long, how soon they were acknowledged, and the time in each stage.
///
/// It reads `history.db` in the data folder and changes nothing, also while `serve` writes it.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  telltale history --data /var/lib/telltale --at 2026-11-22T03:50:00Z --before 2s --after 8s \\\n    \
    --node sensors --node localization --node localization/tf_quality --signal active --figure outage.svg\n  \
    telltale history --data /var/lib/telltale --stats --since 2026-11-20T00:00:00Z"
)]
pub struct Args {
    #[command(flatten)]
    data: DataFolder,
    /// Sum up the alarms in place of drawing
    #[arg(long, conflicts_with_all = ["at", "nodes", "signals", "figure"])]
    stats: bool,
    /// The first instant that is summed up, in UTC
    #[arg(long, value_name = "TIME", requires = "stats", value_parser = humantime::parse_rfc3339_weak)]
    since: Option<SystemTime>,
    /// The last instant that is summed up, in UTC
    #[arg(long, value_name = "TIME", requires = "stats", value_parser = humantime::parse_rfc3339_weak)]
    until: Option<SystemTime>,
    /// The moment that is drawn as zero, in UTC
    #[arg(long, value_name = "TIME", required_unless_present = "stats", value_parser = humantime::parse_rfc3339_weak)]
    at: Option<SystemTime>,
    /// How much of the time before it is drawn
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = humantime::parse_duration)]
    before: Duration,
    /// How much of the time after it is drawn
    #[arg(long, value_name = "TIME", default_value = "8s", value_parser = humantime::parse_duration)]
    after: Duration,
    /// A group or module by its whole name; may be repeated
    #[arg(long = "node", value_name = "NAME", required_unless_present = "stats")]
    nodes: Vec<String>,
    /// A signal; may be repeated
    #[arg(long = "signal", value_name = "NAME")]
    signals: Vec<String>,
    /// The title of the figure
    #[arg(long, value_name = "TEXT", default_value = "from the history")]
    title: String,
    /// The event at the moment zero
    #[arg(long, value_name = "TEXT", default_value = "")]
    event: String,
    /// Where to draw it
    #[arg(long, value_name = "OUT.svg", required_unless_present = "stats")]
    figure: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = args.data.path()?;
    let (Some(at), Some(figure)) = (args.at, &args.figure) else {
        return sums::run(&folder, args.since, args.until);
    };
    let zero_ms = unix_ms(at);
    let millis = |span: Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX / 4);
    let query = HistoryQuery {
        nodes: args.nodes.clone(),
        signals: args.signals.clone(),
        from_ms: zero_ms - millis(args.before),
        to_ms: zero_ms + millis(args.after),
    };
    let past = past_in(&folder, &query).context("the history cannot be read")?;
    let panel = panel(args, &query, &past, zero_ms);
    let unheard: Vec<&str> =
        panel.strips.iter().filter(|strip| strip.segments.is_empty()).map(|strip| &*strip.name).collect();
    if !unheard.is_empty() {
        note!(
            "telltale: nothing is recorded at that time of {}: look at the names and at `--at`, which is in UTC",
            unheard.join(", ")
        );
        return Ok(ExitCode::from(EXIT_NO));
    }
    std::fs::write(figure, figure::draw(&[panel]))
        .with_context(|| format!("the figure cannot be written to {}", figure.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn panel(args: &Args, query: &HistoryQuery, past: &Past, zero_ms: i64) -> Panel {
    let node = |node: &NodePast| Strip::of_node(&node.name, &query.nodes, recorded(&node.stretches));
    let nodes = past.nodes.iter().map(node);
    let signals = past.signals.iter().map(|(name, held)| signal_strip(name, held));
    let strips: Vec<Strip> = nodes.chain(signals).collect();
    let moved = past.events.iter().filter_map(|(at_ms, what)| match what {
        PastEvent::AlarmMoved { symptom, cause, .. } => {
            MovedAlarm::between(stamp(*at_ms), symptom, cause, &strips)
        }
        _ => None,
    });
    Panel {
        title: args.title.clone(),
        from: stamp(query.from_ms),
        to: stamp(query.to_ms),
        zero: Some((stamp(zero_ms), args.event.clone())),
        moved: moved.collect(),
        strips,
    }
}

fn signal_strip(name: &str, held: &[Period<Option<bool>>]) -> Strip {
    let segment =
        |held: &Period<Option<bool>>| Segment::of_signal(stamp(held.from_ms), stamp(held.to_ms), held.value);
    Strip::of_signal(name, merged(held.iter().map(segment).collect()))
}
