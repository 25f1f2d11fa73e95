//! How messages are delivered exactly once as far as a console sees: what to do next, from what the hub answered. No
//! input or output, and the time comes from outside.
//!
//! One batch is on its way at a time, and it names the number of the message before it on its subject. The hub refuses it
//! when that is not the last. Then the vehicle reads its own last message there: its own means that an
//! acknowledgement was lost, an older one that the hub was rolled back, and one of an epoch that is not its own that
//! two vehicles have one identity.

use telltale_engine::time::{Span, Timestamp};

use crate::message::{BATCH_BYTES_MAX, Mark};

/// The first and the longest wait after the hub refused a batch.
const WAIT_MIN: Span = Span::from_secs(1);
const WAIT_MAX: Span = Span::from_secs(60);

/// A batch takes the line for about this long, so that alarms do not wait for much else.
const BATCH_FOR: Span = Span::from_secs(4);

/// A slow line has batches of this size all the same.
const BATCH_BYTES_MIN: usize = 4096;

/// A piece of a recording that the hub did not take is sent again after this time.
const PIECE_AGAIN: Span = Span::from_secs(30);

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Nothing, before something is heard.
    Rest,
    /// Nothing, before this time.
    Until(Timestamp),
    /// Read the own last message.
    Ask,
    /// Send the next batch after the message with this number.
    Send { after: u64 },
}

/// The own last message as the hub has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Last {
    /// Its number in the hub's stream.
    pub sequence: u64,
    /// What it says; `None` if that cannot be read.
    pub said: Option<Said>,
}

/// What the own last message says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Said {
    pub key: String,
    pub end: Mark,
    /// The outbox made it.
    pub known: bool,
}

/// What the hub answered to a batch, or to a question for the last message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// It is the message with this number.
    Stored(u64),
    /// Another message is the last on its subject.
    WrongLast,
    /// The hub does not take it now.
    Refused,
    /// No answer came in time. Perhaps the batch arrived.
    Silence,
    /// There is no message of this vehicle.
    Nothing,
    Last(Last),
}

/// What the answer means for the outbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learned {
    Nothing,
    /// The hub has everything up to here, and nothing after it.
    HubHas(Option<Mark>),
    /// Another vehicle sends by this identity: nothing is sent any more.
    TwoVehicles,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Away,
    /// Connected; the number of the last message is not known.
    Unsure,
    Asking,
    Ready {
        after: u64,
    },
    Sending {
        end: Mark,
    },
    /// Two vehicles have one identity.
    Stopped,
}

#[derive(Debug)]
pub struct Delivery {
    key: String,
    kbit_s_max: u32,
    state: State,
    wait: Span,
    /// Nothing is sent before this.
    not_before: Timestamp,
    /// No piece of a recording is sent before this: all else has the line first.
    pieces_from: Timestamp,
}

impl Delivery {
    /// For a vehicle with this public key, whose line may carry so much.
    pub fn new(key: &str, kbit_s_max: u32) -> Delivery {
        let kbit_s_max = kbit_s_max.max(1);
        Delivery {
            key: key.to_owned(),
            kbit_s_max,
            state: State::Away,
            wait: WAIT_MIN,
            not_before: Timestamp::ZERO,
            pieces_from: Timestamp::ZERO,
        }
    }

    /// The most that a batch should have.
    pub fn batch_bytes(&self) -> usize {
        let bytes = u64::from(self.kbit_s_max) * BATCH_FOR.as_millis() / 8;
        usize::try_from(bytes).unwrap_or(usize::MAX).clamp(BATCH_BYTES_MIN, BATCH_BYTES_MAX)
    }

    pub fn is_stopped(&self) -> bool {
        self.state == State::Stopped
    }

    pub fn connected(&mut self) {
        if !self.is_stopped() {
            self.state = State::Unsure;
            self.wait = WAIT_MIN;
        }
    }

    pub fn disconnected(&mut self) {
        if !self.is_stopped() {
            self.state = State::Away;
        }
    }

    pub fn order(&self, has_unsent: bool, now: Timestamp) -> Order {
        match self.state {
            State::Away | State::Asking | State::Sending { .. } | State::Stopped => Order::Rest,
            State::Ready { .. } if !has_unsent => Order::Rest,
            State::Unsure | State::Ready { .. } if now < self.not_before => Order::Until(self.not_before),
            State::Unsure => Order::Ask,
            State::Ready { after } => Order::Send { after },
        }
    }

    pub fn asks(&mut self) {
        self.state = State::Asking;
    }

    /// A batch up to `end` is on its way.
    pub fn sends(&mut self, end: Mark, bytes: usize, now: Timestamp) {
        self.state = State::Sending { end };
        self.used(bytes, now);
    }

    /// So much went over the line.
    pub fn used(&mut self, bytes: usize, now: Timestamp) {
        self.not_before = self.not_before.max(now) + self.lasts(bytes);
        self.sends_piece(bytes, now);
    }

    /// A piece of a recording is on its way. It holds up other pieces, and no batch.
    pub fn sends_piece(&mut self, bytes: usize, now: Timestamp) {
        self.pieces_from = self.pieces_from.max(now) + self.lasts(bytes);
    }

    /// When the next piece of a recording may be sent; `None` while nothing may.
    pub fn piece_at(&self) -> Option<Timestamp> {
        matches!(self.state, State::Ready { .. }).then_some(self.pieces_from)
    }

    /// The hub did not take a piece: it is full, or silent.
    pub fn piece_refused(&mut self, now: Timestamp) {
        self.pieces_from = self.pieces_from.max(now + PIECE_AGAIN);
    }

    fn lasts(&self, bytes: usize) -> Span {
        Span::from_nanos(bytes as u64 * 8 * 1_000_000 / u64::from(self.kbit_s_max))
    }

    /// Takes the answer to what was ordered last.
    pub fn answered(&mut self, answer: &Answer, now: Timestamp) -> Learned {
        match (self.state, answer) {
            (State::Sending { end }, Answer::Stored(sequence)) => {
                self.wait = WAIT_MIN;
                self.state = State::Ready { after: *sequence };
                Learned::HubHas(Some(end))
            }
            (State::Sending { .. }, Answer::WrongLast | Answer::Silence) => {
                self.state = State::Unsure;
                Learned::Nothing
            }
            (State::Asking, Answer::Nothing) => {
                self.state = State::Ready { after: 0 };
                Learned::HubHas(None)
            }
            (State::Asking, Answer::Last(last)) => self.judge(last),
            (State::Sending { .. } | State::Asking, _) => {
                self.state = State::Unsure;
                self.not_before = self.not_before.max(now + self.wait);
                self.wait = Span::from_nanos(self.wait.as_nanos() * 2).min(WAIT_MAX);
                Learned::Nothing
            }
            (State::Away | State::Unsure | State::Ready { .. } | State::Stopped, _) => Learned::Nothing,
        }
    }

    fn judge(&mut self, last: &Last) -> Learned {
        self.state = State::Ready { after: last.sequence };
        match &last.said {
            Some(said) if said.known => Learned::HubHas(Some(said.end)),
            Some(said) if said.key == self.key => {
                self.state = State::Stopped;
                Learned::TwoVehicles
            }
            // An earlier key of this identity, which the hub admits no more; or what a later version wrote.
            Some(_) | None => Learned::HubHas(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Epoch;

    const END: Mark = Mark { epoch: Epoch { start: 1, nonce: 7 }, n: 5 };

    fn sending(now: Timestamp) -> Delivery {
        let mut delivery = Delivery::new("UA", 512);
        delivery.connected();
        assert_eq!(delivery.order(true, now), Order::Ask);
        delivery.asks();
        assert_eq!(delivery.order(true, now), Order::Rest, "one question at a time");
        assert_eq!(delivery.answered(&Answer::Nothing, now), Learned::HubHas(None));
        assert_eq!(delivery.order(true, now), Order::Send { after: 0 });
        delivery.sends(END, 0, now);
        assert_eq!(delivery.order(true, now), Order::Rest, "one batch at a time");
        delivery
    }

    fn last(key: &str, known: bool) -> Answer {
        Answer::Last(Last { sequence: 9, said: Some(Said { key: key.into(), end: END, known }) })
    }

    #[test]
    fn what_is_stored_is_followed_by_the_next() {
        let mut delivery = sending(Timestamp::ZERO);
        assert_eq!(delivery.answered(&Answer::Stored(3), Timestamp::ZERO), Learned::HubHas(Some(END)));
        assert_eq!(delivery.order(false, Timestamp::ZERO), Order::Rest);
        assert_eq!(delivery.order(true, Timestamp::ZERO), Order::Send { after: 3 });
    }

    #[test]
    fn after_a_wrong_last_message_the_own_last_decides() {
        for (answer, learned) in [
            (last("UA", true), Learned::HubHas(Some(END))),
            (last("UA", false), Learned::TwoVehicles),
            (last("UB", false), Learned::HubHas(None)),
            (last("UB", true), Learned::HubHas(Some(END))),
            (Answer::Last(Last { sequence: 9, said: None }), Learned::HubHas(None)),
        ] {
            for first in [Answer::WrongLast, Answer::Silence] {
                let mut delivery = sending(Timestamp::ZERO);
                assert_eq!(delivery.answered(&first, Timestamp::ZERO), Learned::Nothing);
                assert_eq!(delivery.order(true, Timestamp::ZERO), Order::Ask);
                delivery.asks();
                assert_eq!(delivery.answered(&answer, Timestamp::ZERO), learned, "{answer:?}");
            }
        }
    }

    #[test]
    fn two_vehicles_with_one_identity_stop_for_good() {
        let mut delivery = sending(Timestamp::ZERO);
        delivery.answered(&Answer::WrongLast, Timestamp::ZERO);
        delivery.asks();
        delivery.answered(&last("UA", false), Timestamp::ZERO);
        delivery.disconnected();
        delivery.connected();
        assert!(delivery.is_stopped());
        assert_eq!(delivery.order(true, Timestamp::from_millis(1 << 40)), Order::Rest);
    }

    #[test]
    fn a_hub_that_refuses_is_asked_less_and_less_often() {
        let mut delivery = sending(Timestamp::ZERO);
        let mut now = Timestamp::ZERO;
        for wait_s in [1, 2, 4, 8, 16, 32, 60, 60] {
            delivery.answered(&Answer::Refused, now);
            let then = now + Span::from_secs(wait_s);
            assert_eq!(delivery.order(true, now), Order::Until(then));
            now = then;
            assert_eq!(delivery.order(true, now), Order::Ask);
            delivery.asks();
        }
    }

    #[test]
    fn the_line_carries_no_more_than_it_may() {
        let mut delivery = Delivery::new("UA", 8);
        delivery.connected();
        delivery.asks();
        delivery.answered(&Answer::Nothing, Timestamp::ZERO);
        delivery.sends(END, 4000, Timestamp::ZERO);
        delivery.answered(&Answer::Stored(1), Timestamp::ZERO);
        let then = Timestamp::from_millis(4000);
        assert_eq!(delivery.order(true, Timestamp::ZERO), Order::Until(then));
        assert_eq!(delivery.order(true, then), Order::Send { after: 1 });
        assert_eq!(delivery.piece_at(), Some(then));
        // A batch does not wait for the time that a piece takes, and the next piece waits for both.
        delivery.sends_piece(64_000, then);
        assert_eq!(delivery.order(true, then), Order::Send { after: 1 });
        assert_eq!(delivery.piece_at(), Some(then + Span::from_secs(64)));
        delivery.used(1000, then);
        assert_eq!(delivery.piece_at(), Some(then + Span::from_secs(65)));
        assert_eq!(delivery.batch_bytes(), BATCH_BYTES_MIN);
        assert_eq!(Delivery::new("UA", 100_000).batch_bytes(), BATCH_BYTES_MAX);
    }
}
