//! What becomes of the statuses that no group takes, as it is written: a word, or a map.

use super::filters::Pattern;
use super::policy::Policy;
use crate::decode::FromNode;
use crate::fields::Fields;
use telltale_engine::model::Other;
use telltale_engine::state::State;
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::schema::{default, one_of, words};
use telltale_yaml::{Log, Members, Node, Schema, key, map};

#[derive(Debug, Default)]
pub(crate) struct RawOther {
    pub show: Option<Other>,
    pub policy: Policy,
    /// Statuses that are dropped.
    pub except: Vec<Pattern>,
    /// As which every report counts.
    pub state: Option<State>,
}

impl FromNode for RawOther {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if scalar(node).is_some() {
            return Other::from_node(node, log)
                .map(|show| RawOther { show: Some(show), ..RawOther::default() });
        }
        let about = "Statuses that no group takes.";
        let mut fields = Fields::of(node, map("other_statuses", "the other statuses").about(about), log)?;
        let show = key("show").rules(|| vec![default(Other::default().as_str())]);
        let except =
            key("except").about("Statuses that are dropped: no group takes them, and neither does `other`.");
        let state = key("state").about("Whatever such a status reports, it counts as this.");
        Some(RawOther {
            show: fields.optional(show),
            policy: Policy::of_filter(&mut fields),
            except: fields.or_default(except),
            state: fields.choice(state, "state of other statuses", &[("error", State::Error)]),
        })
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("other", |schema| one_of([Other::form(schema), schema.decoder(Self::from_node)]))
    }
}

impl FromNode for Other {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "way to treat other statuses", &Other::ALL.map(|other| (other.as_str(), other)))
    }

    fn form(_: &mut Schema) -> Members {
        words(Other::ALL.map(Other::as_str))
    }
}
