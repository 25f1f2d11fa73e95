//! Finds discovery in the library that knows too many participants, for example after a flood of
//! announcements of participants that do not exist. The library still hears known participants, but finds
//! nobody new for half a minute.

use std::fs;
use std::path::PathBuf;

use rustdds::DomainParticipantStatusEvent as Event;

use telltale_engine::time::{Span, Timestamp};

/// No vehicle has so many participants. With fewer, discovery is busy with real work that ends.
const VEHICLE_MAX: u64 = 256;
/// The library's cost for each packet grows with the participants that it knows. With more than these it may
/// find nobody new for seconds, even if its discovery thread rests.
const PARTICIPANTS_MAX: u64 = 4096;
/// The number of consecutive looks at which discovery did not rest.
const BUSY_MAX: u32 = 4;
/// The name of the library's thread as the kernel cuts it.
const THREAD: &str = "RustDDS discove";

/// The time for which a thread ran or waited for a processor, and when that was read.
type CpuTime = (Timestamp, Span);

#[derive(Debug, Default)]
pub struct BusyDiscovery {
    participants: u64,
    thread: Option<PathBuf>,
    last: Option<CpuTime>,
    busy: u32,
}

impl BusyDiscovery {
    /// For the only participant of this process. If there are several, or the system gives no figures,
    /// nothing is found.
    pub fn of_this_process() -> BusyDiscovery {
        let tasks = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
        let is_discovery = |path: &PathBuf| {
            fs::read_to_string(path.join("comm")).is_ok_and(|name| name.trim_end() == THREAD)
        };
        let mut found = tasks.map(|task| task.path()).filter(is_discovery);
        let thread = found.next().filter(|_| found.next().is_none());
        BusyDiscovery { thread, ..BusyDiscovery::default() }
    }

    pub fn hear(&mut self, event: &Event) {
        match event {
            Event::ParticipantDiscovered { .. } => self.participants += 1,
            Event::ParticipantLost { .. } => self.participants = self.participants.saturating_sub(1),
            _ => {}
        }
    }

    /// Called at each beat. True once discovery is unusable.
    pub fn is_too_much(&mut self, now: Timestamp) -> bool {
        let Some(awake) = self
            .thread
            .as_ref()
            .and_then(|thread| awake(&fs::read_to_string(thread.join("schedstat")).ok()?))
        else {
            return false;
        };
        self.look((now, awake))
    }

    fn look(&mut self, look: CpuTime) -> bool {
        let Some((then, before)) = self.last.replace(look) else { return false };
        let (passed, awake) =
            (look.0.since(then).as_nanos(), look.1.as_nanos().saturating_sub(before.as_nanos()));
        // It rests if it was asleep for a tenth of the time.
        self.busy = if awake >= passed / 10 * 9 { self.busy + 1 } else { 0 };
        self.participants > PARTICIPANTS_MAX || self.participants > VEHICLE_MAX && self.busy >= BUSY_MAX
    }
}

/// From the kernel's `schedstat` of a thread: nanoseconds on a processor, and those of waiting for one.
fn awake(schedstat: &str) -> Option<Span> {
    let mut numbers = schedstat.split_ascii_whitespace().map(str::parse::<u64>);
    let (ran, waited) = (numbers.next()?.ok()?, numbers.next()?.ok()?);
    Some(Span::from_nanos(ran.saturating_add(waited)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The look (of 40, four a second) at which discovery that is awake for `percent` of the time is given
    /// up.
    fn given_up(participants: u64, percent: u64) -> Option<u64> {
        let mut busy_discovery = BusyDiscovery { participants, ..BusyDiscovery::default() };
        (0..40).find(|look| {
            busy_discovery
                .look((Timestamp::from_millis(250 * look), Span::from_nanos(2_500_000 * percent * look)))
        })
    }

    #[test]
    fn discovery_is_given_up_where_it_never_rests_from_participants_that_none_has() {
        assert_eq!(given_up(4096, 100), Some(4));
        assert_eq!(given_up(4096, 80), None, "it keeps up");
        assert_eq!(given_up(4097, 0), Some(1), "more than anybody needs");
        assert_eq!(given_up(256, 100), None, "a large vehicle starts");
    }

    #[test]
    fn what_the_kernel_tells_of_a_thread_is_read() {
        assert_eq!(awake("382139 59295 1\n"), Some(Span::from_nanos(441_434)));
        assert_eq!(awake(""), None);
        assert!(fs::read_to_string("/proc/self/schedstat").is_ok_and(|text| awake(&text).is_some()));
    }
}
