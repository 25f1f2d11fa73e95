//! Trials in real time: the states that the running diagnosis showed, and their figures beside those of the same trials in
//! virtual time.

use std::sync::Arc;

use serde_json::{Value, json};
use telltale_engine::model::Model;

use super::campaign::{Results, alone, of_track};
use super::figures::{self, Figures};
use super::machine::{Machine, of_each};
use super::plan::Plan;
use super::track::{Track, begun};
use super::truth::Present;
use super::variant;

/// A run counts if neither the program nor a message was held up for longer. A module may notice the same fault so much
/// earlier or later than in virtual time: of two faults, this time around the changes of each counts for neither.
pub const HELD_UP_MS: u64 = 200;

/// The states shown in the trial of a seed.
#[derive(Debug)]
pub struct Heard {
    pub seed: u64,
    pub shown: Track,
    /// By an engine that took the same inputs at the same instants and masks nothing.
    pub off: Track,
}

/// The states shown in all trials.
#[derive(Debug, Default)]
pub struct Trials {
    pub heard: Vec<Heard>,
    /// Runs that do not count and were made again, because the computer held up the program or a message.
    pub repeated: u64,
    /// The trials without a run that counts.
    pub left_out: Vec<u64>,
}

/// The figures of the trials that ran in real time. Each list has one entry for each trial, in the order of the seeds.
#[derive(Debug)]
pub struct Live {
    pub seeds: Vec<u64>,
    pub ours: Vec<Figures>,
    /// The same trials in virtual time.
    pub in_virtual_time: Vec<Figures>,
    pub repeated: u64,
    pub left_out: Vec<u64>,
}

/// The configuration of a trial, and the same one without dependencies.
pub fn models(machine: &dyn Machine, seed: u64) -> [Arc<Model>; 2] {
    let (model, _) = variant::draw(machine.model(), variant::of_seed(seed));
    [model.clone(), variant::off(&model)]
}

fn figures_of(machine: &dyn Machine, Heard { seed, shown, off }: &Heard) -> Figures {
    let plan = Plan::draw(*seed, machine.faults());
    let [_, model] = models(machine, *seed);
    let alone = alone(machine, &plan, &begun(model, machine.beginning(plan.place)));
    of_track(&Present::of(&plan, machine.faults(), off, &alone, HELD_UP_MS), shown, off)
}

impl Live {
    pub fn judge(machine: &dyn Machine, results: &Results, trials: Trials, threads: usize) -> Live {
        let Trials { mut heard, repeated, left_out } = trials;
        heard.sort_unstable_by_key(|it| it.seed);
        let seeds: Vec<u64> = heard.iter().map(|it| it.seed).collect();
        let of_seed = |seed: &u64| results.ours[(seed - results.seeds.start) as usize].clone();
        Live {
            ours: of_each(&(0..heard.len() as u64), threads, |at| figures_of(machine, &heard[at as usize])),
            in_virtual_time: seeds.iter().map(of_seed).collect(),
            seeds,
            repeated,
            left_out,
        }
    }

    pub fn to_json(&self) -> Value {
        let wrong = self.seeds.iter().zip(&self.ours).filter(|(_, trial)| trial.is_wrong());
        json!({
            "trials": self.ours.len(),
            "faults": Figures::sum(&self.ours).faults,
            "repeated": self.repeated,
            "left_out": self.left_out,
            "wrong": wrong.map(|(seed, _)| seed).collect::<Vec<_>>(),
            "ours": figures::to_json(&self.ours),
            "in_virtual_time": figures::to_json(&self.in_virtual_time),
        })
    }
}
