//! Reads the configurations that developers edit for a what-if.

use serde_json::Value;

use crate::cli::fields;
use crate::config::{self, Examined};
use crate::msg::fields::Definitions;
use crate::replay::compare::{Candidate, Mistake};
use crate::web::incidents::Examiner;
use crate::yaml::Problems;

/// Reads them by the folders of the start, and none that a text names.
pub fn examiner(definitions: Definitions) -> Examiner {
    Examiner(Box::new(move |texts, recording| {
        let texts = texts.iter().map(|it| (it.name.clone(), it.text.clone()));
        let read = config::of_texts(texts).and_then(|loaded| {
            let examined = Examined { loaded: Some(loaded), problems: None };
            fields::whole(examined, |_| recording.define(definitions.clone()))
        });
        let definitions = definitions.clone();
        read.map(|loaded| Candidate { loaded, definitions }).map_err(|problems| mistakes(&problems))
    }))
}

fn mistakes(problems: &Problems) -> Vec<Mistake> {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let number = |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok());
    let mistake = |found: &Value| Mistake {
        file: text(&found["file"]),
        line: number(&found["line"]),
        column: number(&found["column"]),
        message: text(&found["message"]),
        help: text(&found["help"]),
    };
    problems.json().iter().map(mistake).collect()
}
