//! Tests of monitors of what repeats itself.

use super::{means, wrong};

#[test]
fn what_repeats_itself_has_limits_of_time_and_of_number() {
    means(
        "frozen: { topic: /i, type: sensor_msgs/msg/Image, warning_above: 1s, error_above: 2.5s }",
        "the messages of /i (sensor_msgs/msg/Image): the same for a time warning above 1 s, error above 2.5 s",
    );
    means(
        "frozen: { topic: /o, type: nav_msgs/msg/Odometry, field: pose.pose, repeats_error_above: 9, error_above: 1s }",
        "all in pose.pose of /o (nav_msgs/msg/Odometry): the same for a time error above 1 s; the same again and again error above 9 repetitions",
    );
    means(
        "frozen: { status: computer, key: beat, repeats_warning_above: 0 }",
        "'beat' of the status 'computer': the same again and again warning above 0 repetitions",
    );
}

#[test]
fn what_cannot_be_compared_or_judged_is_refused() {
    wrong(
        "frozen: { topic: /i, type: sensor_msgs/msg/Image }",
        &[
            "9: without a limit this would never be anything but OK (add at least one of warning_above, error_above, repeats_warning_above, repeats_error_above)",
        ],
    );
    wrong(
        "frozen: { error_above: 1s }",
        &["9: it is not said where the value comes from (write `topic` and `type`, or `status` and `key`)"],
    );
    wrong(
        "frozen: { topic: /i, status: s, key: k, error_above: 1s }",
        &[
            "9: the value comes either from a topic or from a status (write `topic` and `type`, or `status` and `key`)",
        ],
    );
    wrong(
        "frozen: { topic: /i, repeats_warning_above: 3, repeats_error_above: 2 }",
        &[
            "69: `repeats_error_above` is below `repeats_warning_above` (exchange the two, or correct one of them)",
        ],
    );
    wrong(
        "frozen: { topic: /i, repeats_error_above: 1000001 }",
        &["43: 1000001 is not between 0 and 1000000 (choose `0` where each of them is a fault)"],
    );
}
