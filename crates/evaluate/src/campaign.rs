//! Runs all trials of a campaign on all cores, and puts their figures together.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use serde_json::{Map, Value, json};
use telltale_engine::Engine;
use telltale_engine::model::{Model, Within};
use telltale_engine::time::Span;

use super::figures::{self, Figures};
use super::judge::{judge, judge_engine};
use super::live::Live;
use super::machine::{Machine, of_each};
use super::plan::{Place, Plan};
use super::rules::{Rule, of_engine, of_modules};
use super::statistics::{holm, mcnemar, wilcoxon};
use super::track::{Track, begun, track};
use super::truth::Present;
use super::variant;

/// How long a cause explains what begins after it, in milliseconds: the points of the curve.
pub const CURVE_MS: [u64; 7] = [500, 1_000, 2_000, 5_000, 10_000, 20_000, 60_000];

/// What came of a campaign. Each list has one entry for each trial, in the order of the seeds.
#[derive(Debug)]
pub struct Results {
    pub machine: &'static str,
    pub seeds: Range<u64>,
    pub ours: Vec<Figures>,
    pub baselines: BTreeMap<Rule, Vec<Figures>>,
    /// Ours by [`CURVE_MS`].
    pub curve: Vec<Vec<Figures>>,
    /// Trials of these seeds that ran in real time.
    pub live: Option<Live>,
}

struct Trial {
    ours: Figures,
    baselines: BTreeMap<Rule, Figures>,
    curve: Vec<Figures>,
}

/// Engines of one configuration and one place after the beginning.
struct Engines {
    model: Arc<Model>,
    ours: Engine,
    off: Engine,
    always: Engine,
    curve: Vec<Option<Engine>>,
}

impl Engines {
    fn new(machine: &dyn Machine, number: u64, place: Place) -> Engines {
        let (model, _) = variant::draw(machine.model(), number);
        let begin = |model: Arc<Model>| begun(model, machine.beginning(place));
        let default_ms = match Within::default() {
            Within::Limit(span) => span.as_millis(),
            Within::Always => u64::MAX,
        };
        let point =
            |ms: u64| (ms != default_ms).then(|| begin(variant::within(&model, Span::from_millis(ms))));
        Engines {
            ours: begin(model.clone()),
            off: begin(variant::off(&model)),
            always: begin(variant::always(&model)),
            curve: CURVE_MS.into_iter().map(point).collect(),
            model: model.clone(),
        }
    }
}

/// Runs the trials of these seeds; `progress` hears how many are done.
pub fn run(
    machine: &dyn Machine,
    seeds: Range<u64>,
    threads: usize,
    progress: &(dyn Fn(u64) + Sync),
) -> Results {
    let prepared: Vec<OnceLock<Engines>> = (0..variant::count() * 2).map(|_| OnceLock::new()).collect();
    let done = AtomicU64::new(0);
    let trials = of_each(&seeds, threads, |seed| {
        let plan = Plan::draw(seed, machine.faults());
        let number = variant::of_seed(seed);
        let index = number * 2 + u64::from(plan.place == Place::AtAStop);
        let engines = prepared[index as usize].get_or_init(|| Engines::new(machine, number, plan.place));
        let trial = trial(machine, &plan, engines);
        progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        trial
    });
    let mut results = Results {
        machine: machine.name(),
        seeds,
        ours: Vec::new(),
        baselines: BTreeMap::new(),
        curve: vec![Vec::new(); CURVE_MS.len()],
        live: None,
    };
    for trial in trials {
        results.ours.push(trial.ours);
        for (rule, figures) in trial.baselines {
            results.baselines.entry(rule).or_default().push(figures);
        }
        results.curve.iter_mut().zip(trial.curve).for_each(|(point, figures)| point.push(figures));
    }
    results
}

fn trial(machine: &dyn Machine, plan: &Plan, engines: &Engines) -> Trial {
    let history = machine.history(plan.place, &plan.injections, plan.length_ms);
    let (ours, off) = (track(&engines.ours, &history), track(&engines.off, &history));
    let present = Present::of(plan, machine.faults(), &off, &alone(machine, plan, &engines.off), 0);
    let of_engine_track = |shown: &Track| of_track(&present, shown, &off);
    let said = |rule: Rule| of_modules(rule, &engines.model, &off);
    let of_rule = |rule: Rule| match rule {
        Rule::Off => of_engine_track(&off),
        Rule::Always => of_engine_track(&track(&engines.always, &history)),
        Rule::Aggregator => judge(&present, &said(rule), Some(&off.0[0].1)),
        Rule::Modules | Rule::Dependent | Rule::Window => judge(&present, &said(rule), None),
    };
    let ours = of_engine_track(&ours);
    let point = |engine: &Option<Engine>| match engine {
        Some(engine) => of_engine_track(&track(engine, &history)),
        None => ours.clone(),
    };
    Trial {
        curve: engines.curve.iter().map(point).collect(),
        baselines: Rule::ALL.into_iter().map(|rule| (rule, of_rule(rule))).collect(),
        ours,
    }
}

/// Each of several faults alone, with nothing masked.
pub(crate) fn alone(machine: &dyn Machine, plan: &Plan, off: &Engine) -> Vec<Track> {
    let Plan { place, injections, length_ms, .. } = plan;
    let each = injections.iter().filter(|_| injections.len() > 1);
    each.map(|it| track(off, &machine.history(*place, std::slice::from_ref(it), *length_ms))).collect()
}

/// What an engine made of a trial. `off` masks nothing.
pub(crate) fn of_track(present: &[Present], shown: &Track, off: &Track) -> Figures {
    let mut figures = judge(present, &of_engine(shown), None);
    judge_engine(present, shown, off, &mut figures);
    figures
}

/// Ours against another rule, trial by trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    pub rule: Rule,
    /// Trials in which only ours, or only the other, had a true cause on top.
    pub only_ours: u64,
    pub only_other: u64,
    /// McNemar's exact test of these, and Wilcoxon's of the times to the cause, both corrected by Holm.
    pub first_right_p: f64,
    pub time_p: f64,
}

impl Results {
    pub fn faults(&self) -> u64 {
        Figures::sum(&self.ours).faults
    }

    /// The first trials with so many faults together; all of them, if there are not so many.
    pub fn first(&self, faults: u64) -> Vec<u64> {
        let mut before = 0;
        let is_wanted = |(_, trial): &(u64, &Figures)| {
            let wanted = before < faults;
            before += trial.faults;
            wanted
        };
        self.seeds.clone().zip(&self.ours).take_while(is_wanted).map(|(seed, _)| seed).collect()
    }

    /// Each rule by its name, ours first.
    pub fn rules(&self) -> impl Iterator<Item = (&'static str, &Vec<Figures>)> {
        let baselines = self.baselines.iter().map(|(rule, trials)| (rule.name(), trials));
        std::iter::once(("ours", &self.ours)).chain(baselines)
    }

    pub fn comparisons(&self) -> Vec<Comparison> {
        let mut all: Vec<Comparison> = Vec::new();
        for (rule, theirs) in &self.baselines {
            let pairs = || self.ours.iter().zip(theirs);
            let is_only = |one: &Figures, other: &Figures| one.first_right == 1 && other.first_right == 0;
            let only_ours = pairs().filter(|(ours, theirs)| is_only(ours, theirs)).count() as u64;
            let only_other = pairs().filter(|(ours, theirs)| is_only(theirs, ours)).count() as u64;
            let same =
                pairs().filter(|(ours, theirs)| ours.time_to_cause_ms.len() == theirs.time_to_cause_ms.len());
            let differences: Vec<f64> = same
                .flat_map(|(ours, theirs)| ours.time_to_cause_ms.iter().zip(&theirs.time_to_cause_ms))
                .map(|(ours, theirs)| *ours as f64 - *theirs as f64)
                .collect();
            let (first_right_p, time_p) = (mcnemar(only_ours, only_other), wilcoxon(&differences));
            all.push(Comparison { rule: *rule, only_ours, only_other, first_right_p, time_p });
        }
        let tests: Vec<f64> = all.iter().flat_map(|it| [it.first_right_p, it.time_p]).collect();
        for (comparison, corrected) in all.iter_mut().zip(holm(&tests).chunks(2)) {
            (comparison.first_right_p, comparison.time_p) = (corrected[0], corrected[1]);
        }
        all
    }

    /// The object of `telltale evaluate --json`.
    pub fn to_json(&self) -> Value {
        let baselines =
            self.baselines.iter().map(|(rule, trials)| (rule.name().into(), figures::to_json(trials)));
        let baselines: Map<String, Value> = baselines.collect();
        let curve = CURVE_MS.iter().zip(&self.curve).map(|(ms, trials)| {
            let [hidden, ..] = figures::hidden(trials);
            let [.., alarms, _] = figures::ratios(trials);
            json!({
                "within_s": *ms as f64 / 1000.0,
                "hidden": hidden.value, "hidden_ci": [hidden.low, hidden.high],
                "alarms_per_fault": alarms.value, "alarms_per_fault_ci": [alarms.low, alarms.high],
            })
        });
        let mut object = json!({
            "machine": self.machine,
            "seeds": [self.seeds.start, self.seeds.end - 1],
            "faults": self.faults(),
            "ours": figures::to_json(&self.ours),
            "baselines": baselines,
            "curve": curve.collect::<Vec<_>>(),
        });
        if let Some(live) = &self.live {
            object["live"] = live.to_json();
        }
        object
    }
}
