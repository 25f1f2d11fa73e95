//! `name` and `help` of a module as they are written: one text, or different texts by level and stage.

use super::forms::with_about;
use crate::engine::model::Stage;
use crate::engine::model::wording::{ByStage, Wording};
use crate::engine::text::Text;
use crate::yaml::schema::one_of;
use crate::yaml::{Fields, FromNode, Kind, Log, Members, Node, Problem, Schema, map};

/// The meaning of a single text depends on the key.
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
        let mut fields = Fields::of(
            node,
            map("levels", "words for levels").rules(|| vec![("minProperties", 1.into())]),
            log,
        )?;
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

    fn form(schema: &mut Schema) -> Members {
        schema.define("wording", |schema| {
            let forms = one_of([Text::form(schema), schema.decoder(Self::from_node)]);
            with_about(
                "One text, or different words for each level; a level without words has general ones.",
                forms,
            )
        })
    }
}

impl FromNode for ByStage {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if is_text(node) {
            return Text::from_node(node, log).map(ByStage::Always);
        }
        let about =
            "Without words of its own, `cleared` has those of `active`, and `localizing` those of `standby`.";
        let doc =
            map("stage_words", "words for stages").about(about).rules(|| vec![("minProperties", 1.into())]);
        let mut fields = Fields::of(node, doc, log)?;
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

    fn form(schema: &mut Schema) -> Members {
        schema.define("stage_wording", |schema| {
            let forms = one_of([Text::form(schema), schema.decoder(Self::from_node)]);
            with_about("One text for every stage, or different words for each.", forms)
        })
    }
}

/// A scalar, or a map of languages.
fn is_text(node: &Node) -> bool {
    match &node.kind {
        Kind::Mapping(entries) => entries.iter().any(|(key, _)| matches!(key.text.as_str(), "en" | "de")),
        _ => true,
    }
}
