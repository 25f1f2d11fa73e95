//! A held shuttle stays held, whatever becomes of Telltale (`docs/holding.md`).

use super::story::Story;
use crate::engine::input::{OperatorAction, Response};
use crate::engine::model::Stage;
use crate::engine::model::countermeasure::RequestKind;
use crate::engine::restart::resume::Restored;
use crate::engine::snapshot::Snapshot;
use crate::engine::state::State;
use crate::sim::shuttle::Fault;

const RELEASE: OperatorAction = OperatorAction::Release { display_live: true, storage_ok: true };

/// One request, by a fault or by the operator.
#[derive(Debug, Clone, Copy)]
enum Asked {
    Fault(Fault, RequestKind),
    Stop,
}

const EACH_ALONE: [Asked; 3] = [
    Asked::Fault(Fault::PlannerStall, RequestKind::Decelerate),
    Asked::Fault(Fault::CameraCrash, RequestKind::ManeuverStop),
    Asked::Stop,
];

/// When Telltale goes: while the shuttle brakes, or while it stands and waits to be released.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Gone {
    Braking,
    Standing,
}

/// What becomes of Telltale.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    Killed,
    /// As Ctrl-Z does.
    Stopped,
}

/// A drive with this request alone, and what Telltale had stored before it.
fn asked(asked: Asked, gone: Gone) -> (Story, Restored) {
    let mut story = Story::begin();
    story.drive();
    let before = story.snapshot().to_restore();
    let kind = match asked {
        Asked::Fault(fault, kind) => {
            story.set_fault(fault, true);
            kind
        }
        Asked::Stop => {
            assert_eq!(story.act(&OperatorAction::RequestStop), Response::Done);
            RequestKind::ManeuverStop
        }
    };
    story.until(3_000, |snapshot| moving(snapshot) == [kind]).expect("it is asked");
    if let Asked::Fault(fault, _) = asked {
        story.pass(1_000);
        story.set_fault(fault, false);
    }
    if gone == Gone::Standing {
        story.pass(15_000);
        story.until(5_000, |snapshot| snapshot.release_refusals.is_empty()).expect("the cause is gone");
        assert_eq!(story.true_speed_mps(), 0.0);
    }
    assert_eq!((moving(&story.snapshot()), story.snapshot().hold), (vec![kind], Some(true)));
    (story, before)
}

fn moving(snapshot: &Snapshot) -> Vec<RequestKind> {
    snapshot.countermeasures.iter().map(|it| it.request.kind()).filter(|kind| kind.moves()).collect()
}

/// Lets time pass, in which the shuttle may only become slower.
fn only_slower(story: &mut Story, ms: u64) {
    for _ in 0..ms / 100 {
        let before_mps = story.true_speed_mps();
        story.pass(100);
        assert!(story.true_speed_mps() <= before_mps, "{} after {before_mps} m/s", story.true_speed_mps());
    }
}

fn released(story: &mut Story) {
    let offered = story.until(30_000, |snapshot| snapshot.release_refusals.is_empty());
    assert!(offered.is_some(), "{:?}", story.snapshot().release_refusals);
    assert_eq!(story.act(&RELEASE), Response::Done);
    story.pass(6_000);
    assert_eq!((moving(&story.snapshot()), story.snapshot().hold), (vec![], Some(false)));
    assert!(story.true_speed_mps() > 3.0, "it drives on");
}

#[test]
fn a_held_shuttle_stays_held_for_each_request_alone_and_each_end_of_telltale() {
    let cases = EACH_ALONE.iter().flat_map(|&it| [(it, Gone::Braking), (it, Gone::Standing)]);
    let cases = cases.flat_map(|(it, when)| [End::Killed, End::Stopped].map(|end| (it, when, end)));
    for ((it, when, end), away_ms) in cases.flat_map(|case| [5_000, 60_000].map(|ms| (case, ms))) {
        let (mut story, _) = asked(it, when);
        let (kind, memory) = (moving(&story.snapshot())[0], story.snapshot().to_restore());
        let since = story.snapshot().countermeasures[0].since.age(story.snapshot().now);
        story.gone = true;
        only_slower(&mut story, away_ms);
        match end {
            End::Killed => story.restart(&memory),
            End::Stopped => story.gone = false,
        }
        // Before anything is heard it is known what holds the shuttle, since when and why.
        story.pass(10);
        let snapshot = story.snapshot();
        // One that was only stopped finds that nothing was heard for long, which may be another reason.
        let held = moving(&snapshot);
        let as_before = if end == End::Killed { held == [kind] } else { held.contains(&kind) };
        assert!(as_before && snapshot.hold == Some(true), "{it:?} {when:?} {end:?}: {held:?}");
        let countermeasure = snapshot.countermeasures.iter().find(|it| it.request.kind() == kind);
        let countermeasure = countermeasure.expect("it is held");
        assert!(countermeasure.since.age(snapshot.now) >= since);
        match it {
            Asked::Stop => assert!(countermeasure.by_operator.is_some()),
            Asked::Fault(..) => assert!(!countermeasure.causes.is_empty()),
        }
        only_slower(&mut story, 10_000);
        assert_eq!(story.true_speed_mps(), 0.0, "{it:?} {when:?} {end:?}");
        released(&mut story);
    }
}

#[test]
fn a_request_that_was_not_stored_yet_holds_the_shuttle_all_the_same() {
    for it in EACH_ALONE {
        let (mut story, before) = asked(it, Gone::Braking);
        story.gone = true;
        only_slower(&mut story, 5_000);
        story.restart(&before);
        only_slower(&mut story, 10_000);
        assert_eq!((moving(&story.snapshot()), story.snapshot().hold), (vec![], None), "{it:?}");
        assert_eq!(story.true_speed_mps(), 0.0);
        // The way out: a stop, and its release.
        assert_eq!(story.act(&OperatorAction::RequestStop), Response::Done);
        released(&mut story);
    }
}

#[test]
fn after_a_restart_at_a_stop_it_is_the_next_clearance_that_says_that_nothing_is_held() {
    let (mut story, _) = asked(Asked::Stop, Gone::Standing);
    released(&mut story);
    story.until(120_000, |snapshot| snapshot.stage == Stage::Standby).expect("it arrives");
    story.pass(5_000);
    assert_eq!((story.snapshot().hold, story.snapshot().overall), (Some(false), State::Ok));
    let memory = story.snapshot().to_restore();
    story.restart(&memory);
    story.pass(10_000);
    assert_eq!(story.snapshot().hold, None, "a held shuttle stands, and may say that it does not drive, too");
    story.clear();
    assert_eq!(story.snapshot().hold, Some(false));
}
