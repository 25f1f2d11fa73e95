//! The top bar and the action bar: the stage, who is in the seat, and the next step.

use std::hash::{DefaultHasher, Hash, Hasher};

use askama::Template;

use crate::engine::model::Stage;
use crate::engine::state::State;

use super::clean::{NAME, clean};
use super::{Fragment, View, html};
use crate::web::text::Words;

#[derive(Template)]
#[template(path = "partials/top.html")]
struct TopHtml {
    words: &'static Words,
    swap: bool,
    stage: &'static str,
    overall: &'static str,
    layout: String,
    vehicle: String,
    word: &'static str,
    operator: Option<String>,
}

pub fn top(view: &View<'_>) -> Fragment {
    let snapshot = view.snapshot;
    let locked = snapshot.stage == Stage::Locked;
    let html = html(&TopHtml {
        words: view.words,
        swap: view.swap,
        stage: snapshot.stage.as_str(),
        overall: if locked { "" } else { snapshot.overall.as_str() },
        layout: layout_mark(view),
        vehicle: view.lang.pick(&snapshot.layout.vehicle_name, NAME),
        word: view.lang.stage(snapshot.stage, snapshot.overall),
        operator: snapshot.operator.as_ref().map(|name| clean(name, 24)),
    });
    Fragment { id: "top".to_owned(), html }
}

/// Changes when the tiles do, or the program: a page made before then loads itself anew.
pub fn layout_mark(view: &View<'_>) -> String {
    let mut hasher = DefaultHasher::new();
    (env!("CARGO_PKG_VERSION"), &*view.snapshot.layout.vehicle_id).hash(&mut hasher);
    for (tile, place) in view.board.tiles.iter().zip(&view.board.places) {
        (view.snapshot.group(*tile).0.path.as_bytes(), place).hash(&mut hasher);
    }
    format!("{:016x}", hasher.finish())
}

#[derive(Template)]
#[template(path = "partials/actions.html")]
struct ActionsHtml {
    words: &'static Words,
    swap: bool,
    icon: &'static str,
    next: &'static str,
    logout: bool,
}

/// What the stage waits for, with the buttons that work now. While the vehicle drives there is
/// none yet: logging out would be refused.
pub fn actions(view: &View<'_>) -> Fragment {
    let (stage, overall) = (view.snapshot.stage, view.snapshot.overall);
    let html = html(&ActionsHtml {
        words: view.words,
        swap: view.swap,
        icon: match (stage, overall) {
            (Stage::Active, _) => "drive",
            (Stage::Standby, State::Error | State::Unknown) => "wait",
            _ => "ready",
        },
        next: view.lang.next(stage, overall),
        logout: view.snapshot.operator.is_some() && stage != Stage::Active,
    });
    Fragment { id: "actions".to_owned(), html }
}
