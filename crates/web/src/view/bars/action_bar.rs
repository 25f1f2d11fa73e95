//! The action bar: the next step of the stage as one large button, and the reasons against it.

use askama::Template;

use telltale_engine::model::output::Output;
use telltale_engine::model::{LOCALIZATION_GROUP, NodeId, Stage, Stop};
use telltale_engine::snapshot::{Moving, Unreached};
use telltale_engine::state::State;

use super::clearance_checks::Check;
use crate::texts::{ID, NAME, Words, clean};
use crate::view::faults::instruction;
use crate::view::versions::Aspect;
use crate::view::{Fragment, View, html, requests};

/// Stops that have room in the bar; more of them stand on a sheet of their own.
const STOPS_IN_BAR: usize = 3;

pub struct StopHtml {
    id: String,
    name: String,
    /// Where the vehicle was last known to be: how that is known.
    known: Option<&'static str>,
    /// It was chosen, and the vehicle does not stand there.
    wrong: bool,
}

#[derive(Template)]
#[template(path = "partials/step.html")]
struct StepHtml {
    words: &'static Words,
    swap: bool,
    version: u64,
    clearance_version: u64,
    release_version: u64,
    /// The button that stops the vehicle, as long as it moves or may.
    stop: Option<StopButton>,
    /// `None` in a replay.
    step: Option<NextStep>,
    /// Nobody logs out while the vehicle moves.
    logout: bool,
}

struct StopButton {
    /// Since when a stop is requested.
    asked: Option<String>,
}

/// The step that the bar offers.
enum NextStep {
    /// Choose the stop at which the vehicle stands.
    Localize { stops: Vec<StopHtml>, more: bool },
    /// The pose is given; the vehicle checks it.
    Locating { title: String, text: String },
    /// Give clearance; `ready` if no check fails. The page's script hides the checks that have no room. A vehicle
    /// that is held is released first.
    Clear { ready: bool, checks: Vec<Check>, release: bool },
    /// The vehicle may drive: stop it, or let it go on.
    Drive(Drive),
    /// No step: the condition of the vehicle.
    Watch { icon: &'static str, title: &'static str, text: String },
}

struct Drive {
    release: bool,
    /// The vehicle still moves: to let it go on is not the step that is wanted next.
    rolls: bool,
    withdraw: bool,
    icon: &'static str,
    title: &'static str,
    text: String,
    /// How far the next stop is, on the way there.
    way: Option<String>,
}

pub fn step(view: &View<'_>) -> Fragment {
    let snapshot = view.snapshot;
    let html = html(&StepHtml {
        words: view.words,
        swap: view.swap,
        version: view.seen.of(Aspect::Stage),
        clearance_version: view.seen.of(Aspect::Clearance),
        release_version: view.seen.of(Aspect::Release),
        stop: stop(view),
        step: (!view.replay).then(|| of_stage(view)),
        logout: view.may_act() && !snapshot.moves(),
    });
    Fragment { id: "step".to_owned(), html }
}

fn of_stage(view: &View<'_>) -> NextStep {
    let snapshot = view.snapshot;
    match snapshot.stage {
        Stage::Locked => {
            NextStep::Watch { icon: "lock", title: view.words.log_in_to_start, text: String::new() }
        }
        Stage::Localizing if snapshot.localization.given.is_some() && !instruction::is_wrong_stop(view) => {
            locating(view)
        }
        Stage::Localizing => {
            let all = stops(view);
            let more = all.len() > STOPS_IN_BAR;
            let shown = if more { STOPS_IN_BAR - 1 } else { STOPS_IN_BAR };
            NextStep::Localize { stops: all.into_iter().take(shown).collect(), more }
        }
        Stage::Standby => clear(view),
        // A machine without stages is not driven, and has no mission that could be asked to stop.
        Stage::Active if !view.has_stages() && !requests::has_banner(view) => {
            NextStep::Watch { icon: "ready", title: view.lang.runs(snapshot), text: condition(view) }
        }
        Stage::Active if view.has_stages() && snapshot.operator.is_none() => {
            let Drive { icon, title, .. } = drive(view);
            NextStep::Watch { icon, title, text: condition(view) }
        }
        Stage::Cleared | Stage::Active => NextStep::Drive(drive(view)),
    }
}

/// In every stage, as long as the vehicle moves or may. A stop that the vehicle cannot receive is not offered. It stays
/// offered once it is requested: another tap forbids a release that was asked for before it.
fn stop(view: &View<'_>) -> Option<StopButton> {
    let snapshot = view.snapshot;
    let asked = snapshot.stop_requested_since().map(|since| view.wall_since(since));
    let works = snapshot.may_move() && snapshot.unreached(Output::ManeuverStop).is_none();
    let is_offered = view.has_stages() && view.may_act() && (asked.is_some() || works);
    is_offered.then_some(StopButton { asked })
}

fn drive(view: &View<'_>) -> Drive {
    let snapshot = view.snapshot;
    let unreached = snapshot.unreached(Output::ManeuverStop).filter(|_| view.has_stages());
    let unreached = unreached.map(|why| match why {
        Unreached::Unheard => view.words.no_listener,
        Unreached::Unpublished => view.words.not_stoppable,
    });
    let cleared = snapshot.stage == Stage::Cleared;
    let release = requests::waits_for_release(view);
    let request = requests::moving(view).next();
    let stands = snapshot.motion.moving == Moving::No;
    let progress = request.map(|it| requests::progress(view, it));
    let (icon, title, text) = match progress {
        // The instruction says it.
        _ if cleared => ("ready", "", String::new()),
        // A vehicle that stands has nothing to respond to.
        // The instruction asks, and the button beside it answers.
        Some(_) if release && stands => ("idle", "", String::new()),
        Some(_) if stands && request.is_some_and(requests::is_engaged) => {
            ("idle", view.words.held, view.words.until_gone.to_owned())
        }
        Some(progress) if snapshot.stop_requested() => ("stop", progress, String::new()),
        Some(progress) => ("slow", progress, String::new()),
        // The line of the motion says that it stands.
        None if stands => ("idle", "", String::new()),
        None => ("drive", view.words.drives, String::new()),
    };
    let text = unreached.map_or(text, str::to_owned);
    let way = stop_away(view).filter(|_| request.is_none() && !cleared && text.is_empty());
    let rolls = snapshot.motion.moving == Moving::Yes;
    Drive { release, rolls, withdraw: cleared, icon, title, text, way }
}

/// How far the next stop is, and in how many minutes the vehicle is there, as far as both are known.
fn stop_away(view: &View<'_>) -> Option<String> {
    let motion = view.snapshot.motion;
    let metres = motion.goal_m.filter(|&m| m > 0 && motion.destination.is_some())?;
    let (factor, unit) = if metres < 1000 { (1.0, "m") } else { (0.001, "km") };
    let far = view.lang.quantity(&metres.to_string(), factor, unit).replace(' ', "\u{a0}");
    Some(match motion.goal_min {
        Some(min) => view.lang.stop_away_in(&far, min),
        None => view.lang.stop_away(&far),
    })
}

fn locating(view: &View<'_>) -> NextStep {
    let snapshot = view.snapshot;
    let title = view
        .chosen_stop()
        .map_or_else(|| view.words.locating.to_owned(), |name| format!("{}: {name}", view.words.locating));
    let group = match snapshot.node(LOCALIZATION_GROUP) {
        Some(NodeId::Group(id)) => {
            let (_, group) = snapshot.group(id);
            let because = view.reason(NodeId::Group(id), group.reason.as_ref());
            let because = if because.is_empty() { view.lang.state(group.state).to_owned() } else { because };
            format!("{}: {because}. ", view.group_name(id))
        }
        _ => String::new(),
    };
    // With a fault the instruction says what to do.
    let waits = snapshot.localization.ok_since.is_none() && snapshot.roots.is_empty();
    let hint = if waits { view.words.locating_long } else { "" };
    NextStep::Locating { title, text: format!("{group}{hint}") }
}

fn clear(view: &View<'_>) -> NextStep {
    let release = requests::waits_for_release(view);
    NextStep::Clear { ready: view.snapshot.clearance_refusals.is_empty(), checks: view.checks(), release }
}

/// The condition of the vehicle. What to do about it stands beside the causes.
fn condition(view: &View<'_>) -> String {
    match view.snapshot.overall {
        State::Ok | State::Ignore => view.words.nothing_wrong.to_owned(),
        State::Unknown => view.words.no_sight.to_owned(),
        state @ (State::Warning | State::Error) => {
            let tiles = view.board.tiles.iter().copied();
            let names: Vec<String> = tiles
                .filter(|&id| view.snapshot.group(id).1.state == state)
                .map(|id| view.group_name(id))
                .collect();
            if names.is_empty() {
                view.lang.state(state).to_owned()
            } else {
                view.lang.not_fit(state, &names.join(", "))
            }
        }
    }
}

/// The stops of the configuration, the one where the vehicle was last known to be first. One that was chosen and is
/// wrong is the last.
fn stops(view: &View<'_>) -> Vec<StopHtml> {
    let wrong = view.snapshot.localization.pose.filter(|_| instruction::is_wrong_stop(view));
    let last = view.snapshot.localization.last_known.filter(|place| Some(place.pose) != wrong);
    let stop = |stop: &Stop| StopHtml {
        id: clean(&stop.id, ID),
        name: view.lang.pick(&stop.name, NAME),
        known: last
            .filter(|place| place.pose == stop.into())
            .map(|place| if place.driven { view.words.driven_here } else { view.words.chosen_here }),
        wrong: wrong == Some(stop.into()),
    };
    let mut stops: Vec<&Stop> = view.snapshot.layout.stops.iter().collect();
    stops.sort_by_key(|stop| wrong == Some((*stop).into()));
    let mut stops: Vec<_> = stops.into_iter().map(stop).collect();
    stops.sort_by_key(|stop| stop.known.is_none());
    stops
}

#[derive(Template)]
#[template(path = "partials/stops.html")]
struct StopsHtml {
    words: &'static Words,
    swap: bool,
    replay: bool,
    version: u64,
    stops: Vec<StopHtml>,
}

/// All stops as buttons, for the sheet.
pub fn all_stops(view: &View<'_>) -> Fragment {
    let version = view.seen.of(Aspect::Stage);
    let (swap, replay) = (view.swap, view.replay);
    let html = html(&StopsHtml { words: view.words, swap, replay, version, stops: stops(view) });
    Fragment { id: "all-stops".to_owned(), html }
}

#[derive(Template)]
#[template(path = "partials/checks.html")]
struct ChecksHtml {
    swap: bool,
    checks: Vec<Check>,
}

/// All checks before a clearance, for the sheet.
pub fn all_checks(view: &View<'_>) -> Fragment {
    let checks = if view.snapshot.stage == Stage::Standby { view.checks() } else { Vec::new() };
    let html = html(&ChecksHtml { swap: view.swap, checks });
    Fragment { id: "all-checks".to_owned(), html }
}
