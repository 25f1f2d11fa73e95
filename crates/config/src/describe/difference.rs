//! Describes the differences between the present and a new configuration.

use std::collections::HashMap;
use std::fmt;

use super::brief::brief;
use super::words;
use crate::Loaded;
use telltale_engine::model::monitors::StampClock;
use telltale_engine::model::output::Publication;
use telltale_engine::model::wording::{Advice, ByStage, Wording};
use telltale_engine::model::{
    Combine, Dependency, GroupSpec, Limits, Model, ModuleSpec, Parts, SignalSpec, StageModel, Stop,
    Unclaimed, When,
};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_engine::time::Span;

/// One difference. Prints as a sentence without a full stop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    pub change: Change,
    /// With its kind: ``module `a/m` ``.
    pub subject: String,
    /// The old and the new value; empty if the subject itself was added or removed.
    pub detail: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    Added,
    Removed,
    Changed,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { change, subject, detail } = self;
        match change {
            Change::Added => write!(f, "{subject} is new"),
            Change::Removed => write!(f, "{subject} is gone"),
            Change::Changed => write!(f, "{subject}: {detail}"),
        }
    }
}

/// All differences: the vehicle, then signals, stops, groups, modules and countermeasures, removed ones before
/// added ones, in the order of the files. Empty if and only if both configurations mean the same.
pub fn difference(old: &Loaded, new: &Loaded) -> Vec<Difference> {
    let mut found = Vec::new();
    vehicle(old, new, &mut found);
    let (was, is) = (&*old.model, &*new.model);
    signals(was, is, &mut found);
    stops(&was.driving.stops, &is.driving.stops, &mut found);
    groups(was, is, &mut found);
    modules(was, is, &mut found);
    countermeasures(was, is, &mut found);
    found
}

fn vehicle(old: &Loaded, new: &Loaded, found: &mut Vec<Difference>) {
    let stages = |stages: StageModel| match stages {
        StageModel::Shuttle => "shuttle",
        StageModel::None => "none",
    };
    let facts = |loaded: &Loaded| {
        // The fields are named one by one, so that a new field cannot be forgotten here.
        let Parts {
            vehicle_id,
            vehicle_name,
            stages: model,
            discovered,
            other,
            unclaimed: Unclaimed { policy: unclaimed, except },
            limits,
            display_dpi,
            signals: _,
            groups: _,
            modules: _,
            // This follows from the modules.
            watched: _,
            driving,
        } = &**loaded.model;
        let Limits { discovered_modules, values_per_status, string_bytes, status_bytes, source_bytes } =
            limits;
        let folders: Vec<String> =
            loaded.message_folders.iter().map(|folder| folder.display().to_string()).collect();
        let mut facts = vec![
            ("id", vehicle_id.to_string()),
            ("name", text(vehicle_name)),
            ("stages", stages(*model).into()),
            ("defaults", words::policy(discovered)),
            ("other", other.as_str().into()),
            ("other: silence", unclaimed.as_ref().map_or_else(|| "as in defaults".into(), words::policy)),
            ("other: except", if except.is_empty() { "none".into() } else { words::filters(except) }),
            ("limits.discovered_modules", discovered_modules.to_string()),
            ("limits.values_per_status", values_per_status.to_string()),
            ("limits.string_bytes", string_bytes.to_string()),
            ("limits.status_bytes", status_bytes.to_string()),
            ("limits.source_bytes", source_bytes.to_string()),
            ("display.dpi", display_dpi.to_string()),
            ("localized_after", words::span(driving.localized_after)),
            ("motion", words::motion(&loaded.model)),
            ("recording", words::recording(loaded.recording.as_ref())),
            ("fleet", words::fleet(loaded.fleet.as_ref())),
            ("message_folders", listed(&folders)),
        ];
        let publishing = &loaded.publishing;
        facts.extend(Publication::ALL.map(|it| (it.as_str(), published(publishing.topic(it)))));
        facts.push(("services", words::services(&loaded.services)));
        facts.push(("rosout.level", publishing.log_level().as_str().to_owned()));
        let beside = |it| publishing.beside_others(it).to_string();
        facts.push(("diagnostics", words::diagnostics(&loaded.model.watched)));
        let simulated = loaded.model.watched.stamps == StampClock::Ros;
        facts.push(("clock", if simulated { "ros" } else { "system" }.to_owned()));
        facts.push(("diagnostics_agg.beside_others", beside(Publication::DiagnosticsAgg)));
        let path =
            publishing.tree.path.as_ref().map_or_else(|| "the vehicle's name".into(), |it| format!("'{it}'"));
        facts.push(("diagnostics_agg.path", path));
        facts.push(("diagnostics_agg.like", publishing.tree.like.as_str().to_owned()));
        facts.push(("diagnostics_agg.values", publishing.tree.values.to_string()));
        facts.push(("diagnostics_agg.at_once", publishing.tree.at_once.to_string()));
        facts.push(("toplevel_state.beside_others", beside(Publication::TopLevelState)));
        facts
    };
    changed("the vehicle", facts(old), facts(new), found);
}

fn published(topic: Option<(&str, Option<Span>)>) -> String {
    let Some((topic, period)) = topic else { return "switched off".into() };
    let every = period.map_or(String::new(), |period| format!(" every {}", words::span(period)));
    format!("{topic}{every}")
}

fn signals(old: &Model, new: &Model, found: &mut Vec<Difference>) {
    fn key(signal: &SignalSpec) -> &str {
        &signal.name
    }
    let facts = |model: &Model, signal: &SignalSpec| {
        let title = signal.title.as_ref().map_or_else(|| "none".to_owned(), text);
        vec![("source", words::signal(model, signal)), ("name", title)]
    };
    compare("signal", (old, &old.signals), (new, &new.signals), key, facts, found);
}

fn stops(old: &[Stop], new: &[Stop], found: &mut Vec<Difference>) {
    fn key(stop: &Stop) -> &str {
        &stop.id
    }
    let facts = |(): &(), stop: &Stop| {
        let Stop { id: _, name, x_m, y_m, yaw_deg } = stop;
        vec![("name", text(name)), ("place", format!("x {x_m} m, y {y_m} m, {yaw_deg} degrees"))]
    };
    compare("stop", (&(), old), (&(), new), key, facts, found);
}

fn groups(old: &Model, new: &Model, found: &mut Vec<Difference>) {
    fn key(group: &GroupSpec) -> &str {
        &group.path
    }
    let facts = |model: &Model, group: &GroupSpec| {
        // The parent is in the path.
        let GroupSpec { path: _, name, parent: _, combine, when, depends_on, filters, may_be_empty, tile } =
            group;
        let filters: Vec<String> = filters.iter().map(words::matching).collect();
        vec![
            ("name", text(name)),
            ("combine", if *combine == Combine::Any { "any".into() } else { "worst".into() }),
            ("when", condition(model, when.as_ref())),
            ("depends_on", dependencies(model, depends_on)),
            ("match", listed(&filters)),
            ("empty", if *may_be_empty { "ok".into() } else { "unknown".into() }),
            ("tile", tile.map_or("by itself".into(), |(column, row)| format!("column {column}, row {row}"))),
        ]
    };
    compare("group", (old, &old.groups), (new, &new.groups), key, facts, found);
}

fn modules(old: &Model, new: &Model, found: &mut Vec<Difference>) {
    fn key(module: &ModuleSpec) -> &str {
        &module.id
    }
    let facts = |model: &Model, module: &ModuleSpec| {
        // The group is in the id.
        let ModuleSpec { id: _, name, help, group: _, policy, when, depends_on, monitor, expected } = module;
        let expected = expected.as_ref().map_or_else(
            || "no".into(),
            |it| match &*it.prefixes {
                [] => "yes".to_owned(),
                prefixes => format!("yes, without {}", words::prefixes(prefixes)),
            },
        );
        vec![
            ("name", wording(name.as_deref(), text, Wording::name)),
            ("help", wording(help.as_deref(), advice, Wording::help)),
            ("policy", words::policy(policy)),
            ("when", condition(model, when.as_deref())),
            ("depends_on", dependencies(model, depends_on)),
            ("monitor", words::monitor(model, monitor)),
            ("expected by a filter", expected),
        ]
    };
    compare("module", (old, &old.modules), (new, &new.modules), key, facts, found);
}

/// Rules have no names: a changed rule is a removed and an added one.
fn countermeasures(old: &Model, new: &Model, found: &mut Vec<Difference>) {
    let words = |model: &Model| -> Vec<String> {
        model.driving.countermeasures.iter().map(|rule| words::countermeasure(model, rule)).collect()
    };
    let (was, is) = (words(old), words(new));
    let mut kept: Vec<&String> = was.iter().collect();
    let mut added = Vec::new();
    for rule in &is {
        match kept.iter().position(|kept| *kept == rule) {
            Some(index) => drop(kept.remove(index)),
            None => added.push(rule),
        }
    }
    let whole = |change, rule: &String| Difference {
        change,
        subject: format!("countermeasure `{rule}`"),
        detail: String::new(),
    };
    found.extend(kept.iter().map(|rule| whole(Change::Removed, rule)));
    found.extend(added.iter().map(|rule| whole(Change::Added, rule)));
    if kept.is_empty() && added.is_empty() && was != is {
        let (subject, detail) = ("the countermeasures".into(), "they stand in another order".into());
        found.push(Difference { change: Change::Changed, subject, detail });
    }
}

type DescribedParts = Vec<(&'static str, String)>;

/// Compares two lists whose items have names.
fn compare<M, T>(
    kind: &str,
    (old_model, old): (&M, &[T]),
    (new_model, new): (&M, &[T]),
    key: fn(&T) -> &str,
    facts: impl Fn(&M, &T) -> DescribedParts,
    found: &mut Vec<Difference>,
) {
    let before: HashMap<&str, &T> = old.iter().map(|item| (key(item), item)).collect();
    let after: HashMap<&str, &T> = new.iter().map(|item| (key(item), item)).collect();
    let whole = |change, item: &T| Difference {
        change,
        subject: format!("{kind} `{}`", key(item)),
        detail: String::new(),
    };
    let gone = old.iter().filter(|item| !after.contains_key(key(item)));
    found.extend(gone.map(|item| whole(Change::Removed, item)));
    for item in new {
        match before.get(key(item)) {
            None => found.push(whole(Change::Added, item)),
            Some(was) => {
                let subject = format!("{kind} `{}`", key(item));
                changed(&subject, facts(old_model, was), facts(new_model, item), found);
            }
        }
    }
    // The order of tiles, equal causes and numbers follows the order of the file.
    let kept_before = old.iter().map(key).filter(|name| after.contains_key(name));
    let kept_after = new.iter().map(key).filter(|name| before.contains_key(name));
    if !kept_before.eq(kept_after) {
        let detail = "they stand in another order".into();
        found.push(Difference { change: Change::Changed, subject: format!("the {kind}s"), detail });
    }
}

fn changed(subject: &str, was: DescribedParts, is: DescribedParts, found: &mut Vec<Difference>) {
    let different = was.into_iter().zip(is).filter(|(was, is)| was != is);
    let detail = |((what, was), (_, is)): ((&str, String), (&str, String))| {
        let (was, is) = brief(&was, &is);
        format!("{what} from {was} to {is}")
    };
    let details: Vec<String> = different.map(detail).collect();
    if !details.is_empty() {
        let detail = details.join("; ");
        found.push(Difference { change: Change::Changed, subject: subject.to_owned(), detail });
    }
}

fn text(text: &Text) -> String {
    if text.en == text.de { format!("\"{}\"", text.en) } else { format!("\"{}\" / \"{}\"", text.en, text.de) }
}

fn advice(advice: &Advice) -> String {
    let urgency = advice.urgency.map_or(String::new(), |urgency| format!(" ({})", urgency.as_str()));
    format!("{}{urgency}", text(&advice.text))
}

/// The wording as one text, if the file has one text.
fn wording<T: Clone + PartialEq>(
    wording: Option<&Wording<T>>,
    text: fn(&T) -> String,
    of_text: fn(T) -> Wording<T>,
) -> String {
    let Some(wording) = wording else { return "none".into() };
    let texts = |words: &ByStage<T>| match words {
        ByStage::None => Vec::new(),
        ByStage::Always(always) => vec![(None, always.clone())],
        ByStage::In(texts) => texts.iter().map(|(stage, text)| (Some(*stage), text.clone())).collect(),
    };
    let error = texts(&wording.error);
    if let Some((_, plain)) = error.first().filter(|(_, it)| of_text(it.clone()) == *wording) {
        return text(plain);
    }
    let level = |(state, words): (State, &ByStage<T>)| {
        let words: Vec<String> = texts(words)
            .iter()
            .map(|(stage, it)| match stage {
                Some(stage) => format!("{} in {}", text(it), stage.as_str()),
                None => text(it),
            })
            .collect();
        format!("{} {}", state.as_str(), words.join(" and "))
    };
    wording.levels().map(level).collect::<Vec<_>>().join(", ")
}

fn condition(model: &Model, when: Option<&When>) -> String {
    when.map_or("always".into(), |when| words::when(model, when))
}

fn dependencies(model: &Model, depends_on: &[Dependency]) -> String {
    let names: Vec<String> =
        depends_on.iter().map(|dependency| words::dependency(model, dependency)).collect();
    listed(&names)
}

fn listed(items: &[String]) -> String {
    if items.is_empty() { "nothing".into() } else { format!("[{}]", items.join(", ")) }
}
