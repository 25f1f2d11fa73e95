//! Why a node shows `ignore`: masked, or not relevant. In the words of the API, for snapshots, streams and replays.

use schemars::JsonSchema;
use serde::Serialize;

use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{NotRelevant, Reason, Snapshot};

/// Why a node shows `ignore`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Why<'a> {
    /// The nodes that explain it.
    Masked { by: Vec<&'a str> },
    /// The vehicle is in a stage, or a signal has a value, in which it does not matter.
    NotRelevant { because: String },
}

impl<'a> Why<'a> {
    /// A reason with the names of a snapshot. At most this number of nodes is named.
    pub fn of(reason: &Reason, snapshot: &'a Snapshot, named_max: usize) -> Why<'a> {
        let name = |&node: &NodeId| &**snapshot.node_name(node);
        match reason {
            Reason::Masked { by } => Why::Masked { by: by.iter().take(named_max).map(name).collect() },
            Reason::NotRelevant(NotRelevant::Stage(stage)) => {
                Why::NotRelevant { because: format!("stage {}", stage.as_str()) }
            }
            Reason::NotRelevant(NotRelevant::Signal { name, value }) => {
                Why::NotRelevant { because: format!("signal {name} {value}") }
            }
        }
    }
}
