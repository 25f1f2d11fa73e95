//! The state of the vehicle that outlives a restart: its stage, its alarms with their numbers, and the
//! decisions of the operator.

use std::time::{Duration, SystemTime};

use rusqlite::{Connection, OptionalExtension, Row, params};

use super::audit::Record;
use super::database::from_unix_ms;
use super::{Database, Store, StoreError};
use telltale_clock::unix_ms;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::{Request, RequestKind};
use telltale_engine::model::wording::Urgency;
use telltale_engine::restart::resume::{Restored, RestoredAlarm, RestoredCountermeasure};
use telltale_engine::snapshot::{KnownPlace, MapPose};
use telltale_engine::time::Span;

/// The length of stored lists. An engine keeps less; the rest of a longer list is not stored.
const ROWS_MAX: usize = 8192;

/// The vehicle's state to be stored. The operator is stored with the sessions.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleMemory {
    /// Counts the states of this process: a state older than the one stored last is not written.
    pub seq: u64,
    /// The wall time of `vehicle`, because the monotonic clock starts anew.
    pub at: SystemTime,
    pub vehicle: Restored,
}

impl VehicleMemory {
    /// Whether nothing that matters has changed since the earlier state; ages do not matter.
    pub fn says_the_same(&self, earlier: &VehicleMemory) -> bool {
        let [mut now, mut then] = [self.vehicle.clone(), earlier.vehicle.clone()];
        for alarm in now.alarms.iter_mut().chain(&mut then.alarms) {
            alarm.age = Span::ZERO;
        }
        for measure in now.countermeasures.iter_mut().chain(&mut then.countermeasures) {
            measure.age = Span::ZERO;
            measure.by_operator = measure.by_operator.map(|_| Span::ZERO);
        }
        now == then
    }
}

impl VehicleMemory {
    /// The wall time at which something began that is so old.
    fn began_ms(&self, age: Span) -> i64 {
        let began = self.at.checked_sub(Duration::from(age));
        unix_ms(began.unwrap_or(SystemTime::UNIX_EPOCH))
    }
}

impl Store {
    /// Stores the vehicle's state, unless it says the same as what is stored. Records that wait are written
    /// with it. Returns whether the disk had to take anything.
    pub async fn remember(&self, memory: VehicleMemory) -> Result<bool, StoreError> {
        self.call(move |database| database.remember(Some(memory))).await
    }

    /// The vehicle's state that was stored last, with the operator who is still in charge; `None` at the
    /// first start.
    pub async fn recall(&self) -> Result<Option<Restored>, StoreError> {
        let operator = self.operator_in_charge().await?;
        let restored = self.call(Database::read_vehicle).await?;
        Ok(restored.map(|restored| Restored { operator: operator.map(Box::from), ..restored }))
    }
}

pub(super) fn write(connection: &Connection, memory: &VehicleMemory) -> Result<(), StoreError> {
    let vehicle = &memory.vehicle;
    let (number, pose) = vehicle.pose.unzip();
    connection
        .prepare_cached(
            "INSERT INTO vehicle (one, stage, posed, pose_number, pose_x_m, pose_y_m, pose_yaw_deg, last_alarm)
             VALUES (1, ?1, ?2, ?3, ?4, ?5, ?6, ?7)
             ON CONFLICT (one) DO UPDATE SET stage = ?1, posed = ?2, pose_number = ?3, pose_x_m = ?4,
                 pose_y_m = ?5, pose_yaw_deg = ?6, last_alarm = max(last_alarm, ?7)",
        )?
        .execute(params![
            vehicle.stage.as_str(),
            vehicle.posed,
            number.map(|number| number as i64),
            pose.map(|pose| pose.x_m),
            pose.map(|pose| pose.y_m),
            pose.map(|pose| pose.yaw_deg),
            vehicle.last_alarm as i64,
        ])?;
    connection.execute_batch(
        "DELETE FROM last_known_place; DELETE FROM alarms; DELETE FROM accepted; DELETE FROM causes; DELETE FROM asking;
         DELETE FROM latched; DELETE FROM countermeasures;",
    )?;
    if let Some(KnownPlace { pose: MapPose { x_m, y_m, yaw_deg }, driven }) = vehicle.last_known {
        let mut insert =
            connection.prepare_cached("INSERT INTO last_known_place VALUES (1, ?1, ?2, ?3, ?4)")?;
        insert.execute(params![x_m, y_m, yaw_deg, driven])?;
    }
    let mut insert = connection.prepare_cached("INSERT INTO alarms VALUES (?1, ?2, ?3, ?4, ?5, ?6)")?;
    for alarm in vehicle.alarms.iter().take(ROWS_MAX) {
        let RestoredAlarm { id, node, age, acknowledged, active, asked } = alarm;
        let asked = asked.map(Urgency::as_str);
        insert.execute(params![*id as i64, node, memory.began_ms(*age), acknowledged, active, asked])?;
    }
    let mut insert = connection.prepare_cached("INSERT OR IGNORE INTO accepted VALUES (?1)")?;
    for node in vehicle.accepted.iter().take(ROWS_MAX) {
        insert.execute([node])?;
    }
    let mut insert = connection.prepare_cached("INSERT OR IGNORE INTO latched VALUES (?1)")?;
    for node in vehicle.latched.iter().take(ROWS_MAX) {
        insert.execute([node])?;
    }
    let mut insert = connection.prepare_cached("INSERT INTO countermeasures VALUES (?1, ?2, ?3, ?4, ?5)")?;
    let mut insert_cause = connection.prepare_cached("INSERT INTO causes VALUES (?1, ?2, ?3, ?4)")?;
    let mut insert_asking = connection.prepare_cached("INSERT OR IGNORE INTO asking VALUES (?1, ?2)")?;
    for (number, measure) in vehicle.countermeasures.iter().enumerate() {
        let number = number as i64;
        let mps2 = if let Request::Decelerate { mps2 } = measure.request { Some(mps2) } else { None };
        let stopped_ms = measure.by_operator.map(|age| memory.began_ms(age));
        let since_ms = memory.began_ms(measure.age);
        insert.execute(params![number, measure.request.as_str(), mps2, since_ms, stopped_ms])?;
        for (position, (node, acknowledged)) in measure.causes.iter().take(ROWS_MAX).enumerate() {
            insert_cause.execute(params![number, position as i64, node, acknowledged])?;
        }
        for node in measure.about.iter().take(ROWS_MAX) {
            insert_asking.execute(params![number, node])?;
        }
    }
    Ok(())
}

impl Database {
    /// Writes the vehicle's state and the records that wait. A state that is older than the stored one, or
    /// says the same, is not written. Returns whether anything was.
    pub(super) fn remember(&mut self, memory: Option<VehicleMemory>) -> Result<bool, StoreError> {
        let news = memory.filter(|memory| {
            let stored = self.stored_vehicle.as_ref();
            stored.is_none_or(|stored| memory.seq >= stored.seq && !memory.says_the_same(stored))
        });
        let Some(memory) = news else { return self.write_waiting() };
        self.change(&[], |transaction| write(transaction, &memory))?;
        self.is_stored(memory);
        Ok(true)
    }

    /// Writes an action with the vehicle's state after it.
    pub(super) fn write_ahead(
        &mut self,
        memory: Option<VehicleMemory>,
        record: Record,
    ) -> Result<(), StoreError> {
        let memory =
            memory.filter(|memory| self.stored_vehicle.as_ref().is_none_or(|it| memory.seq >= it.seq));
        self.change(&[record], |transaction| memory.as_ref().map_or(Ok(()), |it| write(transaction, it)))?;
        if let Some(memory) = memory {
            self.is_stored(memory);
        }
        Ok(())
    }

    /// Notes that this state of the vehicle was written.
    pub(super) fn is_stored(&mut self, memory: VehicleMemory) {
        let seq = self.stored_vehicle.as_ref().map_or(memory.seq, |stored| stored.seq.max(memory.seq));
        self.stored_vehicle = Some(VehicleMemory { seq, ..memory });
    }

    fn read_vehicle(&mut self) -> Result<Option<Restored>, StoreError> {
        let connection = &self.connection;
        let wall = self.clock.wall();
        let sql =
            "SELECT stage, posed, pose_number, pose_x_m, pose_y_m, pose_yaw_deg, last_alarm FROM vehicle";
        let Some(vehicle) = connection.query_row(sql, [], read_first).optional()? else { return Ok(None) };
        let mut query = connection
            .prepare(&format!("SELECT id, node, raised_ms, acknowledged, active, urgency FROM alarms ORDER BY id LIMIT {ROWS_MAX}"))?;
        let alarms = query.query_map([], |row| {
            Ok(RestoredAlarm {
                id: row.get::<_, i64>(0)?.unsigned_abs(),
                node: row.get(1)?,
                age: age(wall, row.get(2)?),
                acknowledged: row.get(3)?,
                active: row.get(4)?,
                asked: row.get::<_, Option<String>>(5)?.and_then(|word| urgency(&word)),
            })
        })?;
        let alarms = alarms.collect::<Result<_, _>>()?;
        let nodes = |table| {
            let mut query =
                connection.prepare(&format!("SELECT node FROM {table} ORDER BY node LIMIT {ROWS_MAX}"))?;
            query.query_map([], |row| row.get(0))?.collect::<rusqlite::Result<Vec<Box<str>>>>()
        };
        let (accepted, latched) = (nodes("accepted")?, nodes("latched")?);
        let countermeasures = read_measures(connection, wall)?;
        let last_known = read_last_known(connection)?;
        Ok(Some(Restored { last_known, alarms, accepted, latched, countermeasures, ..vehicle }))
    }
}

/// An unknown word for a stage is a fault of the database; the vehicle is locked then.
fn read_first(row: &Row<'_>) -> rusqlite::Result<Restored> {
    let word: String = row.get(0)?;
    let pose = match (row.get::<_, Option<i64>>(2)?, row.get(3)?, row.get(4)?, row.get(5)?) {
        (Some(number), Some(x_m), Some(y_m), Some(yaw_deg)) => {
            Some((number.unsigned_abs(), MapPose { x_m, y_m, yaw_deg }))
        }
        _ => None,
    };
    Ok(Restored {
        stage: Stage::ALL.into_iter().find(|stage| stage.as_str() == word).unwrap_or(Stage::Locked),
        posed: row.get(1)?,
        pose,
        last_alarm: row.get::<_, i64>(6)?.unsigned_abs(),
        ..Restored::default()
    })
}

/// Where the vehicle was last known to be.
fn read_last_known(connection: &Connection) -> rusqlite::Result<Option<KnownPlace>> {
    let place = |row: &Row<'_>| {
        let pose = MapPose { x_m: row.get(0)?, y_m: row.get(1)?, yaw_deg: row.get(2)? };
        Ok(KnownPlace { pose, driven: row.get(3)? })
    };
    connection.query_row("SELECT x_m, y_m, yaw_deg, driven FROM last_known_place", [], place).optional()
}

fn urgency(word: &str) -> Option<Urgency> {
    Urgency::ALL.into_iter().find(|urgency| urgency.as_str() == word)
}

/// How old something is that began at this wall time.
fn age(wall: SystemTime, began_ms: i64) -> Span {
    let age = wall.duration_since(from_unix_ms(began_ms)).unwrap_or_default();
    Span::from_nanos(u64::try_from(age.as_nanos()).unwrap_or(u64::MAX))
}

fn read_measures(
    connection: &Connection,
    wall: SystemTime,
) -> Result<Vec<RestoredCountermeasure>, StoreError> {
    let mut query = connection
        .prepare(&format!("SELECT number, request, mps2, since_ms, stopped_ms FROM countermeasures ORDER BY number LIMIT {ROWS_MAX}"))?;
    let mut causes = connection.prepare(&format!(
        "SELECT node, acknowledged FROM causes WHERE countermeasure = ?1 ORDER BY position LIMIT {ROWS_MAX}"
    ))?;
    let mut asking = connection.prepare(&format!(
        "SELECT node FROM asking WHERE countermeasure = ?1 ORDER BY node LIMIT {ROWS_MAX}"
    ))?;
    let mut rows = query.query([])?;
    let mut measures = Vec::new();
    while let Some(row) = rows.next()? {
        let word: String = row.get(1)?;
        let kind = RequestKind::ALL.into_iter().find(|kind| kind.as_str() == word);
        let request = match (kind, row.get(2)?) {
            (Some(RequestKind::Notify), _) => Request::Notify,
            (Some(RequestKind::Decelerate), mps2) => Request::decelerate(mps2),
            // A word of another version, or a damaged row, holds the vehicle too.
            _ => Request::ManeuverStop,
        };
        let causes = causes.query_map([row.get::<_, i64>(0)?], |row| Ok((row.get(0)?, row.get(1)?)))?;
        let causes = causes.collect::<Result<_, _>>()?;
        let about = asking.query_map([row.get::<_, i64>(0)?], |row| row.get(0))?.collect::<Result<_, _>>()?;
        let by_operator = row.get::<_, Option<i64>>(4)?.map(|ms| age(wall, ms));
        let age = age(wall, row.get(3)?);
        measures.push(RestoredCountermeasure { request, age, by_operator, causes, about });
    }
    Ok(measures)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::{Action, TELLTALE};
    use crate::{DemoSecrets, Store};
    use telltale_clock::Clock;

    fn vehicle(stage: Stage, acknowledged: bool) -> Restored {
        let alarm = |id, acknowledged| RestoredAlarm {
            id,
            node: "sensors/lidar".into(),
            age: Span::ZERO,
            acknowledged,
            active: true,
            asked: Some(Urgency::ALL[usize::from(acknowledged)]),
        };
        let causes = vec![("sensors/lidar".into(), acknowledged), ("can".into(), false)];
        Restored {
            stage,
            operator: None,
            posed: true,
            pose: Some((3, MapPose { x_m: 1.5, y_m: -2.0, yaw_deg: 90.0 })),
            last_known: Some(KnownPlace {
                pose: MapPose { x_m: 12.0, y_m: 0.5, yaw_deg: -90.0 },
                driven: true,
            }),
            alarms: vec![alarm(3, acknowledged), alarm(7, true)],
            last_alarm: 9,
            accepted: vec!["can".into(), "sensors/imu".into()],
            latched: vec!["execution/brake".into()],
            countermeasures: vec![
                RestoredCountermeasure {
                    request: Request::Decelerate { mps2: 1.25 },
                    age: Span::from_secs(50),
                    by_operator: None,
                    causes,
                    about: vec!["can".into(), "sensors".into()],
                },
                RestoredCountermeasure {
                    request: Request::ManeuverStop,
                    age: Span::from_secs(3),
                    by_operator: Some(Span::from_secs(2)),
                    causes: Vec::new(),
                    about: Vec::new(),
                },
            ],
        }
    }

    #[tokio::test]
    async fn the_vehicle_is_recalled_as_it_was_remembered_last() {
        let clock = Clock::start();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        assert_eq!(store.recall().await.unwrap(), None);
        let bare = Restored { last_alarm: 2, ..Restored::default() };
        let recalled =
            |vehicle: &Restored| VehicleMemory { seq: 0, at: clock.wall(), vehicle: vehicle.clone() };
        for vehicle in [vehicle(Stage::Active, false), vehicle(Stage::Localizing, true), bare] {
            let memory = VehicleMemory { seq: 4, ..recalled(&vehicle) };
            let record = Record::of(Action::Acknowledge, TELLTALE).on("7");
            assert!(store.record(record, Some(memory.clone())).await);
            let old = VehicleMemory { seq: 3, vehicle: Restored::default(), ..memory.clone() };
            for passed_over in [memory, old] {
                assert!(!store.remember(passed_over).await.unwrap(), "nothing is to be written");
            }
            let found = store.recall().await.unwrap().unwrap();
            assert_eq!(found.last_alarm, 9, "numbers are never given twice");
            assert!(found.alarms.iter().all(|alarm| alarm.age < Span::from_secs(60)));
            for (found, kept) in found.countermeasures.iter().zip(&vehicle.countermeasures) {
                let grew = |age: Span, kept: Span| age >= kept && age - kept < Span::from_secs(60);
                assert!(grew(found.age, kept.age), "{found:?}");
                assert_eq!(found.by_operator.is_some(), kept.by_operator.is_some());
                assert!(found.by_operator.zip(kept.by_operator).is_none_or(|(age, kept)| grew(age, kept)));
            }
            let expected = Restored { last_alarm: 9, ..vehicle };
            assert!(recalled(&found).says_the_same(&recalled(&expected)), "{found:?}");
        }
        assert_eq!(store.audit_entries(None, 10).await.unwrap().len(), 3);
    }

    #[tokio::test]
    async fn a_request_in_words_that_nobody_knows_still_holds_the_vehicle() {
        let clock = Clock::start();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        let memory = VehicleMemory { seq: 1, at: clock.wall(), vehicle: vehicle(Stage::Active, false) };
        assert!(store.remember(memory).await.unwrap());
        let decelerate = |mps2: &str| {
            (format!("request = 'decelerate', mps2 = {mps2}"), Request::Decelerate { mps2: 1.0 })
        };
        let mut damaged = vec![("request = 'pull_over'".to_owned(), Request::ManeuverStop)];
        damaged.extend(["NULL", "-3.0", "0.0", "1e-320", "0.01", "9e999", "-9e999", "3.5"].map(decelerate));
        for (damage, request) in damaged {
            let sql = format!("UPDATE countermeasures SET {damage}");
            store.call(move |database| Ok(database.connection.execute(&sql, [])?)).await.unwrap();
            let found = store.recall().await.unwrap().unwrap().countermeasures;
            assert_eq!(found.iter().map(|it| it.request).collect::<Vec<_>>(), [request; 2]);
        }
    }
}
