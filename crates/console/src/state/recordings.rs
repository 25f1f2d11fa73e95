//! The recordings of a vehicle's incidents at the console: which were asked for, come, lie here, or do not come.

use serde::{Deserialize, Serialize};
use telltale_fleet::message::{Epoch, Malformed, Mark, NotSent, Pieces, Recording};

use super::vehicle::Vehicle;

/// Recordings that were asked for or come, of one vehicle and of all.
pub const OPEN_OF_VEHICLE: usize = 8;
pub const OPEN_MAX: usize = 256;

/// A recording without a new piece for this time is given up: the hub keeps pieces for as long.
const GIVEN_UP_AFTER_MS: i64 = 14 * 24 * 3_600_000;

/// The recording of one incident.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Transfer {
    pub step: Step,
    /// Somebody asked for it here.
    pub is_asked: bool,
    /// When somebody asked, or it began to come, in milliseconds since 1970.
    since_ms: i64,
    /// The last message about it: the log is read again after a break.
    told: Option<(Epoch, u64)>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// The vehicle has not answered.
    Asked,
    Coming {
        pieces: Pieces,
        /// So many are here.
        have: u64,
    },
    Here(Pieces),
    Refused(NotSent),
    /// The pieces are not those of the recording that the vehicle announced.
    Bad(String),
    /// It was removed here, or nothing came.
    Gone,
}

impl Step {
    pub fn is_open(&self) -> bool {
        matches!(self, Step::Asked | Step::Coming { .. })
    }
}

/// Why a recording cannot be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotAsked {
    NoIncident,
    /// The vehicle did not tell of a finished recording.
    NoRecording,
    TooMany,
}

impl Vehicle {
    /// The recordings that were asked for or come.
    pub fn open_recordings(&self) -> impl Iterator<Item = (u64, &Transfer)> {
        self.recordings.iter().filter(|(_, it)| it.step.is_open()).map(|(number, it)| (*number, it))
    }

    /// Whether the recording of an incident is here.
    pub fn has_recording(&self, number: u64) -> bool {
        matches!(self.recordings.get(&number).map(|it| &it.step), Some(Step::Here(_)))
    }

    pub fn is_open(&self, number: u64) -> bool {
        self.recordings.get(&number).is_some_and(|it| it.step.is_open())
    }

    /// Whether a recording may come: it is open already, or there is room; `open` is how many are open in the whole fleet.
    fn may_open(&self, number: u64, open: usize) -> bool {
        let has_room = open < OPEN_MAX && self.open_recordings().count() < OPEN_OF_VEHICLE;
        self.is_open(number) || has_room
    }

    /// Whether somebody may ask for a recording.
    ///
    /// # Errors
    /// Why not.
    pub fn may_ask(&self, number: u64, open: usize) -> Result<(), NotAsked> {
        let incident = self.incidents.get(&number).ok_or(NotAsked::NoIncident)?;
        incident.sha256.as_ref().ok_or(NotAsked::NoRecording)?;
        if self.may_open(number, open) { Ok(()) } else { Err(NotAsked::TooMany) }
    }

    /// Somebody asks for a recording. One that comes already goes on.
    pub fn ask(&mut self, number: u64, now_ms: i64) {
        if !self.is_open(number) {
            let told = self.recordings.get(&number).and_then(|it| it.told);
            let asked = Transfer { step: Step::Asked, is_asked: true, since_ms: now_ms, told };
            self.recordings.insert(number, asked);
        }
    }

    /// Takes what the vehicle says of a recording. Returns whether that is news.
    ///
    /// # Errors
    /// It says what cannot be.
    pub fn take_recording(
        &mut self,
        mark: Mark,
        said: &Recording,
        open: usize,
        now_ms: i64,
    ) -> Result<bool, Malformed> {
        let number = said.incident;
        let wrong = |why| Err(Malformed::Recording(number, why));
        let Some(incident) = self.incidents.get(&number) else { return wrong("there is no such incident") };
        let known = self.recordings.get(&number);
        if known.is_some_and(|it| it.told >= Some((mark.epoch, mark.n))) {
            return Ok(false);
        }
        let is_asked = known.is_some_and(|it| it.is_asked && it.step.is_open());
        let step = match (&said.pieces, said.refused) {
            (None, Some(_)) if !is_asked => return Ok(false),
            (None, Some(why)) => Step::Refused(why),
            (Some(pieces), None) => {
                if Pieces::of(&pieces.sha256, pieces.bytes).as_ref() != Some(pieces) {
                    return wrong("its hash, size and pieces do not fit");
                }
                if incident.sha256.as_ref() != Some(&pieces.sha256) || incident.bytes != pieces.bytes {
                    return wrong("it is not the one of the incident");
                }
                if !self.may_open(number, open) {
                    return wrong("more come at once than are taken");
                }
                Step::Coming { pieces: pieces.clone(), have: 0 }
            }
            _ => return wrong("it neither comes nor is refused"),
        };
        let told = Some((mark.epoch, mark.n));
        self.recordings.insert(number, Transfer { step, is_asked, since_ms: now_ms, told });
        Ok(true)
    }

    /// A recording went on. Returns whether it is still the one with these pieces.
    pub fn recording_is(&mut self, number: u64, of: &Pieces, step: Step) -> bool {
        let Some(transfer) = self.recordings.get_mut(&number) else { return false };
        let is_it = match &transfer.step {
            Step::Coming { pieces, .. } => pieces == of,
            _ => false,
        };
        if is_it {
            transfer.step = step;
        }
        is_it
    }

    /// Gives up what nothing came of. Returns the numbers.
    pub fn give_up_recordings(&mut self, now_ms: i64) -> Vec<u64> {
        let is_old = |it: &Transfer| now_ms.saturating_sub(it.since_ms) > GIVEN_UP_AFTER_MS;
        let old = self.open_recordings().filter(|(_, it)| is_old(it)).map(|(number, _)| number);
        let old: Vec<u64> = old.collect();
        for number in &old {
            if let Some(transfer) = self.recordings.get_mut(number) {
                transfer.step = Step::Gone;
            }
        }
        old
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::incidents::INCIDENTS_MAX;
    use telltale_fleet::message::{Incident, RECORDING_BYTES_MAX, VehicleId};

    const NOW: i64 = 1_780_000_000_000;

    fn hash(number: u64) -> String {
        format!("{number:064x}")
    }

    /// A vehicle with finished recordings of 100,000 bytes.
    fn vehicle() -> Vehicle {
        let mut vehicle = Vehicle::new(VehicleId::new("a").unwrap());
        for number in 1..=20 {
            vehicle.take_incident(&Incident {
                number,
                since: NOW,
                until: Some(NOW),
                stage: String::new(),
                causes: Vec::new(),
                triggers: 1,
                version: String::new(),
                config: String::new(),
                bytes: 100_000,
                sha256: (number != 20).then(|| hash(number)),
            });
        }
        vehicle
    }

    fn mark(n: u64) -> Mark {
        Mark { epoch: Epoch { start: 1, nonce: 0 }, n }
    }

    fn comes(incident: u64) -> Recording {
        Recording { incident, pieces: Pieces::of(&hash(incident), 100_000), refused: None }
    }

    #[test]
    fn what_is_told_is_compared_with_the_incident_and_taken_once() {
        let mut vehicle = vehicle();
        assert_eq!(vehicle.take_recording(mark(1), &comes(3), 0, NOW), Ok(true), "by itself");
        let coming = vehicle.recordings[&3].clone();
        assert!(!coming.is_asked && coming.step.is_open());
        let pieces = comes(3).pieces.unwrap();
        assert!(vehicle.recording_is(3, &pieces, Step::Here(pieces.clone())));
        assert_eq!(vehicle.take_recording(mark(1), &comes(3), 0, NOW), Ok(false), "the log is read again");
        assert_eq!(vehicle.recordings[&3].step, Step::Here(pieces.clone()));
        let of = |sha256: &str, bytes, pieces| {
            let pieces = Some(Pieces { sha256: sha256.into(), bytes, pieces });
            Recording { incident: 4, pieces, refused: None }
        };
        for bad in [
            of("../../../etc/passwd", 100_000, 2),
            of(&hash(4).to_uppercase().replace('0', "G"), 100_000, 2),
            of(&hash(4), 100_000, 3),
            of(&hash(4), 100_001, 2),
            of(&hash(5), 100_000, 2),
            of(&hash(4), RECORDING_BYTES_MAX + 1, (RECORDING_BYTES_MAX + 1).div_ceil(65_536)),
            of(&hash(4), 0, 0),
            Recording { refused: Some(NotSent::Gone), ..comes(4) },
            Recording { incident: 4, pieces: None, refused: None },
            Recording { incident: 400, ..comes(4) },
        ] {
            let taken = vehicle.take_recording(mark(2), &bad, 0, NOW);
            assert!(matches!(taken, Err(Malformed::Recording(..))), "{bad:?}: {taken:?}");
        }
        assert!(!vehicle.recordings.contains_key(&4));
    }

    #[test]
    fn an_incident_with_its_recording_here_outlasts_newer_ones() {
        let mut vehicle = vehicle();
        let pieces = comes(3).pieces.unwrap();
        vehicle.take_recording(mark(1), &comes(3), 0, NOW).unwrap();
        vehicle.recording_is(3, &pieces, Step::Here(pieces.clone()));
        let newest = vehicle.incidents[&1].clone();
        for number in 21..=300 {
            vehicle.take_incident(&Incident { number, ..newest.clone() });
        }
        let numbers: Vec<u64> = vehicle.incidents.keys().copied().collect();
        assert_eq!((numbers.len(), &numbers[..2]), (INCIDENTS_MAX + 1, &[3, 201][..]));
        assert!(vehicle.has_recording(3));
    }

    #[test]
    fn few_come_at_once_and_what_does_not_come_is_given_up() {
        let mut vehicle = vehicle();
        assert_eq!(vehicle.may_ask(21, 0), Err(NotAsked::NoIncident));
        assert_eq!(vehicle.may_ask(20, 0), Err(NotAsked::NoRecording));
        assert_eq!(vehicle.may_ask(1, OPEN_MAX), Err(NotAsked::TooMany));
        for number in 1..=OPEN_OF_VEHICLE as u64 {
            assert_eq!(vehicle.may_ask(number, 0), Ok(()));
            vehicle.ask(number, NOW);
        }
        assert_eq!(vehicle.may_ask(9, 0), Err(NotAsked::TooMany));
        assert_eq!(vehicle.may_ask(8, 0), Ok(()), "it is asked for already");
        assert!(vehicle.take_recording(mark(1), &comes(9), 0, NOW).is_err());
        let never = Recording { incident: 1, pieces: None, refused: Some(NotSent::Never) };
        assert_eq!(vehicle.take_recording(mark(2), &never, 0, NOW), Ok(true));
        assert_eq!(vehicle.recordings[&1].step, Step::Refused(NotSent::Never));
        assert!(vehicle.give_up_recordings(NOW + GIVEN_UP_AFTER_MS).is_empty());
        assert_eq!(vehicle.give_up_recordings(NOW + GIVEN_UP_AFTER_MS + 1).len(), 7);
        assert_eq!(vehicle.may_ask(9, 0), Ok(()));
    }
}
