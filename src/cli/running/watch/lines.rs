//! `watch --plain`: a line for each change.

use std::collections::BTreeMap;
use std::time::Duration;

use super::freshness::Freshness;
use super::snapshot::Vehicle;
use crate::engine::time::Span;

/// The facts that were printed last, by their subjects.
#[derive(Debug, Default)]
pub struct Lines {
    facts: BTreeMap<String, String>,
    at: String,
    connection: Connection,
}

/// What was said of the connection; its age alone is no news.
#[derive(Debug, Default, PartialEq, Eq)]
enum Connection {
    #[default]
    Live,
    Stale,
    Lost {
        connected: bool,
    },
}

impl Lines {
    /// The lines for what is different since the last call. All that is known comes at first.
    pub fn changes(&mut self, vehicle: Option<&Vehicle>, freshness: Freshness) -> Vec<String> {
        let mut lines = Vec::new();
        let connection = match freshness {
            // Before the first data there is nothing that could be old.
            _ if self.at.is_empty() => Connection::Live,
            Freshness::Live => Connection::Live,
            Freshness::Stale(_) => Connection::Stale,
            Freshness::Lost { connected, .. } => Connection::Lost { connected },
        };
        if connection != self.connection {
            self.connection = connection;
            let is_live = self.connection == Connection::Live;
            let said = if is_live { "live again".to_owned() } else { freshness.words() };
            let at = match (freshness, vehicle) {
                (Freshness::Stale(since) | Freshness::Lost { since: Some(since), .. }, _) => {
                    later(&self.at, since)
                }
                (_, Some(vehicle)) => vehicle.head.at.to_string(),
                _ => self.at.clone(),
            };
            lines.push(format!("{at}  connection: {said}"));
        }
        let Some(vehicle) = vehicle else { return lines };
        self.at = vehicle.head.at.to_string();
        let now = facts(vehicle);
        for (subject, fact) in &now {
            if self.facts.get(subject) != Some(fact) {
                lines.push(format!("{}  {subject}: {fact}", self.at));
            }
        }
        for subject in self.facts.keys().filter(|subject| !now.contains_key(*subject)) {
            lines.push(format!("{}  {subject}: over", self.at));
        }
        self.facts = now;
        lines
    }
}

/// The time so long after the server's last one. The clock of this computer may be another.
fn later(at: &str, since: Span) -> String {
    match humantime::parse_rfc3339(at) {
        Ok(time) => {
            humantime::format_rfc3339_millis(time + Duration::from_nanos(since.as_nanos())).to_string()
        }
        Err(_) => at.to_owned(),
    }
}

/// The values whose changes are printed. The speed is left out: it changes all the time.
fn facts(vehicle: &Vehicle) -> BTreeMap<String, String> {
    let mut facts = BTreeMap::new();
    let head = &vehicle.head;
    let motion = super::snapshot::Motion { speed_mps: None, ..head.motion.clone() };
    facts.insert("vehicle".to_owned(), head.overall.as_str().to_uppercase());
    facts.insert("stage".to_owned(), head.stage.as_str().to_owned());
    facts.insert(
        "operator".to_owned(),
        head.operator.as_ref().map_or("nobody".to_owned(), ToString::to_string),
    );
    facts.insert("motion".to_owned(), motion.words());
    facts.insert(
        "recording".to_owned(),
        if head.recording { "an incident" } else { "no incident" }.to_owned(),
    );
    facts.insert("alarms".to_owned(), format!("{} not acknowledged", vehicle.open_alarms()));
    for group in &vehicle.groups {
        let (why, state) = (group.why(), group.state.as_str().to_uppercase());
        let counts = format!("{state} {}/{}", group.ok, group.counted);
        let said = if why.is_empty() { counts } else { format!("{counts}, {why}") };
        facts.insert(format!("group {}", group.id), said);
    }
    for root in &vehicle.roots {
        let (state, message) = vehicle.says(&root.node);
        let state = state.map_or(String::new(), |state| state.as_str().to_uppercase());
        facts.insert(format!("cause {}", root.node), format!("{state} {message} ({})", root.words()));
    }
    for shelved in &vehicle.shelved {
        facts.insert(format!("shelved {}", shelved.node), shelved.words());
    }
    for countermeasure in &vehicle.countermeasures {
        let words = countermeasure.words();
        let (request, said) = words.split_once(": ").unwrap_or((&words, ""));
        facts.insert(format!("request {request}"), said.to_owned());
    }
    facts
}

#[cfg(test)]
mod tests {
    use super::super::snapshot::tests::{changes, golden};
    use super::*;

    #[test]
    fn each_change_is_a_line_and_silence_too() {
        let (mut lines, mut vehicle) = (Lines::default(), Some(golden()));
        let first = lines.changes(vehicle.as_ref(), Freshness::Live).join("\n");
        for said in [
            "vehicle: ERROR",
            "group sensors: ERROR 3/4",
            "cause sensors/velodyne_packet_alive: ERROR no packets",
        ] {
            assert!(first.contains(said), "{said}\n{first}");
        }
        assert_eq!(lines.changes(vehicle.as_ref(), Freshness::Live), Vec::<String>::new());
        let late = Freshness::Stale(Span::from_millis(1200));
        assert_eq!(
            lines.changes(None, late),
            ["2026-11-20T12:00:40.200Z  connection: STALE, last data 1 s ago"]
        );
        assert!(lines.changes(None, late).is_empty());
        let lost = |ms| Freshness::Lost { since: Some(Span::from_millis(ms)), connected: false };
        assert!(lines.changes(None, lost(2100))[0].ends_with("NOT CONNECTED, last data 2 s ago"));
        assert!(lines.changes(None, lost(9000)).is_empty());
        let over = r#""groups":[{"id":"sensors","name":"Sensors","state":"ok","ok":4,"counted":4,"reason":null}],"roots":[]"#;
        Vehicle::take(&mut vehicle, &changes(r#""base":9,"#, over)).unwrap();
        let after = lines.changes(vehicle.as_ref(), Freshness::Live);
        for said in
            ["connection: live again", "group sensors: OK 4/4", "cause sensors/velodyne_packet_alive: over"]
        {
            assert!(after.iter().any(|line| line.ends_with(said)), "{said}: {after:#?}");
        }
    }
}
