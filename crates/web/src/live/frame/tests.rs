//! The JSON for programs: what is kept in parts reads as what is made at once, and changes make the whole.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use super::{Form, Frames};
use crate::view::tests::sample::{Sample, parts};
use telltale_engine::action::OperatorAction;
use telltale_engine::input::TroubleKind;
use telltale_runtime::Published;

const START: Duration = Duration::from_secs(1_795_176_000);

/// A drive with faults, silence, words, an unknown status, a stop and a lock, some instants apart.
fn drive() -> Vec<Published> {
    let mut vehicle = Sample::of(parts());
    let mut shown = Vec::new();
    let mut show = |vehicle: &mut Sample, offset: Duration| {
        let snapshot = vehicle.snapshot();
        let at = UNIX_EPOCH + START + offset + Duration::from_nanos(snapshot.now.as_nanos());
        shown.push(Published::recorded(snapshot, at));
    };
    show(&mut vehicle, Duration::ZERO);
    vehicle = vehicle.login().signal("active", false).pass(5).localize("depot").pass(5);
    let steps: [fn(Sample) -> Sample; 12] = [
        |it| it.signal("active", true).pass(20),
        |it| {
            it.report("can/battery", 1, "20 \u{202e}%", &[("volt", "11.9"), ("volt", "0"), ("\"a\"", "\\")])
                .pass(3)
        },
        |it| it.report("sensors/velodyne_packet_alive", 2, "no packets", &[]).pass(3),
        |it| it.pass(1),
        |it| it.silence("mission/server").pass(7),
        |it| it.pass(1),
        |it| it.act(OperatorAction::RequestStop).pass(1),
        |it| it.report("stray", 1, "gone mad", &[("k", "v")]).pass(2),
        |it| it.trouble("/diagnostics", TroubleKind::Lost, 3, "lost").pass(1),
        |it| it.report("sensors/velodyne_packet_alive", 0, "fine", &[]).pass(9),
        |it| it.act(OperatorAction::Release { display_live: true, storage_ok: true }).pass(1),
        |it| it.signal("active", false).pass(5),
    ];
    for (number, step) in (0..).zip(steps) {
        vehicle = step(vehicle);
        // The clock jitters, and is set once.
        let jitter = Duration::from_micros(number * 130);
        let offset = jitter + if number < 8 { Duration::ZERO } else { Duration::from_secs(60) };
        show(&mut vehicle, offset);
        vehicle = vehicle.pass(1);
        show(&mut vehicle, offset);
    }
    shown
}

fn value(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn a_snapshot_in_parts_reads_as_one_that_is_written_at_once() {
    let frames = Frames::default();
    let drive = drive();
    // Forwards, and then back, a rewind for each step.
    let back = drive.iter().rev().zip(1..).map(|(it, rewinds)| Published { rewinds, ..it.clone() });
    for (place, published) in drive.iter().cloned().chain(back).enumerate() {
        let anew = Frames::default().json(&published);
        assert_eq!(frames.json(&published).as_str(), anew.as_str(), "{place}");
    }
}

/// The wire of one instant, byte by byte. `TELLTALE_GOLDEN=1` writes it anew.
#[test]
fn the_wire_is_as_it_was() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/src/live/frame/golden.json");
    let whole = Frames::default().json(&drive()[6]);
    if std::env::var_os("TELLTALE_GOLDEN").is_some() {
        std::fs::write(path, format!("{whole}\n")).unwrap();
    }
    assert_eq!(format!("{whole}\n"), std::fs::read_to_string(path).unwrap());
}

/// Takes in a message of a stream with `?deltas`, as a program does.
fn take(state: &mut Value, message: Value) {
    let Some(base) = message.get("base") else {
        *state = message;
        return;
    };
    assert_eq!(*base, state["seq"]);
    for (key, new) in message.as_object().unwrap() {
        match key.as_str() {
            "base" => {}
            "groups" => {
                new.as_array().unwrap().iter().for_each(|group| merge(&mut state["groups"], group, false))
            }
            "modules" => {
                new.as_array().unwrap().iter().for_each(|module| merge(&mut state["groups"], module, true))
            }
            key => state[key] = new.clone(),
        }
    }
}

/// Replaces the members of the group or module of the same id.
fn merge(groups: &mut Value, new: &Value, is_module: bool) {
    for group in groups.as_array_mut().unwrap() {
        if is_module {
            for module in
                group["modules"].as_array_mut().unwrap().iter_mut().filter(|it| it["id"] == new["id"])
            {
                *module = new.clone();
            }
        } else if group["id"] == new["id"] {
            new.as_object().unwrap().iter().for_each(|(key, new)| group[key] = new.clone());
        }
        merge(&mut group["groups"], new, is_module);
    }
}

/// Without what changes with time alone.
fn timeless(mut whole: Value) -> Value {
    fn groups(all: &mut Value) {
        for group in all.as_array_mut().unwrap() {
            for module in group["modules"].as_array_mut().into_iter().flatten() {
                let module = module.as_object_mut().unwrap();
                module.remove("age_ms");
                module.remove("silent_s");
            }
            groups(&mut group["groups"]);
        }
    }
    groups(&mut whole["groups"]);
    whole
}

/// Without the microseconds by which the clock jitters.
fn even(published: &Published) -> Published {
    let micros = published.at.duration_since(SystemTime::UNIX_EPOCH).unwrap().as_micros() % 1_000_000;
    Published { at: published.at - Duration::from_micros(micros as u64), ..published.clone() }
}

#[test]
fn changes_make_the_whole_also_for_who_skips_some() {
    let drive: Vec<Published> = drive().iter().map(even).collect();
    for form in [Form { deltas: true, groups: false }, Form { deltas: true, groups: true }] {
        for stride in [1, 2, 3] {
            let frames = Frames::default();
            let (mut state, mut sent, mut wholes) = (Value::Null, None, 0);
            for (place, published) in drive.iter().enumerate() {
                // Another program reads each.
                frames.json(published);
                if place % stride > 0 {
                    continue;
                }
                let (message, has) = frames.stream(published, form, sent);
                sent = Some(has);
                wholes += usize::from(value(&message).get("base").is_none());
                take(&mut state, value(&message));
                let (whole, _) = frames.stream(published, Form { deltas: false, ..form }, None);
                assert_eq!(timeless(state.clone()), timeless(value(&whole)), "{form:?} {stride} {place}");
                assert!(!form.groups || !whole.contains("\"modules\""));
            }
            assert!(wholes <= 8, "{wholes} of {} are whole", drive.len() / stride);
        }
    }
}

#[test]
fn a_message_of_changes_is_small() {
    let frames = Frames::default();
    let form = Form { deltas: true, groups: false };
    let read = |vehicle: &mut Sample, sent| {
        let snapshot = vehicle.snapshot();
        let at = UNIX_EPOCH + START + Duration::from_nanos(snapshot.now.as_nanos());
        frames.stream(&Published::recorded(snapshot, at), form, sent)
    };
    let mut vehicle = Sample::shuttle(true);
    let (whole, sent) = read(&mut vehicle, None);
    vehicle = vehicle.pass(1);
    let (calm, sent) = read(&mut vehicle, Some(sent));
    vehicle = vehicle.report("can/battery", 1, "20 %", &[]).pass(1);
    let (fault, _) = read(&mut vehicle, Some(sent));
    assert!(whole.len() > 4000 && calm.len() < 400 && fault.len() < 1500, "{calm} {fault}");
    let fault = value(&fault);
    let ids =
        |list: &str| fault[list].as_array().unwrap().iter().map(|it| it["id"].clone()).collect::<Vec<_>>();
    assert_eq!((ids("groups"), ids("modules")), (vec!["can".into()], vec!["can/battery".into()]));
    assert_eq!(fault["modules"][0]["message"], "20 %");
}
