//! Learns from the past which module fails when another one fails, and proposes changes of the dependencies.
//!
//! A proposal to add `cause -> dependent` needs failures of the cause that nothing else explains. The dependent has to fail
//! with them more often than by chance, and with few counterexamples. Which of two comes first follows from the
//! counterexamples of the other direction, from what the monitors read, and from when the faults began: each
//! monitor notices late, by a time that its configuration bounds. Nothing here reads a clock or a file.
//!
//! A proposal of a `when` needs a module that is UNKNOWN while a signal has one value, or in a stage, and heard otherwise.

mod configured;
mod lateness;
mod pairs;
mod past;
mod states;
mod statistics;

use telltale_engine::model::{Model, ModuleId, NodeId};

pub use configured::{closure, closure_with, modules_of};
pub use past::{History, Stretch};
pub use states::{About, EPISODES, Episodes, Fact, Silence};
pub use statistics::wilson;

/// How long after a cause its effect may begin, and how long a cause has to last to be evidence for or against one.
/// This is the time in which a cause explains a fault, unless the configuration says another one.
pub const WITHIN_MS: i64 = 5_000;
/// Reports of two modules of one instant may be this far apart.
const JITTER_MS: i64 = 200;
/// So many failures of a cause have to speak for an edge.
pub const SUPPORT: u64 = 5;
/// At most this probability that any of the proposed edges is due to chance.
pub const CHANCE: f64 = 0.01;
/// The dependent fails in more than this share of the cause's failures: the lower end of the interval of 95 %.
pub const SHARE_LEAST: f64 = 0.5;
/// A configured edge is doubted when the upper end is below this: none in 16 failures.
pub const SHARE_DOUBTED: f64 = 0.2;

/// What the past says of one module's failures and another module.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// When the cause failed and the dependent too, in milliseconds since 1970.
    pub examples: Vec<i64>,
    /// When the cause failed and the dependent stayed well.
    pub counterexamples: Vec<i64>,
    /// From the notice of the cause to that of the dependent, for each example. A cause may be noticed last.
    pub delays_ms: Vec<i64>,
    /// How often the dependent begins to fail in a time as long, wherever it lies.
    pub chance: f64,
    /// How probable as many examples are if the two have nothing to do with each other, corrected for the number of pairs.
    pub p: f64,
}

impl Evidence {
    pub fn failures(&self) -> u64 {
        (self.examples.len() + self.counterexamples.len()) as u64
    }

    /// How often the dependent failed with the cause: the share of the cause's failures, and its interval of 95 %.
    pub fn share(&self) -> (f64, f64, f64) {
        let (part, whole) = (self.examples.len() as u64, self.failures());
        let (low, high) = wilson(part, whole);
        (part as f64 / whole.max(1) as f64, low, high)
    }

    /// How many times more often than by chance.
    pub fn lift(&self) -> f64 {
        self.share().0 / self.chance.max(1e-6)
    }
}

/// A failure of `cause` makes `dependent` fail.
#[derive(Debug, Clone, PartialEq)]
pub struct Edge {
    pub cause: ModuleId,
    pub dependent: ModuleId,
    pub evidence: Evidence,
    /// `None` where a configured dependency says which one is the cause.
    pub direction: Option<Direction>,
}

/// Why the one is the cause, and not the other way round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// The cause counts the messages that the dependent reads.
    Feeds,
    /// The dependent failed so often while the cause stayed well.
    Alone(usize),
    /// The cause began earlier, in the middle by so many milliseconds, as the monitors' lateness lets it be estimated.
    Earlier(i64),
}

/// A configured dependency that the past does not support.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    pub node: NodeId,
    /// The position in its dependencies.
    pub index: usize,
    /// What remains of it: nothing, or these modules of the group that it names.
    pub remains: Vec<ModuleId>,
    /// The modules that failed without effect, each with one of the dependents.
    pub edges: Vec<Edge>,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Proposals {
    /// All edges that the past supports and that follow from no others of them, configured or not.
    pub learned: Vec<Edge>,
    /// Positions of those that the configuration lacks, directly and by way of others, once the doubted
    /// ones are gone, and that close no circle.
    pub add: Vec<usize>,
    pub doubted: Vec<Doubt>,
    /// Modules that fail together, and nothing says which one is the cause.
    pub undecided: Vec<(ModuleId, ModuleId)>,
    /// Modules that are silent in some stages, or while a signal has a value.
    pub silences: Vec<Silence>,
}

/// Learns from the past of a model's modules.
pub fn learn(history: &History, model: &Model) -> Proposals {
    learn_within(history, model, &|_| true).expect("it goes on to its end")
}

/// The same while `go_on` permits it: it is asked now and then with the bytes of the evidence so far. `None` if
/// it did not.
pub fn learn_within(history: &History, model: &Model, go_on: &dyn Fn(usize) -> bool) -> Option<Proposals> {
    let learned = pairs::learn(history, model, go_on)?;
    let doubted = configured::doubted(model, &learned);
    let add = configured::missing(model, &doubted, &learned.direct);
    let silences = states::silences(history, model, go_on)?;
    Some(Proposals { add, doubted, undecided: learned.undecided, learned: learned.direct, silences })
}

#[cfg(test)]
mod tests;
