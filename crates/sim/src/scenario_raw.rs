//! The keys of a scenario file as they are written, with their places.

use std::collections::HashSet;

use super::scenario::{Expected, IgnoreReason, why_word};
use super::scenario_operator::operator;
use super::scenario_sample::{RawListeners, RawProbe, RawPublishers, RawSample, Stamp};
use telltale_config::decode::{Entries, FromNode, Spanned};
use telltale_config::fields::Fields;
use telltale_engine::input::OperatorAction;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::snapshot::Moving;
use telltale_engine::state::State;
use telltale_engine::time::{self, Timestamp};
use telltale_yaml::decode::{scalar, scaled, word};
use telltale_yaml::{Kind, Log, Node, Problem, Span};

#[derive(Debug)]
pub(super) struct Raw {
    /// The file as a whole.
    pub span: Span,
    pub name: Option<String>,
    pub config: Option<Node>,
    pub dependencies: Option<bool>,
    pub start: Option<Stage>,
    pub steps: Vec<RawStep>,
    pub expect: Vec<RawExpect>,
    pub figure: Option<RawFigure>,
}

impl Raw {
    /// Whether the file expects something or draws something.
    pub fn serves(&self) -> bool {
        let judged = self.steps.iter().any(|step| step.refused.is_some());
        judged || !self.expect.is_empty() || self.figure.is_some()
    }

    /// The nodes that steps name as writers, in the order in which they are first named.
    pub fn writers(&self) -> Vec<&str> {
        let mut writers = Vec::new();
        for name in self.steps.iter().filter_map(|step| step.writer.as_deref()) {
            if !writers.contains(&name) {
                writers.push(name);
            }
        }
        writers
    }

    /// The last instant in the file.
    pub fn end(&self) -> Timestamp {
        let steps = self.steps.iter().flat_map(|step| [step.at, step.until]);
        let expectations = self.expect.iter().map(|expect| expect.at);
        steps.chain(expectations).flatten().max().unwrap_or(Timestamp::ZERO)
    }

    /// Statuses that a step names.
    pub fn named_statuses(&self) -> HashSet<&str> {
        let statuses = self.steps.iter().filter_map(|step| match &step.action {
            Some(Action::Statuses(statuses)) => Some(statuses),
            _ => None,
        });
        statuses.flatten().map(|status| status.name.as_str()).collect()
    }
}

impl FromNode for Raw {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a scenario", log)?;
        let config = fields.node("config").cloned();
        match &config {
            Some(Node { kind: Kind::Mapping(_), .. }) => {}
            Some(node) => drop(String::from_node(node, fields.log)),
            None => fields.needs("config", "`config: ../shuttle.yaml`, or the configuration itself"),
        }
        Some(Raw {
            span: fields.span(),
            config,
            name: fields.required("name"),
            dependencies: fields
                .node("dependencies")
                .and_then(|node| word(node, fields.log, "switch", &[("on", true), ("off", false)])),
            start: fields.optional::<Start>("start").map(|Start(stage)| stage),
            steps: fields.or_default("steps"),
            expect: fields.or_default("expect"),
            figure: fields.optional("figure"),
        })
    }
}

/// The figure of the scenario, for `--figure`.
#[derive(Debug, Default)]
pub(super) struct RawFigure {
    pub nodes: Option<Vec<Spanned<String>>>,
    pub signals: Vec<Spanned<String>>,
    pub from: Option<Timestamp>,
    pub to: Option<Timestamp>,
    pub zero: Option<Timestamp>,
    /// The event at `zero`.
    pub event: Option<String>,
}

impl FromNode for RawFigure {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a figure", log)?;
        let mut instant = |key| fields.optional(key).map(|Seconds(at)| at);
        let (from, to, zero) = (instant("from"), instant("to"), instant("zero"));
        let figure = RawFigure {
            from,
            to,
            zero,
            nodes: fields.optional("nodes"),
            signals: fields.or_default("signals"),
            event: fields.optional("event"),
        };
        if from.zip(to).is_some_and(|(from, to)| from >= to) {
            fields.log.push(
                Problem::at(node.span, "the figure ends before it begins").help("exchange `from` and `to`"),
            );
        }
        if figure.event.is_some() && zero.is_none() {
            fields.log.push(
                Problem::at(node.span, "`event` without `zero`").help("add `zero: 3`, when it happens"),
            );
        }
        Some(figure)
    }
}

struct Start(Stage);

impl FromNode for Start {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a start", log)?;
        fields.needs("stage", "`stage: active`");
        fields.optional("stage").map(Start)
    }
}

#[derive(Debug)]
pub(super) struct RawStep {
    pub span: Span,
    pub at: Option<Timestamp>,
    pub every: Option<Spanned<time::Span>>,
    pub until: Option<Timestamp>,
    pub action: Option<Action>,
    /// The node that publishes the statuses.
    pub writer: Option<String>,
    pub refused: Option<bool>,
}

#[derive(Debug)]
pub(super) enum Action {
    /// One array.
    Statuses(Vec<RawStatus>),
    /// An array of every declared status that no step names.
    Others(u8),
    Signals(Entries<bool>),
    Operator(OperatorAction),
    Sample(RawSample),
    Publishers(RawPublishers),
    Listeners(RawListeners),
    Probe(RawProbe),
    /// Steps the wall clock by this many nanoseconds.
    ClockStep(i64),
}

impl FromNode for RawStep {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a step", log)?;
        let at = fields.required("at").map(|Seconds(at)| at);
        let every: Option<Spanned<Seconds>> = fields.optional("every");
        let until: Option<Spanned<Seconds>> = fields.optional("until");
        let every =
            every.map(|every| Spanned { value: every.value.0.since(Timestamp::ZERO), span: every.span });
        if let Some(every) = every.filter(|every| every.value.is_zero()) {
            fields
                .log
                .push(Problem::at(every.span, "`every` must be above 0").help("for example `every: 0.1`"));
        }
        if let Some(until) = until {
            if fields.key_span("every").is_none() {
                let problem = Problem::at(until.span, "`until` without `every`");
                fields.log.push(problem.help("add `every: 0.1`, or remove `until`"));
            } else if at.is_some_and(|at| until.value.0 < at) {
                fields.log.push(Problem::at(until.span, "`until` is before `at`").help("exchange them"));
            }
        }
        let action = action(&mut fields);
        if let (Some(_), Some(Action::Sample(RawSample { stamp: Some(stamp), .. }))) = (every, &action)
            && matches!(stamp.value, Stamp::At(_))
        {
            let problem = Problem::at(stamp.span, "every one of these messages would have the same stamp");
            fields.log.push(problem.help("write how old each is when it comes: `delay: 0.05`"));
        }
        let refused = fields.optional("refused");
        let writer: Option<Spanned<String>> = fields.optional("writer");
        let says = matches!(action, None | Some(Action::Statuses(_) | Action::Others(_)));
        if let Some(writer) = writer.as_ref().filter(|_| !says) {
            let problem = Problem::at(writer.span, "only a `status`, or `others`, has a `writer`");
            fields.log.push(problem.help("remove `writer`"));
        }
        let writer = writer.map(|writer| writer.value);
        let span = fields.span();
        Some(RawStep { span, at, every, until: until.map(|until| until.value.0), action, writer, refused })
    }
}

fn action(fields: &mut Fields) -> Option<Action> {
    const KINDS: [&str; 9] = [
        "status",
        "others",
        "signal",
        "operator",
        "sample",
        "publishers",
        "listeners",
        "probe",
        "clock_step",
    ];
    let found: Vec<_> = KINDS.into_iter().filter_map(|key| Some((key, fields.node(key)?))).collect();
    let [(key, node)] = found[..] else {
        let problem = Problem::at(fields.span(), format!("a step needs one of {}", KINDS.join(", ")));
        fields.log.push(problem.help("write one step for each thing that happens"));
        return None;
    };
    let log = &mut *fields.log;
    match key {
        "status" if matches!(node.kind, Kind::Sequence(_)) => Vec::from_node(node, log).map(Action::Statuses),
        "status" => RawStatus::from_node(node, log).map(|status| Action::Statuses(vec![status])),
        "others" => level(node, log).map(Action::Others),
        "signal" => Entries::from_node(node, log).map(Action::Signals),
        "operator" => operator(node, log).map(Action::Operator),
        "sample" => RawSample::from_node(node, log).map(Action::Sample),
        "publishers" => RawPublishers::from_node(node, log).map(Action::Publishers),
        "listeners" => RawListeners::from_node(node, log).map(Action::Listeners),
        "probe" => RawProbe::from_node(node, log).map(Action::Probe),
        _ => f64::from_node(node, log).map(|seconds| Action::ClockStep((seconds * 1e9).round() as i64)),
    }
}

#[derive(Debug)]
pub(super) struct RawStatus {
    pub name: String,
    pub level: u8,
    pub message: String,
    pub hardware_id: String,
    pub values: Vec<(String, String)>,
}

impl FromNode for RawStatus {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a status", log)?;
        let name = fields.required("name");
        let found = fields.node("level").and_then(|node| level(node, fields.log));
        fields.needs("level", "`level: ok`");
        let text = |node: Option<&Node>| node.and_then(scalar).unwrap_or_default().to_owned();
        let (message, hardware_id) = (text(fields.node("message")), text(fields.node("hardware_id")));
        let values: Entries<String> = fields.or_default("values");
        let values = values.0.into_iter().map(|(key, value)| (key.text, value)).collect();
        Some(RawStatus { name: name?, level: found?, message, hardware_id, values })
    }
}

/// The byte of `diagnostic_msgs/DiagnosticStatus`.
fn level(node: &Node, log: &mut Log) -> Option<u8> {
    word(node, log, "level", &[("ok", 0), ("warning", 1), ("error", 2), ("stale", 3)])
}

#[derive(Debug)]
pub(super) struct RawExpect {
    pub at: Option<Timestamp>,
    pub what: Vec<(Span, Expected)>,
}

impl FromNode for RawExpect {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "an expectation", log)?;
        let at = fields.required("at").map(|Seconds(at)| at);
        let mut what = Vec::new();
        if let Some(stage) = fields.optional::<Spanned<Stage>>("stage") {
            what.push((stage.span, Expected::Stage(stage.value)));
        }
        if let Some(overall) = fields.optional::<Spanned<StateWord>>("overall") {
            what.push((overall.span, Expected::Overall(overall.value.0)));
        }
        for key in ["groups", "modules"] {
            let states = each::<StateWord>(&mut fields, key);
            what.extend(states.map(|(span, name, StateWord(state))| (span, Expected::Shown(name, state))));
        }
        let own = each::<StateWord>(&mut fields, "own");
        what.extend(own.map(|(span, name, StateWord(state))| (span, Expected::Own(name, state))));
        let roots = each::<Vec<String>>(&mut fields, "roots");
        what.extend(roots.map(|(span, name, roots)| (span, Expected::Roots(name, roots))));
        let reasons = each::<IgnoreReason>(&mut fields, "reasons");
        what.extend(reasons.map(|(span, name, why)| (span, Expected::Why(name, why))));
        let counts = each::<Counts>(&mut fields, "counts");
        what.extend(counts.map(|(span, name, Counts(ok, of))| (span, Expected::Counts(name, ok, of))));
        if let Some(ranking) = fields.optional::<Spanned<Vec<String>>>("ranking") {
            what.push((ranking.span, Expected::Ranking(ranking.value)));
        }
        if let Some(alarms) = fields.optional::<Spanned<u64>>("alarms") {
            what.push((alarms.span, Expected::Alarms(alarms.value)));
        }
        if let Some(alarms) = fields.optional::<Spanned<Entries<String>>>("active_alarms") {
            let named = alarms.value.0.into_iter().map(|(number, node)| (number.text, node));
            what.push((alarms.span, Expected::ActiveAlarms(named.collect())));
        }
        if let Some(node) = fields.node("countermeasure") {
            let words = [("none", None), ("notify", Some(RequestKind::Notify))];
            let words = words.into_iter().chain(
                [RequestKind::ManeuverStop, RequestKind::Decelerate].map(|it| (it.as_str(), Some(it))),
            );
            let kind = word(node, fields.log, "countermeasure", &words.collect::<Vec<_>>());
            what.extend(kind.map(|kind| (node.span, Expected::Countermeasure(kind))));
        }
        if let Some(node) = fields.node("motion") {
            let moving = word(node, fields.log, "motion", &Moving::ALL.map(|it| (it.as_str(), it)));
            what.extend(moving.map(|moving| (node.span, Expected::Moving(moving))));
        }
        if let Some(stop) = fields.optional::<Spanned<String>>("destination") {
            let named = (stop.value != "none").then_some(stop.value);
            what.push((stop.span, Expected::Destination(named)));
        }
        if matches!(&node.kind, Kind::Mapping(entries) if entries.len() < 2) {
            let problem = Problem::at(fields.span(), "this expects nothing");
            fields.log.push(problem.help("add `groups: { sensors: error }`, or remove it"));
        }
        Some(RawExpect { at, what })
    }
}

/// The entries of a key whose values belong to nodes, each with the place of its name.
fn each<T: FromNode>(
    fields: &mut Fields,
    key: &'static str,
) -> impl Iterator<Item = (Span, String, T)> + use<T> {
    let entries: Entries<T> = fields.or_default(key);
    entries.0.into_iter().map(|(key, value)| (key.span, key.text, value))
}

struct StateWord(State);

impl FromNode for StateWord {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "state", &State::ALL.map(|state| (state.as_str(), state))).map(StateWord)
    }
}

impl FromNode for IgnoreReason {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let words = [IgnoreReason::None, IgnoreReason::Masked, IgnoreReason::NotRelevant]
            .map(|why| (why_word(why), why));
        word(node, log, "reason", &words)
    }
}

/// "ok/counted".
struct Counts(u32, u32);

impl FromNode for Counts {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let parts = scalar(node).and_then(|text| text.split_once('/'));
        let counts =
            parts.and_then(|(ok, of)| Some(Counts(ok.trim().parse().ok()?, of.trim().parse().ok()?)));
        if counts.is_none() {
            let problem = Problem::at(node.span, format!("expected a count, found {}", node.describe()));
            log.push(problem.help("write how many are OK of how many that count: `2/3`"));
        }
        counts
    }
}

/// An instant in seconds since the start, read exactly.
#[derive(Debug, Clone, Copy)]
struct Seconds(Timestamp);

impl FromNode for Seconds {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let nanos = scalar(node).and_then(|text| scaled(text, 1_000_000_000));
        if nanos.is_none() {
            let problem = Problem::at(node.span, format!("expected seconds, found {}", node.describe()));
            log.push(problem.help("write a number without a unit, for example `3.5`"));
        }
        nanos.map(|nanos| Seconds(Timestamp::from_nanos(nanos)))
    }
}
