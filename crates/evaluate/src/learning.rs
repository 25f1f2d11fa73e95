//! How well dependencies are learned from the trials of a campaign, against which modules fail with each fault alone.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use telltale_engine::model::{Model, ModuleId, NodeId};
use telltale_engine::state::State;
use telltale_learn::{Edge, History, Stretch, closure, closure_with, learn};

use super::machine::{Machine, of_each};
use super::plan::{Injection, Place, Plan};
use super::random::Random;
use super::track::{Track, begun, track};
use super::variant;

/// Numbers of trials: the points of the curve.
pub const CURVE: [u64; 6] = [25, 50, 100, 200, 400, 800];
/// A fault alone lasts so long that all of its effects show.
const ALONE_MS: (u64, u64, u64) = (1_000, 11_000, 15_000);
/// All modules have been well, or not relevant, for so long when a trial begins.
const WELL_BEFORE_MS: i64 = 5_000;
/// Trials lie so far apart that nothing in one explains anything in another.
const APART_MS: i64 = 3_600_000;

/// What the modules reported in each trial.
pub struct Past {
    pub model: Arc<Model>,
    trials: Vec<Vec<Vec<Stretch>>>,
}

impl Past {
    /// Trials of these seeds with the configuration of this number. `only` leaves out the other faults.
    pub fn of(
        machine: &dyn Machine,
        number: u64,
        seeds: Range<u64>,
        only: Option<&[usize]>,
        threads: usize,
    ) -> Past {
        let model = variant::draw(machine.model(), number).0;
        let off = variant::off(&model);
        let engines = [Place::OnItsWay, Place::AtAStop]
            .map(|place| (place, begun(off.clone(), machine.beginning(place))));
        let trials = of_each(&seeds, threads, |seed| {
            let plan = draw(machine, seed, only);
            let engine = &engines.iter().find(|(place, _)| *place == plan.place).expect("both").1;
            let history = machine.history(plan.place, &plan.injections, plan.length_ms);
            stretches(&model, &track(engine, &history), plan.length_ms)
        });
        Past { model, trials }
    }

    /// Some of them, one after the other.
    pub fn part(&self, trials: Range<usize>) -> History {
        let trials = || self.trials.iter().enumerate().skip(trials.start).take(trials.len());
        let module = |module: usize| {
            let all = trials().flat_map(|(index, trial)| {
                trial[module].iter().map(move |it| moved(it, index as i64 * APART_MS))
            });
            all.collect()
        };
        History { modules: (0..self.model.modules.len()).map(module).collect(), facts: Vec::new() }
    }

    /// All trials without a gap, and the past of each module turned by a time of its own, far from that of every other:
    /// nothing fails because something else does.
    pub fn shuffled(&self, seed: u64) -> History {
        let length = |trial: &Vec<Vec<Stretch>>| trial[0].last().map_or(0, |it| it.to_ms) + WELL_BEFORE_MS;
        let whole: i64 = self.trials.iter().map(length).sum();
        let apart = whole / self.model.modules.len().max(1) as i64;
        let mut random = Random::new(seed, 5);
        let mut module = |module: usize| {
            let by = apart * module as i64 + random.below((apart / 2).max(1) as usize) as i64;
            let mut zero = by;
            let mut turned: Vec<Stretch> = Vec::new();
            for trial in &self.trials {
                turned.extend(trial[module].iter().map(|it| moved(it, zero % whole)));
                zero += length(trial);
            }
            turned.sort_by_key(|it| it.from_ms);
            turned
        };
        History { modules: (0..self.model.modules.len()).map(&mut module).collect(), facts: Vec::new() }
    }
}

fn moved(stretch: &Stretch, by_ms: i64) -> Stretch {
    Stretch { from_ms: stretch.from_ms + by_ms, to_ms: stretch.to_ms + by_ms, own: stretch.own }
}

fn draw(machine: &dyn Machine, seed: u64, only: Option<&[usize]>) -> Plan {
    let Some(only) = only else { return Plan::draw(seed, machine.faults()) };
    let faults: Vec<_> = only.iter().map(|index| machine.faults()[*index].clone()).collect();
    let mut plan = Plan::draw(seed, &faults);
    plan.injections.iter_mut().for_each(|it| it.fault = only[it.fault]);
    plan
}

fn stretches(model: &Model, track: &Track, length_ms: u64) -> Vec<Vec<Stretch>> {
    let of_module = |index: usize| {
        let mut all: Vec<Stretch> = Vec::new();
        for (ms, snapshot) in &track.0 {
            // Nothing is masked, so IGNORE means not relevant.
            let own = snapshot.shown(NodeId::Module(ModuleId(index as u32))).0;
            let from_ms = *ms as i64;
            match all.last_mut() {
                Some(last) if last.own == own => {}
                Some(last) => {
                    last.to_ms = from_ms;
                    all.push(Stretch { from_ms, to_ms: from_ms, own });
                }
                None => all.push(Stretch { from_ms: -WELL_BEFORE_MS, to_ms: from_ms, own }),
            }
        }
        if let Some(last) = all.last_mut() {
            last.to_ms = length_ms as i64;
        }
        all
    };
    (0..model.modules.len()).map(of_module).collect()
}

/// Which modules a fault breaks, and which fail because of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Effect {
    pub broken: BTreeSet<usize>,
    pub follow: BTreeSet<usize>,
}

/// The effects of a machine's faults, each alone, at both places.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Effects(pub Vec<Effect>);

impl Effects {
    pub fn of(machine: &dyn Machine) -> Effects {
        let model = machine.model();
        let off = variant::off(model);
        let names: BTreeMap<&str, usize> =
            model.modules.iter().enumerate().map(|(index, it)| (&*it.id, index)).collect();
        let truth = machine.faults().iter().map(|fault| Effect {
            broken: fault.truth.iter().filter_map(|name| names.get(&**name).copied()).collect(),
            follow: BTreeSet::new(),
        });
        let mut all: Vec<Effect> = truth.collect();
        for place in [Place::OnItsWay, Place::AtAStop] {
            let engine = begun(off.clone(), machine.beginning(place));
            for (fault, effect) in all.iter_mut().enumerate() {
                let (from, to, length) = ALONE_MS;
                let alone = Injection { fault, spells: vec![(from, to)] };
                let track = track(&engine, &machine.history(place, &[alone], length));
                let failed = |index: &usize| {
                    let own = |ms: u64| track.at(ms).own(NodeId::Module(ModuleId(*index as u32)));
                    let is_worse = |(ms, _): &(u64, _)| (from..to).contains(ms) && own(*ms) > State::Ok;
                    own(from) == State::Ok && track.0.iter().any(is_worse)
                };
                let failed: BTreeSet<usize> = (0..model.modules.len()).filter(failed).collect();
                if failed.intersection(&effect.broken).next().is_some() {
                    effect.follow.extend(failed.difference(&effect.broken));
                }
            }
        }
        Effects(all)
    }

    /// The faults that have no effect.
    pub fn without(&self) -> Vec<usize> {
        (0..self.0.len()).filter(|fault| self.0[*fault].follow.is_empty()).collect()
    }

    pub fn follows(&self, cause: usize, dependent: usize) -> bool {
        self.0.iter().any(|it| it.broken.contains(&cause) && it.follow.contains(&dependent))
    }

    /// Effects that one closure has and another one has not.
    fn beyond(&self, whole: &[Vec<bool>], rest: &[Vec<bool>]) -> Vec<(usize, usize)> {
        let pairs = (0..rest.len()).flat_map(|one| (0..rest.len()).map(move |other| (one, other)));
        pairs.filter(|&(a, b)| whole[a][b] && !rest[a][b] && self.follows(a, b)).collect()
    }

    fn is_one_component(&self, one: usize, other: usize) -> bool {
        self.0.iter().any(|it| it.broken.contains(&one) && it.broken.contains(&other))
    }

    /// Each fault with a module that fails because of it, and not because of another fault that it leads to.
    fn direct(&self) -> Vec<(usize, usize)> {
        let is_direct = |fault: usize, dependent: usize| {
            let between = |it: &Effect| {
                it.broken.iter().any(|module| self.0[fault].follow.contains(module))
                    && it.follow.contains(&dependent)
            };
            !self.0.iter().any(between)
        };
        let all = self.0.iter().enumerate();
        let pairs = all.flat_map(|(fault, effect)| effect.follow.iter().map(move |it| (fault, *it)));
        pairs.filter(|(fault, dependent)| is_direct(*fault, *dependent)).collect()
    }

    pub fn score(&self, learned: &[Edge]) -> Score {
        let direct = self.direct();
        let mut score = Score { known: direct.len() as u64, ..Score::default() };
        let pairs: Vec<(usize, usize)> =
            learned.iter().map(|it| (it.cause.0 as usize, it.dependent.0 as usize)).collect();
        let breaks = |fault: usize, cause: usize| self.0[fault].broken.contains(&cause);
        for (cause, dependent) in &pairs {
            // Two modules of one component notice the same fault. They are counted apart.
            if self.is_one_component(*cause, *dependent) {
                score.together += 1;
                continue;
            }
            score.learned += 1;
            score.right += u64::from(self.follows(*cause, *dependent));
            score.direct += u64::from(direct.iter().any(|it| it.1 == *dependent && breaks(it.0, *cause)));
            score.reversed += u64::from(self.follows(*dependent, *cause));
        }
        let found =
            direct.iter().filter(|it| pairs.iter().any(|pair| pair.1 == it.1 && breaks(it.0, pair.0)));
        score.found = found.count() as u64;
        score
    }
}

/// Learned edges against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Score {
    /// Without those between two modules of one broken component.
    pub learned: u64,
    pub together: u64,
    /// The dependent fails because of the cause, directly or by way of others.
    pub right: u64,
    pub direct: u64,
    pub reversed: u64,
    /// Direct effects that there are, and that were learned.
    pub known: u64,
    pub found: u64,
}

impl std::ops::AddAssign for Score {
    fn add_assign(&mut self, other: Score) {
        self.learned += other.learned;
        self.together += other.together;
        self.right += other.right;
        self.direct += other.direct;
        self.reversed += other.reversed;
        self.known += other.known;
        self.found += other.found;
    }
}

/// Some of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Part {
    pub part: u64,
    pub whole: u64,
}

impl Part {
    fn add(&mut self, is_part: bool) {
        self.part += u64::from(is_part);
        self.whole += 1;
    }
}

/// How well a machine's dependencies are learned.
#[derive(Debug, Clone, PartialEq)]
pub struct Learning {
    pub machine: &'static str,
    pub seeds: Range<u64>,
    /// By the number of trials: how many pasts of so many trials there are, and the sum of their scores.
    pub curve: Vec<(u64, u64, Score)>,
    /// With drawn configurations, each from a past of [`TRIALS`].
    pub drawn: Score,
    pub pasts_drawn: u64,
    /// Dependencies that were hidden, one at a time, where the configuration then lacks an effect; and how many the
    /// proposals restore.
    pub hidden: Part,
    /// Proposals to remove or narrow a shipped dependency, from all trials; and how many are right.
    pub doubted: Part,
    /// Pasts with faults that have no effect; and how many of them taught anything.
    pub independent: Part,
    /// The same for pasts with the times of each module shifted against those of the others.
    pub shuffled: Part,
}

/// Trials of a past for everything but the curve.
pub const TRIALS: u64 = 200;
const SHUFFLES: u64 = 20;
/// Of the drawn configurations, every third.
const EACH_DRAWN: usize = 3;

/// Learns from the trials of these seeds, and compares.
pub fn measure(machine: &dyn Machine, seeds: Range<u64>, threads: usize) -> Learning {
    let effects = Effects::of(machine);
    let past = Past::of(machine, 0, seeds.clone(), None, threads);
    let model = &past.model;
    let all = seeds.end - seeds.start;
    let few = seeds.start..seeds.end.min(seeds.start + TRIALS);
    let blocks =
        |trials: u64| (0..all / trials).map(move |it| (it * trials) as usize..((it + 1) * trials) as usize);
    let learned = |trials: Range<usize>| learn(&past.part(trials), model);
    let point = |trials: &u64| {
        let mut sum = Score::default();
        blocks(*trials).for_each(|it| sum += effects.score(&learned(it).learned));
        (*trials, all / trials, sum)
    };
    let curve = CURVE.iter().filter(|trials| **trials <= all).map(point).collect();
    let mut drawn = Score::default();
    let numbers = || (1..variant::count()).step_by(EACH_DRAWN);
    for number in numbers() {
        let past = Past::of(machine, number, few.clone(), None, threads);
        drawn += effects.score(&learn(&past.part(0..TRIALS as usize), &past.model).learned);
    }
    let mut hidden = Part::default();
    let whole = closure(model);
    for past in blocks(TRIALS.min(all)).map(&learned) {
        for without in variant::without_each(model) {
            let lost = effects.beyond(&whole, &closure(&without));
            if !lost.is_empty() {
                let restored = closure_with(&without, &past.learned);
                hidden.add(lost.iter().all(|(cause, dependent)| restored[*cause][*dependent]));
            }
        }
    }
    let mut doubted = Part::default();
    for doubt in &learned(0..all as usize).doubted {
        let waiting = telltale_learn::modules_of(model, doubt.node);
        let has_effect = |edge: &Edge| waiting.iter().any(|it| effects.follows(edge.cause.0 as usize, *it));
        doubt.edges.iter().for_each(|edge| doubted.add(!has_effect(edge)));
    }
    let is_any = |history: &History| {
        let found = learn(history, model);
        !found.learned.is_empty() || !found.undecided.is_empty()
    };
    let (mut independent, mut shuffled) = (Part::default(), Part::default());
    let without = Past::of(machine, 0, seeds.clone(), Some(&effects.without()), threads);
    blocks(TRIALS.min(all)).for_each(|it| independent.add(is_any(&without.part(it))));
    (0..SHUFFLES).for_each(|it| shuffled.add(is_any(&past.shuffled(seeds.start + it))));
    Learning {
        machine: machine.name(),
        seeds,
        curve,
        drawn,
        pasts_drawn: numbers().count() as u64,
        hidden,
        doubted,
        independent,
        shuffled,
    }
}
