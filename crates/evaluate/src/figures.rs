//! The figures of a campaign: what a rule made of one trial, and of many.

use serde_json::{Map, Value, json};

use super::statistics::{bootstrap, percentile, wilson};

/// What a rule made of one trial, or the sum of many.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Figures {
    /// Faults that the machine's modules could notice.
    pub faults: u64,
    /// Trials in which causes were shown when the first fault ended, and those of them with a true cause on top.
    pub named: u64,
    pub first_right: u64,
    /// Causes that were shown then, and the true ones among them.
    pub causes: u64,
    pub causes_right: u64,
    /// Faults that were there then, and those that were named.
    pub there: u64,
    pub found: u64,
    /// The sum of the places of the first true causes in their lists, from 1, and the number of these.
    pub ranks: u64,
    pub ranked: u64,
    pub alarms: u64,
    pub never_named: u64,
    pub wrong_greens: u64,
    pub wrong_reactions: u64,
    pub wrong_instructions: u64,
    /// Faults that no list of causes and no tile showed for a while, those of them that no cause may explain, and how
    /// long.
    pub hidden: u64,
    pub hidden_beyond_within: u64,
    pub hidden_ms: u64,
    /// From the beginning of each fault until it was named.
    pub time_to_cause_ms: Vec<u64>,
}

impl Figures {
    /// Without the times.
    fn add(&mut self, other: &Figures) {
        self.faults += other.faults;
        self.named += other.named;
        self.first_right += other.first_right;
        self.causes += other.causes;
        self.causes_right += other.causes_right;
        self.there += other.there;
        self.found += other.found;
        self.ranks += other.ranks;
        self.ranked += other.ranked;
        self.alarms += other.alarms;
        self.never_named += other.never_named;
        self.wrong_greens += other.wrong_greens;
        self.wrong_reactions += other.wrong_reactions;
        self.wrong_instructions += other.wrong_instructions;
        self.hidden += other.hidden;
        self.hidden_beyond_within += other.hidden_beyond_within;
        self.hidden_ms += other.hidden_ms;
    }

    /// Something happened that must not.
    pub fn is_wrong(&self) -> bool {
        self.wrong_greens + self.wrong_reactions + self.wrong_instructions + self.hidden_beyond_within > 0
    }

    pub fn sum<'a>(trials: impl IntoIterator<Item = &'a Figures>) -> Figures {
        trials.into_iter().fold(Figures::default(), |mut sum, trial| {
            sum.add(trial);
            sum
        })
    }
}

/// One figure with its interval of 95 %.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figure {
    pub name: &'static str,
    /// `None` where there was nothing to measure.
    pub value: Option<f64>,
    pub low: f64,
    pub high: f64,
}

type Of = fn(&Figures) -> Option<f64>;

const RATIOS: [(&str, Of); 6] = [
    ("first_right", |it| ratio(it.first_right, it.named)),
    ("precision", |it| ratio(it.causes_right, it.causes)),
    ("recall", |it| ratio(it.found, it.there)),
    ("rank", |it| ratio(it.ranks, it.ranked)),
    ("alarms_per_fault", |it| ratio(it.alarms, it.faults)),
    ("never_named", |it| ratio(it.never_named, it.faults)),
];

const HIDDEN_S: (&str, Of) = ("seconds", |it| Some(it.hidden_ms as f64 / 1000.0));

type Count = fn(&Figures) -> u64;

const COUNTS: [(&str, Count); 3] = [
    ("wrong_greens", |it| it.wrong_greens),
    ("wrong_reactions", |it| it.wrong_reactions),
    ("wrong_instructions", |it| it.wrong_instructions),
];

const HIDDEN: [(&str, Count); 2] =
    [("count", |it| it.hidden), ("beyond_within", |it| it.hidden_beyond_within)];

fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// A ratio or a sum over trials, with an interval by drawing trials again.
pub fn measured((name, of): (&'static str, Of), trials: &[Figures]) -> Figure {
    let value = of(&Figures::sum(trials));
    let (low, high) =
        bootstrap(trials.len(), |drawn| of(&Figures::sum(drawn.iter().map(|index| &trials[*index]))));
    Figure { name, value, low, high }
}

/// Events that should not happen, with Wilson's interval: a count of 0 alone says nothing of their rate.
fn counted((name, of): (&'static str, Count), sum: &Figures) -> Figure {
    let (low, high) = wilson(of(sum), sum.faults);
    let faults = sum.faults as f64;
    Figure { name, value: Some(of(sum) as f64), low: low * faults, high: high * faults }
}

fn time((name, share): (&'static str, f64), trials: &[Figures]) -> Figure {
    let times = |drawn: &mut dyn Iterator<Item = usize>| {
        let mut all: Vec<u64> =
            drawn.flat_map(|index| trials[index].time_to_cause_ms.iter().copied()).collect();
        percentile(&mut all, share)
    };
    let value = times(&mut (0..trials.len()));
    let (low, high) = bootstrap(trials.len(), |drawn| times(&mut drawn.iter().copied()));
    Figure { name, value, low, high }
}

pub fn ratios(trials: &[Figures]) -> [Figure; 6] {
    RATIOS.map(|ratio| measured(ratio, trials))
}

pub fn counts(trials: &[Figures]) -> [Figure; 3] {
    let sum = Figures::sum(trials);
    COUNTS.map(|count| counted(count, &sum))
}

pub fn times(trials: &[Figures]) -> [Figure; 2] {
    [("p50", 0.5), ("p95", 0.95)].map(|it| time(it, trials))
}

pub fn hidden(trials: &[Figures]) -> [Figure; 3] {
    let sum = Figures::sum(trials);
    let [count, beyond] = HIDDEN.map(|count| counted(count, &sum));
    [count, beyond, measured(HIDDEN_S, trials)]
}

/// The figures of a rule as the object of `telltale evaluate --json`.
pub fn to_json(trials: &[Figures]) -> Value {
    let mut object = Map::new();
    put(&mut object, &ratios(trials));
    put(&mut object, &counts(trials));
    for (name, figures) in [("time_to_cause_ms", &times(trials)[..]), ("hidden", &hidden(trials)[..])] {
        let mut inner = Map::new();
        put(&mut inner, figures);
        object.insert(name.into(), inner.into());
    }
    object.into()
}

fn put(object: &mut Map<String, Value>, figures: &[Figure]) {
    for Figure { name, value, low, high } in figures {
        object.insert((*name).into(), json!(value.map(rounded)));
        object.insert(format!("{name}_ci"), json!([rounded(*low), rounded(*high)]));
    }
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
