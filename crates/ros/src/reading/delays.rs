//! How much later than usual a message comes: it was lost at first and sent again, or waited in a queue.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::{SystemTime, UNIX_EPOCH};

use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

/// Writers that are known at once. The one that was heard longest ago makes room.
const WRITERS_MAX: usize = 1024;
/// A message comes as usual if it takes no longer than this beyond the fastest one.
const USUAL_NS: i128 = 1_000_000_000;
/// The stamps of messages that several threads of one writer publish go back by less than this.
const SWAPPED_NS: i128 = 1_000_000_000;
/// A clock that is slewed runs faster or slower than ours by less than one part in so many (chrony: a twelfth), and by no
/// more than this time in all.
const SLEW: i128 = 10;
const SLEWED_NS: i128 = 10_000_000_000;
/// After a silence, no more than this time of it is taken for slewing.
const SLEWS_FOR_NS: i128 = 10_000_000_000;
/// A clock that is not slewed runs faster or slower than ours by less than one part in so many.
const DRIFT: i128 = 1000;
/// If all messages of this time come late by the same, that is usual from then on: the writer's clock was set, or the network
/// is slower. The messages of a backlog come late by less and less, or by more and more.
const ACCEPTED_NS: i128 = 30_000_000_000;
/// Until a message came in time, the clocks of both sides tell how old it is. They may disagree: if the least late messages of
/// two such times in a row were equally late, or nearly, the clocks are the reason. Those of a backlog are not.
const FIRST_NS: i128 = 2_500_000_000;
const FIRST_ALIKE_NS: i128 = 500_000_000;

/// The delays of one topic's writers.
#[derive(Debug, Default)]
pub struct Delays {
    writers: BTreeMap<Guid, Delay>,
}

/// Times are nanoseconds. An offset is the difference of our clock, which is never set, from the writer's.
#[derive(Debug, Clone, Copy)]
struct Delay {
    /// The offset of the fastest message, which follows a slewed clock, and when it came.
    least: i128,
    at: i128,
    /// The offset of the fastest message, which follows no slewed clock, and when it came.
    fastest: (i128, i128),
    /// When the last one was published, and when it came.
    source: i128,
    heard: i128,
    /// Since when all messages come late by the same, with the least and the largest offset.
    late: Option<(i128, i128, i128)>,
    /// No message came in time yet: the clocks tell the usual delay.
    unproven: Option<Unproven>,
}

/// The least offset since an instant, and that of the time before.
#[derive(Debug, Clone, Copy)]
struct Unproven {
    since: i128,
    least: i128,
    before: Option<i128>,
}

impl Delays {
    /// Takes a message in the order of its writer, at an instant of both our clocks. Returns how much later than usual it was
    /// received; nothing of a writer that gives no source stamps.
    pub fn take(
        &mut self,
        writer: &Guid,
        source: Option<SystemTime>,
        (now, wall): (Timestamp, SystemTime),
    ) -> Span {
        let nanos = |it: SystemTime| it.duration_since(UNIX_EPOCH).ok().map(|it| it.as_nanos() as i128);
        let (Some(source), Some(wall)) = (source.and_then(nanos), nanos(wall)) else {
            return Span::ZERO;
        };
        let now = i128::from(now.as_nanos());
        if self.writers.len() >= WRITERS_MAX && !self.writers.contains_key(writer) {
            let oldest = self.writers.iter().min_by_key(|(_, delay)| delay.heard).map(|(guid, _)| *guid);
            oldest.map(|guid| self.writers.remove(&guid));
        }
        let late = match self.writers.entry(*writer) {
            Entry::Occupied(known) => known.into_mut().take(source, now, wall),
            Entry::Vacant(free) => {
                let first = free.insert(Delay::first(source, now, wall));
                now - source - first.least
            }
        };
        Span::from_nanos(u64::try_from(late).unwrap_or(u64::MAX))
    }
}

impl Delay {
    fn of(offset: i128, now: i128, source: i128) -> Delay {
        Delay {
            least: offset,
            at: now,
            fastest: (offset, now),
            source,
            heard: now,
            late: None,
            unproven: None,
        }
    }

    /// A first message that is older than usual by the clocks of both sides.
    fn first(source: i128, now: i128, wall: i128) -> Delay {
        let (offset, agreeing) = (now - source, now - wall);
        if offset <= agreeing + USUAL_NS {
            return Delay::of(offset, now, source);
        }
        let unproven = Some(Unproven { since: now, least: offset, before: None });
        Delay { unproven, ..Delay::of(agreeing, now, source) }
    }

    fn take(&mut self, source: i128, now: i128, wall: i128) -> i128 {
        self.heard = now;
        // A stamp that stays the same is none.
        if source == self.source {
            return 0;
        }
        let offset = now - source;
        // Messages of one writer come in order. Of two threads one may take its stamp first and write last.
        if source + SWAPPED_NS < self.source {
            // Its clock was set back.
            *self = Delay::first(source, now, wall);
            return offset - self.least;
        }
        self.source = self.source.max(source);
        let drifted = self.fastest.0 + (now - self.fastest.1) / DRIFT;
        if offset <= drifted {
            self.fastest = (offset, now);
        }
        let usual = (self.least + (now - self.at).min(SLEWS_FOR_NS) / SLEW).min(drifted + SLEWED_NS);
        if offset <= usual + USUAL_NS {
            if offset <= usual {
                (self.least, self.at) = (offset, now);
            }
            (self.late, self.unproven) = (None, None);
            return 0;
        }
        if let Some(unproven @ Unproven { since, least, before }) = self.unproven {
            let times = (now - since) / FIRST_NS;
            // If messages come seldom, this one stands for the second time.
            let (enough, before, latest) = before.map_or((2, least, offset), |before| (1, before, least));
            if times >= enough && (before - latest).abs() <= FIRST_ALIKE_NS {
                *self = Delay::of(latest, now, source);
                return if offset > latest + USUAL_NS { offset - latest } else { 0 };
            }
            self.unproven = Some(match times {
                0 => Unproven { least: least.min(offset), ..unproven },
                _ => Unproven { since: since + times * FIRST_NS, least: offset, before: Some(least) },
            });
        }
        let (since, least, most) = self.late.unwrap_or((now, offset, offset));
        let (least, most) = (least.min(offset), most.max(offset));
        if most - least > USUAL_NS {
            self.late = Some((now, offset, offset));
        } else if now - since >= ACCEPTED_NS {
            *self = Delay::of(least, now, source);
            return 0;
        } else {
            self.late = Some((since, least, most));
        }
        offset - usual
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const A: Guid = [1; 16];

    /// Our wall clock at the zero of the other one.
    const WALL_MS: u64 = 1_780_000_000_000;

    fn take(delays: &mut Delays, source_ms: u64, received_ms: u64) -> Span {
        let wall = |ms: u64| UNIX_EPOCH + Duration::from_millis(ms);
        let now = (Timestamp::from_millis(received_ms), wall(WALL_MS + received_ms));
        delays.take(&A, Some(wall(source_ms)), now)
    }

    /// When each message was published by its writer's clock and received by ours, and how late it is; in milliseconds.
    fn check(messages: &[(u64, u64, u64)]) {
        let mut delays = Delays::default();
        for &(source, received, late) in messages {
            let told = take(&mut delays, source, received);
            // Clocks may run apart by a tenth.
            let range = late / 2..=late;
            assert!(range.contains(&told.as_millis()), "at {received}: {told:?}, not {late} ms");
        }
    }

    /// The same by a clock that agrees with ours.
    fn check_agreeing(messages: &[(u64, u64, u64)]) {
        let agreeing = |&(source, received, late)| (WALL_MS + source, received, late);
        check(&messages.iter().map(agreeing).collect::<Vec<_>>());
    }

    #[test]
    fn what_was_lost_at_first_or_waited_is_late_whatever_the_clocks_say() {
        for clock in [WALL_MS + 10_000, WALL_MS + 9_200, WALL_MS + 300_000, 2 * WALL_MS] {
            let sent = |ms: u64| clock + ms;
            check(&[
                (sent(0), 10_010, 0),
                (sent(200), 10_205, 0),
                (sent(400), 10_600, 0),
                // Nothing gets through for eight seconds.
                (sent(600), 18_605, 8_000),
                (sent(800), 18_605, 7_800),
                (sent(8_600), 18_605, 0),
            ]);
        }
    }

    #[test]
    fn stamps_that_go_back_a_little_hide_no_backlog() {
        // Two threads of one writer, and nothing gets through for eight seconds.
        check_agreeing(&[
            (0, 10, 0),
            (200, 205, 0),
            (596, 8_605, 8_009),
            (592, 8_605, 8_013),
            (800, 8_605, 7_805),
            (796, 8_605, 7_809),
            (8_600, 8_605, 0),
        ]);
        // Its clock is set back meanwhile.
        check_agreeing(&[(20_000, 20_010, 0), (17_000, 25_005, 8_005), (17_200, 25_005, 7_805)]);
    }

    #[test]
    fn a_clock_that_is_set_and_a_longer_way_are_usual_after_a_while() {
        // Back by ten seconds, which is seen at once.
        check_agreeing(&[(20_000, 1_000, 0), (21_000, 2_000, 0), (12_000, 3_000, 0), (13_000, 4_000, 0)]);
        // Ahead by ten seconds.
        check_agreeing(&[(20_000, 1_000, 0), (31_000, 2_000, 0), (32_000, 3_000, 0), (32_500, 6_500, 3_000)]);
        // One that stands says nothing.
        check_agreeing(&[(20_000, 1_000, 0), (20_000, 9_000, 0), (20_000, 90_000, 0)]);
        // From now on each message takes ten seconds.
        let slow: Vec<(u64, u64, u64)> =
            (1..60).map(|s| (s * 1000, s * 1000 + 10_000, if s <= 30 { 10_000 } else { 0 })).collect();
        check_agreeing(&[&[(0, 0, 0)], &slow[..]].concat());
    }

    #[test]
    fn a_first_message_is_as_old_as_the_clocks_say_until_they_are_known_to_disagree() {
        // Told again to a Telltale that has just started: its writer hangs since.
        check_agreeing(&[(3_000, 9_300, 6_300), (3_200, 9_300, 6_100)]);
        // And its writer goes on.
        check_agreeing(&[
            (3_000, 9_300, 6_300),
            (3_200, 9_300, 6_100),
            (9_295, 9_300, 0),
            (9_500, 11_700, 2_200),
        ]);
        // The writer's clock is seven seconds behind, or has no date.
        for clock in [WALL_MS - 7_000, 0] {
            let age = WALL_MS - clock;
            let late = |ms: u64| if ms < 5_000 { age } else { 0 };
            check(
                &(0..60).map(|step| (clock + step * 200, step * 200, late(step * 200))).collect::<Vec<_>>(),
            );
            check(&[(clock, 0, age), (clock + 10_000, 10_000, 0), (clock + 20_000, 23_000, 3_000)]);
            // Of nine messages one is lost at first, and comes after 0.8 s together with the next ones.
            let way = |step: u64| if step.is_multiple_of(9) { 0 } else { 900 - step % 9 * 100 };
            let lossy = (0..100).map(|step| (clock + step * 100, step * 100 + way(step)));
            let mut delays = Delays::default();
            let late: Vec<Span> =
                lossy.map(|(source, received)| take(&mut delays, source, received)).collect();
            assert!(late[60..].iter().all(|it| it.is_zero()), "{clock}: {late:?}");
        }
        // It is ahead.
        check(&[(WALL_MS + 7_000, 0, 0), (WALL_MS + 7_200, 200, 0), (WALL_MS + 7_400, 3_400, 3_000)]);
    }

    #[test]
    fn a_backlog_never_becomes_usual() {
        // What was lost for 40 s comes again within 36 s.
        check_agreeing(
            &[
                &[(0, 0, 0)],
                &(1..90).map(|s| (s * 500, 40_000 + s * 400, 40_000 - s * 100)).collect::<Vec<_>>()[..],
            ]
            .concat(),
        );
        let mut delays = Delays::default();
        let late: Vec<Span> =
            (0..600).map(|s| take(&mut delays, WALL_MS + s * 1000, s * 1000 + s * 90)).collect();
        assert!(
            late[..100].iter().all(|it| it.is_zero()) && late[599] > Span::from_secs(30),
            "{:?}",
            late[599]
        );
    }

    #[test]
    fn clocks_that_run_apart_make_nothing_late() {
        // Its clock is slewed by ten seconds, a twelfth slower than ours, and faster.
        check_agreeing(&(0..120).map(|s| (s * 1000, s * 1000 + s * 1000 / 12, 0)).collect::<Vec<_>>());
        check_agreeing(&(0..120).map(|s| (s * 1000 + s * 1000 / 12, s * 1000, 0)).collect::<Vec<_>>());
    }

    #[test]
    fn a_writer_without_a_stamp_is_never_late_and_the_writers_are_bounded() {
        let mut delays = Delays::default();
        assert_eq!(delays.take(&A, None, (Timestamp::from_millis(1), UNIX_EPOCH)), Span::ZERO);
        for number in 0..3000_u32 {
            let mut guid = A;
            guid[..4].copy_from_slice(&number.to_be_bytes());
            delays.take(&guid, Some(UNIX_EPOCH), (Timestamp::from_millis(number.into()), UNIX_EPOCH));
        }
        assert_eq!(delays.writers.len(), WRITERS_MAX);
    }
}
