//! The kinds of findings in a configuration.

use super::situation::Situation;
use crate::engine::model::{ModuleId, NodeId};
use crate::engine::state::State;

/// What was looked at, and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Soundness {
    pub situations: usize,
    /// Combinations of a situation and failing modules that were judged.
    pub pictures: usize,
    /// Nothing was left out: what is not among the findings is not there.
    pub complete: bool,
    /// By kind, then in the order of the configuration.
    pub findings: Vec<Finding>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Whose condition, dependency or state it is.
    pub node: NodeId,
    pub what: What,
    /// Where it happens; none where it is about every situation.
    pub example: Option<Example>,
}

/// A situation with failing modules in which it can be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    pub situation: Situation,
    pub failing: Vec<ModuleId>,
    /// What they report; all others are OK.
    pub state: State,
}

#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// The node is masked and nothing that fails in sight is behind it: a fault of this program.
    Unexplained,
    /// Entry `dependency` can mask `masked` while no tile gets worse.
    HiddenCause { dependency: usize, masked: NodeId },
    /// Entry `dependency` blocks with every module OK: `on` has no members and is UNKNOWN.
    AlwaysMasked { dependency: usize },
    /// Entry `dependency` can never block.
    DeadDependency { dependency: usize, why: Dead },
    /// The condition never holds while its signals are known.
    NeverHolds,
    /// The condition changes nothing: what is around it says as much.
    AlwaysHolds,
    /// The group can never show OK.
    NeverOk { why: Dead },
    /// Countermeasure `rule` watches the node in stages in which it is never relevant.
    DeadRule { rule: usize },
    /// In the tree for ROS 2 the node would be called as `first`, which stands beside it.
    SameName { first: NodeId, name: String },
    /// The tile is called as the group of this id, which Telltale makes by itself.
    BuiltInName { built_in: &'static str, name: String },
    /// The vehicle drives and no request to stop is published; it is about no node in particular.
    NoStop,
    /// No condition of the module's expression looks at this input.
    UnusedInput { input: Box<str> },
    /// A limit on a value that goes from 0 to 1 is written in percent: of the node, or of the signal of
    /// this position.
    PercentLimit { signal: Option<usize>, field: Box<str>, limit: f64 },
    /// A name of a status, or a filter that is no `regex`, is a pattern of file names; what to write
    /// instead in a filter.
    Glob { signal: Option<usize>, text: Box<str>, regex: Option<String> },
    /// The class of the module is none that the classification has.
    NoColumn { flow: bool },
    /// The condition looks at no input: it is always so.
    Constant { text: Box<str>, holds: bool },
}

/// Why nothing comes of a group or of what a dependency names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dead {
    NoMembers(NodeId),
    /// It is never relevant when it would matter.
    NotRelevant(NodeId),
    /// It, or a member that counts, waits for what never can be OK.
    Waits(NodeId),
}
