//! Names of faults and advice, by level and stage. A WARNING never shows the texts of the ERROR, and no text at
//! a stop asks the operator to take over.

use super::Stage;
use crate::state::State;
use crate::text::{Text, words};
use serde::{Deserialize, Serialize};

/// The words of a module by its level: names, or [`Advice`]. The page has general words for the rest.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Wording<T = Text> {
    /// The part that works, while there is no fault. There is no advice for it.
    pub ok: ByStage<T>,
    pub warning: ByStage<T>,
    pub error: ByStage<T>,
    pub unknown: ByStage<T>,
}

/// The words of one level.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum ByStage<T = Text> {
    #[default]
    None,
    /// In every stage.
    Always(T),
    /// In these stages. `cleared` falls back to the words of `active`, and `localizing` to those of `standby`.
    In(Vec<(Stage, T)>),
}

/// The advice for a fault.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Advice {
    pub text: Text,
    /// The urgency for the operator of a driving vehicle, if the configuration gives one.
    pub urgency: Option<Urgency>,
}

words! {
    /// How soon the operator of a driving vehicle has to act. Its words are those of files and pages.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Urgency {
        BeReady = "be_ready",
        TakeOver = "take_over",
    }
}

impl From<Text> for Advice {
    fn from(text: Text) -> Advice {
        Advice { text, urgency: None }
    }
}

impl Wording {
    /// A name without levels: it is for WARNING and ERROR. An UNKNOWN module may have no fault at all.
    pub fn name(text: Text) -> Wording {
        Wording { warning: ByStage::Always(text.clone()), error: ByStage::Always(text), ..Wording::default() }
    }
}

impl Wording<Advice> {
    /// Advice without levels: for an ERROR, while the vehicle drives or may start.
    pub fn help(advice: impl Into<Advice>) -> Wording<Advice> {
        Wording { error: ByStage::In(vec![(Stage::Active, advice.into())]), ..Wording::default() }
    }
}

impl<T: PartialEq> Wording<T> {
    /// The words for a state in a stage.
    pub fn of(&self, state: State, stage: Stage) -> Option<&T> {
        match state {
            State::Warning => self.warning.of(stage),
            State::Error => self.error.of(stage),
            State::Unknown => self.unknown.of(stage),
            State::Ok | State::Ignore => self.ok.of(stage),
        }
    }

    /// The levels that have words, in order.
    pub fn levels(&self) -> impl Iterator<Item = (State, &ByStage<T>)> {
        let all = [
            (State::Ok, &self.ok),
            (State::Warning, &self.warning),
            (State::Error, &self.error),
            (State::Unknown, &self.unknown),
        ];
        all.into_iter().filter(|(_, words)| **words != ByStage::None)
    }
}

impl<T> ByStage<T> {
    /// The words of every stage.
    pub fn all(&self) -> impl Iterator<Item = &T> {
        let (always, in_stages): (Option<&T>, &[(Stage, T)]) = match self {
            ByStage::None => (None, &[]),
            ByStage::Always(text) => (Some(text), &[]),
            ByStage::In(texts) => (None, texts),
        };
        always.into_iter().chain(in_stages.iter().map(|(_, text)| text))
    }

    fn of(&self, stage: Stage) -> Option<&T> {
        let texts = match self {
            ByStage::None => return None,
            ByStage::Always(text) => return Some(text),
            ByStage::In(texts) => texts,
        };
        let written = |stage| texts.iter().find(|(of, _)| *of == stage).map(|(_, text)| text);
        let alike = match stage {
            Stage::Cleared => Stage::Active,
            Stage::Localizing => Stage::Standby,
            other => other,
        };
        written(stage).or_else(|| written(alike))
    }
}

#[cfg(test)]
mod tests {
    use super::ByStage::In;
    use super::*;

    fn said(wording: &Wording, state: State, stage: Stage) -> &str {
        wording.of(state, stage).map_or("", |text| &text.en)
    }

    #[test]
    fn words_without_levels_are_said_where_they_are_true() {
        let name = Wording::name("Bus dead".into());
        let help = Wording::help(Text::plain("Take over."));
        for stage in Stage::ALL {
            assert_eq!(said(&name, State::Warning, stage), "Bus dead");
            assert_eq!(said(&name, State::Error, stage), "Bus dead");
            assert_eq!(said(&name, State::Unknown, stage), "");
            let drives = matches!(stage, Stage::Cleared | Stage::Active);
            let advice = |state| help.of(state, stage).map_or("", |advice| &advice.text.en);
            assert_eq!(advice(State::Error), if drives { "Take over." } else { "" });
            for state in [State::Ok, State::Ignore, State::Warning, State::Unknown] {
                assert_eq!(advice(state), "", "{state:?} {stage:?}");
            }
        }
    }

    #[test]
    fn a_stage_without_words_has_those_of_the_stage_that_is_like_it() {
        let texts: Vec<(Stage, Text)> =
            vec![(Stage::Standby, "Wait.".into()), (Stage::Active, "Take over.".into())];
        let help = Wording { error: In(texts.clone()), ..Wording::default() };
        let all = Stage::ALL.map(|stage| said(&help, State::Error, stage).to_owned());
        assert_eq!(all, ["", "Wait.", "Wait.", "Take over.", "Take over."]);
        let cleared = [texts, vec![(Stage::Cleared, "Withdraw.".into())]].concat();
        let help = Wording { error: In(cleared), ..Wording::default() };
        assert_eq!(said(&help, State::Error, Stage::Cleared), "Withdraw.");
        let levels: Vec<State> = help.levels().map(|(state, _)| state).collect();
        assert_eq!(levels, [State::Error]);
    }
}
