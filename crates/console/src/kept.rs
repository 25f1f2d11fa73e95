//! What the console keeps over a restart: the vehicles with their last heads, their incidents, the heads of their audit
//! logs, and how far the log is known.

use std::path::Path;

use rusqlite::{Connection, OpenFlags, params};
use serde::de::DeserializeOwned;
use telltale_clock::{Clock, unix_ms};
use telltale_engine::time::{Since, Span};
use telltale_fleet::message::{Incident, VehicleId};
use telltale_store::Head;
use telltale_yaml::private_file::{make_folder, make_private_file};

use crate::state::incidents::INCIDENTS_MAX;
use crate::state::recordings::Transfer;
use crate::state::vehicle::Vehicle;
use crate::state::{Fleet, Unwritten};

/// In the data folder of the console.
pub const FILE_NAME: &str = "console.db";

const SCHEMA: &str = "
    CREATE TABLE IF NOT EXISTS vehicles (id TEXT PRIMARY KEY, kept TEXT NOT NULL) STRICT, WITHOUT ROWID;
    CREATE TABLE IF NOT EXISTS incidents (
        vehicle TEXT NOT NULL,
        number INTEGER NOT NULL,
        incident TEXT NOT NULL,
        PRIMARY KEY (vehicle, number)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE IF NOT EXISTS recordings (
        vehicle TEXT NOT NULL,
        number INTEGER NOT NULL,
        transfer TEXT NOT NULL,
        PRIMARY KEY (vehicle, number)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE IF NOT EXISTS audit_heads (
        told INTEGER PRIMARY KEY,
        vehicle TEXT NOT NULL,
        record INTEGER NOT NULL,
        head TEXT NOT NULL,
        stored_ms INTEGER NOT NULL,
        UNIQUE (vehicle, record, head)
    ) STRICT;
    CREATE INDEX IF NOT EXISTS audit_heads_of ON audit_heads (vehicle, told);
    CREATE TABLE IF NOT EXISTS reading (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        log_ms INTEGER NOT NULL,
        last_up_ms INTEGER NOT NULL
    ) STRICT;
";

/// Heads of the audit log of one vehicle. Of those before the newer half one in 64 stays, so that many new ones do not push out
/// all old ones; beyond the bound the oldest go.
pub const AUDIT_HEADS_MAX: usize = 20_000;

/// A head of a vehicle's audit log, as the vehicle told it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ToldHead {
    pub head: Head,
    /// When the hub took it first, in milliseconds since 1970.
    pub stored_ms: i64,
}

/// Why it cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeptError {
    #[error("{}: {reason}", .path.display())]
    File { path: std::path::PathBuf, reason: std::io::Error },
    #[error("what the console keeps: {0}")]
    Disk(#[from] rusqlite::Error),
    #[error("no console has kept anything in {}", .0.display())]
    NoConsole(std::path::PathBuf),
}

#[derive(Debug)]
pub struct Store {
    connection: Connection,
    clock: Clock,
}

/// The changes for the disk.
#[derive(Debug, Default)]
pub struct Changes {
    vehicles: Vec<(String, String)>,
    incidents: Vec<(String, i64, String)>,
    recordings: Vec<(String, i64, String)>,
    log_ms: i64,
    last_up_ms: i64,
    /// What it is of.
    pub unwritten: Unwritten,
}

impl Changes {
    /// What changed in the fleet since the last call.
    pub fn of(fleet: &mut Fleet, clock: &Clock) -> Changes {
        let (now, wall_ms) = (clock.now(), unix_ms(clock.wall()));
        let unwritten = fleet.take_unwritten();
        let kept = |id: &VehicleId| {
            let kept = fleet.vehicle(id)?.kept(wall_ms, now)?;
            Some((id.to_string(), serde_json::to_string(&kept).ok()?))
        };
        let incident = |(id, number): &(VehicleId, u64)| {
            let incident = fleet.vehicle(id)?.incidents.get(number)?;
            Some((id.to_string(), i64::try_from(*number).ok()?, serde_json::to_string(incident).ok()?))
        };
        let recording = |(id, number): &(VehicleId, u64)| {
            let transfer = fleet.vehicle(id)?.recordings.get(number)?;
            Some((id.to_string(), i64::try_from(*number).ok()?, serde_json::to_string(transfer).ok()?))
        };
        let line = fleet.line();
        let up_age = if line.up_since.is_some() { Span::ZERO } else { line.last_up.age(now) };
        Changes {
            vehicles: unwritten.vehicles.iter().filter_map(kept).collect(),
            incidents: unwritten.incidents.iter().filter_map(incident).collect(),
            recordings: unwritten.recordings.iter().filter_map(recording).collect(),
            log_ms: fleet.log_ms,
            last_up_ms: wall_ms.saturating_sub(i64::try_from(up_age.as_millis()).unwrap_or(i64::MAX)),
            unwritten,
        }
    }
}

impl Store {
    /// Opens or makes it in a data folder.
    ///
    /// # Errors
    /// Of the disk.
    pub fn open(folder: &Path, clock: Clock) -> Result<Store, KeptError> {
        let path = folder.join(FILE_NAME);
        make_folder(folder)
            .and_then(|()| make_private_file(&path))
            .map_err(|reason| KeptError::File { path: path.clone(), reason })?;
        let connection = Connection::open(&path)?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "journal_size_limit", 4 << 20)?;
        connection.execute_batch(SCHEMA)?;
        Ok(Store { connection, clock })
    }

    /// The fleet as it was kept. A row that cannot be read is left out; the hub tells it again.
    ///
    /// # Errors
    /// Of the disk.
    pub fn fleet(&self) -> Result<Fleet, KeptError> {
        let (now, wall_ms) = (self.clock.now(), unix_ms(self.clock.wall()));
        let mut vehicles = Vec::new();
        for (id, kept) in self.rows("SELECT id, kept FROM vehicles ORDER BY id")? {
            let mut vehicle = Vehicle::of_kept(id.clone(), kept, wall_ms, now);
            let sql = "SELECT vehicle, incident FROM incidents WHERE vehicle = ?1 ORDER BY number";
            for (_, incident) in self.rows_of::<Incident>(sql, &[id.as_str()])? {
                vehicle.take_incident(&incident);
            }
            let sql =
                "SELECT vehicle, '[' || number || ',' || transfer || ']' FROM recordings WHERE vehicle = ?1";
            let recordings = self.rows_of::<(u64, Transfer)>(sql, &[id.as_str()])?;
            vehicle.recordings = recordings.into_iter().map(|(_, numbered)| numbered).collect();
            vehicle.recordings.retain(|number, _| vehicle.incidents.contains_key(number));
            vehicles.push(vehicle);
        }
        let reading = self
            .connection
            .query_row("SELECT log_ms, last_up_ms FROM reading", [], |row| Ok((row.get(0)?, row.get(1)?)));
        let (log_ms, last_up_ms): (i64, i64) = match reading {
            Ok(reading) => reading,
            Err(rusqlite::Error::QueryReturnedNoRows) => (0, wall_ms),
            Err(error) => return Err(error.into()),
        };
        let up_age = Span::from_millis(u64::try_from(wall_ms.saturating_sub(last_up_ms)).unwrap_or(0));
        Ok(Fleet::new(vehicles, log_ms, Since::of_age(up_age, now)))
    }

    /// The heads of a vehicle's audit log in the order in which they were told, from the data folder of a console that may run.
    ///
    /// # Errors
    /// There is no such folder, or its disk does not answer.
    pub fn audit_heads(folder: &Path, id: &VehicleId) -> Result<Vec<ToldHead>, KeptError> {
        let path = folder.join(FILE_NAME);
        if !path.exists() {
            return Err(KeptError::NoConsole(folder.to_owned()));
        }
        let connection = Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let sql = "SELECT head, stored_ms FROM audit_heads WHERE vehicle = ?1 ORDER BY told";
        let mut query = connection.prepare(sql)?;
        let rows = query.query_map([id.as_str()], |row| Ok((row.get::<_, String>(0)?, row.get(1)?)))?;
        let rows: Vec<(String, i64)> = rows.collect::<Result<_, _>>()?;
        let told = |(head, stored_ms): (String, i64)| Some(ToldHead { head: Head::parse(&head)?, stored_ms });
        Ok(rows.into_iter().filter_map(told).collect())
    }

    fn rows<T: DeserializeOwned>(&self, sql: &str) -> Result<Vec<(VehicleId, T)>, KeptError> {
        self.rows_of(sql, &[])
    }

    fn rows_of<T: DeserializeOwned>(&self, sql: &str, of: &[&str]) -> Result<Vec<(VehicleId, T)>, KeptError> {
        let mut query = self.connection.prepare_cached(sql)?;
        let rows = query.query_map(rusqlite::params_from_iter(of), |row| {
            Ok((row.get::<_, String>(0)?, row.get::<_, String>(1)?))
        })?;
        let rows: Vec<(String, String)> = rows.collect::<Result<_, _>>()?;
        let read =
            |(id, text): (String, String)| Some((VehicleId::new(&id)?, serde_json::from_str(&text).ok()?));
        Ok(rows.into_iter().filter_map(read).collect())
    }

    /// Writes changes, all or none.
    ///
    /// # Errors
    /// Of the disk.
    pub fn write(&mut self, changes: &Changes) -> Result<(), KeptError> {
        let transaction = self.connection.transaction()?;
        for (id, kept) in &changes.vehicles {
            let sql = "INSERT INTO vehicles VALUES (?1, ?2) ON CONFLICT (id) DO UPDATE SET kept = ?2";
            transaction.prepare_cached(sql)?.execute(params![id, kept])?;
        }
        for (id, number, incident) in &changes.incidents {
            let sql = "INSERT INTO incidents VALUES (?1, ?2, ?3)
                       ON CONFLICT (vehicle, number) DO UPDATE SET incident = ?3";
            transaction.prepare_cached(sql)?.execute(params![id, number, incident])?;
            // Those that memory forgot.
            let sql = "DELETE FROM incidents WHERE vehicle = ?1 AND number NOT IN (
                           SELECT number FROM incidents WHERE vehicle = ?1 ORDER BY number DESC LIMIT ?2)
                       AND number NOT IN (SELECT number FROM recordings
                           WHERE vehicle = ?1 AND json_extract(transfer, '$.step.here') IS NOT NULL)";
            transaction.prepare_cached(sql)?.execute(params![id, INCIDENTS_MAX as i64])?;
        }
        for (id, number, transfer) in &changes.recordings {
            let sql = "INSERT INTO recordings VALUES (?1, ?2, ?3)
                       ON CONFLICT (vehicle, number) DO UPDATE SET transfer = ?3";
            transaction.prepare_cached(sql)?.execute(params![id, number, transfer])?;
            let sql = "DELETE FROM recordings WHERE vehicle = ?1 AND number NOT IN (
                           SELECT number FROM incidents WHERE vehicle = ?1)";
            transaction.prepare_cached(sql)?.execute(params![id])?;
        }
        for (id, heads) in &changes.unwritten.heads {
            for (head, stored_ms) in heads {
                let record = i64::try_from(head.number).unwrap_or(i64::MAX);
                // An older head that the hub took earlier is read again, after it was thinned out.
                let sql = "INSERT OR IGNORE INTO audit_heads (vehicle, record, head, stored_ms)
                           SELECT ?1, ?2, ?3, ?4 WHERE NOT EXISTS (
                               SELECT 1 FROM audit_heads WHERE vehicle = ?1 AND record > ?2 AND stored_ms > ?4)";
                let values = params![id.as_str(), record, head.to_string(), stored_ms];
                transaction.prepare_cached(sql)?.execute(values)?;
            }
            let beyond = |newest: usize, which: &str| -> Result<(), KeptError> {
                let sql = format!(
                    "DELETE FROM audit_heads WHERE vehicle = ?1 {which} AND told <= (
                         SELECT told FROM audit_heads WHERE vehicle = ?1 ORDER BY told DESC LIMIT 1 OFFSET ?2)"
                );
                transaction.prepare_cached(&sql)?.execute(params![id.as_str(), newest as i64])?;
                Ok(())
            };
            beyond(AUDIT_HEADS_MAX / 2, "AND told % 64 <> 0")?;
            beyond(AUDIT_HEADS_MAX, "")?;
        }
        let sql = "INSERT INTO reading VALUES (1, ?1, ?2)
                   ON CONFLICT (one) DO UPDATE SET log_ms = ?1, last_up_ms = ?2";
        transaction.execute(sql, params![changes.log_ms, changes.last_up_ms])?;
        Ok(transaction.commit()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::Arrived;
    use crate::state::contact::Contact;
    use crate::state::incidents::INCIDENTS_MAX;
    use std::os::unix::fs::PermissionsExt as _;
    use telltale_engine::model::Stage;
    use telltale_engine::state::State;
    use telltale_fleet::message::{Batch, Content, Epoch, Head, Message};
    use telltale_fleet::reading::Stream;

    #[test]
    fn vehicles_and_incidents_are_there_after_a_restart_with_their_age() {
        let folder = tempfile::tempdir().unwrap();
        let (clock, hand) = Clock::standing();
        let mut store = Store::open(folder.path(), clock).unwrap();
        let mut fleet = store.fleet().unwrap();
        fleet.line_opened(clock.now());
        let id = VehicleId::new("a").unwrap();
        let head = Head {
            name: "Eins".into(),
            state: State::Error,
            cause: None,
            since: 1_780_000_000_000,
            stage: Stage::Active,
            drives: true,
            speed_kmh: Some(9),
            unacknowledged: 1,
            version: "0.1.0".into(),
            config: String::new(),
            last: 1,
            ending: false,
        };
        let message = |n, content| {
            let epoch = Epoch { start: 1, nonce: 0 };
            Message { epoch, n, at: 1_780_000_000_000, content }
        };
        let incident = |number| {
            Content::Incident(Incident {
                number,
                since: 1_780_000_000_000,
                until: None,
                stage: "active".into(),
                causes: vec!["lidar".into()],
                triggers: 1,
                version: "0.1.0".into(),
                config: String::new(),
                bytes: 0,
                sha256: None,
            })
        };
        let incidents = (1..=INCIDENTS_MAX as u64 + 5).map(|number| message(number, incident(number)));
        for (stream, messages) in
            [(Stream::Head, vec![message(1, Content::Head(head))]), (Stream::Log, incidents.collect())]
        {
            let batch = Batch { id: id.clone(), key: "UA".into(), sent: 1_780_000_000_000, messages };
            let (stored_ms, age) = (1_780_000_000_007, Span::ZERO);
            fleet.take(Arrived { stream, id: id.clone(), batch: Ok(batch), stored_ms, age }, clock.now());
        }
        store.write(&Changes::of(&mut fleet, &clock)).unwrap();
        assert!(Changes::of(&mut fleet, &clock).vehicles.is_empty(), "each change is written once");
        drop(store);
        let mode = folder.path().join(FILE_NAME).metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        hand.advance(Span::from_secs(3600));
        let again = Store::open(folder.path(), clock).unwrap().fleet().unwrap();
        let rows = again.rows(clock.now());
        assert_eq!((rows.len(), rows[0].name.as_str(), rows[0].state), (1, "Eins", State::Error));
        assert_eq!((rows[0].contact, again.log_ms), (Contact::HubDown, 1_780_000_000_007));
        assert!(rows[0].age_s.is_some_and(|age| (3599.0..3601.0).contains(&age)), "{:?}", rows[0].age_s);
        let numbers: Vec<u64> = again.incidents().iter().map(|it| it.number).collect();
        assert_eq!((numbers.len(), numbers[0]), (INCIDENTS_MAX, 6));
    }

    #[test]
    fn many_heads_of_one_vehicle_push_out_no_others_and_not_all_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let (clock, _hand) = Clock::standing();
        let mut store = Store::open(folder.path(), clock).unwrap();
        let mut fleet = store.fleet().unwrap();
        let [a, b] = ["a", "b"].map(|id| VehicleId::new(id).unwrap());
        let head = |number: usize| telltale_store::Head::parse(&format!("{number}:{number:064x}")).unwrap();
        let mut tell = |of: &VehicleId, heads: Vec<(telltale_store::Head, i64)>| {
            let mut changes = Changes::of(&mut fleet, &clock);
            changes.unwritten.heads.insert(of.clone(), heads);
            store.write(&changes).unwrap();
        };
        tell(&b, vec![(head(7), 0)]);
        // The last ones are read again.
        for heads in [0..10, 10..15_000, 40..60] {
            tell(&a, heads.map(|number| (head(number + 1), number as i64)).collect());
        }
        let kept = |id| Store::audit_heads(folder.path(), id).unwrap();
        assert_eq!(kept(&b).len(), 1);
        let numbers: Vec<u64> = kept(&a).iter().map(|told| told.head.number).collect();
        let old = numbers.iter().filter(|&&number| number <= 5_000).count();
        assert_eq!((numbers.len() - old, numbers.last()), (10_000, Some(&15_000)));
        assert!((77..=79).contains(&old), "{old}");
        tell(&a, vec![(head(50), 20_000)]);
        assert_eq!(kept(&a).last().map(|told| told.head.number), Some(50), "an older copy tells it anew");
    }
}
