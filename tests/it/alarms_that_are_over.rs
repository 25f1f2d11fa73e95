//! Acknowledging all alarms that are over: never one that is active, and none that nobody was shown.

use telltale::engine::Engine;
use telltale::engine::input::{AlarmRef, Input, OperatorAction, Response};
use telltale::engine::time::Timestamp;

use crate::by_hand::{model, said};

const CONFIG: &str = "
vehicle: { stages: none }
groups:
  - { id: sensors, modules: [{ id: lidar, status: lidar }, { id: radar, status: radar }] }
  - { id: copy, modules: [{ id: lidar, status: lidar, clear_after: 1h }] }
";

/// Numbers of all alarms that are kept, with whether each is active, and whether it is acknowledged.
fn alarms(engine: &mut Engine) -> Vec<(u64, bool, bool)> {
    engine.snapshot().alarms.iter().map(|it| (it.id, it.active, it.acknowledged)).collect()
}

#[test]
fn all_that_is_over_is_acknowledged_up_to_the_last_that_was_shown() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    // One status in two places: at one it is over, at the other it stays.
    for (at_ms, lidar, radar) in [(0, 0, 0), (100, 2, 0), (200, 0, 2), (300, 0, 0), (400, 0, 2), (500, 0, 0)]
    {
        engine.handle(&said(&[("lidar", lidar), ("radar", radar)]), Timestamp::from_millis(at_ms));
    }
    let (over, here) = (|id| (id, false, false), |id| (id, true, false));
    assert_eq!(alarms(&mut engine), [over(1), here(2), over(3), over(4)]);
    for (last, left) in [
        (0, vec![over(1), here(2), over(3), over(4)]),
        (3, vec![here(2), over(4)]),
        (3, vec![here(2), over(4)]),
        (u64::MAX, vec![here(2)]),
    ] {
        let action = OperatorAction::Acknowledge { alarm: AlarmRef::Over { last } };
        let now = Timestamp::from_millis(600);
        let kept = engine.preview(&action, now).unwrap().vehicle.alarms;
        let kept: Vec<_> = kept.iter().map(|it| (it.id, it.active, it.acknowledged)).collect();
        assert_eq!(kept, left, "what is stored, up to {last}");
        assert_eq!(engine.handle(&Input::Operator(action), now), Response::Done);
        assert_eq!(alarms(&mut engine), left, "up to {last}");
    }
}
