//! How a `system` monitor is written: a resource or a process of Telltale's computer, and its limits.

use super::bands::{self, Unit};
use super::{AGE_MAX, Monitor, span};
use crate::decode::Spanned;
use crate::fields::Fields;
use crate::file::forms::default_span;
use telltale_engine::model::monitors::{ProcessMeasure, Resource};
use telltale_engine::time;
use telltale_yaml::schema::{needs_one, pattern, words};
use telltale_yaml::{KeyDoc, Log, Node, Problem, key, map};

const EVERY_MIN: time::Span = time::Span::from_millis(500);
const EVERY: time::Span = time::Span::from_secs(2);
/// A longer path or name is none.
const NAME_BYTES_MAX: usize = 255;

const WORD: &str = "used";
const CPU: KeyDoc =
    key("cpu").about("`used`: what all cores are busy with, in percent.").form(|_| words([WORD]));
const MEMORY: KeyDoc = key("memory")
    .about("`used`: what is not available to a new program, in percent.")
    .form(|_| words([WORD]));
const DISK: KeyDoc = key("disk")
    .about("A path: what is used of its file system, in percent, as `df` counts it.")
    .form(|_| pattern("^/"));
const TEMPERATURE: KeyDoc = key("temperature").about(
    "In °C: the type of a thermal zone, or the name or label of a sensor, as `sensors` has them. Of several the hottest counts.",
);
const PROCESS: KeyDoc = key("process").about(
    "The name of a program without its folder, or of a script that an interpreter runs: whether it runs, an ERROR if it does not. With `measure` also how much it takes, all of its processes together.",
);
const MEASURE: KeyDoc =
    key("measure").about("With `process`: `cpu` in percent of one core, or `memory` in MB.");

pub(crate) fn system(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("system", "a system monitor")
        .about("The computer on which Telltale runs.")
        .rules(|| vec![needs_one(&[&["cpu"], &["memory"], &["disk"], &["temperature"], &["process"]])]);
    let mut fields = Fields::of(node, doc, log)?;
    let resource = resource(&mut fields).map(|resource| resource.value);
    let every = key("every").about("From 500ms to 1h.").rules(|| vec![default_span(EVERY)]);
    let every = span(&mut fields, every, EVERY_MIN, AGE_MAX).unwrap_or(EVERY);
    let unit = match &resource {
        Some(Resource::Cpu | Resource::Memory | Resource::Disk { .. }) => Unit::Percent,
        Some(Resource::Process { .. }) => Unit::Size,
        Some(Resource::Temperature { .. }) | None => Unit::Number,
    };
    let bands = bands::bands(&mut fields, unit);
    let measures = !matches!(resource, Some(Resource::Process { measure: None, .. }));
    match (measures, bands::any(&fields)) {
        (true, false) if resource.is_some() => bands::without_a_limit(node.span, "", fields.log),
        (false, true) => {
            let problem = Problem::at(node.span, "it is not said what of the process has limits");
            fields.log.push(problem.help("add `measure: cpu` or `measure: memory`, or remove the limits"));
        }
        _ => {}
    }
    Some(Monitor::System { resource: resource?, every, bands })
}

/// The one resource that is named.
pub fn resource(fields: &mut Fields) -> Option<Spanned<Resource>> {
    let texts = [CPU, MEMORY, DISK, TEMPERATURE, PROCESS].map(|doc| {
        let text: Option<Spanned<String>> = fields.optional(doc);
        text.map(|text| (doc.name(), text))
    });
    let measures = [("cpu", ProcessMeasure::Cpu), ("memory", ProcessMeasure::Memory)];
    let measure = fields.choice(MEASURE, "measure", &measures);
    let named: Vec<_> = texts.into_iter().flatten().collect();
    let [(kind, text)] = &named[..] else {
        let any = ["cpu", "memory", "disk", "temperature", "process"];
        if named.len() > 1 || any.into_iter().all(|key| fields.key_span(key).is_none()) {
            let problem = Problem::at(
                fields.span(),
                "one of `cpu`, `memory`, `disk`, `temperature`, `process` is measured",
            );
            fields
                .log
                .push(problem.help("for example `cpu: used`, `disk: /var` or `process: planner_server`"));
        }
        return None;
    };
    if let Some(place) = fields.key_span("measure").filter(|_| *kind != "process") {
        let problem = Problem::at(place, "only of a `process` one thing or another is measured");
        fields.log.push(problem.help("remove `measure`"));
    }
    let (value, is_good, help) = match *kind {
        "cpu" => (Resource::Cpu, text.value == WORD, "write `cpu: used`"),
        "memory" => (Resource::Memory, text.value == WORD, "write `memory: used`"),
        "disk" => (
            Resource::Disk { path: text.value.as_str().into() },
            text.value.starts_with('/') && text.value.len() <= NAME_BYTES_MAX,
            "write a path from the root: `/var/log`",
        ),
        "temperature" => (
            Resource::Temperature { sensor: text.value.as_str().into() },
            !text.value.is_empty() && text.value.len() <= NAME_BYTES_MAX,
            "write the name of a sensor: `x86_pkg_temp`",
        ),
        _ => (
            Resource::Process { name: text.value.as_str().into(), measure },
            !text.value.is_empty() && text.value.len() <= NAME_BYTES_MAX && !text.value.contains('/'),
            "write the name of the program without its folder: `planner_server`",
        ),
    };
    if !is_good {
        let problem = Problem::at(text.span, format!("`{}` cannot be measured by `{kind}`", text.value));
        fields.log.push(problem.help(help));
    }
    Some(Spanned { value, span: text.span })
}
