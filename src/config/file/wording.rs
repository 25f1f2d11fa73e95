//! `name` and `help` of a module as they are written: one text, or different texts by level and stage.

use crate::engine::model::Stage;
use crate::engine::model::wording::{ByStage, Wording};
use crate::engine::text::Text;
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem};

/// What the text alone stands for depends on the key.
#[derive(Debug)]
pub(in crate::config) enum RawWording {
    Text(Text),
    Levels(Wording),
}

impl RawWording {
    pub fn resolve(&self, of_text: fn(Text) -> Wording) -> Wording {
        match self {
            RawWording::Text(text) => of_text(text.clone()),
            RawWording::Levels(wording) => wording.clone(),
        }
    }
}

impl FromNode for RawWording {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if is_text(node) {
            return Text::from_node(node, log).map(RawWording::Text);
        }
        let mut fields = Fields::of(node, "words for levels", log)?;
        let wording = Wording {
            warning: fields.or_default("warning"),
            error: fields.or_default("error"),
            unknown: fields.or_default("unknown"),
        };
        let named = ["warning", "error", "unknown"].iter().any(|level| fields.key_span(level).is_some());
        if !named {
            let problem = Problem::at(node.span, "there are words for no level");
            fields.log.push(problem.help("write one text, or `{ warning: ..., error: ..., unknown: ... }`"));
        }
        fields.finish();
        Some(RawWording::Levels(wording))
    }
}

impl FromNode for ByStage {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if is_text(node) {
            return Text::from_node(node, log).map(ByStage::Always);
        }
        let mut fields = Fields::of(node, "words for stages", log)?;
        let stages = [Stage::Localizing, Stage::Standby, Stage::Cleared, Stage::Active];
        let texts: Vec<(Stage, Text)> =
            stages.into_iter().filter_map(|stage| Some((stage, fields.optional(stage.as_str())?))).collect();
        if stages.iter().all(|stage| fields.key_span(stage.as_str()).is_none()) {
            let problem = Problem::at(node.span, "there are words for no stage");
            fields.log.push(problem.help("write one text, or `{ standby: ..., active: ... }`"));
        }
        fields.finish();
        Some(ByStage::In(texts))
    }
}

/// A scalar, or a map of languages.
fn is_text(node: &Node) -> bool {
    match &node.kind {
        Kind::Mapping(entries) => entries.iter().any(|(key, _)| matches!(key.text.as_str(), "en" | "de")),
        _ => true,
    }
}
