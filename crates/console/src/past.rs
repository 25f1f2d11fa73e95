//! One vehicle as it was at a moment of its log. What the log does not prove is not known, and nothing of it is OK.

use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_fleet::message::{Content, Mark, Message};
use telltale_fleet::vehicle::KEYFRAME_EVERY;

use crate::history::Known;
use crate::state::Row;
use crate::state::contact::{Contact, Judged, LATE_AFTER};
use crate::state::picture::Picture;

/// What a vehicle showed at a moment, by its own clock.
#[derive(Debug)]
pub struct Past {
    pub at_ms: i64,
    /// Empty if no keyframe was found.
    pub picture: Picture,
    /// `Live` if the picture is proven to be that of the moment, `Off` after a goodbye, else `Lost`.
    pub contact: Contact,
}

impl Past {
    /// From messages that begin some time before the moment. `last_told` is the last place of the log that the vehicle's last
    /// head names, and when that head was made.
    pub fn of(known: &Known, at_ms: i64, last_told: Option<(Mark, i64)>) -> Past {
        let is_after = |message: &&Message| message.at > at_ms;
        let mut picture = Picture::default();
        let (mut has_keyframe, mut has_left) = (false, false);
        let mut messages = known.messages().peekable();
        while let Some(message) = messages.next_if(|message| !is_after(message)) {
            picture.take(message);
            has_keyframe |= matches!(message.content, Content::Keyframe(_));
            has_left = message.content == Content::Goodbye;
        }
        let (Some(end), Some(made_ms)) = (picture.end.filter(|_| has_keyframe), picture.at_ms) else {
            return Past { at_ms, picture: Picture::default(), contact: Contact::Lost };
        };
        let next = messages.peek().map(|message| message.mark());
        // The vehicle's clock was set back: the moment came twice. A running vehicle tells something at least as often as a
        // keyframe, so one that ran through the moment again told something shortly before it.
        let keyframe_ms = i64::try_from(2 * KEYFRAME_EVERY.as_millis()).unwrap_or(i64::MAX);
        let again_from = made_ms.min(at_ms.saturating_sub(keyframe_ms));
        let came_twice = messages.any(|message| (again_from..=at_ms).contains(&message.at));
        let follows = next == Some(Mark { n: end.n + 1, ..end });
        let is_last = next.is_none() && last_told.is_some_and(|(last, ms)| last == end && at_ms <= ms);
        let late_ms = i64::try_from(LATE_AFTER.as_millis()).unwrap_or(i64::MAX);
        let is_proven = follows || is_last || at_ms.saturating_sub(made_ms) <= late_ms;
        let contact = match () {
            () if came_twice => Contact::Lost,
            () if has_left => Contact::Off,
            () if picture.is_whole && is_proven => Contact::Live,
            () => Contact::Lost,
        };
        Past { at_ms, picture, contact }
    }

    /// How long before the moment the picture was told.
    pub fn age(&self) -> Option<Span> {
        let age_ms = self.at_ms.saturating_sub(self.picture.at_ms?);
        Some(Span::from_millis(u64::try_from(age_ms).unwrap_or(0)))
    }

    /// The vehicle in one line, as far as its log has that. `now` is its present line.
    pub fn row(&self, now: Row) -> Row {
        let picture = &self.picture;
        let overall = picture.overall();
        let is_doubtful = self.contact == Contact::Lost && overall <= State::Ok;
        let state = if is_doubtful { State::Unknown } else { overall };
        let unacknowledged = picture.alarms.values().filter(|alarm| !alarm.acknowledged).count() as u32;
        let judged =
            Judged { contact: self.contact, state, drives: false, unacknowledged: unacknowledged > 0 };
        // A machine without stages is always active and never drives.
        let has_stages = now.stage != Some(Stage::Active) || now.drives;
        Row {
            state,
            cause: None,
            since: None,
            stage: picture.stage,
            contact: self.contact,
            age_s: self.age().map(|age| age.as_secs_f64()),
            version: String::new(),
            config: String::new(),
            speed_kmh: None,
            unacknowledged,
            clock_skew_s: None,
            two_vehicles: false,
            refused: 0,
            refused_why: None,
            drives: has_stages && picture.stage == Some(Stage::Active),
            urgency: judged.urgency(),
            since_ms: None,
            ..now
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_fleet::message::{Batch, Epoch, Node, NodeStates, VehicleId};

    fn content(state: Option<State>) -> Content {
        let nodes = state.into_iter().map(|state| Node {
            node: "sensors".into(),
            state,
            own: state,
            cause: None,
            words: String::new(),
            gone: false,
        });
        Content::Keyframe(NodeStates { stage: Stage::Active, nodes: nodes.collect() })
    }

    fn delta(state: State) -> Content {
        match content(Some(state)) {
            Content::Keyframe(all) => Content::Delta(all),
            other => other,
        }
    }

    /// Messages of runs with their numbers and seconds.
    fn known(messages: &[(u32, u64, i64, Content)]) -> Known {
        let message = |(run, n, at_s, content): &(u32, u64, i64, Content)| Message {
            epoch: Epoch { start: *run, nonce: 0 },
            n: *n,
            at: at_s * 1000,
            content: content.clone(),
        };
        let mut known = Known::default();
        let id = VehicleId::new("a").unwrap();
        known.take(Batch {
            id,
            key: String::new(),
            sent: 0,
            messages: messages.iter().map(message).collect(),
        });
        known
    }

    fn at(known: &Known, at_s: i64) -> (Contact, State) {
        let past = Past::of(known, at_s * 1000, None);
        (past.contact, past.picture.overall())
    }

    #[test]
    fn the_picture_of_a_moment_is_known_only_if_the_log_proves_it() {
        use State::{Error, Ok, Unknown};
        let all = known(&[
            (1, 4, 50, delta(Error)),
            (1, 5, 100, content(Some(Ok))),
            (1, 6, 500, delta(Error)),
            (1, 8, 900, delta(Ok)),
            (1, 9, 1000, Content::Goodbye),
            (2, 1, 5000, content(Some(Ok))),
        ]);
        assert_eq!(at(&all, 40), (Contact::Lost, Unknown), "nothing was told");
        assert_eq!(at(&all, 60), (Contact::Lost, Unknown), "there is no keyframe yet");
        assert_eq!(at(&all, 100), (Contact::Live, Ok));
        assert_eq!(at(&all, 499), (Contact::Live, Ok), "the next message follows");
        assert_eq!(at(&all, 500), (Contact::Live, Error));
        assert_eq!(at(&all, 535), (Contact::Live, Error), "it was heard a moment ago");
        assert_eq!(at(&all, 536), (Contact::Lost, Error), "a message is missing, and nobody knows from when");
        assert_eq!(at(&all, 950), (Contact::Lost, Ok), "the gap may be of another node");
        assert_eq!(at(&all, 1500), (Contact::Off, Ok));
        assert_eq!(at(&all, 5030), (Contact::Live, Ok));
        assert_eq!(at(&all, 5100), (Contact::Lost, Ok), "nothing was heard of it since");
        let head = |n, ms| Some((Mark { epoch: Epoch { start: 2, nonce: 0 }, n }, ms));
        assert_eq!(Past::of(&all, 5_100_000, head(1, 5_100_000)).contact, Contact::Live);
        for head in [head(1, 5_099_999), head(2, 5_100_000)] {
            assert_eq!(Past::of(&all, 5_100_000, head).contact, Contact::Lost, "{head:?}");
        }
    }

    #[test]
    fn a_moment_that_came_twice_is_not_known() {
        let all = known(&[
            (1, 1, 100, content(Some(State::Ok))),
            (1, 2, 900, delta(State::Error)),
            (1, 3, 110, delta(State::Ok)),
        ]);
        assert_eq!(at(&all, 105).0, Contact::Live);
        assert_eq!(at(&all, 120).0, Contact::Lost);
        let all = known(&[
            (1, 1, 5000, content(Some(State::Ok))),
            (1, 2, 5900, delta(State::Error)),
            (1, 3, 4900, delta(State::Ok)),
        ]);
        assert_eq!(at(&all, 5020).0, Contact::Lost, "it was set back to before the picture");
        // One that began with an old clock does not count.
        let all = known(&[
            (1, 1, 5000, content(Some(State::Ok))),
            (1, 2, 5900, delta(State::Error)),
            (2, 1, 1, content(Some(State::Ok))),
        ]);
        assert_eq!(at(&all, 5020).0, Contact::Live);
    }
}
