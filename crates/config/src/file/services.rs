//! The offered services in the file: `services: { acknowledge: true, reset: { while_driving: true } }`.

use super::forms::with_about;
use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use telltale_yaml::decode::scalar;
use telltale_yaml::schema::{default, one_of};
use telltale_yaml::{Log, Members, Node, Schema, key, map};

/// Each service that is named; without the key, none is offered.
#[derive(Debug, Default)]
pub(crate) struct RawServices {
    pub acknowledge: Option<RawService>,
    pub reset: Option<RawService>,
    pub reload: Option<RawService>,
    pub mark: Option<bool>,
}

impl FromNode for RawServices {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "Services for other ROS 2 nodes, each off unless it is named: every program on the DDS network can call them.";
        let mut fields = Fields::of(node, map("services", "the services").about(about), log)?;
        Some(RawServices {
            acknowledge: fields.optional(
                key("acknowledge").about("~/acknowledge (diagnostic_msgs/srv/AddDiagnostics): takes note of an alarm by its number, or of those of a node by its name."),
            ),
            reset: fields.optional(
                key("reset").about("~/reset (diagnostic_msgs/srv/AddDiagnostics): resets the latched ERROR of a module, `group/module`."),
            ),
            reload: fields.optional(key("reload").about("~/reload (std_srvs/srv/Trigger): reads the configuration again.")),
            mark: fields.optional(key("mark").about("~/mark (std_srvs/srv/Trigger): marks this moment in the recording.").rules(|| vec![default(false)])),
        })
    }
}

/// `true`, `false`, or the conditions.
#[derive(Debug)]
pub(crate) enum RawService {
    Is(bool),
    With(RawOffer),
}

impl FromNode for RawService {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match scalar(node) {
            Some(_) => bool::from_node(node, log).map(RawService::Is),
            None => RawOffer::from_node(node, log).map(RawService::With),
        }
    }

    fn form(schema: &mut Schema) -> Members {
        let forms = [bool::form(schema), RawOffer::form(schema)];
        with_about("Whether it is offered, or under which conditions.", one_of(forms))
    }
}

#[derive(Debug)]
pub(crate) struct RawOffer {
    pub while_driving: Option<Spanned<bool>>,
}

impl FromNode for RawOffer {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("service", "a service"), log)?;
        let while_driving = key("while_driving")
            .about("Whether it is done also while the vehicle is cleared or drives: then its alarms are for its operator.")
            .rules(|| vec![default(false)]);
        Some(RawOffer { while_driving: fields.optional(while_driving) })
    }
}
