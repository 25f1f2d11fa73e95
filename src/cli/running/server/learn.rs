//! Learns dependencies for the developer's page, by what `telltale learn` and `telltale check` do.

use crate::cli::{fields, learned};
use crate::config::{self, Examined, Loaded};
use crate::learn::{Proposals, learn_within};
use crate::msg::fields::Definitions;
use crate::record::ring::ConfigurationText;
use crate::web::developer::learn::{Learned, Learner, NotLearned, Patched};
use crate::yaml::Problems;

/// Reads the configurations by the folders of the start.
pub fn learner(definitions: Definitions) -> Learner {
    Learner(Box::new(move |texts, history, go_on| {
        let bad = |error: &dyn ToString| NotLearned::Bad(error.to_string());
        let texts = texts.iter().map(|it| (it.name.clone(), it.text.clone()));
        let loaded = config::of_texts(texts).map_err(|problems| bad(&problems))?;
        let (modules, signals) = learned::names(&loaded).map_err(|error| bad(&error))?;
        let reported = history.reported(&modules, &signals, &|| go_on(0)).map_err(|error| bad(&error))?;
        let history = learned::history(reported.ok_or(NotLearned::TooMuch)?).ok_or(NotLearned::Nothing)?;
        let proposals = learn_within(&history, &loaded.model, go_on).ok_or(NotLearned::TooMuch)?;
        Ok(Learned {
            model: loaded.model.clone(),
            failed: history.failed(),
            patched: patched(&loaded, &proposals, &definitions),
            proposals,
        })
    }))
}

fn patched(loaded: &Loaded, proposals: &Proposals, definitions: &Definitions) -> Option<Patched> {
    let edited = learned::edited(loaded, proposals)?;
    let checked = config::of_texts(edited.texts(loaded)).and_then(|loaded| {
        let examined = Examined { loaded: Some(loaded), problems: None };
        fields::whole(examined, |loaded| definitions.clone().with(&loaded.message_folders))
    });
    let told = |problems: Problems| problems.render(false);
    Some(Patched {
        patch: edited.patch(loaded),
        checked: checked.map(|loaded| loaded.soundness().1.map(told)).map_err(told),
        texts: edited
            .texts(loaded)
            .into_iter()
            .map(|(name, text)| ConfigurationText { name, text })
            .collect(),
        left: edited.left,
    })
}
