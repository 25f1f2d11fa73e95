//! Scenario files: reads them and binds them to the model of a vehicle.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::scenario::{Expectation, Expected, Figure, Repeat, Scenario, Step};
use super::scenario_raw::{Action, Raw, RawExpect, RawFigure, RawStatus, RawStep};
use super::scenario_sample;
use telltale_config::decode::{Entries, FromNode};
use telltale_engine::input::{AlarmRef, Input, NodeOf, OperatorAction, StatusArray, WriterId, WriterList};
use telltale_engine::model::Model;
use telltale_engine::time::Timestamp;
use telltale_yaml::decode::did_you_mean;
use telltale_yaml::{Kind, Log, Node, Problem, Problems, Sources, Span, suggest, tree};

/// Repetitions of all steps together: more are certainly a mistake.
const INPUTS_MAX: u64 = 10_000_000;

/// A scenario file before it is bound to its configuration.
#[derive(Debug)]
pub struct File {
    pub sources: Sources,
    pub name: String,
    pub config: Config,
    /// Whether the vehicle knows its dependencies.
    pub dependencies: bool,
    raw: Raw,
    /// The problems of the file itself; the names in it are checked all the same.
    wrong: Vec<Problem>,
}

#[derive(Debug)]
pub enum Config {
    /// Relative to the working directory if the scenario's path is.
    Path(PathBuf),
    Inline(Node),
}

/// Reads a scenario file.
///
/// # Errors
/// Why nothing can be made of it. Other problems are reported by [`File::bind`].
pub fn load(path: &Path) -> Result<File, Problems> {
    let mut sources = Sources::default();
    match sources.read(path) {
        Ok(file) => of_source(sources, file),
        Err(problem) => Err(Problems::new(sources, vec![problem])),
    }
}

/// Reads a scenario from a text that is called `name` in messages.
///
/// # Errors
/// As [`load`].
pub fn parse(name: &str, text: &str) -> Result<File, Problems> {
    let mut sources = Sources::default();
    let file = sources.add(name, text);
    of_source(sources, file)
}

fn of_source(sources: Sources, file: u16) -> Result<File, Problems> {
    let mut log = Log::default();
    let raw = tree::parse(&sources, file, &mut log).and_then(|node| Raw::from_node(&node, &mut log));
    let wrong = log.into_problems();
    let Some(mut raw) = raw else { return Err(Problems::new(sources, wrong)) };
    let base = Path::new(sources.name(file)).parent().unwrap_or(Path::new(""));
    let config = match raw.config.take() {
        Some(Node { kind: Kind::Scalar { text, .. }, .. }) => Config::Path(base.join(text)),
        Some(node) => Config::Inline(node),
        None => return Err(Problems::new(sources, wrong)),
    };
    let name = raw.name.take().unwrap_or_default();
    Ok(File { name, config, dependencies: raw.dependencies.unwrap_or(true), raw, sources, wrong })
}

impl File {
    /// The problems of the file itself, if there are any.
    pub fn wrong(&self) -> Option<Problems> {
        (!self.wrong.is_empty()).then(|| Problems::new(self.sources.clone(), self.wrong.clone()))
    }

    /// The scenario as it runs on this model.
    ///
    /// # Errors
    /// Its problems, and every name in it that the model does not have.
    pub fn bind(&self, model: &Model) -> Result<Scenario, Problems> {
        let mut log = Log::default();
        let end = self.raw.end();
        let named = self.raw.named_statuses();
        let writers = self.raw.writers();
        let bind = Bind { model, end, named, writers, whole: self.wrong.is_empty() };
        let mut count = 0;
        let mut steps: Vec<Step> = bind.announcement(self.raw.span).into_iter().collect();
        for raw in &self.raw.steps {
            steps.extend(bind.step(raw, &mut count, &mut log));
        }
        let mut expectations = Vec::new();
        for raw in &self.raw.expect {
            bind.expect(raw, &mut expectations, &mut log);
        }
        let figure = bind.figure(self.raw.figure.as_ref(), &expectations, &mut log);
        if log.is_empty() && self.wrong.is_empty() && !self.raw.serves() {
            let problem = Problem::at(self.raw.span, "this scenario expects nothing, so it cannot fail");
            log.push(problem.help(
                "add `expect: [{ at: 1, groups: { NAME: ok } }]`, or `figure: { nodes: [NAME] }` if it is only drawn",
            ));
        }
        let found: Vec<Problem> = self.wrong.iter().cloned().chain(log.into_problems()).collect();
        if found.is_empty() {
            Ok(Scenario { start: self.raw.start, steps, expectations, figure })
        } else {
            Err(Problems::new(self.sources.clone(), found))
        }
    }
}

struct Bind<'a> {
    model: &'a Model,
    /// The last instant that the file names.
    end: Timestamp,
    named: HashSet<&'a str>,
    writers: Vec<&'a str>,
    /// If the file itself has no problems, its times are valid.
    whole: bool,
}

impl Bind<'_> {
    fn step(&self, raw: &RawStep, count: &mut u64, log: &mut Log) -> Option<Step> {
        let at = raw.at?;
        let repeat =
            raw.every.map(|every| Repeat { every: every.value, until: raw.until.unwrap_or(self.end) });
        if let Some(repeat) = repeat {
            *count = count.saturating_add(repeat.until.since(at).as_nanos() / repeat.every.as_nanos().max(1));
            if *count > INPUTS_MAX && self.whole {
                let problem = Problem::at(raw.span, format!("the steps repeat more than {INPUTS_MAX} times"));
                log.push(problem.help("choose a longer `every` or an earlier `until`"));
            }
        }
        let inputs = match raw.action.as_ref()? {
            Action::Statuses(statuses) => vec![self.said(array(statuses), raw)],
            Action::Others(level) => vec![self.said(self.others(*level), raw)],
            Action::Signals(signals) => self.signals(signals, log),
            Action::Operator(action) => {
                self.check_action(action, raw.span, log);
                vec![Input::Operator(action.clone())]
            }
            Action::Sample(raw) => scenario_sample::sample(raw, self.model, log).into_iter().collect(),
            Action::Publishers(raw) => {
                scenario_sample::publishers(raw, self.model, log).into_iter().collect()
            }
            Action::Listeners(raw) => scenario_sample::listeners(raw, self.model, log).into_iter().collect(),
            Action::Probe(raw) => scenario_sample::probes(raw, self.model, log),
            Action::ClockStep(_) => Vec::new(),
        };
        let stamp = match &raw.action {
            Some(Action::Sample(raw)) => raw.stamp.map(|stamp| stamp.value),
            _ => None,
        };
        let clock_step_ns = if let Some(Action::ClockStep(nanos)) = raw.action { nanos } else { 0 };
        Some(Step { span: raw.span, at, repeat, inputs, stamp, clock_step_ns, refused: raw.refused })
    }

    /// The nodes of the writers that steps name, known from the start.
    fn announcement(&self, span: Span) -> Option<Step> {
        if self.writers.is_empty() {
            return None;
        }
        let named = |name: &&str| (self.writer(name), NodeOf::Named((*name).into()));
        let list = WriterList { writers: self.writers.iter().map(named).collect(), ..WriterList::default() };
        Some(Step {
            span,
            at: Timestamp::ZERO,
            repeat: None,
            inputs: vec![Input::Writers(Arc::new(list))],
            stamp: None,
            clock_step_ns: 0,
            refused: None,
        })
    }

    /// The writer's id is the number of its node in the file; 0 belongs to no node.
    fn writer(&self, name: &str) -> WriterId {
        let number =
            self.writers.iter().position(|known| *known == name).map_or(0, |index| index as u128 + 1);
        WriterId(number.to_be_bytes())
    }

    fn said(&self, array: StatusArray, step: &RawStep) -> Input {
        let writer = step.writer.as_ref().map(|name| self.writer(name));
        Input::Diagnostics(array.said_by(writer.unwrap_or_default()))
    }

    /// Every declared status that no step names.
    fn others(&self, level: u8) -> StatusArray {
        let mut array = StatusArray::default();
        let mut seen = self.named.clone();
        for module in &self.model.modules {
            if let Some(status) = module.monitor.status()
                && seen.insert(status)
            {
                array.push_status(level, status, "", "");
            }
        }
        array
    }

    /// A name that is acknowledged must be a node.
    fn check_action(&self, action: &OperatorAction, span: Span, log: &mut Log) {
        if let OperatorAction::Acknowledge { alarm: AlarmRef::Node(name) } = action {
            self.check_node(name, span, log);
        }
    }

    fn signals(&self, signals: &Entries<bool>, log: &mut Log) -> Vec<Input> {
        let mut inputs = Vec::new();
        for (key, value) in &signals.0 {
            self.check_signal(&key.text, key.span, log);
            inputs.push(Input::Signal { name: key.text.as_str().into(), value: *value });
        }
        inputs
    }

    fn check_signal(&self, name: &str, span: Span, log: &mut Log) {
        let known = || self.model.signals.iter().map(|signal| &*signal.name);
        if !known().any(|known| known == name) {
            let problem = Problem::at(span, format!("the configuration has no signal `{name}`"));
            let help = suggest(name, known()).map_or("declare it under `signals`".into(), did_you_mean);
            log.push(problem.help(help));
        }
    }

    fn expect(&self, raw: &RawExpect, expectations: &mut Vec<Expectation>, log: &mut Log) {
        let Some(at) = raw.at else { return };
        for (span, what) in &raw.what {
            match what {
                Expected::Shown(name, _)
                | Expected::Own(name, _)
                | Expected::Why(name, _)
                | Expected::Counts(name, ..) => {
                    self.check_node(name, *span, log);
                }
                Expected::Roots(name, names) => {
                    self.check_node(name, *span, log);
                    names.iter().for_each(|name| self.check_node(name, *span, log));
                }
                Expected::Ranking(names) => names.iter().for_each(|name| self.check_node(name, *span, log)),
                Expected::ActiveAlarms(alarms) => {
                    alarms.iter().for_each(|(_, name)| self.check_node(name, *span, log));
                }
                Expected::Destination(Some(stop)) => self.check_stop(stop, *span, log),
                Expected::Stage(_)
                | Expected::Overall(_)
                | Expected::Moving(_)
                | Expected::Destination(None)
                | Expected::Alarms(_)
                | Expected::Countermeasure(_) => {}
            }
            expectations.push(Expectation { span: *span, at, what: what.clone() });
        }
    }

    fn check_stop(&self, name: &str, span: Span, log: &mut Log) {
        let known = || self.model.driving.stops.iter().map(|stop| &*stop.id);
        if !known().any(|known| known == name) {
            let problem = Problem::at(span, format!("the configuration has no stop `{name}`"));
            let help = suggest(name, known()).map_or("declare it under `stops`".into(), did_you_mean);
            log.push(problem.help(help));
        }
    }

    /// Without a list of nodes: the nodes whose states the file expects, in the order in which they are
    /// first named.
    fn figure(&self, raw: Option<&RawFigure>, expectations: &[Expectation], log: &mut Log) -> Figure {
        let none = RawFigure::default();
        let raw = raw.unwrap_or(&none);
        for name in raw.nodes.iter().flatten() {
            self.check_node(&name.value, name.span, log);
        }
        for name in &raw.signals {
            self.check_signal(&name.value, name.span, log);
        }
        let mut nodes: Vec<String> = raw.nodes.iter().flatten().map(|name| name.value.clone()).collect();
        if raw.nodes.is_none() {
            for expectation in expectations {
                if let Expected::Shown(name, _) | Expected::Own(name, _) = &expectation.what
                    && !nodes.contains(name)
                {
                    nodes.push(name.clone());
                }
            }
        }
        Figure {
            nodes,
            signals: raw.signals.iter().map(|name| name.value.clone()).collect(),
            from: raw.from.unwrap_or(Timestamp::ZERO),
            to: raw.to.unwrap_or(self.end),
            zero: raw.zero.map(|zero| (zero, raw.event.clone().unwrap_or_default())),
        }
    }

    /// A node is declared, or can be created in a group with filters.
    fn check_node(&self, name: &str, span: Span, log: &mut Log) {
        let groups = || self.model.groups.iter().map(|group| &*group.path).chain(["other", "telltale"]);
        let known = || groups().chain(self.model.modules.iter().map(|module| &*module.id));
        let inside = |path: &str| name.strip_prefix(path).is_some_and(|rest| rest.starts_with('/'));
        let mut takers = self.model.groups.iter().filter(|group| !group.filters.is_empty());
        let made = takers.any(|group| inside(&group.path)) || inside("other") || inside("telltale");
        if made || known().any(|known| known == name) {
            return;
        }
        let problem = Problem::at(span, format!("the configuration has no group or module `{name}`"));
        let help = suggest(name, known()).map_or("write the full name".into(), did_you_mean);
        log.push(problem.help(help));
    }
}

fn array(statuses: &[RawStatus]) -> StatusArray {
    let mut array = StatusArray::default();
    for status in statuses {
        array.push_status(status.level, &status.name, &status.message, &status.hardware_id);
        for (key, value) in &status.values {
            array.push_value(key, value);
        }
    }
    array
}
