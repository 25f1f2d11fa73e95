//! Tests of monitors that compare several sources.

use State::{Error, Ok, Unknown, Warning};

use super::*;
use crate::model::monitors::Class;
use crate::model::monitors::{AgreementRule, Condition};

#[test]
fn a_rate_ratio_without_input_is_unknown_and_without_output_zero() {
    let ratio =
        || MonitorSpec::RateRatio { input: A, output: B, window: millis(1000), bands: at_least(0.9, 0.5) };
    check(
        ratio(),
        &[(999, Do::Nothing, Unknown, "measuring"), (1000, Do::Nothing, Unknown, "no input for 1 s")],
    );
    check_every(
        ratio(),
        100,
        2000,
        |_| vec![Do::Number(0, 0.0)],
        &[(2000, Do::Nothing, Error, "0 outputs per input, at least 0.9 wanted")],
    );
    // The output stops at two seconds, the input at three.
    let both =
        |at| if at <= 2000 { vec![Do::Number(0, 0.0), Do::Number(1, 0.0)] } else { vec![Do::Number(0, 0.0)] };
    check_every(ratio(), 100, 2100, both, &[(2100, Do::Nothing, Ok, "")]);
    check_every(ratio(), 100, 2200, both, &[(2200, Do::Nothing, Warning, "")]);
    check_every(
        ratio(),
        100,
        3000,
        both,
        &[
            (3000, Do::Nothing, Error, "outputs"),
            (3999, Do::Nothing, Error, ""),
            (4000, Do::Nothing, Unknown, "no input"),
        ],
    );
}

#[test]
fn a_ratio_with_limits_on_both_sides_comes_right_when_both_windows_let_go_at_once() {
    let bands = Bands { error_below: Some(1.0), error_above: Some(1.0), ..Bands::default() };
    check(
        MonitorSpec::RateRatio { input: A, output: B, window: millis(1000), bands },
        &[
            (100, Do::Number(0, 0.0), Unknown, ""),
            (100, Do::Number(1, 0.0), Unknown, ""),
            (100, Do::Number(1, 0.0), Unknown, ""),
            (300, Do::Number(0, 0.0), Unknown, ""),
            (300, Do::Number(1, 0.0), Unknown, ""),
            (1000, Do::Nothing, Error, "1.5 outputs per input, 1 to 1 wanted"),
            (1100, Do::Nothing, Ok, ""),
            (1300, Do::Nothing, Unknown, "no input"),
        ],
    );
}

#[test]
fn a_sequence_compares_the_later_value_with_the_one_before_it() {
    let sequence = MonitorSpec::Sequence {
        earlier: field(A, 0),
        later: field(B, 0),
        max_gap: millis(300),
        bands: Bands { error_below: Some(-0.5), ..at_most(0.1, 0.5) },
    };
    check(
        sequence,
        &[
            (0, Do::Number(0, 1.0), Unknown, "nothing came yet of later (/b x)"),
            // Equal to the limit but for rounding.
            (100, Do::Number(1, 1.1), Ok, "later minus earlier: 0.1, -0.5 to 0.1 wanted"),
            // A new earlier value is an answer to nothing.
            (200, Do::Number(0, 3.0), Ok, ""),
            (300, Do::Number(1, 3.2), Warning, "0.2"),
            (400, Do::Number(1, 2.0), Error, "-1"),
            (500, Do::Number(1, 3.0), Ok, ""),
            (501, Do::Number(1, 3.0), Unknown, "earlier (/a x) is more than 300 ms behind"),
            (600, Do::Number(0, f64::NAN), Unknown, ""),
            (610, Do::Number(1, 3.0), Unknown, ""),
            (760, Do::Nothing, Unknown, "earlier (/a x) is not a number"),
            (820, Do::Number(0, 3.0), Unknown, ""),
            (830, Do::Number(1, 3.0), Ok, ""),
            (1130, Do::Number(0, 3.0), Ok, ""),
            (1131, Do::Number(0, 3.0), Unknown, "later (/b x) is more than 300 ms behind"),
            (3131, Do::Nothing, Unknown, ""),
        ],
    );
}

fn numbers_agree() -> MonitorSpec {
    MonitorSpec::Agreement {
        a: field(A, 0),
        b: field(B, 0),
        max_age: millis(500),
        motion_over: None,
        rule: AgreementRule::Number(at_most(0.1, 0.5)),
    }
}

#[test]
fn numbers_agree_while_both_are_young() {
    check(
        numbers_agree(),
        &[
            (0, Do::Number(0, 1.0), Unknown, "nothing came yet of b (/b x)"),
            (100, Do::Number(1, 1.1), Ok, "they differ by 0.1, at most 0.1 wanted"),
            (200, Do::Number(1, 0.8), Warning, "0.2"),
            (300, Do::Number(1, 1.6), Error, "0.6"),
            (400, Do::Number(1, 1.0), Ok, ""),
            (500, Do::Nothing, Ok, ""),
            (501, Do::Nothing, Unknown, "a (/a x) is older than 500 ms"),
            (600, Do::Number(0, f64::INFINITY), Unknown, ""),
            (850, Do::Nothing, Unknown, "a (/a x) is infinite"),
            (860, Do::Number(0, f64::MAX), Error, ""),
            (870, Do::Number(1, f64::MIN), Unknown, "they differ by infinite"),
            (880, Do::Pose(0, Pose::default()), Unknown, ""),
            (1130, Do::Nothing, Unknown, "cannot be read"),
        ],
    );
}

fn pose(x_m: f64, yaw_deg: f64) -> Pose {
    let half = yaw_deg.to_radians() / 2.0;
    Pose { x_m, qz: half.sin(), qw: half.cos(), ..Pose::default() }
}

fn poses_agree(motion_over: Option<Span>) -> MonitorSpec {
    MonitorSpec::Agreement {
        a: field(A, 1),
        b: field(B, 1),
        max_age: millis(500),
        motion_over,
        rule: AgreementRule::Pose { translation: at_most(0.5, 1.0), rotation_deg: at_most(5.0, 20.0) },
    }
}

#[test]
fn poses_agree_in_place_and_in_rotation() {
    let nan = Pose { x_m: f64::NAN, ..pose(0.0, 0.0) };
    let huge = Pose { qw: 1e200, ..pose(0.0, 0.0) };
    let far = |x_m| Pose { x_m, ..pose(0.0, 0.0) };
    check(
        poses_agree(None),
        &[
            (0, Do::Pose(0, pose(0.0, 179.0)), Unknown, ""),
            (10, Do::Pose(1, pose(0.5, -178.0)), Ok, ""),
            (20, Do::Pose(1, pose(0.6, 179.0)), Warning, "they differ by 0.6 m, at most 0.5 m wanted"),
            (30, Do::Pose(1, pose(0.0, -160.0)), Error, "21 deg, at most 5 deg wanted"),
            (40, Do::Pose(1, Pose::default()), Unknown, "b (/b pose) has a rotation of length zero"),
            (300, Do::Pose(1, nan), Unknown, ""),
            (310, Do::Pose(1, pose(0.0, 179.0)), Ok, ""),
            (320, Do::Pose(1, huge), Unknown, "infinite"),
            (330, Do::Pose(1, far(f64::MAX)), Error, ""),
            (340, Do::Pose(0, far(f64::MIN)), Unknown, ""),
        ],
    );
}

/// Localization at 10 Hz in a turned map and odometry at 50 Hz, both of a drive at 5 m/s.
fn drive(at: u64, jump_m: f64) -> Vec<Do> {
    let metres = at as f64 / 200.0;
    let quarter = std::f64::consts::FRAC_1_SQRT_2;
    let mut happens = vec![Do::Pose(1, pose(metres, 0.0))];
    if at.is_multiple_of(100) {
        let map = Pose {
            x_m: 70.0,
            y_m: 9.0 + metres + jump_m,
            z_m: 1.0,
            qz: quarter,
            qw: quarter,
            ..Pose::default()
        };
        happens.push(Do::Pose(0, map));
    }
    happens
}

#[test]
fn a_localization_is_judged_against_odometry_by_its_motion() {
    let monitor = || poses_agree(Some(millis(1000)));
    let steady = |at| drive(at, 0.0);
    check_every(
        monitor(),
        20,
        500,
        steady,
        &[(500, Do::Nothing, Unknown, "has not been followed for 1 s yet")],
    );
    check_every(monitor(), 20, 1000, steady, &[(1000, Do::Nothing, Ok, "over 1 s their motions differ by")]);
    // A jump of 1.2 m at three seconds shows with the first pose after it, and for one second.
    let jump = |at| drive(at, if at >= 3000 { 1.2 } else { 0.0 });
    check_every(monitor(), 20, 2980, jump, &[(2980, Do::Nothing, Ok, "")]);
    check_every(monitor(), 20, 3000, jump, &[(3000, Do::Nothing, Error, "1.2 m, at most 0.5 m wanted")]);
    check_every(monitor(), 20, 3880, jump, &[(3880, Do::Nothing, Error, "1.2 m")]);
    check_every(monitor(), 20, 4000, jump, &[(4000, Do::Nothing, Ok, "")]);
    // Odometry ends.
    let alone = |at: u64| {
        drive(at, 0.0).into_iter().filter(|what| at <= 3000 || matches!(what, Do::Pose(0, _))).collect()
    };
    check_every(
        monitor(),
        20,
        4000,
        alone,
        &[(4000, Do::Nothing, Unknown, "b (/b pose) is older than 500 ms")],
    );
}

fn expression(error: Condition, warning: Condition) -> MonitorSpec {
    MonitorSpec::Expression {
        inputs: vec![("v".into(), field(A, 0)), ("w".into(), field(B, 0))],
        max_age: millis(500),
        warning: Some(warning),
        error: Some(error),
        class: Class { location: "contextual", information: "content", flow: None },
    }
}

/// A condition on the sum of both values.
fn sum_above(text: &'static str, limit: f64) -> Condition {
    Condition::new(text, move |values| match values {
        [FieldValue::Number(v), FieldValue::Number(w)] => Result::Ok(v + w > limit),
        _ => Err("no such overload".into()),
    })
}

#[test]
fn an_expression_holds_over_the_latest_values() {
    check(
        expression(sum_above("v + w > 10", 10.0), sum_above("v + w > 5", 5.0)),
        &[
            (0, Do::Number(0, 1.0), Unknown, "nothing came yet of w (/b x)"),
            (10, Do::Number(1, 2.0), Ok, "v = 1, w = 2"),
            (20, Do::Number(1, 5.0), Warning, "v + w > 5 holds: v = 1, w = 5"),
            (30, Do::Number(0, 6.0), Error, "v + w > 10 holds: v = 6, w = 5"),
            (40, Do::Value(0, FieldValue::Text("fast".into())), Unknown, "no such overload"),
            (300, Do::Number(0, 0.0), Ok, ""),
            (310, Do::Number(0, f64::NAN), Unknown, "v (/a x) is not a number"),
            (320, Do::Number(0, 0.0), Ok, ""),
            (500, Do::Value(1, FieldValue::Absent), Ok, ""),
            (520, Do::Nothing, Ok, ""),
            (521, Do::Value(1, FieldValue::Absent), Unknown, "w (/b x) is older than 500 ms"),
        ],
    );
}

#[test]
fn what_cannot_be_evaluated_hides_no_error() {
    let fails = || Condition::new("w.x", |_| Err("no such field".into()));
    let both = [(0, Do::Number(0, 9.0)), (1, Do::Number(1, 9.0))];
    for (error, warning, state) in [
        (sum_above("", 10.0), fails(), Error),
        (sum_above("", 99.0), fails(), Unknown),
        (fails(), sum_above("", 10.0), Unknown),
    ] {
        let (mut engine, model) = start(expression(error, warning), Policy::default());
        for (at, what) in &both {
            feed(&mut engine, &model, *at, what);
        }
        assert_eq!(own(&engine.snapshot(), 0).0, state);
    }
}

fn objects(places: &[(f64, f64)]) -> Positions {
    let taken = places.iter().map(|&(x_m, y_m)| Position { x_m, y_m }).collect();
    Positions { taken, count: places.len() as u32 }
}

fn lists_agree(count: Bands, nearest: Bands) -> MonitorSpec {
    MonitorSpec::Agreement {
        a: field(A, 2),
        b: field(B, 2),
        max_age: millis(500),
        motion_over: None,
        rule: AgreementRule::Positions { count, nearest },
    }
}

#[test]
fn lists_agree_in_number_and_in_where_their_objects_are() {
    let one = objects(&[(1.0, 1.0)]);
    check(
        lists_agree(at_most(1.0, 2.0), at_most(0.5, 2.0)),
        &[
            (0, Do::Objects(0, objects(&[])), Unknown, "nothing came yet of b (/b objects)"),
            // Nothing is there, say both.
            (
                100,
                Do::Objects(1, objects(&[])),
                Ok,
                "0 against 0 objects: 0, at most 1 wanted; apart by up to 0 m",
            ),
            // One sees what the other does not: further from a counterpart than any limit.
            (200, Do::Objects(1, one.clone()), Error, "an empty list has no counterpart"),
            (300, Do::Objects(0, objects(&[(1.3, 1.4)])), Ok, "1 against 1 objects"),
            (
                400,
                Do::Objects(0, objects(&[(1.0, 1.6)])),
                Warning,
                "apart by up to 0.6 m, at most 0.5 m wanted",
            ),
            (500, Do::Objects(0, objects(&[(1.0, 3.1)])), Error, "apart by up to 2.1 m"),
            (
                600,
                Do::Objects(0, objects(&[(1.0, 1.0), (1.2, 1.0), (0.9, 1.0)])),
                Warning,
                "3 against 1 objects: 2, at most 1",
            ),
            (650, Do::Objects(1, one.clone()), Warning, ""),
            (700, Do::Objects(0, objects(&[(1.0, 1.0); 4])), Error, "4 against 1 objects: 3, at most 1"),
            (800, Do::Objects(0, objects(&[(1.0, f64::NAN)])), Unknown, ""),
            (900, Do::Objects(0, one.clone()), Ok, ""),
            (1150, Do::Nothing, Ok, ""),
            (1151, Do::Nothing, Unknown, "b (/b objects) is older than 500 ms"),
            (1300, Do::Number(1, 1.0), Unknown, ""),
        ],
    );
}

#[test]
fn of_a_list_that_was_cut_only_the_number_is_known() {
    let many = |count| Positions { taken: vec![Position::default(); POSITIONS_MAX].into(), count };
    check(
        lists_agree(at_most(10.0, 20.0), at_most(0.5, 2.0)),
        &[
            (0, Do::Objects(0, many(300)), Unknown, ""),
            (10, Do::Objects(1, many(300)), Unknown, ""),
            (300, Do::Nothing, Unknown, "of more than 256 the distances are not known"),
            (400, Do::Objects(1, many(330)), Error, "300 against 330 objects: 30, at most 10 wanted"),
            (450, Do::Objects(1, many(256)), Error, ""),
        ],
    );
    check(
        lists_agree(at_most(10.0, 20.0), Bands::default()),
        &[(0, Do::Objects(0, many(300)), Unknown, ""), (10, Do::Objects(1, many(305)), Ok, "")],
    );
    // Without a limit for a warning nothing is worse than the one for an error, and the other way round.
    let only = Bands { warning_above: Some(0.5), ..Bands::default() };
    check(
        lists_agree(Bands::default(), only),
        &[
            (0, Do::Objects(0, objects(&[])), Unknown, ""),
            (10, Do::Objects(1, objects(&[(0.0, 0.0)])), Warning, ""),
        ],
    );
}
