//! The top bar: the vehicle, its stage and its operator.

use std::hash::{DefaultHasher, Hash, Hasher};

use askama::Template;

use telltale_engine::model::Stage;

use crate::assets;
use crate::texts::{NAME, Words, clean};
use crate::view::{Fragment, View, html};

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
    /// A machine without stages says the word to screen readers alone: its motion above is what changes.
    has_stages: bool,
    /// The reader of the page: the operator of a vehicle, or a person who looks at a machine.
    user_is: &'static str,
    operator: Option<String>,
    /// The button that ends the work, in every stage but driving.
    shutdown: bool,
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
        word: view.lang.stage_of(snapshot),
        has_stages: view.has_stages(),
        user_is: if view.has_stages() { view.words.operator } else { view.words.logged_in },
        operator: snapshot.operator.as_ref().map(|name| clean(name, 24)),
        shutdown: view.may_act()
            && view.has_stages()
            && !matches!(snapshot.stage, Stage::Locked | Stage::Active),
    });
    Fragment { id: "top".to_owned(), html }
}

/// Changes with the tiles and with the program: a page with another value reloads itself.
pub fn layout_mark(view: &View<'_>) -> String {
    let mut hasher = DefaultHasher::new();
    (telltale_record::VERSION, assets::url(""), &*view.snapshot.layout.vehicle_id).hash(&mut hasher);
    for (tile, place) in view.board.tiles.iter().zip(&view.board.places) {
        (view.snapshot.group(*tile).0.path.as_bytes(), place).hash(&mut hasher);
    }
    format!("{:016x}", hasher.finish())
}
