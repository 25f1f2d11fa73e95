//! What a terminal shows of a snapshot, read from the JSON of the stream. Changes are taken into the state that
//! they apply to. Every text is cleaned as it is read: names and messages come from the vehicle's network.

use std::collections::HashMap;
use std::fmt;

use anyhow::{Context as _, bail};
use serde::{Deserialize, Deserializer};

use crate::engine::model::Stage;
use crate::engine::snapshot::{CountermeasureState, Moving};
use crate::engine::state::State;
use crate::web::texts::{ID, clean};

/// Groups inside groups. The configuration has fewer.
const DEPTH_MAX: usize = 32;

/// A text from outside without control characters, in one line.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Cleaned(String);

impl<'de> Deserialize<'de> for Cleaned {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Cleaned, D::Error> {
        String::deserialize(deserializer).map(|text| Cleaned(clean(&text, ID)))
    }
}

impl fmt::Display for Cleaned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

/// The vehicle as it was last told.
#[derive(Debug, Clone)]
pub struct Vehicle {
    pub head: Head,
    /// The tiles, each followed by the groups inside it.
    pub groups: Vec<Group>,
    modules: HashMap<Cleaned, Module>,
    pub roots: Vec<Root>,
    pub alarms: Vec<Alarm>,
    pub shelved: Vec<Shelved>,
    pub countermeasures: Vec<Countermeasure>,
}

#[derive(Debug, Clone, Deserialize)]
pub struct Head {
    seq: u64,
    /// The state to which changes apply; a whole snapshot has none.
    base: Option<u64>,
    pub at: Cleaned,
    pub stage: Stage,
    pub operator: Option<Cleaned>,
    pub overall: State,
    pub motion: Motion,
    pub recording: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Motion {
    pub moving: Moving,
    pub speed_mps: Option<f64>,
    pub destination: Option<Cleaned>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Group {
    pub id: Cleaned,
    pub name: Cleaned,
    pub state: State,
    pub ok: u32,
    pub counted: u32,
    pub reason: Option<Reason>,
    #[serde(default)]
    modules: Vec<Module>,
    #[serde(default)]
    groups: Vec<Group>,
    /// 0 for a tile.
    #[serde(skip)]
    pub depth: usize,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Reason {
    Masked { by: Vec<Cleaned> },
    NotRelevant { because: Cleaned },
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Module {
    pub id: Cleaned,
    pub state: State,
    pub message: Cleaned,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Root {
    pub node: Cleaned,
    masks: u32,
    second: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Alarm {
    pub acknowledged: bool,
    pub active: bool,
}

/// A module whose faults raise no alarm for now.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Shelved {
    pub node: Cleaned,
    until: Cleaned,
    by: Cleaned,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Countermeasure {
    pub request: Cleaned,
    pub mps2: Option<f64>,
    pub cause: Cleaned,
    pub state: CountermeasureState,
}

#[derive(Deserialize)]
struct Message {
    #[serde(flatten)]
    head: Head,
    groups: Vec<Group>,
    #[serde(default)]
    modules: Vec<Module>,
    roots: Option<Vec<Root>>,
    alarms: Option<Vec<Alarm>>,
    shelved: Option<Vec<Shelved>>,
    countermeasures: Option<Vec<Countermeasure>>,
}

impl Vehicle {
    /// Takes a message of the stream: a whole snapshot, or the changes since the one before.
    ///
    /// # Errors
    /// If it is no message of this version of the stream.
    pub fn take(vehicle: &mut Option<Vehicle>, text: &str) -> anyhow::Result<()> {
        let message: Message = serde_json::from_str(text)
            .context("the server sends what this version of telltale cannot read")?;
        match (&mut *vehicle, message.head.base) {
            (_, None) => *vehicle = Some(Vehicle::whole(message)?),
            (Some(vehicle), Some(base)) if base == vehicle.head.seq => vehicle.change(message),
            _ => bail!("the server sends changes to a state that it did not send"),
        }
        Ok(())
    }

    fn whole(message: Message) -> anyhow::Result<Vehicle> {
        let mut vehicle = Vehicle {
            head: message.head,
            groups: Vec::new(),
            modules: HashMap::new(),
            roots: message.roots.unwrap_or_default(),
            alarms: message.alarms.unwrap_or_default(),
            shelved: message.shelved.unwrap_or_default(),
            countermeasures: message.countermeasures.unwrap_or_default(),
        };
        vehicle.flatten(message.groups, 0)?;
        Ok(vehicle)
    }

    fn flatten(&mut self, groups: Vec<Group>, depth: usize) -> anyhow::Result<()> {
        if depth > DEPTH_MAX {
            bail!("the server sends groups inside groups without end");
        }
        for mut group in groups {
            let (inside, modules) = (std::mem::take(&mut group.groups), std::mem::take(&mut group.modules));
            self.modules.extend(modules.into_iter().map(|module| (module.id.clone(), module)));
            self.groups.push(Group { depth, ..group });
            self.flatten(inside, depth + 1)?;
        }
        Ok(())
    }

    fn change(&mut self, message: Message) {
        self.head = message.head;
        for group in message.groups {
            if let Some(known) = self.groups.iter_mut().find(|known| known.id == group.id) {
                *known = Group { depth: known.depth, ..group };
            }
        }
        for module in message.modules {
            // Changes name no new modules: those come with a whole snapshot.
            if let Some(known) = self.modules.get_mut(&module.id) {
                *known = module;
            }
        }
        // A list that is not told has not changed.
        if let Some(roots) = message.roots {
            self.roots = roots;
        }
        if let Some(alarms) = message.alarms {
            self.alarms = alarms;
        }
        if let Some(shelved) = message.shelved {
            self.shelved = shelved;
        }
        if let Some(countermeasures) = message.countermeasures {
            self.countermeasures = countermeasures;
        }
    }

    pub fn tiles(&self) -> impl Iterator<Item = &Group> {
        self.groups.iter().filter(|group| group.depth == 0)
    }

    /// The state of a node and what it says; a group says nothing.
    pub fn says(&self, node: &Cleaned) -> (Option<State>, String) {
        let group = || self.groups.iter().find(|group| group.id == *node);
        match self.modules.get(node) {
            Some(module) => (Some(module.state), module.message.to_string()),
            None => (group().map(|group| group.state), String::new()),
        }
    }

    /// The modules that are not OK and no cause, as those with a WARNING.
    pub fn troubled(&self) -> impl Iterator<Item = &Module> {
        let is_cause = |module: &Module| self.roots.iter().any(|root| root.node == module.id);
        let is_bad = |state| matches!(state, State::Warning | State::Unknown | State::Error);
        self.modules.values().filter(move |module| is_bad(module.state) && !is_cause(module))
    }

    /// How many alarms nobody has acknowledged.
    pub fn open_alarms(&self) -> usize {
        self.alarms.iter().filter(|alarm| !alarm.acknowledged).count()
    }
}

impl Group {
    /// Why it does not count; empty if it does.
    pub fn why(&self) -> String {
        match &self.reason {
            None => String::new(),
            Some(Reason::Masked { by }) => match by.as_slice() {
                [] => "waits".to_owned(),
                [one] => format!("waits for {one}"),
                [first, others @ ..] => format!("waits for {first} and {} more", others.len()),
            },
            Some(Reason::NotRelevant { because }) => format!("not relevant: {because}"),
        }
    }
}

impl Motion {
    pub fn words(&self) -> String {
        let destination = self.destination.as_ref().map_or(String::new(), |it| format!(", to {it}"));
        let speed = self.speed_mps.map_or(String::new(), |speed| format!(" at {speed:.1} m/s"));
        match self.moving {
            Moving::Yes => format!("moving{speed}{destination}"),
            Moving::No => format!("standing{destination}"),
            Moving::Unknown => format!("motion unknown{destination}"),
        }
    }
}

impl Root {
    /// `masks 4`, or `second fault, masks 4`.
    pub fn words(&self) -> String {
        let second = if self.second { "second fault, " } else { "" };
        format!("{second}masks {}", self.masks)
    }
}

impl Shelved {
    pub fn words(&self) -> String {
        format!("until {}, by {}", self.until, self.by)
    }
}

impl Countermeasure {
    pub fn words(&self) -> String {
        let strength = self.mps2.map_or(String::new(), |mps2| format!(" {mps2:.1} m/s²"));
        format!("{}{strength}: {}, because of {}", self.request, self.state.as_str(), self.cause)
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// The frame that the server's own tests write, so that neither side changes alone.
    pub const GOLDEN: &str = include_str!("../../../../crates/web/src/live/frame/golden.json");

    pub fn golden() -> Vehicle {
        let mut vehicle = None;
        Vehicle::take(&mut vehicle, GOLDEN).unwrap();
        vehicle.unwrap()
    }

    /// A message of changes alone.
    pub fn changes(head: &str, rest: &str) -> String {
        format!(
            r#"{{"seq":10,{head}"at":"2026-11-20T12:00:40.000Z","stage":"active","operator":null,"overall":"ok",
            "motion":{{"moving":"yes","speed_mps":2.5,"destination":"depot"}},"recording":true,{rest}}}"#
        )
    }

    #[test]
    fn what_the_server_writes_is_read_whole() {
        let vehicle = golden();
        assert_eq!((vehicle.head.stage, vehicle.head.overall), (Stage::Active, State::Error));
        let (state, message) = vehicle.says(&vehicle.roots[0].node);
        assert_eq!((state, message.as_str()), (Some(State::Error), "no packets"));
        let waiting = vehicle.tiles().find(|tile| tile.name.to_string() == "Localization").unwrap();
        assert_eq!(waiting.why(), "waits for sensors/velodyne_packet_alive");
    }

    #[test]
    fn changes_are_taken_into_the_state_that_they_apply_to() {
        let mut vehicle = Some(golden());
        let sensors = r#""groups":[{"id":"sensors","name":"Sensors","state":"ok","ok":4,"counted":4,"reason":null}],"roots":[]"#;
        Vehicle::take(&mut vehicle, &changes(r#""base":9,"#, sensors)).unwrap();
        let after = vehicle.as_ref().unwrap();
        assert_eq!((after.tiles().next().unwrap().ok, after.roots.len()), (4, 0));
        assert_eq!(after.tiles().count(), golden().tiles().count());
        assert!(
            !after.countermeasures.is_empty() || golden().countermeasures.is_empty(),
            "what is not told stays"
        );
        let error = Vehicle::take(&mut vehicle, &changes(r#""base":7,"#, sensors)).unwrap_err();
        assert!(error.to_string().contains("changes to a state"), "{error}");
        assert!(Vehicle::take(&mut vehicle, "{}").is_err());
    }

    #[test]
    fn a_hostile_text_brings_no_control_character() {
        let hostile = r#""groups":[{"id":"a","name":"\u001b[2J\u009b31mA\nB\u202e","state":"ok","ok":0,"counted":0,"reason":null}]"#;
        let mut vehicle = None;
        Vehicle::take(&mut vehicle, &changes("", hostile)).unwrap();
        let name = vehicle.unwrap().groups[0].name.to_string();
        assert!(
            !name.contains(|it: char| it.is_control() || it == '\u{202e}') && name.contains("A B"),
            "{name:?}"
        );
    }
}
