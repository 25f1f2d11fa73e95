use std::collections::BTreeMap;

use super::*;

/// The latest level and message of every status, and the signal, as a listener has them.
#[derive(Default)]
struct Listener {
    levels: BTreeMap<String, u8>,
    messages: BTreeMap<String, String>,
    active: Option<bool>,
    heard: usize,
}

impl Listener {
    fn hear(&mut self, messages: Vec<Message>) {
        self.heard += messages.len();
        for message in messages {
            match message {
                Message::Active(active) => self.active = Some(active),
                Message::Diagnostics(array) => {
                    for status in array.iter() {
                        self.levels.insert(status.name().to_owned(), status.level());
                        self.messages.insert(status.name().to_owned(), status.message().to_owned());
                    }
                }
            }
        }
    }

    fn level(&self, name: &str) -> u8 {
        *self.levels.get(name).unwrap_or_else(|| panic!("{name} was never published"))
    }
}

fn at(ms: u64) -> Timestamp {
    Timestamp::from_millis(ms)
}

/// Lets the shuttle run until it drives at full speed, and returns when that is.
fn driving(shuttle: &mut Shuttle, listener: &mut Listener) -> u64 {
    let start_ms = 35_000;
    for ms in (0..=start_ms).step_by(10) {
        listener.hear(shuttle.advance(at(ms)));
    }
    assert_eq!(listener.active, Some(true));
    start_ms
}

/// When, after `from_ms`, the status first has this level; within 5 s.
fn first(shuttle: &mut Shuttle, listener: &mut Listener, from_ms: u64, name: &str, level: u8) -> u64 {
    for ms in (from_ms..from_ms + 5_000).step_by(10) {
        listener.hear(shuttle.advance(at(ms)));
        if listener.level(name) == level {
            return ms - from_ms;
        }
    }
    panic!("{name} did not reach {level} within 5 s: {:?}", listener.messages.get(name));
}

#[test]
fn same_seed_and_instants_same_messages_however_time_is_cut() {
    let run = |seed, cut_ms: usize| {
        let mut shuttle = Shuttle::new(seed, Timestamp::ZERO);
        (0..=24_000).step_by(cut_ms).flat_map(|ms| shuttle.advance(at(ms))).collect::<Vec<_>>()
    };
    assert_eq!(run(1, 10), run(1, 1000));
    assert_ne!(run(1, 10), run(2, 10));
}

#[test]
fn a_healthy_loop_alternates_between_stops_and_drives_of_about_45_s() {
    let mut shuttle = Shuttle::new(7, Timestamp::ZERO);
    let mut listener = Listener::default();
    let mut changes = Vec::new();
    for ms in (0..240_000).step_by(10) {
        let before = listener.active;
        listener.hear(shuttle.advance(at(ms)));
        if listener.active != before {
            changes.push(ms);
        }
        if listener.active == Some(true) {
            let bad: Vec<_> = listener.levels.iter().filter(|(_, level)| **level != 0).collect();
            assert!(bad.is_empty(), "{ms}: {bad:?}");
        }
    }
    assert!(changes.len() >= 8, "{changes:?}");
    for pair in changes[1..].windows(2) {
        let (first_ms, length_ms) = (pair[0], pair[1] - pair[0]);
        let drives = changes.iter().position(|&ms| ms == first_ms).is_some_and(|index| index % 2 == 1);
        let expected = if drives { 40_000..55_000 } else { 9_000..11_000 };
        assert!(expected.contains(&length_ms), "{changes:?}");
    }
}

#[test]
fn at_a_stop_the_planner_is_not_content_and_the_rest_is() {
    let mut shuttle = Shuttle::new(7, Timestamp::ZERO);
    let mut listener = Listener::default();
    for ms in (0..5_000).step_by(10) {
        listener.hear(shuttle.advance(at(ms)));
    }
    assert_eq!(listener.active, Some(false));
    assert_eq!(listener.level("planner_submitted"), 2);
    assert!(!listener.levels.contains_key("execution: controller"));
    let bad: Vec<_> = listener.levels.iter().filter(|(_, level)| **level != 0).collect();
    assert_eq!(bad.len(), 1, "{bad:?}");
}

#[test]
fn in_a_sensor_outage_who_uses_the_data_notices_before_who_counts_it() {
    let mut shuttle = Shuttle::new(7, Timestamp::ZERO);
    let mut listener = Listener::default();
    let mut now_ms = driving(&mut shuttle, &mut listener);
    shuttle.set_fault(Fault::SensorOutage, true);
    let localization_ms = first(&mut shuttle, &mut listener, now_ms, "localization: tf_quality", 2);
    assert!((50..400).contains(&localization_ms), "{localization_ms}");
    assert_eq!(listener.level("velodyne_packet_alive"), 0);
    now_ms += localization_ms;
    let warning_ms = first(&mut shuttle, &mut listener, now_ms, "velodyne_packet_alive", 1);
    now_ms += warning_ms;
    let error_ms = first(&mut shuttle, &mut listener, now_ms, "velodyne_packet_alive", 2);
    let sensors_ms = localization_ms + warning_ms + error_ms;
    assert!((900..1_300).contains(&sensors_ms), "{sensors_ms}");
}

/// Each fault: the status that is its cause, the level, the words, and how fast it shows.
#[test]
fn every_fault_shows_at_its_cause_and_goes_away_again() {
    let table = [
        (Fault::SensorOutage, "velodyne_packet_alive", 2, "Only 4.5 scans per second", 1_300),
        (Fault::LocalizationJump, "localization: tf_quality", 2, "Position jumped by 1.2 m", 100),
        (Fault::CostmapDelay, "perception: costmap_delay", 2, "Costmap is late: 3", 100),
        (Fault::PlannerStall, "planner_submitted", 2, "No trajectory for 0.", 700),
        (Fault::CanLoss, "can: bus", 2, "No frame for 0.", 400),
        (Fault::LowBattery, "can: battery", 1, "17 percent charged", 500),
    ];
    for (fault, name, level, words, within_ms) in table {
        let mut shuttle = Shuttle::new(7, Timestamp::ZERO);
        let mut listener = Listener::default();
        let now_ms = driving(&mut shuttle, &mut listener);
        shuttle.set_fault(fault, true);
        let shown_ms = first(&mut shuttle, &mut listener, now_ms, name, level);
        assert!(shown_ms <= within_ms, "{fault:?}: {shown_ms} ms");
        assert!(listener.messages[name].starts_with(words), "{fault:?}: {}", listener.messages[name]);
        for ms in (now_ms + shown_ms..now_ms + 6_000).step_by(10) {
            listener.hear(shuttle.advance(at(ms)));
        }
        shuttle.set_fault(fault, false);
        let gone_ms = first(&mut shuttle, &mut listener, now_ms + 6_000, name, 0);
        assert!(gone_ms <= 2_500, "{fault:?}: {gone_ms} ms");
        for ms in (now_ms + 6_000 + gone_ms..now_ms + 10_000).step_by(10) {
            listener.hear(shuttle.advance(at(ms)));
        }
        let bad: Vec<_> = listener.levels.iter().filter(|(_, level)| **level != 0).collect();
        assert!(bad.is_empty(), "{fault:?}: {bad:?}");
    }
}

#[test]
fn a_stopped_process_does_not_flood_the_bus_afterwards() {
    let mut shuttle = Shuttle::new(7, Timestamp::ZERO);
    let mut listener = Listener::default();
    listener.hear(shuttle.advance(at(1_000)));
    let a_second = listener.heard;
    listener.hear(shuttle.advance(at(3_600_000)));
    assert!(listener.heard < a_second * 7, "{} messages after an hour", listener.heard);
    let before = listener.heard;
    listener.hear(shuttle.advance(at(3_601_000)));
    assert!((a_second / 2..a_second * 2).contains(&(listener.heard - before)));
}

#[test]
fn the_words_of_faults_are_read_back() {
    for fault in Fault::ALL {
        assert_eq!(Fault::from_word(fault.as_str()), Some(fault));
    }
    assert_eq!(Fault::from_word("none"), None);
}
