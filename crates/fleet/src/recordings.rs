//! The recordings that a vehicle sends: which wait, and how much of them the hub has. They lie in the outbox's file, so
//! that they go on after the program was ended.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use rusqlite::{OptionalExtension as _, params};
use telltale_engine::time::{Span, Timestamp};

use crate::message::{Content, NotSent, PIECE_BYTES, Pieces, Recording};
use crate::outbox::{Outbox, OutboxError, signed};

/// Recordings that wait to be sent. Others are not taken.
pub const WAITING_MAX: usize = 64;

/// The newest recordings that were sent by themselves, and are remembered for that. Older ones count as sent.
const SENT_KEPT: i64 = 100_000;

/// Numbers that are asked for at once, and then one in each of these spans: each makes the vehicle look for a recording,
/// and say so if there is none.
pub const WISHES_AT_ONCE: u64 = 16;
const WISH_EVERY: Span = Span::from_secs(10);

/// A recording that will not change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    pub incident: u64,
    pub path: PathBuf,
    /// In hexadecimal digits.
    pub sha256: String,
    pub bytes: u64,
    /// Nobody asked for it. Such a one is sent once.
    pub by_itself: bool,
}

/// The recording that is sent now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sending {
    pub incident: u64,
    path: PathBuf,
    /// `None` if it cannot be sent in pieces.
    pub pieces: Option<Pieces>,
    /// So many of them the hub has.
    pub sent: u64,
    /// The fleet knows that it comes.
    pub is_told: bool,
}

impl Sending {
    /// What the fleet is told before the first piece, and whether the recording comes.
    pub fn announced(&self) -> (Content, bool) {
        let here = std::fs::symlink_metadata(&self.path).ok().filter(std::fs::Metadata::is_file);
        let refused = match (&self.pieces, here) {
            (Some(pieces), Some(file)) if file.len() == pieces.bytes => None,
            (Some(_), _) => Some(NotSent::Gone),
            (None, _) => Some(NotSent::TooLarge),
        };
        let pieces = self.pieces.clone().filter(|_| refused.is_none());
        (Content::Recording(Recording { incident: self.incident, pieces, refused }), refused.is_none())
    }

    /// The next piece; `None` if the file is gone.
    pub fn next_piece(&self) -> Option<Vec<u8>> {
        let mut piece = vec![0; self.pieces.as_ref()?.len_of(self.sent)];
        let file = File::open(&self.path).ok()?;
        file.read_exact_at(&mut piece, self.sent * PIECE_BYTES as u64).ok()?;
        Some(piece)
    }
}

/// That a recording is not sent.
pub fn refused(incident: u64, why: NotSent) -> Content {
    Content::Recording(Recording { incident, pieces: None, refused: Some(why) })
}

/// Limits the wishes that a vehicle follows: it looks for few recordings, however many the hub asks for.
#[derive(Debug, Default)]
pub struct Wishes {
    /// All that was followed is paid for by then.
    paid: Timestamp,
}

impl Wishes {
    /// Whether another number is looked for.
    pub fn take(&mut self, now: Timestamp) -> bool {
        let before = Span::from_nanos(WISH_EVERY.as_nanos() * (WISHES_AT_ONCE - 1));
        let is_taken = self.paid <= now + before;
        if is_taken {
            self.paid = self.paid.max(now) + WISH_EVERY;
        }
        is_taken
    }
}

impl Outbox {
    /// Takes a recording that is to be sent. `false`: there is no room for more.
    ///
    /// # Errors
    /// Of the disk.
    pub fn take_recording(&mut self, finished: &Finished) -> Result<bool, OutboxError> {
        let incident = signed(finished.incident);
        if finished.by_itself && self.was_sent(incident)? || self.sends(finished.incident)? {
            return Ok(true);
        }
        let waiting: i64 =
            self.connection().query_row("SELECT count(*) FROM recordings", [], |row| row.get(0))?;
        let Some(path) = finished.path.to_str().filter(|_| waiting < WAITING_MAX as i64) else {
            return Ok(false);
        };
        let sql = "INSERT INTO recordings (incident, path, sha256, bytes) VALUES (?1, ?2, ?3, ?4)";
        self.connection().execute(sql, params![incident, path, finished.sha256, signed(finished.bytes)])?;
        if finished.by_itself {
            self.connection().execute("INSERT OR IGNORE INTO sent_by_itself VALUES (?1)", [incident])?;
            let sql = "DELETE FROM sent_by_itself WHERE incident <= (SELECT max(incident) FROM sent_by_itself) - ?1";
            self.connection().execute(sql, [SENT_KEPT])?;
        }
        Ok(true)
    }

    fn was_sent(&self, incident: i64) -> Result<bool, OutboxError> {
        let sql = "SELECT count(*) > 0 FROM sent_by_itself
                   WHERE incident = ?1 OR ?1 <= (SELECT max(incident) FROM sent_by_itself) - ?2";
        Ok(self.connection().query_row(sql, [incident, SENT_KEPT], |row| row.get(0))?)
    }

    /// Whether the recording of this incident waits or is sent.
    ///
    /// # Errors
    /// Of the disk.
    pub fn sends(&self, incident: u64) -> Result<bool, OutboxError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM recordings WHERE incident = ?1)";
        Ok(self.connection().query_row(sql, [signed(incident)], |row| row.get(0))?)
    }

    /// The oldest recording that is not sent.
    ///
    /// # Errors
    /// Of the disk.
    pub fn next_recording(&self) -> Result<Option<Sending>, OutboxError> {
        let sql =
            "SELECT incident, path, sha256, bytes, sent, is_told FROM recordings ORDER BY incident LIMIT 1";
        let sending = self.connection().query_row(sql, [], |row| {
            let number = |index| row.get::<_, i64>(index).map(i64::unsigned_abs);
            Ok(Sending {
                incident: number(0)?,
                path: Path::new(&row.get::<_, String>(1)?).to_owned(),
                pieces: Pieces::of(&row.get::<_, String>(2)?, number(3)?),
                sent: number(4)?,
                is_told: row.get(5)?,
            })
        });
        Ok(sending.optional()?)
    }

    /// The fleet was told of this recording, and the hub has so many of its pieces.
    ///
    /// # Errors
    /// Of the disk.
    pub fn recording_sent(&mut self, incident: u64, pieces: u64) -> Result<(), OutboxError> {
        let sql = "UPDATE recordings SET sent = ?2, is_told = 1 WHERE incident = ?1";
        self.connection().execute(sql, [signed(incident), signed(pieces)])?;
        Ok(())
    }

    /// The hub has all of it, or it does not come.
    ///
    /// # Errors
    /// Of the disk.
    pub fn recording_over(&mut self, incident: u64) -> Result<(), OutboxError> {
        self.connection().execute("DELETE FROM recordings WHERE incident = ?1", [signed(incident)])?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbox::{Limits, Seed};

    #[test]
    fn few_wishes_are_followed_at_once() {
        let mut wishes = Wishes::default();
        let taken = |wishes: &mut Wishes, now| (0..100).filter(|_| wishes.take(now)).count();
        let start = Timestamp::from_millis(5_000);
        assert_eq!(taken(&mut wishes, start), 16);
        assert_eq!(taken(&mut wishes, start + Span::from_secs(30)), 3);
        assert_eq!(taken(&mut wishes, start + Span::from_secs(3600)), 16);
    }

    #[test]
    fn recordings_wait_in_their_order_and_go_on_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let open = || {
            let seed = Seed { first: 1, nonce: 2 };
            Outbox::open(folder.path(), Limits::default(), seed, Timestamp::ZERO).unwrap()
        };
        let path = folder.path().join("incident-7.mcap");
        std::fs::write(&path, vec![7; PIECE_BYTES + 3]).unwrap();
        let finished = |incident, by_itself| Finished {
            incident,
            path: path.clone(),
            sha256: "ab".repeat(32),
            bytes: PIECE_BYTES as u64 + 3,
            by_itself,
        };
        let mut outbox = open();
        for incident in [8, 7, 7] {
            assert!(outbox.take_recording(&finished(incident, false)).unwrap());
        }
        let first = outbox.next_recording().unwrap().unwrap();
        assert_eq!((first.incident, first.sent, first.is_told, first.announced().1), (7, 0, false, true));
        outbox.recording_sent(7, 1).unwrap();
        drop(outbox);
        let mut outbox = open();
        let first = outbox.next_recording().unwrap().unwrap();
        assert_eq!((first.incident, first.sent, first.is_told), (7, 1, true));
        assert_eq!(first.next_piece(), Some(vec![7; 3]));
        outbox.recording_over(7).unwrap();
        std::fs::remove_file(&path).unwrap();
        let next = outbox.next_recording().unwrap().unwrap();
        assert_eq!((next.incident, next.announced()), (8, (refused(8, NotSent::Gone), false)));
        assert_eq!(next.next_piece(), None);
        outbox.recording_over(8).unwrap();
        // By themselves they go once, and again if somebody asks.
        for (incident, by_itself, waits) in [(9, true, true), (9, true, false), (9, false, true)] {
            assert!(outbox.take_recording(&finished(incident, by_itself)).unwrap());
            assert_eq!(outbox.sends(9).unwrap(), waits);
            outbox.recording_over(9).unwrap();
        }
        // One that was finished, or found room, after a later one.
        for incident in [30, 20] {
            assert!(
                outbox.take_recording(&finished(incident, true)).unwrap() && outbox.sends(incident).unwrap()
            );
            outbox.recording_over(incident).unwrap();
        }
        let taken = (100..200).filter(|&it| outbox.take_recording(&finished(it, false)).unwrap()).count();
        assert_eq!(taken, WAITING_MAX);
    }
}
