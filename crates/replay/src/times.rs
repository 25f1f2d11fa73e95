//! The time of each message of a recording without a journal, where time must not go back.

use std::time::Duration;

use humantime::format_duration;

use super::steps::Notes;
use telltale_record::file::MessageStamps;

/// A message that is so much earlier than the one before counts as one of the same instant.
const BEHIND_MAX: i128 = 10_000_000_000;
/// A longer time without any message is the mistake of a clock.
const AHEAD_MAX: i128 = 24 * 3600 * 1_000_000_000;
/// So many messages of another time, one after the other: the clock was set.
const SET_AFTER: u32 = 10;

/// The times of messages, in the order of the recording.
#[derive(Debug, Clone, Default)]
pub(super) struct Times {
    /// The latest one.
    last: Option<i128>,
    /// The correction since the clock was set.
    shift: i128,
    /// The stamp of the last message that was left out, and how many there were in a row.
    other: Option<(i128, u32)>,
}

impl Times {
    /// The time of the next message, in nanoseconds; `None`: it is left out.
    pub fn take(&mut self, stamps: MessageStamps, notes: &mut Notes) -> Option<u64> {
        let stamp = [stamps.log_time_ns, stamps.publish_time_ns].into_iter().find(|stamp| *stamp > 0);
        let Some(stamp) = stamp.map(i128::from) else {
            notes.without_time += 1;
            return self.last.and_then(|last| u64::try_from(last).ok());
        };
        let last = *self.last.get_or_insert(stamp);
        let time = stamp + self.shift;
        if (-BEHIND_MAX..=AHEAD_MAX).contains(&(time - last)) {
            notes.out_of_order += u64::from(time < last);
            self.other = None;
            return self.keep(time.max(last));
        }
        let in_a_row = match self.other {
            Some((before, count)) if (stamp - before).abs() <= BEHIND_MAX => count + 1,
            _ => 1,
        };
        if in_a_row < SET_AFTER {
            self.other = Some((stamp, in_a_row));
            notes.of_other_times += 1;
            return None;
        }
        let by = Duration::from_secs(u64::try_from((time - last).abs() / 1_000_000_000).unwrap_or(u64::MAX));
        let way = if time < last { "back" } else { "forward" };
        notes.say(format!(
            "the clock of the recording is set {way} by {}: what follows is replayed as if it were not",
            format_duration(by)
        ));
        (self.shift, self.other) = (last - stamp, None);
        self.keep(last)
    }

    fn keep(&mut self, time: i128) -> Option<u64> {
        self.last = Some(time);
        u64::try_from(time).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    /// The times of messages with these stamps, in seconds, and what is noted.
    fn taken(stamps: &[u64]) -> (Vec<Option<u64>>, Notes) {
        let (mut times, mut notes) = (Times::default(), Notes::default());
        let mut take = |stamp: &u64| {
            let stamps = MessageStamps { log_time_ns: stamp * S, publish_time_ns: 0, sequence: 0 };
            times.take(stamps, &mut notes).map(|time| time / S)
        };
        (stamps.iter().map(&mut take).collect(), notes)
    }

    #[test]
    fn time_never_goes_back_and_a_mistake_of_a_stamp_costs_its_message_alone() {
        let (times, notes) = taken(&[0, 100, 103, 101, 0, 104]);
        assert_eq!(times, [None, Some(100), Some(103), Some(103), Some(103), Some(104)]);
        assert_eq!((notes.without_time, notes.out_of_order, notes.of_other_times), (2, 1, 0));
        let (times, notes) = taken(&[100, 5, 101, 4_000_000_000, 102, 103]);
        assert_eq!(times, [Some(100), None, Some(101), None, Some(102), Some(103)]);
        assert_eq!((notes.of_other_times, notes.said.len()), (2, 0));
        // A long pause of the recorder is none.
        assert_eq!(taken(&[100, 50_000]).0, [Some(100), Some(50_000)]);
        assert_eq!(taken(&[u64::MAX / S, 1]).0, [Some(u64::MAX / S), None]);
    }

    #[test]
    fn a_clock_that_is_set_goes_on_where_it_was() {
        for other in [10_000, 900_000] {
            let stamps: Vec<u64> = (100_000..100_005).chain(other..other + 20).collect();
            let (times, notes) = taken(&stamps);
            assert_eq!(times[4..7], [Some(100_004), None, None], "{other}");
            assert_eq!(times[14..16], [Some(100_004), Some(100_005)], "{other}");
            assert_eq!((times.last().unwrap(), notes.of_other_times), (&Some(100_014), 9));
            assert_eq!(notes.said.len(), 1, "{:?}", notes.said);
        }
    }

    #[test]
    fn a_message_without_a_time_of_receipt_has_that_of_its_publication() {
        let mut notes = Notes::default();
        let stamps = MessageStamps { log_time_ns: 0, publish_time_ns: 7, sequence: 0 };
        assert_eq!(Times::default().take(stamps, &mut notes), Some(7));
        assert_eq!(notes, Notes::default());
    }
}
