//! `telltale history --stats`: the alarms of some days, and the time in each stage.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;

use crate::cli::EXIT_NO;
use crate::cli::print::{Lines, note, text};
use crate::clock::Clock;
use crate::clock::unix_ms;
use crate::store::{NodeFigures, Statistics, how_long_ms, per_100_km, statistics_in, way};

const WEEK: Duration = Duration::from_secs(7 * 24 * 3600);
/// As ISA-18.2 counts.
const MOST_FREQUENT: usize = 10;

pub fn run(folder: &Path, since: Option<SystemTime>, until: Option<SystemTime>) -> anyhow::Result<ExitCode> {
    let until = until.unwrap_or_else(|| Clock::start().wall());
    let since = since.unwrap_or_else(|| until.checked_sub(WEEK).unwrap_or(SystemTime::UNIX_EPOCH));
    let found =
        statistics_in(folder, unix_ms(since), unix_ms(until)).context("the history cannot be read")?;
    if found.recorded_ms == 0 {
        note!(
            "telltale: nothing is recorded in that time: look at `--since` and `--until`, which are in UTC"
        );
        return Ok(ExitCode::from(EXIT_NO));
    }
    text(told(&found).text());
    Ok(ExitCode::SUCCESS)
}

fn told(found: &Statistics) -> Lines {
    let mut lines = Lines::default();
    lines.add(format_args!("recorded        {}", how_long_ms(found.recorded_ms)));
    for (stage, ms, share) in found.shares() {
        lines.add(format_args!("  {:<14}{}, {share}", stage.as_str(), how_long_ms(ms)));
    }
    if let Some(metres) = found.driven_m {
        lines.add(format_args!("driven          {}", way(metres)));
    }
    let on_100_km = per_100_km(found.alarms, found.driven_m).map(|rate| format!(", {rate:.2} on 100 km"));
    let rate = found.rate(found.alarms);
    let an_hour = if rate.is_empty() { rate } else { format!(", {rate} an hour") };
    lines.add(format_args!("alarms          {}{an_hour}{}", found.alarms, on_100_km.unwrap_or_default()));
    lines.add(format_args!("most in 10 min  {}", found.most_in_10_min));
    let soon = found.to_acknowledge_ms.map(|ms| format!(", half of them within {}", how_long_ms(ms)));
    lines.add(format_args!("acknowledged    {}{}", found.acknowledged, soon.unwrap_or_default()));
    if found.lost > 0 {
        lines.add(format_args!("missing         {} records", found.lost));
    }
    if !found.nodes.is_empty() {
        lines.add("");
        lines.add("alarms  an hour  on 100 km  MTBF         in all      longest     node");
    }
    for node in found.nodes.iter().take(MOST_FREQUENT) {
        let NodeFigures { an_hour, on_100_km, between, alarmed, longest } = found.figures(node);
        let chatters = if node.chatters { "  (chatters)" } else { "" };
        lines.add(format_args!(
            "{:>6}  {an_hour:>7}  {on_100_km:>9}  {between:<11}  {alarmed:<10}  {longest:<10}  {}{chatters}",
            node.alarms, node.node,
        ));
    }
    match found.nodes.len().saturating_sub(MOST_FREQUENT) {
        0 => {}
        more => lines.add(format_args!("and {more} nodes more")),
    }
    lines.add("");
    lines.add("recorded    driven      alarms  MTBF         version of Telltale");
    for version in &found.versions {
        let recorded = how_long_ms(version.recorded_ms);
        let driven = version.driven_m.map(way).unwrap_or_default();
        let between = version.between_alarms_ms().map_or_else(String::new, how_long_ms);
        let name = if version.version.is_empty() { "not known" } else { &version.version };
        let alarms = version.alarms;
        lines.add(format_args!("{recorded:<10}  {driven:<10}  {alarms:>6}  {between:<11}  {name}"));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::model::Stage;
    use crate::store::{NodeStatistics, VersionStatistics};

    #[test]
    fn a_week_is_told_in_lines() {
        let node = NodeStatistics {
            node: "sensors/gnss".to_owned(),
            alarms: 3,
            alarmed_ms: 15_000,
            longest_ms: 5_000,
            chatters: true,
        };
        let found = Statistics {
            recorded_ms: 7_200_000,
            alarms: 4,
            most_in_10_min: 3,
            acknowledged: 1,
            to_acknowledge_ms: Some(3_000),
            stages: vec![(Stage::Standby, 5_400_000), (Stage::Active, 1_800_000)],
            versions: vec![VersionStatistics {
                version: "0.1.0".to_owned(),
                recorded_ms: 7_200_000,
                driven_m: Some(20_000.0),
                alarms: 4,
                nodes: vec![node.clone()],
            }],
            driven_m: Some(20_000.0),
            nodes: vec![node],
            ..Statistics::default()
        };
        let expected = "\
recorded        2 h 0 min
  standby       1 h 30 min, 75 %
  active        30 min, 25 %
driven          20.0 km
alarms          4, 2.00 an hour, 20.00 on 100 km
most in 10 min  3
acknowledged    1, half of them within 3 s

alarms  an hour  on 100 km  MTBF         in all      longest     node
     3     1.50      15.00  39 min       15 s        5 s         sensors/gnss  (chatters)

recorded    driven      alarms  MTBF         version of Telltale
2 h 0 min   20.0 km          4  30 min       0.1.0
";
        assert_eq!(told(&found).text(), expected);
    }
}
