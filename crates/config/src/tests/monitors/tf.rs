//! Tests of monitors of transforms.

use super::{means, wrong};

#[test]
fn a_chain_of_frames_has_limits_of_age() {
    means(
        "tf: { frames: [map, odom, base_link] }",
        "the transforms map -> odom -> base_link: error above 2 s old",
    );
    means(
        "tf: { frames: [base_link, arm/left], namespace: /robot1, warning_above: 100ms, error_above: 1s }",
        "the transforms base_link -> arm/left of /robot1/tf and /robot1/tf_static: warning above 0.1 s old, error above 1 s old",
    );
    means("tf: { frames: [a, b], warning_above: 1s }", "the transforms a -> b: warning above 1 s old");
}

#[test]
fn what_is_no_chain_of_frames_is_refused() {
    wrong(
        "tf: { frames: [map] }",
        &["7: 1 frame, not 2 to 32 (name each frame after its parent: `frames: [map, odom, base_link]`)"],
    );
    wrong("tf: { frames: [map, odom, map] }", &["27: `map` would be above itself (name each frame once)"]);
    wrong(
        "tf: { frames: [/map, 'a b'] }",
        &[
            "16: `/map` begins with `/`, which tf2 leaves out (write `map`)",
            "22: `a b` is no name of a frame (write it as `ros2 run tf2_tools view_frames` does: `base_link`)",
        ],
    );
    wrong(
        "tf: { frames: [a, b], namespace: robot1 }",
        &["34: `robot1` is no namespace (begin with `/`, as in `/robot1`; without it `/tf` is read)"],
    );
}
