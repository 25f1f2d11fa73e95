//! What the console knows of all vehicles. Everything in it came from the hub and is hostile: each text has bounds, each
//! list too, and a vehicle changes nothing but itself.

pub mod contact;
pub mod incidents;
pub mod picture;
pub mod recordings;
pub mod search;
#[cfg(test)]
mod tests;
pub mod vehicle;

use std::collections::{BTreeMap, BTreeSet};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Serialize;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::{Since, Span, Timestamp};
use telltale_fleet::hub::VEHICLES_MAX;
use telltale_fleet::message::{Batch, Cause, Content, Malformed, Pieces, VehicleId};
use telltale_fleet::reading::Stream;
use telltale_store::Head;
pub use telltale_web::common::wall_time as time;
use telltale_web::describe::words;

use contact::{Contact, Counts, Judged, Line, Urgency};
use incidents::IncidentRow;
use recordings::{NotAsked, Step};
use vehicle::{Times, Vehicle};

/// The log is read again from this long before its known end, so that a keyframe of each vehicle is in it.
const OVERLAP_MS: i64 = 15 * 60_000;

/// Heads of a vehicle's audit log that wait for the disk. The newest stands for all before it.
const HEADS_WAIT_MAX: usize = 8;

/// All vehicles.
#[derive(Debug)]
pub struct Fleet {
    vehicles: BTreeMap<VehicleId, Vehicle>,
    line: Line,
    /// The log is known up to here, by the hub's clock, in milliseconds since 1970.
    pub log_ms: i64,
    /// What changed since it was written last.
    unwritten: Unwritten,
    /// Messages that were not taken.
    pub refused: u64,
}

#[derive(Debug, Default)]
pub struct Unwritten {
    pub vehicles: BTreeSet<VehicleId>,
    pub incidents: BTreeSet<(VehicleId, u64)>,
    pub recordings: BTreeSet<(VehicleId, u64)>,
    /// Of the vehicles' audit logs, as they were told, with the hub's time in milliseconds since 1970.
    pub heads: BTreeMap<VehicleId, Vec<(Head, i64)>>,
}

impl Unwritten {
    fn add_head(&mut self, id: VehicleId, head: (Head, i64)) {
        let heads = self.heads.entry(id).or_default();
        heads.truncate(HEADS_WAIT_MAX - 1);
        heads.push(head);
    }
}

/// A message from the hub, unpacked.
#[derive(Debug)]
pub struct Arrived {
    pub stream: Stream,
    pub id: VehicleId,
    pub batch: Result<Batch, Malformed>,
    pub stored_ms: i64,
    pub age: Span,
}

/// A vehicle in one line, for programs and the page.
#[derive(Debug, Clone, Serialize, JsonSchema)]
#[schemars(rename = "Vehicle")]
pub struct Row {
    pub id: String,
    pub name: String,
    #[schemars(schema_with = "words::state")]
    pub state: State,
    #[schemars(schema_with = "cause")]
    pub cause: Option<Cause>,
    /// Since when it shows this state, by the hub's clock.
    #[schemars(schema_with = "words::some_time")]
    pub since: Option<String>,
    #[schemars(schema_with = "words::some_stage")]
    pub stage: Option<Stage>,
    pub contact: Contact,
    pub age_s: Option<f64>,
    pub version: String,
    pub config: String,
    pub speed_kmh: Option<u32>,
    pub unacknowledged: u32,
    /// By how much the vehicle's clock is ahead, if it is wrong by more than 5 s.
    pub clock_skew_s: Option<f64>,
    /// Two vehicles tell by this name.
    pub two_vehicles: bool,
    /// Messages of it that were not taken, and why the last one was not.
    pub refused: u64,
    pub refused_why: Option<String>,
    /// It drove when it was heard last.
    pub drives: bool,
    #[serde(skip)]
    pub urgency: Urgency,
    #[serde(skip)]
    pub since_ms: Option<i64>,
}

fn cause(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "type": ["object", "null"], "required": ["node", "words"],
        "properties": { "node": { "type": "string" }, "words": { "type": "string" } },
    })
}

impl Fleet {
    /// Without a line yet. `last_up` is when the hub was reached last.
    pub fn new(vehicles: impl IntoIterator<Item = Vehicle>, log_ms: i64, last_up: Since) -> Fleet {
        let vehicles = vehicles.into_iter().take(VEHICLES_MAX).map(|it| (it.id.clone(), it)).collect();
        let line = Line { up_since: None, last_up, why: "it was not reached yet".into() };
        Fleet { vehicles, line, log_ms, unwritten: Unwritten::default(), refused: 0 }
    }

    pub fn line(&self) -> &Line {
        &self.line
    }

    pub fn line_opened(&mut self, now: Timestamp) {
        self.line.up_since = Some(now);
    }

    pub fn line_ended(&mut self, why: &str, now: Timestamp) {
        if self.line.up_since.take().is_some() {
            self.line.last_up = Since::of_age(Span::ZERO, now);
        }
        self.line.why = why.chars().take(200).collect();
    }

    /// Whether a message of this vehicle is read now: there is room for it, and it has not told too much.
    pub fn reads(&self, id: &VehicleId, now: Timestamp) -> bool {
        match self.vehicles.get(id) {
            Some(vehicle) => vehicle.may_tell(now),
            None => self.vehicles.len() < VEHICLES_MAX,
        }
    }

    /// Somebody looks at a vehicle. Returns whether it must be asked for live data.
    pub fn look(&mut self, id: &VehicleId, now: Timestamp) -> bool {
        self.vehicles.get_mut(id).is_some_and(|vehicle| vehicle.look(now))
    }

    /// So many unpacked bytes of it were read.
    pub fn has_read(&mut self, id: &VehicleId, bytes: usize, now: Timestamp) {
        if let Some(vehicle) = self.vehicles.get_mut(id) {
            vehicle.has_told(bytes, now);
        }
    }

    /// Takes a message. One that is not as it should be is counted at its vehicle, and changes nothing else.
    pub fn take(&mut self, arrived: Arrived, now: Timestamp) {
        let Arrived { stream, id, batch, stored_ms, age } = arrived;
        if !self.vehicles.contains_key(&id) && self.vehicles.len() >= VEHICLES_MAX {
            self.refused += 1;
            return;
        }
        let comes =
            |batch: &Batch| batch.messages.iter().any(|it| matches!(it.content, Content::Recording(_)));
        let open = if batch.as_ref().is_ok_and(comes) { self.open_recordings() } else { 0 };
        let vehicle = self.vehicles.entry(id.clone()).or_insert_with(|| Vehicle::new(id.clone()));
        let is_head = |batch: &Batch| {
            batch.messages.len() == 1 && matches!(batch.messages[0].content, Content::Head(_))
        };
        match (stream, batch) {
            (Stream::Head, Ok(batch)) if is_head(&batch) => {
                let times = Times { heard: Since::of_age(age, now), now, stored_ms };
                if vehicle.take_head(&batch, times) {
                    self.unwritten.vehicles.insert(id);
                }
            }
            (Stream::Log, Ok(batch)) => {
                let mut last_head = None;
                vehicle.take_key(&batch.key);
                for message in &batch.messages {
                    if let Content::AuditHead(head) = &message.content {
                        last_head = Head::parse(&format!("{}:{}", head.record, head.hash)).or(last_head);
                    }
                    if let Some(number) = vehicle.take(message) {
                        self.unwritten.incidents.insert((id.clone(), number));
                    }
                    if let Content::Recording(said) = &message.content {
                        match vehicle.take_recording(message.mark(), said, open, stored_ms) {
                            Ok(true) => {
                                self.unwritten.recordings.insert((id.clone(), said.incident));
                            }
                            Ok(false) => {}
                            Err(why) => {
                                self.refused += 1;
                                vehicle.refuse(why);
                            }
                        }
                    }
                    if message.content == Content::Goodbye {
                        self.unwritten.vehicles.insert(id.clone());
                    }
                }
                if let Some(head) = last_head {
                    self.unwritten.add_head(id, (head, stored_ms));
                }
            }
            (_, refused) => {
                self.refused += 1;
                vehicle.refuse(refused.err().unwrap_or(Malformed::NoMessage(2)));
            }
        }
        if stream == Stream::Log {
            self.log_ms = self.log_ms.max(stored_ms);
        }
    }

    /// From when on the log is read, by the hub's clock. A hub whose clock was ahead once must not make the console pass
    /// over what came later.
    pub fn log_from_ms(&self, wall_ms: i64) -> i64 {
        self.log_ms.min(wall_ms).saturating_sub(OVERLAP_MS).max(0)
    }

    pub fn vehicle(&self, id: &VehicleId) -> Option<&Vehicle> {
        self.vehicles.get(id)
    }

    pub fn vehicles(&self) -> impl Iterator<Item = &Vehicle> {
        self.vehicles.values()
    }

    fn open_recordings(&self) -> usize {
        self.vehicles.values().map(|it| it.open_recordings().count()).sum()
    }

    /// Whether somebody may ask for the recording of an incident.
    ///
    /// # Errors
    /// Why not.
    pub fn may_ask(&self, id: &VehicleId, number: u64) -> Result<(), NotAsked> {
        self.vehicles.get(id).ok_or(NotAsked::NoIncident)?.may_ask(number, self.open_recordings())
    }

    /// Somebody who may asks for it.
    pub fn ask(&mut self, id: &VehicleId, number: u64, now_ms: i64) {
        if let Some(vehicle) = self.vehicles.get_mut(id) {
            vehicle.ask(number, now_ms);
            self.unwritten.recordings.insert((id.clone(), number));
        }
    }

    /// A recording with these pieces went on.
    pub fn recording_is(&mut self, id: &VehicleId, number: u64, of: &Pieces, step: Step) {
        let is_over = !step.is_open();
        if let Some(vehicle) = self.vehicles.get_mut(id)
            && vehicle.recording_is(number, of, step)
            && is_over
        {
            self.unwritten.recordings.insert((id.clone(), number));
        }
    }

    /// The pieces of a recording are not those that the vehicle announced.
    pub fn refuse_recording(&mut self, id: &VehicleId, number: u64, of: &Pieces, why: &'static str) {
        self.recording_is(id, number, of, Step::Bad(why.to_owned()));
        self.refused += 1;
        if let Some(vehicle) = self.vehicles.get_mut(id) {
            vehicle.refuse(Malformed::Recording(number, why));
        }
    }

    /// It was removed here.
    pub fn recording_removed(&mut self, id: &VehicleId, number: u64) {
        if let Some(transfer) = self.vehicles.get_mut(id).and_then(|it| it.recordings.get_mut(&number)) {
            transfer.step = Step::Gone;
            self.unwritten.recordings.insert((id.clone(), number));
        }
    }

    /// Gives up recordings that nothing came of.
    pub fn give_up_recordings(&mut self, now_ms: i64) {
        for vehicle in self.vehicles.values_mut() {
            let given_up = vehicle.give_up_recordings(now_ms).into_iter();
            self.unwritten.recordings.extend(given_up.map(|number| (vehicle.id.clone(), number)));
        }
    }

    /// What changed since the last call.
    pub fn take_unwritten(&mut self) -> Unwritten {
        std::mem::take(&mut self.unwritten)
    }

    /// The disk did not take it.
    pub fn put_back(&mut self, unwritten: Unwritten) {
        self.unwritten.vehicles.extend(unwritten.vehicles);
        self.unwritten.incidents.extend(unwritten.incidents);
        self.unwritten.recordings.extend(unwritten.recordings);
        let newer = std::mem::replace(&mut self.unwritten.heads, unwritten.heads);
        for (id, heads) in newer {
            heads.into_iter().for_each(|head| self.unwritten.add_head(id.clone(), head));
        }
    }

    /// All vehicles, the worst first.
    pub fn rows(&self, now: Timestamp) -> Vec<Row> {
        let mut rows: Vec<Row> = self.vehicles.values().map(|vehicle| self.row(vehicle, now)).collect();
        rows.sort_by(|a, b| (a.urgency, b.state, &a.id).cmp(&(b.urgency, a.state, &b.id)));
        rows
    }

    pub fn row(&self, vehicle: &Vehicle, now: Timestamp) -> Row {
        let id = vehicle.id.to_string();
        let (refused, refused_why) = match &vehicle.refused {
            Some((count, why)) => (*count, Some(why.to_string())),
            None => (0, None),
        };
        let none = Row {
            name: id.clone(),
            id,
            state: State::Unknown,
            cause: None,
            since: None,
            stage: None,
            contact: if self.line.up_since.is_some() { Contact::Lost } else { Contact::HubDown },
            age_s: None,
            version: String::new(),
            config: String::new(),
            speed_kmh: None,
            unacknowledged: 0,
            clock_skew_s: None,
            two_vehicles: vehicle.is_two(now),
            refused,
            refused_why,
            drives: false,
            urgency: Urgency::NeverHeard,
            since_ms: None,
        };
        let Some(heard) = &vehicle.head else { return none };
        let head = &heard.head;
        let contact = self.line.contact(heard.at, vehicle.has_left(), now);
        let drives = head.drives || head.speed_kmh.is_some_and(|speed| speed > 0);
        let judged = Judged { contact, state: head.state, drives, unacknowledged: head.unacknowledged > 0 };
        let since_ms = vehicle.since_ms();
        Row {
            name: if head.name.is_empty() { none.name } else { head.name.clone() },
            state: head.state,
            cause: head.cause.clone(),
            since: since_ms.map(time),
            stage: Some(head.stage),
            contact,
            age_s: Some((heard.at.age(now).as_secs_f64() * 10.0).round() / 10.0),
            version: head.version.clone(),
            config: head.config.clone(),
            speed_kmh: head.speed_kmh,
            unacknowledged: head.unacknowledged,
            clock_skew_s: vehicle.skew_ms().map(|ms| ms as f64 / 1000.0),
            drives,
            urgency: judged.urgency(),
            since_ms,
            ..none
        }
    }

    pub fn incidents(&self) -> Vec<IncidentRow> {
        let of = |vehicle: &Vehicle| -> Vec<IncidentRow> {
            let row = |(number, it)| incidents::row(&vehicle.id, it, vehicle.recordings.get(number));
            vehicle.incidents.iter().map(row).collect()
        };
        self.vehicles.values().flat_map(of).collect()
    }
}

/// How many there are of each kind.
pub fn counts(rows: &[Row]) -> Counts {
    let mut counts = Counts::default();
    for row in rows {
        counts.add(row.contact, row.state, row.urgency);
    }
    counts
}
