//! How a `tf` monitor is written: a chain of frames, each the parent of the next.

use super::Monitor;
use super::bands;
use crate::decode::{All, Spanned};
use crate::fields::Fields;
use crate::file::ros_names::is_full_name;
use telltale_engine::model::monitors::Bands;
use telltale_yaml::schema::pattern;
use telltale_yaml::{Log, Node, Problem, key, map};

/// Each is looked for in every message.
const FRAMES_MAX: usize = 32;
const FRAME_BYTES_MAX: usize = 255;
/// In seconds.
const AGE: f64 = 2.0;

pub(crate) fn tf(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("tf", "a tf monitor").about(
        "The transforms along a chain of frames. Each comes, none is old, and no frame below the first has two parents, which is an ERROR.",
    );
    let mut fields = Fields::of(node, doc, log)?;
    let frames = key("frames")
        .about("At least two, each the parent of the next: `[map, odom, base_link]`.")
        .rules(|| vec![("minItems", 2.into()), ("maxItems", FRAMES_MAX.into())]);
    let frames: Option<All<Spanned<String>>> = fields.required(frames);
    let namespace = key("namespace")
        .about("That of the topics: `/robot1` for `/robot1/tf` and `/robot1/tf_static`.")
        .form(|_| pattern("^(/[A-Za-z_][A-Za-z0-9_]*)+$"));
    let namespace: Option<Spanned<String>> = fields.optional(namespace);
    let about = "The age of a transform by its stamp and the time since it came; without any limit, 2s is the one of an ERROR. A static transform has no age.";
    let mut bands = bands::durations_above(&mut fields, about);
    if bands == Bands::default() {
        bands.error_above = Some(AGE);
    }
    if let Some(wrong) = namespace.as_ref().filter(|it| !is_full_name(&it.value)) {
        let problem = Problem::at(wrong.span, format!("`{}` is no namespace", wrong.value));
        fields.log.push(problem.help("begin with `/`, as in `/robot1`; without it `/tf` is read"));
    }
    let namespace = namespace.filter(|it| is_full_name(&it.value));
    let All(frames) = frames?;
    if !(2..=FRAMES_MAX).contains(&frames.len()) {
        let text =
            format!("{}, not 2 to {FRAMES_MAX}", crate::describe::words::counted(frames.len(), "frame"));
        let problem = Problem::at(fields.key_span("frames").unwrap_or(node.span), text);
        fields.log.push(problem.help("name each frame after its parent: `frames: [map, odom, base_link]`"));
    }
    for (at, frame) in frames.iter().enumerate() {
        check_frame(frame, fields.log);
        if let Some(first) = frames[..at].iter().find(|it| it.value == frame.value) {
            let problem = Problem::at(frame.span, format!("`{}` would be above itself", frame.value));
            fields.log.push(problem.also(first.span, "it stands here already").help("name each frame once"));
        }
    }
    Some(Monitor::Tf { frames, namespace, bands })
}

fn check_frame(frame: &Spanned<String>, log: &mut Log) {
    let name = &frame.value;
    if let Some(bare) = name.strip_prefix('/') {
        let problem = Problem::at(frame.span, format!("`{name}` begins with `/`, which tf2 leaves out"));
        log.push(problem.help(format!("write `{bare}`")));
        return;
    }
    let is_special = |it: char| it.is_whitespace() || it.is_control() || "[]'\"".contains(it);
    if name.len() > FRAME_BYTES_MAX || name.contains(is_special) {
        let problem = Problem::at(frame.span, format!("`{name}` is no name of a frame"));
        log.push(problem.help("write it as `ros2 run tf2_tools view_frames` does: `base_link`"));
    }
}
