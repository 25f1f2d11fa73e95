//! The situations of a vehicle that its conditions can distinguish.

use std::collections::BTreeSet;

use telltale_engine::mask::rules;
use telltale_engine::model::{ACTIVE_SIGNAL, Model, POSED_SIGNAL, Stage, StageModel, When};

/// A stage, and the value of each of the model's signals for conditions; `None` is unknown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Situation {
    pub stage: Stage,
    pub signals: Vec<Option<bool>>,
    /// The operator gave a pose.
    pub posed: bool,
}

impl Situation {
    /// Whether a condition holds.
    pub fn meets(&self, when: Option<&When>) -> bool {
        rules::unmet(when, self.stage, self.posed, |index| self.signals[index]).is_none()
    }

    /// As text: `stage standby, doors true, active unknown`.
    pub fn describe(&self, model: &Model) -> String {
        let mut text = format!("stage {}", self.stage.as_str());
        if self.stage == Stage::Localizing && whens(model).any(|when| when.posed.is_some()) {
            text.push_str(&format!(", {POSED_SIGNAL} {}", self.posed));
        }
        for index in named_in(model) {
            let value = self.signals[index].map_or("unknown".into(), |value| value.to_string());
            text.push_str(&format!(", {} {value}", model.signals[index].name));
        }
        text
    }
}

/// The signals in the model's conditions.
pub fn named_in(model: &Model) -> BTreeSet<usize> {
    named(whens(model))
}

fn whens(model: &Model) -> impl Iterator<Item = &When> {
    let groups = model.groups.iter().filter_map(|group| group.when.as_ref());
    groups.chain(model.modules.iter().filter_map(|module| module.when.as_deref()))
}

/// The signals in these conditions.
pub fn named<'a>(whens: impl IntoIterator<Item = &'a When>) -> BTreeSet<usize> {
    whens.into_iter().flat_map(|when| when.signals.iter().map(|(index, _)| *index)).collect()
}

/// All combinations of the possible values of these signals; `None` if there are more than `most`.
pub fn all(model: &Model, named: &BTreeSet<usize>, unknown_too: bool, most: usize) -> Option<Vec<Situation>> {
    let stages: &[Stage] = match model.stages {
        StageModel::Shuttle => &Stage::ALL,
        StageModel::None => &[Stage::Active],
    };
    let mut situations = Vec::new();
    let asked = whens(model).any(|when| when.posed.is_some());
    for (stage, posed) in stages.iter().flat_map(|&stage| with_posed(stage, asked)) {
        let mut partial = vec![Situation { stage, signals: vec![None; model.signals.len()], posed }];
        for &index in named {
            let values = values(model, index, stage, unknown_too);
            if partial.len().saturating_mul(values.len()) > most {
                return None;
            }
            let with = |situation: &Situation, value| {
                let mut next = situation.clone();
                next.signals[index] = value;
                next
            };
            partial =
                partial.iter().flat_map(|it| values.iter().map(move |&value| with(it, value))).collect();
        }
        situations.extend(partial);
        if situations.len() > most {
            return None;
        }
    }
    Some(situations)
}

/// Only while localizing can the pose be given or not.
fn with_posed(stage: Stage, asked: bool) -> impl Iterator<Item = (Stage, bool)> {
    let values: &[bool] = match stage {
        Stage::Locked => &[false],
        Stage::Localizing if asked => &[false, true],
        Stage::Localizing => &[false],
        Stage::Standby | Stage::Cleared | Stage::Active => &[true],
    };
    values.iter().map(move |&posed| (stage, posed))
}

/// The possible values of a signal for conditions in a stage.
fn values(model: &Model, index: usize, stage: Stage, unknown_too: bool) -> Vec<Option<bool>> {
    let spec = &model.signals[index];
    let makes_the_stage = &*spec.name == ACTIVE_SIGNAL && model.stages == StageModel::Shuttle;
    let mut values = match (makes_the_stage, stage) {
        (true, Stage::Active) => vec![Some(true)],
        (true, _) => vec![Some(false)],
        (false, _) => vec![Some(false), Some(true)],
    };
    // Before its first sample and after its timeout a signal is unknown; but an unknown signal cannot have made
    // the vehicle active, and an event without a message counts as false.
    let can_be_unknown = spec.present_for.is_none()
        && (spec.timeout.is_some() || !(makes_the_stage && stage == Stage::Active));
    if unknown_too && can_be_unknown {
        values.push(None);
    }
    values
}
