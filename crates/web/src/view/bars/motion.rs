//! The motion in words and numbers: what the vehicle does, how fast, and where to.

use askama::Template;

use crate::texts::NAME;
use crate::view::{Fragment, View, html};
use telltale_engine::model::Stage;
use telltale_engine::snapshot::Moving;

#[derive(Template)]
#[template(path = "partials/motion.html")]
struct MotionHtml {
    swap: bool,
    moving: &'static str,
    word: &'static str,
    /// The speed and the destination.
    details: Vec<String>,
}

pub fn motion(view: &View<'_>) -> Fragment {
    let html = html(&MotionHtml {
        swap: view.swap,
        moving: view.snapshot.motion.moving.as_str(),
        word: word(view),
        details: speed(view).into_iter().chain(destination(view)).collect(),
    });
    Fragment { id: "motion".to_owned(), html }
}

/// The word for the vehicle's motion. It drives only where it is known to move.
fn word(view: &View<'_>) -> &'static str {
    let (snapshot, words) = (view.snapshot, view.words);
    match snapshot.motion.moving {
        Moving::Unknown if snapshot.motion.has_source => words.no_speed,
        Moving::Unknown if view.has_stages() => words.no_signal,
        Moving::Unknown => view.lang.runs(snapshot),
        Moving::No => words.standing,
        Moving::Yes if !drives(view) => words.moving,
        Moving::Yes if snapshot.maneuver_stop() => words.stopping,
        Moving::Yes if snapshot.deceleration().is_some() => words.slowing,
        Moving::Yes => words.moves_itself,
    }
}

/// Whether the vehicle is on a drive of its own.
fn drives(view: &View<'_>) -> bool {
    view.has_stages() && view.snapshot.stage == Stage::Active
}

fn speed(view: &View<'_>) -> Option<String> {
    let motion = view.snapshot.motion;
    motion.speed_kmh.filter(|_| motion.moving == Moving::Yes).map(|kmh| format!("{kmh}\u{a0}km/h"))
}

/// The destination: as such where the vehicle drives to it, as the next stop where it stands. A vehicle that brakes, or
/// that somebody moves by hand, goes elsewhere.
fn destination(view: &View<'_>) -> Option<String> {
    let name = view.lang.pick(&view.snapshot.destination()?.name, NAME);
    let brakes = view.snapshot.maneuver_stop() || view.snapshot.deceleration().is_some();
    match view.snapshot.motion.moving {
        Moving::No => Some(format!("{}: {name}", view.words.next)),
        Moving::Yes if view.snapshot.stage == Stage::Active && !brakes => Some(view.lang.drives_to(&name)),
        Moving::Yes | Moving::Unknown => None,
    }
}
