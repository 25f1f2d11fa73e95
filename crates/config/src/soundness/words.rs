//! Turns findings into problems with their places.

use super::urgency::Behind;
use super::{Example, Finding, FindingKind, NoEffect};
use crate::describe::places::Places;
use crate::describe::words::{self, span};
use telltale_engine::model::{Model, NodeId, Within};
use telltale_yaml::{Problem, Span};

/// A finding as a problem, with its place.
pub fn problem(model: &Model, places: &Places, finding: &Finding) -> Problem {
    let node = finding.node;
    let place = places.of(node);
    let name = model.node_name(node);
    let dependency = |index: usize| place.depends_on.get(index).copied().unwrap_or(place.id);
    let example = finding.example.as_ref().map_or(String::new(), |example| self::example(model, example));
    let (span, message, help): (Span, String, &str) = match &finding.what {
        FindingKind::Unexplained => (
            place.id,
            format!("`{name}` can be masked without a cause in sight{example}"),
            "this is a fault of telltale: please report it with the configuration",
        ),
        FindingKind::HiddenCause { dependency: index, masked } => (
            dependency(*index),
            format!("`{}` can be masked while no tile gets worse{example}", model.node_name(*masked)),
            "the cause is named in the list of causes only: depend on the redundant group as a whole, or let the group combine the worst",
        ),
        FindingKind::AlwaysMasked { dependency: index } => (
            dependency(*index),
            format!("this masks `{name}` even while every module is OK{example}"),
            "give the group that it names members, or let only `error` mask",
        ),
        FindingKind::DeadDependency { dependency: index, why } => (
            dependency(*index),
            format!("this dependency of `{name}` can never mask: {}", dead(model, *why)),
            "remove it",
        ),
        FindingKind::NoEarlier { source } => {
            let source = model.node_name(*source);
            let message =
                format!("a fault of `{source}` is one of `{name}` too, which compares with what it judges");
            let help = format!("add `depends_on: [{source}]`, so that only the cause is shown");
            return Problem::at(place.id, message).help(help).as_warning();
        }
        FindingKind::SilenceHides { dependency: index, silent, hidden } => {
            let [silent, hidden] = [*silent, *hidden].map(|node| model.node_name(node));
            let message = format!("while `{silent}` is only silent, this hides an ERROR of `{hidden}`");
            let help = format!(
                "give `{silent}` `stale: error`, so that its silence is a fault, or let only `error` mask"
            );
            return Problem::at(dependency(*index), message).help(help).as_warning();
        }
        FindingKind::NeverHolds => (
            place.when.unwrap_or(place.id),
            format!("`{name}` is never relevant while its signals are known"),
            "its own condition and those of the groups around it exclude each other: widen one of them",
        ),
        FindingKind::AlwaysHolds => (
            place.when.unwrap_or(place.id),
            format!("this condition of `{name}` changes nothing"),
            "it holds whenever the groups around it are relevant: remove it",
        ),
        FindingKind::DeadRule { rule } => {
            let watched = model.driving.countermeasures.get(*rule).map_or(&[][..], |rule| &rule.nodes);
            let position = watched.iter().position(|&watched| watched == node);
            let spans = places.rules.get(*rule).zip(position);
            (
                spans.and_then(|(spans, position)| spans.get(position).copied()).unwrap_or(place.id),
                format!("`{name}` is never relevant in the stages of this countermeasure"),
                "remove it there, or name the stages in which it counts",
            )
        }
        FindingKind::SameName { first, name: part } => (
            place.id,
            format!(
                "`{name}` and `{}` are both called \"{part}\" on /diagnostics_agg",
                model.node_name(*first)
            ),
            "give one of them another name: the second is called after the first there, with a number",
        ),
        FindingKind::BuiltInName { built_in, name: called } => (
            place.id,
            format!(
                "`{name}` is called \"{called}\", as the group `{built_in}` that Telltale makes by itself"
            ),
            "give it another name: on the page nobody can tell the two apart, and on /diagnostics_agg the path that programs know the built-in group by may be taken",
        ),
        FindingKind::NoStop => (
            places.stop_off.unwrap_or(place.id),
            "the vehicle drives, and no request to stop is published: the operator's page offers no stop"
                .into(),
            "remove the line, or make sure that it can be stopped in another way",
        ),
        FindingKind::NoDrive if places.stages.is_none() => (
            place.id,
            "this counts as a shuttle, because `vehicle` has no `stages`: it begins locked, and nothing is judged before an operator logs in"
                .into(),
            "write `vehicle: { stages: none }` for a machine that is no shuttle; for a shuttle add `signals: { active: ... }`, which says whether it drives",
        ),
        FindingKind::NoDrive => (
            places.stages.unwrap_or(place.id),
            "nothing says whether this shuttle drives: there is no signal `active`".into(),
            "add `signals: { active: ... }`, or write `vehicle: { stages: none }` for a machine that is no shuttle; until then a held vehicle stays held until it is released",
        ),
        FindingKind::UnusedInput { input } => (
            place.id,
            format!("no condition of `{name}` looks at its input `{input}`"),
            "use it in `error` or `warning`, or remove it",
        ),
        FindingKind::PercentLimit { signal, field, limit } => (
            signal.and_then(|index| places.signals.get(index)).map_or(place.id, |signal| signal.field),
            format!("{} has a limit of {limit}, and `{field}` goes from 0 to 1", owner(model, node, *signal)),
            "write the limit as a fraction: 20 % is `0.2`; a driver that publishes percent is not as its type says",
        ),
        FindingKind::Glob { signal, text, regex } => {
            let span = signal.and_then(|index| places.signals.get(index));
            let message = format!(
                "`{text}` of {} looks like a pattern of file names, and every character stands for itself",
                owner(model, node, *signal)
            );
            let help = match regex {
                Some(regex) => format!("write `regex: '{regex}'`, or leave it if statuses are called so"),
                None => "name the status as it is called; `match` in a group takes several".to_owned(),
            };
            let problem = Problem::at(span.map_or(place.id, |signal| signal.field), message);
            return problem.help(help).as_warning();
        }
        FindingKind::SharedStatuses { first, statuses } => {
            let first = model.node_name(*first);
            let message = format!("statuses with `{statuses}` join `{first}` and `{name}`: both show them");
            let help = format!(
                "add `except: [{{ {statuses} }}]` to the filter of the one that is not meant, or leave it if both are meant"
            );
            return Problem::at(place.id, message).help(help).as_warning();
        }
        FindingKind::NoColumn { flow: true } => (
            place.id,
            format!("`{name}` is isolated and has a flow: the classification has no such column"),
            "what looks at one part alone has no flow: remove `flow`, or write `location: contextual`",
        ),
        FindingKind::NoColumn { flow: false } => (
            place.id,
            format!("`{name}` sets contents against each other and does not say how they flow"),
            "give its `class` a `flow`: `sequential` from an earlier stage to a later one, `parallel` for independent sources; or write `location: isolated`",
        ),
        FindingKind::Constant { text, holds } => {
            let always = if *holds { "always" } else { "never" };
            let help = "compare an input: `... > 0`";
            (
                place.id,
                format!("the condition `{text}` of `{name}` looks at no input: it {always} holds"),
                help,
            )
        }
        FindingKind::LateCause { late, after, limit, dependency: index } => {
            let late = model.node_name(*late);
            let (after, limit) = (span(*after), span(*limit));
            let message = format!(
                "`{late}` may be noticed only after {after}, and this dependency of `{name}` explains within {limit}: one fault may be shown as two"
            );
            let help = format!("write `within: {after}` or more here, or let `{late}` be noticed earlier");
            return Problem::at(dependency(*index), message).help(help).as_warning();
        }
        FindingKind::ShortWindow { window, limit, least } => {
            let message = format!(
                "the window of `{name}`, {}, holds fewer than two messages at its limit of {limit} Hz: each message that comes a little early or late may raise or end an alarm",
                span(*window)
            );
            let help = format!("write `window: {}` or more", span(*least));
            return Problem::at(place.id, message).help(help).as_warning();
        }
        FindingKind::HidesUrgent(behind) => {
            let (message, help) = behind_words(model, behind);
            return Problem::at(dependency(behind.dependency), message).help(help).as_warning();
        }
        FindingKind::NeverOk { why } => {
            let help = match why {
                NoEffect::NoMembers(_) => "give it `modules`, `match` or `groups`, or remove it",
                _ => "let its members be relevant when it is",
            };
            (place.id, format!("`{name}` can never show OK: {}{example}", dead(model, *why)), help)
        }
    };
    let mut problem = Problem::at(span, message).help(help);
    if let FindingKind::SameName { first, .. } = finding.what {
        problem = problem.also(places.of(first).id, "the other one");
    }
    if finding.what == FindingKind::Unexplained { problem } else { problem.as_warning() }
}

/// `localization waits for sensors: 9 less urgent faults stand before localization/tf_map; ...`
pub fn behind(model: &Model, it: &Behind) -> String {
    let (message, help) = behind_words(model, it);
    format!("{message}; {help}")
}

/// What stands before what, and the shortest change.
fn behind_words(model: &Model, it: &Behind) -> (String, String) {
    let dependency = &model.depends_on(it.holder)[it.dependency];
    let (holder, hidden) = (model.node_name(it.holder), model.node_name(NodeId::Module(it.hidden)));
    let on = words::dependency(model, dependency);
    let stand = if it.less_urgent == 1 { "fault stands" } else { "faults stand" };
    let message = format!("{holder} waits for {on}: {} less urgent {stand} before {hidden}", it.less_urgent);
    let is_group = dependency.targets().iter().any(|target| matches!(target, NodeId::Group(_)));
    let help = match (dependency.within, it.only) {
        (Within::Always, _) => "write `within: 5s` in place of `always`".to_owned(),
        (_, Some(only)) => format!("give {} the same urgency", model.node_name(NodeId::Module(only))),
        _ if is_group => "name the modules that it needs in place of the group".to_owned(),
        _ => format!(
            "let only the module that needs them depend on them, or give them the urgency of {hidden}"
        ),
    };
    (message, help)
}

fn example(model: &Model, example: &Example) -> String {
    let failing: Vec<&str> = example.failing.iter().map(|id| &*model.modules[id.0 as usize].id).collect();
    let with = match failing.as_slice() {
        [] => String::new(),
        names => {
            let state = example.state.as_str().to_uppercase();
            format!(", with {} in {state}", names.join(" and "))
        }
    };
    format!(" (in {}{with})", example.situation.describe(model))
}

fn dead(model: &Model, why: NoEffect) -> String {
    match why {
        NoEffect::NoMembers(node) => format!("`{}` has no members", model.node_name(node)),
        NoEffect::NotRelevant(node) => match node {
            NodeId::Group(_) => {
                format!("`{}`, or what is in it, is never relevant then", model.node_name(node))
            }
            NodeId::Module(_) => format!("`{}` is never relevant then", model.node_name(node)),
        },
        NoEffect::Waits(node) => format!("`{}` waits for what is never OK", model.node_name(node)),
    }
}

/// The owner of the limit or the name.
fn owner(model: &Model, node: NodeId, signal: Option<usize>) -> String {
    match signal.and_then(|index| model.signals.get(index)) {
        Some(signal) => format!("signal `{}`", signal.name),
        None => format!("`{}`", model.node_name(node)),
    }
}
