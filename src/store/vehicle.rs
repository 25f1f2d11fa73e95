//! What of the vehicle outlives a restart: the stage it was in, and its alarms with their numbers.

use rusqlite::{OptionalExtension, params};

use super::audit::Record;
use super::users::{from_unix_ms, to_unix_ms};
use super::{Store, StoreError};
use std::time::SystemTime;

/// More alarms than an engine keeps; the rest of a longer list is not remembered.
const ALARMS_MAX: usize = 4096;

/// The vehicle as it was last. Who sits in the operator's seat is with the sessions, see
/// [`Store::seated_operator`]; that it was cleared is never remembered.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct VehicleMemory {
    /// Counts the states of this process: an older one than that remembered last is not written.
    pub seq: u64,
    /// The stage's name.
    pub stage: String,
    /// The number of the alarm that was raised last, as far as is known; it never becomes smaller.
    pub last_alarm: u64,
    pub alarms: Vec<AlarmMemory>,
}

impl VehicleMemory {
    /// Whether nothing that matters has changed between the two.
    pub fn says_the_same(&self, later: &VehicleMemory) -> bool {
        self.stage == later.stage && self.alarms == later.alarms
    }
}

/// One alarm that is active or not acknowledged yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlarmMemory {
    pub id: u64,
    /// The node's full name.
    pub node: String,
    /// On the wall clock: the monotonic one starts anew.
    pub raised: SystemTime,
    pub acknowledged: bool,
    pub active: bool,
}

impl Store {
    /// Remembers the vehicle, and writes what led there into the audit log, both or neither. When
    /// this returns, it is on the disk; only then may an action be acknowledged.
    ///
    /// # Errors
    /// If the database fails: the action must not be acknowledged then.
    pub async fn remember(&self, memory: VehicleMemory, records: Vec<Record>) -> Result<(), StoreError> {
        self.call(move |database| {
            let is_new = memory.seq >= database.remembered_seq;
            let seq = memory.seq;
            database.change(&records, |transaction| {
                if !is_new {
                    return Ok(());
                }
                transaction.execute(
                    "INSERT INTO vehicle (one, stage, last_alarm) VALUES (1, ?1, ?2)
                     ON CONFLICT (one) DO UPDATE SET stage = excluded.stage,
                         last_alarm = max(last_alarm, excluded.last_alarm)",
                    params![memory.stage, memory.last_alarm as i64],
                )?;
                transaction.execute("DELETE FROM alarms", [])?;
                let mut insert = transaction.prepare_cached(
                    "INSERT INTO alarms (id, node, raised_ms, acknowledged, active) VALUES (?1, ?2, ?3, ?4, ?5)",
                )?;
                for alarm in memory.alarms.iter().take(ALARMS_MAX) {
                    let raised_ms = to_unix_ms(alarm.raised);
                    let AlarmMemory { id, node, acknowledged, active, .. } = alarm;
                    insert.execute(params![*id as i64, node, raised_ms, acknowledged, active])?;
                }
                Ok(())
            })?;
            database.remembered_seq = database.remembered_seq.max(seq);
            Ok(())
        })
        .await
    }

    /// The vehicle as it was remembered last; `None` at the first start.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn recall(&self) -> Result<Option<VehicleMemory>, StoreError> {
        self.call(|database| {
            let connection = &database.connection;
            let vehicle: Option<(String, i64)> = connection
                .query_row("SELECT stage, last_alarm FROM vehicle", [], |row| Ok((row.get(0)?, row.get(1)?)))
                .optional()?;
            let Some((stage, last_alarm)) = vehicle else { return Ok(None) };
            let mut query = connection
                .prepare_cached("SELECT id, node, raised_ms, acknowledged, active FROM alarms ORDER BY id")?;
            let alarms = query.query_map([], |row| {
                Ok(AlarmMemory {
                    id: row.get::<_, i64>(0)?.unsigned_abs(),
                    node: row.get(1)?,
                    raised: from_unix_ms(row.get(2)?),
                    acknowledged: row.get(3)?,
                    active: row.get(4)?,
                })
            })?;
            let alarms = alarms.collect::<Result<_, _>>()?;
            Ok(Some(VehicleMemory { seq: 0, stage, last_alarm: last_alarm.unsigned_abs(), alarms }))
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, UNIX_EPOCH};

    use super::*;
    use crate::clock::Clock;
    use crate::store::audit::{Action, TELLTALE};
    use crate::store::{DemoSecrets, Store};

    #[tokio::test]
    async fn the_vehicle_is_recalled_as_it_was_remembered_last() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        assert_eq!(store.recall().await.unwrap(), None);
        let alarm = |id, acknowledged| AlarmMemory {
            id,
            node: "sensors/lidar".to_owned(),
            raised: UNIX_EPOCH + Duration::from_millis(1_795_000_000_123),
            acknowledged,
            active: !acknowledged,
        };
        for alarms in [vec![alarm(3, false), alarm(7, true)], vec![alarm(7, true)], Vec::new()] {
            let last_alarm = alarms.len() as u64 + 5;
            let mut memory = VehicleMemory { seq: 4, stage: "active".to_owned(), last_alarm, alarms };
            let record = Record::of(Action::Acknowledge, TELLTALE).on("7");
            store.remember(memory.clone(), vec![record]).await.unwrap();
            let old = VehicleMemory { seq: 3, stage: "locked".to_owned(), ..memory.clone() };
            store.remember(old, Vec::new()).await.unwrap();
            (memory.seq, memory.last_alarm) = (0, 7);
            assert_eq!(store.recall().await.unwrap(), Some(memory));
        }
        assert_eq!(store.audit_entries(None, 10).await.unwrap().len(), 3);
    }
}
