//! `name` and `help` of a module in the file: one text, or different texts by level and stage.

use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use crate::file::forms::with_about;
use crate::file::languages;
use telltale_engine::model::Stage;
use telltale_engine::model::wording::{Advice, ByStage, Urgency, Wording};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_yaml::decode::word;
use telltale_yaml::schema::{one_of, words};
use telltale_yaml::{KeyDoc, Kind, Log, MapDoc, Members, Node, Problem, Schema, Span, key, map};

/// The texts of a key with levels and stages.
pub(crate) trait Said: FromNode + Clone + PartialEq {
    /// The names of the definitions in the schema: of the whole, and of one level.
    const NAMES: [&str; 2];
    const LEVELS: MapDoc;
    const STAGES: MapDoc;
    /// The levels that can have words.
    const NAMED: &[&str];

    /// The urgency for the operator of a driving vehicle, if it is given.
    fn urgency(&self) -> Option<Urgency>;
}

impl Said for Text {
    const NAMES: [&str; 2] = ["wording", "stage_wording"];
    const LEVELS: MapDoc = map("levels", "words for levels");
    const STAGES: MapDoc = map("stage_words", "words for stages");
    const NAMED: &[&str] = &["ok", "warning", "error", "unknown"];

    fn urgency(&self) -> Option<Urgency> {
        None
    }
}

impl Said for Advice {
    const NAMES: [&str; 2] = ["advice_wording", "stage_advice"];
    const LEVELS: MapDoc = map("levels_of_advice", "advice for levels");
    const STAGES: MapDoc = map("stages_of_advice", "advice for stages");
    const NAMED: &[&str] = &["warning", "error", "unknown"];

    fn urgency(&self) -> Option<Urgency> {
        self.urgency
    }
}

/// The meaning of a single text depends on the key.
#[derive(Debug)]
pub(crate) enum RawWording<T> {
    Text(T),
    Levels(Wording<T>),
}

impl<T: Said> RawWording<T> {
    pub fn resolve(&self, of_text: impl FnOnce(T) -> Wording<T>) -> Wording<T> {
        match self {
            RawWording::Text(text) => of_text(text.clone()),
            RawWording::Levels(wording) => wording.clone(),
        }
    }
}

impl<T: Said> FromNode for RawWording<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if is_text(node) {
            return T::from_node(node, log).map(RawWording::Text);
        }
        let mut fields = Fields::of(node, T::LEVELS.rules(|| vec![("minProperties", 1.into())]), log)?;
        let mut level = |name: &'static str| {
            let words = if T::NAMED.contains(&name) { fields.optional(name) } else { None };
            words.unwrap_or(ByStage::None)
        };
        let wording = Wording {
            ok: level("ok"),
            warning: level("warning"),
            error: level("error"),
            unknown: level("unknown"),
        };
        if !T::NAMED.iter().any(|level| fields.key_span(level).is_some()) {
            let problem = Problem::at(node.span, "there are words for no level");
            fields.log.push(problem.help("write one text, or `{ warning: ..., error: ..., unknown: ... }`"));
        }
        let place = ["error", "warning"].iter().find_map(|level| fields.key_span(level));
        if let Some(problem) = place.and_then(|place| weaker_error(&wording, place)) {
            fields.log.push(problem);
        }
        Some(RawWording::Levels(wording))
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define(T::NAMES[0], |schema| {
            let forms = one_of([T::form(schema), schema.decoder(Self::from_node)]);
            with_about(
                "One text, or different words for each level; a level without words has general ones.",
                forms,
            )
        })
    }
}

impl<T: Said> FromNode for ByStage<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if is_text(node) {
            return T::from_node(node, log).map(ByStage::Always);
        }
        let about =
            "Without words of its own, `cleared` has those of `active`, and `localizing` those of `standby`.";
        let doc = T::STAGES.about(about).rules(|| vec![("minProperties", 1.into())]);
        let mut fields = Fields::of(node, doc, log)?;
        let stages = [Stage::Localizing, Stage::Standby, Stage::Cleared, Stage::Active];
        let mut texts: Vec<(Stage, T)> = Vec::new();
        for stage in stages {
            let Some(text) = fields.optional::<Spanned<T>>(stage.as_str()) else { continue };
            if text.value.urgency().is_some() && matches!(stage, Stage::Localizing | Stage::Standby) {
                let problem = Problem::at(text.span, "nobody takes over a vehicle that stands");
                fields.log.push(problem.help("remove `urgency` here; it is for `cleared` and `active`"));
            }
            texts.push((stage, text.value));
        }
        if stages.iter().all(|stage| fields.key_span(stage.as_str()).is_none()) {
            let problem = Problem::at(node.span, "there are words for no stage");
            fields.log.push(problem.help("write one text, or `{ standby: ..., active: ... }`"));
        }
        Some(ByStage::In(texts))
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define(T::NAMES[1], |schema| {
            let forms = one_of([T::form(schema), schema.decoder(Self::from_node)]);
            with_about("One text for every stage, or different words for each.", forms)
        })
    }
}

const URGENCY: KeyDoc = key("urgency").about(
    "What it asks of the operator of a driving vehicle: to take over at once, or to be ready for it. It has no effect at a stop.",
);

/// A text, or `{ en: Take over., de: Übernehmen., urgency: take_over }`
impl FromNode for Advice {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if !matches!(node.kind, Kind::Mapping(_)) {
            return Text::from_node(node, log).map(Advice::from);
        }
        let mut fields = Fields::of(node, map("advice", "advice in two languages"), log)?;
        let text = languages(&mut fields);
        let urgency = fields.optional(URGENCY);
        Some(Advice { text: text?, urgency })
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("advice_text", |schema| {
            let plain = vec![("type", vec!["string", "number"].into())];
            let forms = one_of([plain, schema.decoder(Self::from_node)]);
            with_about("One text, or one in each language, with its urgency.", forms)
        })
    }
}

impl FromNode for Urgency {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "urgency", &Urgency::ALL.map(|urgency| (urgency.as_str(), urgency)))
    }

    fn form(_: &mut Schema) -> Members {
        words(Urgency::ALL.map(Urgency::as_str))
    }
}

/// An ERROR that asks for less than the WARNING before it: an operator would be told to do less when it gets worse.
/// Without an urgency, an ERROR asks to be ready to take over.
fn weaker_error<T: Said>(wording: &Wording<T>, place: Span) -> Option<Problem> {
    let urgency = |state, stage| wording.of(state, stage).and_then(Said::urgency);
    let (stage, warning) = [Stage::Active, Stage::Cleared].into_iter().find_map(|stage| {
        let warning = urgency(State::Warning, stage)?;
        (urgency(State::Error, stage).unwrap_or(Urgency::BeReady) < warning).then_some((stage, warning))
    })?;
    let text = format!("in `{}`, an ERROR asks for less than a WARNING", stage.as_str());
    let help = format!("give `error` the `urgency: {}` too, or `warning` a lower one", warning.as_str());
    Some(Problem::at(place, text).help(help))
}

/// A scalar, or a map of languages.
fn is_text(node: &Node) -> bool {
    match &node.kind {
        Kind::Mapping(entries) => entries.iter().any(|(key, _)| matches!(key.text.as_str(), "en" | "de")),
        _ => true,
    }
}
