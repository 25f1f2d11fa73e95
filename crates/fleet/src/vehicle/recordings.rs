//! Sends recordings after all else that waits for the hub: the oldest first, one piece at a time.

use telltale_engine::time::Timestamp;
use tokio::sync::mpsc;

use super::{Heard, Vehicle, Waiting};
use crate::delivery::Answer;
use crate::line::Requests;
use crate::message::NotSent;
use crate::outbox::OutboxError;
use crate::recordings::{Finished, refused};

impl Vehicle {
    /// The recording of this incident is wanted. One that waits already does not wait twice.
    pub(super) fn want(&mut self, incident: u64, wanted: &mpsc::Sender<u64>) {
        if self.outbox.sends(incident).unwrap_or(false) {
            return;
        }
        if !self.wishes.take(self.clock.now()) {
            self.drop_wish();
        } else if !self.settings.sends_recordings {
            self.hurry = true;
            self.push(vec![refused(incident, NotSent::Never)]);
        } else if wanted.try_send(incident).is_err() {
            self.drop_wish();
        }
    }

    pub(super) fn drop_wish(&mut self) {
        self.status.send_if_modified(|status| {
            status.dropped_wishes = status.dropped_wishes.saturating_add(1);
            if status.dropped_wishes == 1 {
                tracing::warn!("the hub of the fleet wishes more than it may, or nothing that is known");
            }
            false
        });
    }

    pub(super) fn take_finished(&mut self, finished: &Finished) {
        let taken = self.outbox.take_recording(finished);
        if matches!(taken, Ok(false)) && !finished.by_itself {
            self.drop_wish();
        }
        self.note_disk(taken.err());
        self.look_for_recordings();
    }

    pub(super) fn look_for_recordings(&mut self) {
        match self.outbox.next_recording() {
            Ok(next) => self.sending = next,
            Err(error) => self.note_disk(Some(error)),
        }
    }

    /// Tells the fleet which recording comes next, or that it does not come.
    pub(super) fn announce_recording(&mut self) {
        let Some(sending) = self.sending.as_ref().filter(|it| !it.is_told) else { return };
        let incident = sending.incident;
        let (content, comes) = match self.settings.sends_recordings {
            true => sending.announced(),
            false => (refused(incident, NotSent::Never), false),
        };
        self.hurry = true;
        self.push(vec![content]);
        let noted = match comes {
            true => self.outbox.recording_sent(incident, 0),
            false => self.outbox.recording_over(incident),
        };
        self.recording_noted(noted);
    }

    /// The request with the next piece, if nothing else waits and the line has room.
    pub(super) fn next_piece(&mut self, requests: Requests, now: Timestamp) -> Option<Waiting> {
        let has_room = self.delivery.piece_at().is_some_and(|then| now >= then);
        let sending = self.sending.as_ref().filter(|it| it.is_told && has_room)?;
        if self.is_worth_sending(now) {
            return None;
        }
        let (incident, number) = (sending.incident, sending.sent);
        let pieces = sending.pieces.clone().filter(|it| number < it.pieces && self.settings.sends_recordings);
        let piece = sending.next_piece().zip(pieces);
        let Some((piece, pieces)) = piece else {
            // It was removed while it was sent.
            self.hurry = true;
            self.push(vec![refused(incident, NotSent::Gone)]);
            let noted = self.outbox.recording_over(incident);
            self.recording_noted(noted);
            return None;
        };
        self.delivery.sends_piece(piece.len(), now);
        Some(Box::pin(async move { Heard::Piece(requests.piece(&pieces.sha256, number, piece).await) }))
    }

    pub(super) fn piece_answered(&mut self, answer: &Answer) {
        let Some(sending) = &self.sending else { return };
        let (incident, sent) = (sending.incident, sending.sent + 1);
        // One with this number is there already if its acknowledgement was lost, or somebody asked twice.
        let noted = match answer {
            Answer::Stored(_) | Answer::WrongLast
                if sending.pieces.as_ref().is_some_and(|it| sent < it.pieces) =>
            {
                self.outbox.recording_sent(incident, sent)
            }
            Answer::Stored(_) | Answer::WrongLast => self.outbox.recording_over(incident),
            _ => {
                self.delivery.piece_refused(self.clock.now());
                return;
            }
        };
        self.recording_noted(noted);
    }

    fn recording_noted(&mut self, noted: Result<(), OutboxError>) {
        if let Err(error) = noted {
            // Nothing is sent again and again while the disk does not answer.
            self.delivery.piece_refused(self.clock.now());
            self.sending = None;
            return self.note_disk(Some(error));
        }
        self.look_for_recordings();
    }
}
