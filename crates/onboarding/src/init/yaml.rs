//! The text of a draft: the configuration, with its evidence as comments.

use std::fmt::Write as _;

use super::draft::{Draft, Group, Module, ModuleKind, NODE_EVERY_S, NODE_MISSES, Transform};
use super::names::{comment, is_full_name, scalar};
use super::passing::Passing;
use super::proposals::{Proposal, Target};
use super::rhythm::duration;
use super::values::Meaning;
use telltale_engine::model::Within;
use telltale_engine::time::Span;

/// Nodes that are listed without a group.
const QUIET_MAX: usize = 40;

/// The configuration. Dependencies that the graph suggests are comments, unless `accept_guesses`.
pub fn text(draft: &Draft, accept_guesses: bool) -> String {
    let mut out = format!(
        "# A first configuration, written by `telltale init` from what it heard in {} s. Limits and timeouts follow from\n\
         # that time alone: what rested then is missing or too strict. Check it with `telltale check`, then change it.\n",
        draft.observed_s
    );
    for note in &draft.notes {
        let _ = writeln!(out, "# {note}");
    }
    out.push_str("\n# A machine without stages: Telltale publishes the diagnosis and nothing else.\n");
    out.push_str("vehicle: { id: robot, name: Robot, stages: none }\n\n");
    if !draft.diagnostics.is_empty() {
        let _ =
            writeln!(out, "diagnostics: {{ topics: [/diagnostics, {}] }}\n", draft.diagnostics.join(", "));
    }
    if !draft.message_folders.is_empty() {
        let folders: Vec<String> = draft.message_folders.iter().map(|it| scalar(it)).collect();
        out.push_str(
            "# Where the types are defined that are not built in; a path may be relative to this file.\n",
        );
        let _ = writeln!(out, "message_folders: [{}]\n", folders.join(", "));
    }
    out.push_str(
        "# A status that has no module below, because it came later, leaves after an hour of silence. Add a module for each\n\
         # that must be there: a module below is never forgotten, and UNKNOWN while it is silent.\n\
         defaults: { timeout: 3s, stale: unknown, forget_after: 1h }\n\n",
    );
    out.push_str("# Statuses that no group takes are a tile of their own.\nother: counted\n\ngroups:\n");
    if draft.groups.is_empty() {
        out.push_str("  # Nothing was heard: this group takes every status that comes.\n");
        out.push_str("  - { id: everything, name: Everything, match: [{ regex: '(?s).*' }] }\n");
    }
    for group in &draft.groups {
        write_group(&mut out, group, accept_guesses);
    }
    write_quiet(&mut out, draft);
    out.push_str(COMPUTER);
    out
}

/// Telltale may be heard from another computer than the robot's, so nothing of this one is in force.
const COMPUTER: &str = "
# The computer on which Telltale runs. If that is the robot's, make it a group of `groups`:
#   - id: computer
#     modules:
#       - { id: processor, monitor: { system: { cpu: used, warning_above: 90, error_above: 98 } }, raise_after: 10s }
#       - { id: memory, monitor: { system: { memory: used, warning_above: 80, error_above: 95 } } }
#       - { id: disk, monitor: { system: { disk: /, warning_above: 85, error_above: 95 } } }
";

/// A configuration that shows every status that was heard, by node, and judges nothing else.
pub fn heard_text(draft: &Draft) -> String {
    let mut out = String::from(
        "# No configuration: everything that is heard is shown, by node. `telltale init` writes a first one.\n\
         vehicle: { id: robot, name: { en: Not configured (telltale init), de: Nicht eingerichtet (telltale init) }, stages: none }\n",
    );
    if !draft.diagnostics.is_empty() {
        let _ = writeln!(out, "diagnostics: {{ topics: [/diagnostics, {}] }}", draft.diagnostics.join(", "));
    }
    out.push_str("defaults: { timeout: 10s, stale: unknown, forget_after: 10m }\nother: counted\ngroups:\n");
    let is_heard =
        |group: &&Group| !(group.namespaces.is_empty() && group.names.is_empty() && group.passing.is_empty());
    let heard = draft.groups.iter().filter(is_heard);
    let mut any = false;
    for group in heard {
        let _ = writeln!(
            out,
            "  - {{ id: {}, name: {}, match: [{}] }}",
            group.id,
            scalar(&group.title),
            filters(group, true)
        );
        any = true;
    }
    if !any {
        out.push_str("  - { id: everything, name: Everything heard, match: [{ regex: '(?s).*' }] }\n");
    }
    out
}

/// Those that come and go, then by namespace; those with other names are declared, unless `all`.
fn filters(group: &Group, all: bool) -> String {
    let passing = group.passing.iter().map(filter_of_passing);
    let namespaces = group.namespaces.iter().map(|it| format!("{{ namespace: {} }}", scalar(it)));
    let names = group.names.iter().filter(|_| all).map(|it| format!("{{ name: {} }}", scalar(it)));
    passing.chain(namespaces).chain(names).collect::<Vec<_>>().join(", ")
}

fn filter_of_passing(it: &Passing) -> String {
    let (regex, timeout, after) = (scalar(&it.regex), duration(it.timeout_ms), duration(it.forget_after_ms));
    format!("{{ regex: {regex}, timeout: {timeout}, forget_after: {after} }}")
}

pub(crate) fn write_group(out: &mut String, group: &Group, accept_guesses: bool) {
    let _ = writeln!(out, "  # {}", group.about);
    let _ = writeln!(out, "  - id: {}", group.id);
    let _ = writeln!(out, "    name: {}", scalar(&group.title));
    for it in &group.passing {
        let (heard, ended) = (it.heard, it.ended);
        let _ = writeln!(
            out,
            "    # Names such as \"{}\" come and go: {heard} were heard, {ended} of them fell silent, and others followed.",
            comment(&it.example)
        );
    }
    if !(group.namespaces.is_empty() && group.passing.is_empty()) {
        let _ = writeln!(out, "    match: [{}]", filters(group, false));
    }
    if !group.modules.is_empty() {
        out.push_str("    modules:\n");
    }
    for module in &group.modules {
        write_module(out, module, accept_guesses);
    }
    if !group.remarks.is_empty() {
        out.push_str("    # Not judged:\n");
    }
    for remark in &group.remarks {
        let _ = writeln!(out, "    #   {remark}");
    }
    if group.more_remarks > 0 {
        let _ = writeln!(out, "    #   and {} further topics.", group.more_remarks);
    }
    out.push('\n');
}

/// A module with guesses has a line for each key, so that the `#` in front of one can be removed.
pub(crate) fn write_module(out: &mut String, module: &Module, accept_guesses: bool) {
    let _ = writeln!(out, "      # {}", module.about);
    let keys = keys(&module.kind);
    let (circular, open): (Vec<&Proposal>, Vec<&Proposal>) =
        module.proposals.iter().partition(|it| it.circular);
    if !circular.is_empty() {
        out.push_str("      # Not proposed, because it would close a circle:\n");
        write_evidence(out, &circular);
    }
    if open.is_empty() {
        let _ = writeln!(out, "      - {{ id: {}, {} }}", module.id, keys.join(", "));
        return write_comments(out, module);
    }
    let (advice, hash) = match accept_guesses {
        true => ("A guess from the graph, in force as asked:", ""),
        false => ("A guess from the graph. If it is right, remove the `#` in front of `depends_on`:", "# "),
    };
    let _ = writeln!(out, "      # {advice}");
    write_evidence(out, &open);
    let _ = writeln!(out, "      - id: {}", module.id);
    for key in keys {
        let _ = writeln!(out, "        {key}");
    }
    let on: Vec<String> = open.iter().flat_map(|it| &it.on).map(|it| target(it, &module.kind)).collect();
    let _ = writeln!(out, "        {hash}depends_on: [{}]", on.join(", "));
    write_comments(out, module);
}

/// Where the fault of the one or the other may be noticed late, `within` says how far apart they still are one fault.
fn target(Target { name, noticed_s }: &Target, of: &ModuleKind) -> String {
    let apart_s = of.noticed_s().max(*noticed_s);
    match Within::default() {
        Within::Limit(limit) if limit < Span::from_secs(apart_s) => {
            format!("{{ on: {name}, within: {apart_s}s }}")
        }
        Within::Limit(_) | Within::Always => name.clone(),
    }
}

/// Further monitors that a reader may want.
fn write_comments(out: &mut String, module: &Module) {
    write_frozen(out, module);
    let ModuleKind::Rate { topic, transforms, .. } = &module.kind else { return };
    let Some(namespace) = topic.strip_suffix("/tf").filter(|_| !transforms.is_empty()) else { return };
    let of = if namespace.is_empty() { String::new() } else { format!("namespace: {namespace}, ") };
    out.push_str("      # Transforms that came on it. Whether they are old, or of two parents, can be watched, a whole chain at once:\n");
    for Transform { parent, child, rate_hz, warning_ms } in transforms {
        let (id, warning, error) = (child.replace('/', "_"), duration(*warning_ms), duration(2 * warning_ms));
        let _ = writeln!(
            out,
            "      # - {{ id: tf_{id}, monitor: {{ tf: {{ frames: [{parent}, {child}], {of}warning_above: {warning}, error_above: {error} }} }} }}  # {rate_hz:.1} Hz",
        );
    }
}

/// A value that never repeated may be watched for it. A machine at rest may well repeat one, so that is a comment.
fn write_frozen(out: &mut String, module: &Module) {
    let ModuleKind::Rate { topic, type_name, frozen_ms: Some(frozen_ms), .. } = &module.kind else { return };
    let id = module.id.strip_suffix("_rate").unwrap_or(&module.id);
    let (warning, error) = (duration(*frozen_ms), duration(2 * frozen_ms));
    out.push_str("      # No message was like the one before it. Where that holds at rest too, this notices values that freeze:\n");
    let _ = writeln!(
        out,
        "      # - {{ id: {id}_frozen, monitor: {{ frozen: {{ topic: {topic}, type: {type_name}, warning_above: {warning}, \
         error_above: {error} }} }} }}"
    );
}

fn write_evidence(out: &mut String, proposals: &[&Proposal]) {
    for proposal in proposals {
        for evidence in &proposal.evidence {
            let _ = writeln!(out, "      #   {}: {evidence}", proposal.group);
        }
    }
}

fn keys(kind: &ModuleKind) -> Vec<String> {
    match kind {
        ModuleKind::Status { name, timeout_ms } => {
            vec![format!("status: {}", scalar(name)), format!("timeout: {}", duration(*timeout_ms))]
        }
        ModuleKind::Rate { topic, type_name, limits, .. } => vec![format!(
            "monitor: {{ frequency: {{ topic: {topic}, type: {type_name}, window: {}s, warning_below: {}, \
             error_below: {} }} }}",
            limits.window_s, limits.warning_below, limits.error_below
        )],
        ModuleKind::Age { topic, type_name, warning_ms } => vec![format!(
            "monitor: {{ latency: {{ topic: {topic}, type: {type_name}, warning_above: {}, error_above: {} }} }}",
            duration(*warning_ms),
            duration(2 * warning_ms)
        )],
        ModuleKind::Value { topic, type_name, meaning, timeout_ms } => {
            let empty = match (timeout_ms, meaning) {
                (Some(_), _) => "",
                (None, Meaning::Goal) => ", empty: ok",
                (None, _) => ", empty: unknown",
            };
            let rule = meaning.rule();
            let monitor =
                format!("monitor: {{ value: {{ topic: {topic}, type: {type_name}, {rule}{empty} }} }}");
            let timeout = timeout_ms.map(|timeout_ms| format!("timeout: {}", duration(timeout_ms)));
            std::iter::once(monitor).chain(timeout).collect()
        }
        ModuleKind::Node { name, has_lifecycle } => {
            let target = if *has_lifecycle { "lifecycle" } else { "node" };
            vec![format!(
                "monitor: {{ watchdog: {{ {target}: {name}, every: {NODE_EVERY_S}s, misses: {NODE_MISSES} }} }}"
            )]
        }
    }
}

fn write_quiet(out: &mut String, draft: &Draft) {
    let Some(first) = draft.quiet.iter().find(|node| is_full_name(node)) else { return };
    out.push_str("# Nodes without a group: they publish nothing that can be judged, as viewers and some drivers of motors do.\n");
    for node in draft.quiet.iter().take(QUIET_MAX) {
        let _ = writeln!(out, "#   {}", comment(node));
    }
    if let Some(more @ 1..) = draft.quiet.len().checked_sub(QUIET_MAX) {
        let _ = writeln!(out, "#   and {more} more");
    }
    let _ = writeln!(
        out,
        "# To watch that one of them runs: {{ id: runs, monitor: {{ watchdog: {{ node: {first} }} }} }}"
    );
}
