//! The kinds of findings in a configuration.

use super::situation::Situation;
use super::urgency::Behind;
use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::state::State;
use telltale_engine::time::Span;

/// The extent and the result of the examination.
#[derive(Debug, Clone, PartialEq)]
pub struct Soundness {
    pub situations: usize,
    /// The number of judged combinations of a situation and failing modules.
    pub pictures: usize,
    /// Nothing was left out: there are no further findings.
    pub complete: bool,
    /// By kind, then in the order of the configuration.
    pub findings: Vec<Finding>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The node of the condition, dependency or state.
    pub node: NodeId,
    pub what: FindingKind,
    /// An example; none if it concerns every situation.
    pub example: Option<Example>,
}

/// A situation with failing modules that shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    pub situation: Situation,
    pub failing: Vec<ModuleId>,
    /// The state of these modules; all others are OK.
    pub state: State,
}

#[derive(Debug, Clone, PartialEq)]
pub enum FindingKind {
    /// The node is masked without a visible cause: a fault of this program.
    Unexplained,
    /// Entry `dependency` can mask `masked` while no tile gets worse.
    HiddenCause { dependency: usize, masked: NodeId },
    /// Entry `dependency` blocks with every module OK: `on` has no members and is UNKNOWN.
    AlwaysMasked { dependency: usize },
    /// Entry `dependency` can never block.
    DeadDependency { dependency: usize, why: NoEffect },
    /// It compares a later stage with an earlier one, which `source` judges, and does not depend on it.
    NoEarlier { source: NodeId },
    /// Entry `dependency` masks `hidden` in ERROR while `silent` is UNKNOWN because it is silent.
    SilenceHides { dependency: usize, silent: NodeId, hidden: NodeId },
    /// The condition never holds, as long as its signals are known.
    NeverHolds,
    /// The condition has no effect: the enclosing groups' conditions imply it.
    AlwaysHolds,
    /// The group can never show OK.
    NeverOk { why: NoEffect },
    /// Countermeasure `rule` watches the node in stages in which it is never relevant.
    DeadRule { rule: usize },
    /// In the tree for ROS 2 the node would have the same name as its sibling `first`.
    SameName { first: NodeId, name: String },
    /// The tile has the name of the built-in group with this id.
    BuiltInName { built_in: &'static str, name: String },
    /// The vehicle drives and no request to stop is published; it concerns no single node.
    NoStop,
    /// A shuttle without the signal `active`, which tells whether it drives; it concerns no single node.
    NoDrive,
    /// No condition of the module's expression uses this input.
    UnusedInput { input: Box<str> },
    /// A limit in percent on a value from 0 to 1: of the node, or of the signal of this index.
    PercentLimit { signal: Option<usize>, field: Box<str>, limit: f64 },
    /// The name of a status, or a filter without `regex`, is a shell pattern; with the equivalent filter.
    Glob { signal: Option<usize>, text: Box<str>, regex: Option<String> },
    /// The statuses of this filter join the group `first` too.
    SharedStatuses { first: NodeId, statuses: String },
    /// The class of the module is not in the classification.
    NoColumn { flow: bool },
    /// The module `late` may be noticed only `after` this time, and entry `dependency`, on it or of its own, explains
    /// within `limit`.
    LateCause { late: NodeId, after: Span, limit: Span, dependency: usize },
    /// Less urgent faults hide a more urgent one, however late it comes.
    HidesUrgent(Behind),
    /// The window of a rate holds so few messages at its limit that one more or less passes it; and the shortest that does not.
    ShortWindow { window: Span, limit: f64, least: Span },
    /// The condition uses no input: its result is constant.
    Constant { text: Box<str>, holds: bool },
}

/// The reason why a group or a dependency has no effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoEffect {
    NoMembers(NodeId),
    /// It is never relevant in the cases that count.
    NotRelevant(NodeId),
    /// It, or a member that counts, waits for a node that can never be OK.
    Waits(NodeId),
}
