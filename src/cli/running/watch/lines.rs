//! `watch --plain`: a line for each change.

use std::collections::BTreeMap;
use std::time::Duration;

use super::freshness::Freshness;
use super::snapshot::Vehicle;
use crate::engine::time::Span;

/// The facts that were printed last, by their subjects.
#[derive(Debug, Default)]
pub struct Lines {
    facts: BTreeMap<String, Fact>,
    /// The time of the last data.
    at: String,
    /// The time of the last line. It is later where a line said that the data are late.
    shown: String,
    connection: Connection,
}

/// What a line says of its subject.
#[derive(Debug)]
struct Fact {
    said: String,
    /// Follows what is said. Its numbers may change all the time, so it makes no line of its own.
    message: String,
}

impl From<String> for Fact {
    fn from(said: String) -> Fact {
        Fact { said, message: String::new() }
    }
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
            match (freshness, vehicle) {
                (Freshness::Stale(since) | Freshness::Lost { since: Some(since), .. }, _) => {
                    self.show_at(later(&self.at, since));
                }
                (_, Some(vehicle)) => self.take_time(vehicle),
                _ => {}
            }
            lines.push(format!("{}  connection: {said}", self.shown));
        }
        let Some(vehicle) = vehicle else { return lines };
        self.take_time(vehicle);
        let now = facts(vehicle);
        for (subject, Fact { said, message }) in &now {
            if self.facts.get(subject).is_none_or(|known| known.said != *said) {
                lines.push(format!("{}  {subject}: {said}{message}", self.shown));
            }
        }
        for subject in self.facts.keys().filter(|subject| !now.contains_key(*subject)) {
            lines.push(format!("{}  {subject}: over", self.shown));
        }
        self.facts = now;
        lines
    }

    /// Data that came late are not dated before the line that said so. A replay may really go back.
    fn take_time(&mut self, vehicle: &Vehicle) {
        let before = std::mem::replace(&mut self.at, vehicle.head.at.to_string());
        match self.at < before {
            true => self.shown.clone_from(&self.at),
            false => self.show_at(self.at.clone()),
        }
    }

    fn show_at(&mut self, at: String) {
        self.shown = std::mem::take(&mut self.shown).max(at);
    }
}

/// The time so long after the server's last one. The clock of this computer may be another.
fn later(at: &str, since: Span) -> String {
    match humantime::parse_rfc3339(at) {
        Ok(time) => humantime::format_rfc3339_millis(time + Duration::from(since)).to_string(),
        Err(_) => at.to_owned(),
    }
}

/// The values whose changes are printed. The speed is left out: it changes all the time.
fn facts(vehicle: &Vehicle) -> BTreeMap<String, Fact> {
    let mut facts: BTreeMap<String, Fact> = BTreeMap::new();
    let mut say = |subject: String, said: String| drop(facts.insert(subject, said.into()));
    let head = &vehicle.head;
    let motion = super::snapshot::Motion { speed_mps: None, ..head.motion.clone() };
    say("vehicle".to_owned(), head.overall.as_str().to_uppercase());
    say("stage".to_owned(), head.stage.as_str().to_owned());
    say("operator".to_owned(), head.operator.as_ref().map_or("nobody".to_owned(), ToString::to_string));
    say("motion".to_owned(), motion.words());
    say("recording".to_owned(), if head.recording { "an incident" } else { "no incident" }.to_owned());
    say("alarms".to_owned(), format!("{} not acknowledged", vehicle.open_alarms()));
    for group in &vehicle.groups {
        let (why, state) = (group.why(), group.state.as_str().to_uppercase());
        let counts = format!("{state} {}/{}", group.ok, group.counted);
        say(format!("group {}", group.id), if why.is_empty() { counts } else { format!("{counts}, {why}") });
    }
    for root in &vehicle.roots {
        let (state, message) = vehicle.says(&root.node);
        let state = state.map_or(String::new(), |state| state.as_str().to_uppercase());
        say(format!("cause {}", root.node), format!("{state} {message} ({})", root.words()));
    }
    for shelved in &vehicle.shelved {
        say(format!("shelved {}", shelved.node), shelved.words());
    }
    for countermeasure in &vehicle.countermeasures {
        let words = countermeasure.words();
        let (request, said) = words.split_once(": ").unwrap_or((&words, ""));
        say(format!("request {request}"), said.to_owned());
    }
    for module in vehicle.troubled() {
        let fact =
            Fact { said: module.state.as_str().to_uppercase(), message: format!(" {}", module.message) };
        facts.insert(format!("module {}", module.id), fact);
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
            "module can/battery: WARNING 20 ",
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

    #[test]
    fn data_that_come_late_are_not_dated_before_the_line_that_said_so() {
        let (mut lines, mut vehicle) = (Lines::default(), Some(golden()));
        let mut said = lines.changes(vehicle.as_ref(), Freshness::Live);
        let lost = Freshness::Lost { since: Some(Span::from_millis(3000)), connected: false };
        said.extend(lines.changes(None, lost));
        said.extend(lines.changes(None, Freshness::Live));
        let idle = r#""groups":[],"roots":[]"#;
        Vehicle::take(&mut vehicle, &changes(r#""base":9,"#, idle)).unwrap();
        said.extend(lines.changes(vehicle.as_ref(), Freshness::Live));
        assert!(said.iter().any(|line| line.ends_with("velodyne_packet_alive: over")), "{said:#?}");
        assert!(said.is_sorted_by_key(|line| &line[..24]), "{said:#?}");
    }
}
