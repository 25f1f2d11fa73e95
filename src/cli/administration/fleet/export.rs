//! `telltale fleet export`: the log of one vehicle as the hub keeps it, as lines of JSON.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};

use crate::cli::EXIT_NO;
use crate::cli::moment::{Moment, moment};
use crate::cli::print::{self, note};
use crate::cli::process::hub_flags::HubFlags;
use crate::cli::process::new_file::create;
use crate::clock::unix_ms;
use crate::config::describe::words::counted;
use crate::console::history::{self, Known, Part, Told};
use crate::console::state::time;
use crate::fleet::line::NoLine;
use crate::fleet::message::{Batch, VehicleId};
use crate::fleet::reading::{From, Logs};
use crate::web::texts::Lang;
use crate::web::texts::console::ConsoleWords;
use crate::yaml::plain;

/// Write what a vehicle told the hub, as lines of JSON; exit code 1 if there is more than is read at once
///
/// Each line is a message as in the API of the console, in the vehicle's order: `epoch`, `n`, `at` (UTC, by the vehicle's
/// clock), `kind` and its content. A line of the kind `gap` stands for the messages from `n` up to `to`, which are not
/// known; `why` is null where the vehicle says nothing of them. How many messages there are, and how many are
/// missing, is said on standard error.
///
/// At most 10,000 messages are written. Where there are more, the next export begins with the time of the last one.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale fleet export --vehicle shuttle-03 --from 2026-11-20T12:00:00Z \
    --to 2026-11-20T13:00:00Z \\\n    --hub tls://hub.example:4222 --credentials hub/console.nk -o shuttle-03.jsonl")]
pub struct Args {
    /// The vehicle
    #[arg(long, value_name = "ID", value_parser = super::id)]
    vehicle: VehicleId,
    /// From here on, by the vehicle's clock: a time as `2026-11-20T12:00:00Z`, or `12s` after the first message that the
    /// hub keeps of it
    #[arg(long, value_name = "TIME", value_parser = moment)]
    from: Moment,
    /// Up to here [default: the last message]
    #[arg(long, value_name = "TIME", value_parser = moment)]
    to: Option<Moment>,
    #[command(flatten)]
    hub: HubFlags,
    /// Write to this file; no file there is overwritten [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let (Moment::Wall(from), Some(Moment::Wall(to))) = (args.from, args.to) {
        check_order(unix_ms(from), unix_ms(to))?;
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let kept = runtime.context("the async runtime cannot be started")?.block_on(read(args))?;
    let told = kept.known.told(kept.from, kept.to);
    match &args.output {
        Some(output) => write(output, &told)?,
        None => {
            // A reader that ends early is no error.
            told.parts.iter().all(|part| print::json(&line(part)));
        }
    }
    report(&args.vehicle, &kept, &told);
    Ok(if told.is_whole { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

/// What the hub keeps of a time.
struct Kept {
    known: Known,
    /// In milliseconds since 1970.
    from: i64,
    to: i64,
    /// When the oldest message that the hub has was made, if it can be read.
    oldest: Option<i64>,
}

async fn read(args: &Args) -> anyhow::Result<Kept> {
    let (id, url) = (&args.vehicle, &args.hub.hub);
    let (hub, identity) = args.hub.read()?;
    let logs = Logs::open(&hub, &identity).await.map_err(|error| match error {
        NoLine::Refused => anyhow::anyhow!(
            "the hub {url} lets the key {} read no logs: give the key for consoles, console.nk in the folder that \
             `telltale fleet hub-config` made",
            args.hub.credentials.display()
        ),
        NoLine::Unreachable(why) => anyhow::anyhow!(
            "the hub {url} cannot be read: {why}. Look whether nats-server runs there, and at --hub and --ca"
        ),
    })?;
    let unread = |why| anyhow::anyhow!("the hub {url} stopped answering: {why}. Try again when it is back");
    let oldest = logs.next(id, From::After(0)).await.map_err(unread)?;
    let (Some(oldest), Some(last)) = (oldest, logs.last(id).await.map_err(unread)?) else {
        bail!(
            "the hub {url} keeps no log of {id}: look at the id. `telltale fleet list` says which vehicles are \
             enrolled; one that has not told anything for 14 days has no log"
        );
    };
    let batches = [&oldest, &last].map(|found| (Batch::unpack(&found.packed, id).ok(), found.stored_ms));
    let oldest_ms = batches[0].0.as_ref().and_then(|batch| Some(batch.messages.first()?.at));
    let at = |moment| match moment {
        Moment::Wall(wall) => Ok(unix_ms(wall)),
        Moment::After(span) => match oldest_ms {
            Some(ms) => Ok(ms.saturating_add(i64::try_from(span.as_millis()).unwrap_or(i64::MAX))),
            None => bail!("the first message of {id} cannot be read: write times as `2026-11-20T12:00:00Z`"),
        },
    };
    let (from, to) = (at(args.from)?, args.to.map_or(Ok(i64::MAX), at)?);
    check_order(from, to)?;
    let skews = batches.iter().filter_map(|(batch, stored_ms)| Some(batch.as_ref()?.sent - (*stored_ms)?));
    let skew_ms = skews.max().unwrap_or(0);
    let mut known = history::read(&logs, id, from, to, skew_ms).await.map_err(unread)?;
    known.oldest_is(oldest.number);
    Ok(Kept { known, from, to, oldest: oldest_ms })
}

fn check_order(from: i64, to: i64) -> anyhow::Result<()> {
    if from > to {
        bail!("--from {} is later than --to {}: nothing lies between them", time(from), time(to));
    }
    Ok(())
}

fn line(part: &Part<'_>) -> serde_json::Value {
    match part {
        Part::Message(message) => history::message(message),
        Part::Missing(missing) => {
            let mut line = history::missing(missing);
            line["kind"] = "gap".into();
            line
        }
    }
}

fn write(output: &Path, told: &Told<'_>) -> anyhow::Result<()> {
    let what = "the log cannot be written to";
    let mut lines = String::new();
    for part in &told.parts {
        lines.push_str(&plain::json(&line(part).to_string()));
        lines.push('\n');
    }
    let mut file = create(output, what, "--output")?;
    file.write_all(lines.as_bytes())
        .and_then(|()| file.sync_all())
        .with_context(|| format!("{what} {}", output.display()))
}

/// Says how many messages were written, and how many are missing.
fn report(id: &VehicleId, kept: &Kept, told: &Told<'_>) {
    let Kept { known, from, oldest, .. } = kept;
    let times: Vec<i64> = told.parts.iter().filter_map(|part| part.at()).collect();
    match (times.first(), times.last()) {
        (Some(first), Some(last)) => {
            let messages = counted(times.len(), "message");
            note!("telltale: {messages} of {id}, from {} to {}", time(*first), time(*last));
        }
        _ => note!("telltale: no messages of {id} are of this time"),
    }
    let gaps = told.parts.iter().filter_map(|part| match part {
        Part::Message(_) => None,
        Part::Missing(it) => Some(it.to.saturating_sub(it.from.n).saturating_add(1)),
    });
    let (count, missing) = gaps.fold((0, 0_u64), |(count, sum), it| (count + 1, sum.saturating_add(it)));
    if count > 0 {
        note!("telltale: {}, in {}", Lang::En.missing_messages(missing), counted(count, "gap"));
    }
    if let Some(oldest) = oldest.filter(|oldest| from < oldest) {
        note!("telltale: the hub keeps nothing of {id} from before {}", time(oldest));
    }
    if known.refused > 0 {
        note!("telltale: {}", Lang::En.unread_batches(known.refused));
    }
    if known.contradictions > 0 {
        note!("telltale: {}", ConsoleWords::of(Lang::En).log_contradicts);
    }
    if !told.is_whole {
        match times.last() {
            Some(last) => note!("telltale: there is more: go on with --from {}", time(*last)),
            None => note!("telltale: there is more than is read at once, and none of it is of this time"),
        }
    }
}
