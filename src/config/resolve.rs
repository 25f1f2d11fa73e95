//! From what is written to what the engine takes.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::names::{self, Names, check_id};
use super::places::{NodePlace, Places};
use super::raw;
use super::relations::{self, Signals};
use super::topics::{self, Topics};
use super::{Loaded, countermeasures, monitors, publishing};
use crate::engine::model::{
    Combine, Driving, FieldSource, GroupSpec, Limits, Model, ModuleSpec, MonitorSpec, NodeId, POSED_SIGNAL,
    Parts, Policy, SignalSpec, StageModel, Stop, Text,
};
use crate::engine::time;
use crate::yaml::{Log, Problem, Sources, Span, Spanned};

const LOCALIZED_AFTER: time::Span = time::Span::from_secs(2);
const TILE_MAX: u64 = 12;

/// What a file says, if it can be said to the engine; the log says what is wrong.
pub(super) fn resolve(file: &raw::File, message_folders: Vec<PathBuf>, log: &mut Log) -> Option<Loaded> {
    let vehicle = file.vehicle.as_ref();
    let id = vehicle.and_then(|vehicle| vehicle.id.as_ref());
    let id: Arc<str> = id.filter(|id| check_id(id, "vehicle", log)).map_or("vehicle", |id| &id.value).into();
    let name = vehicle.and_then(|vehicle| vehicle.name.clone()).unwrap_or_else(|| Text::plain(&id));
    let defaults = file.defaults.as_ref().map(|defaults| defaults.0).unwrap_or_default();
    let defaults = policy(&defaults, &Policy::default(), log);

    let mut topics = Topics::new();
    let (signals, signal_places) = signals(file, &mut topics, log);
    let names = Names::of(file, log);
    let index = signals.iter().enumerate().map(|(index, signal)| (&*signal.name, index)).collect();
    let countermeasures = countermeasures::rules(&file.countermeasures, &names, &index, log);
    let localized_after = file.localized_after.unwrap_or(LOCALIZED_AFTER);
    let driving = Driving { stops: stops(file, log), localized_after, countermeasures };
    let groups = groups(&names, &index, log);
    let modules = modules(&names, &index, &defaults, &mut topics, log);
    let stages = vehicle.and_then(|vehicle| vehicle.stages).unwrap_or(StageModel::Shuttle);
    let rules = &driving.countermeasures;
    let publishing = publishing::publishing(file.publish.as_ref(), stages, rules, &topics, log);
    let (watched, topics) = topics.finish();
    let limits = limits(file.limits.as_ref(), log);
    let parts = Parts {
        vehicle_id: id,
        vehicle_name: name,
        stages,
        signals,
        groups,
        modules,
        watched,
        driving,
        discovered: defaults,
        limits,
    };
    let model = match Model::new(parts) {
        Ok(model) => Arc::new(model),
        Err(cycle) => {
            log.push(relations::describe_cycle(&names, &cycle));
            return None;
        }
    };
    let rules = countermeasures::spans(&file.countermeasures);
    let places = Places { topics, signals: signal_places, rules, ..places(&names) };
    Some(Loaded { model, publishing, message_folders, places: Arc::new(places) })
}

fn places(names: &Names) -> Places {
    let place = |node: NodeId, when: Option<&raw::When>| NodePlace {
        id: names.span(node),
        when: when.map(|when| when.span),
        depends_on: names.dependencies(node).iter().map(|dependency| dependency.span).collect(),
    };
    let groups = names.groups().map(|(id, group)| place(NodeId::Group(id), group.raw.when.as_ref()));
    let modules = names.modules().map(|(id, module)| place(NodeId::Module(id), module.raw.when.as_ref()));
    Places {
        sources: Sources::default(),
        groups: groups.collect(),
        modules: modules.collect(),
        topics: Vec::new(),
        signals: Vec::new(),
        rules: Vec::new(),
    }
}

fn policy(raw: &raw::Policy, around: &Policy, log: &mut Log) -> Policy {
    if let Some(timeout) = raw.timeout.filter(|timeout| timeout.value.is_zero()) {
        let problem = Problem::at(timeout.span, "a timeout of nothing would make everything stale at once");
        log.push(problem.help("write a duration above 0, for example `2s`"));
    }
    Policy {
        timeout: raw.timeout.map_or(around.timeout, |timeout| timeout.value),
        stale: raw.stale.unwrap_or(around.stale),
        raise_after: raw.raise_after.unwrap_or(around.raise_after),
        clear_after: raw.clear_after.unwrap_or(around.clear_after),
        no_publisher: raw.no_publisher.unwrap_or(around.no_publisher),
        latch: raw.latch.or(around.latch),
    }
}

fn signals(file: &raw::File, topics: &mut Topics, log: &mut Log) -> (Vec<SignalSpec>, Vec<(Span, Span)>) {
    let mut seen: HashMap<&str, Span> = HashMap::new();
    let (mut signals, mut places) = (Vec::new(), Vec::new());
    for (key, raw) in &file.signals.0 {
        check_id(&Spanned { value: key.text.clone(), span: key.span }, "signal", log);
        if key.text == POSED_SIGNAL {
            let problem = Problem::at(key.span, "`posed` is built in: it says that the operator gave a pose");
            log.push(problem.help("choose another name"));
        }
        if let Some(first) = seen.insert(&key.text, key.span) {
            log.push(twice(key.span, first, &format!("signal `{}`", key.text)));
        }
        for span in [raw.timeout, raw.present_for].into_iter().flatten().filter(|span| span.value.is_zero()) {
            log.push(Problem::at(span.span, "expected a duration above 0").help("for example `2s`"));
        }
        let Some((source, place)) = field_source(raw, topics, log) else { continue };
        places.push(place);
        signals.push(SignalSpec {
            name: key.text.as_str().into(),
            source,
            timeout: raw.timeout.map(|span| span.value),
            present_for: raw.present_for.map(|span| span.value),
        });
    }
    (signals, places)
}

/// Where a signal comes from; the places of its type and its field.
fn field_source(
    raw: &raw::Signal,
    topics: &mut Topics,
    log: &mut Log,
) -> Option<(FieldSource, (Span, Span))> {
    let (topic, type_name) = (raw.topic.as_ref()?, raw.type_name.as_ref()?);
    topics.read(topic, type_name, log);
    let field = match &raw.field {
        Some(field) => {
            topics::check_path(field, log);
            &field.value
        }
        None if type_name.value.starts_with("std_msgs/") => "data",
        // Only that the message came matters then.
        None if raw.present_for.is_some() => "",
        None => {
            let problem = Problem::at(type_name.span, format!("which field of a {}?", type_name.value));
            log.push(problem.help("add `field: PATH`, or `present_for: 1h` if only its arrival matters"));
            return None;
        }
    };
    let place = (type_name.span, raw.field.as_ref().map_or(type_name.span, |field| field.span));
    let source = FieldSource {
        topic: topic.value.as_str().into(),
        type_name: type_name.value.as_str().into(),
        field: field.into(),
    };
    Some((source, place))
}

fn stops(file: &raw::File, log: &mut Log) -> Vec<Stop> {
    let mut seen: HashMap<&str, Span> = HashMap::new();
    let mut stops = Vec::new();
    for raw in &file.stops {
        let Some(id) = raw.id.as_ref().filter(|id| check_id(id, "stop", log)) else { continue };
        if let Some(first) = seen.insert(&id.value, id.span) {
            log.push(twice(id.span, first, &format!("stop `{}`", id.value)));
        }
        if let (Some(x_m), Some(y_m)) = (raw.x, raw.y) {
            let name = raw.name.clone().unwrap_or_else(|| Text::plain(&id.value));
            let yaw_deg = raw.yaw_deg.unwrap_or(0.0);
            stops.push(Stop { id: id.value.as_str().into(), name, x_m, y_m, yaw_deg });
        }
    }
    stops
}

fn limits(raw: Option<&raw::Limits>, log: &mut Log) -> Limits {
    let default = Limits::default();
    let Some(raw) = raw else { return default };
    let mut limit = |value: Option<Spanned<u64>>, otherwise: usize, least: u64, most: u64| {
        let Some(value) = value else { return otherwise };
        if !(least..=most).contains(&value.value) {
            let problem =
                Problem::at(value.span, format!("{} is not between {least} and {most}", value.value));
            log.push(problem.help(format!("the default is {otherwise}")));
        }
        value.value as usize
    };
    Limits {
        discovered_modules: limit(raw.discovered_modules, default.discovered_modules, 0, 1_000_000),
        values_per_status: limit(raw.values_per_status, default.values_per_status, 0, 65_536),
        string_bytes: limit(raw.string_bytes, default.string_bytes, 16, 1 << 20),
    }
}

fn groups(names: &Names, signals: &Signals, log: &mut Log) -> Vec<GroupSpec> {
    let mut tiles: HashMap<(u8, u8), Span> = HashMap::new();
    let mut specs = Vec::new();
    for (id, group) in names.groups() {
        let raw = group.raw;
        let tile =
            raw.tile.as_ref().and_then(|tile| check_tile(tile, group.parent.is_some(), &mut tiles, log));
        specs.push(GroupSpec {
            path: group.path.clone(),
            name: raw.name.clone().unwrap_or_else(|| Text::plain(group.id())),
            parent: group.parent,
            combine: raw.combine.unwrap_or(Combine::Worst),
            when: raw.when.as_ref().and_then(|when| relations::when(when, signals, log)),
            depends_on: relations::depends_on(names, NodeId::Group(id), &raw.depends_on, log),
            filters: super::filters::filters(&raw.filters, names, log),
            tile,
        });
    }
    specs
}

fn check_tile(
    tile: &Spanned<raw::Tile>,
    nested: bool,
    taken: &mut HashMap<(u8, u8), Span>,
    log: &mut Log,
) -> Option<(u8, u8)> {
    if nested {
        let problem = Problem::at(tile.span, "only a group at the top has a tile");
        log.push(problem.help("remove `tile` from this group"));
        return None;
    }
    let (column, row) = (tile.value.column?, tile.value.row?);
    if !(1..=TILE_MAX).contains(&column) || !(1..=TILE_MAX).contains(&row) {
        let problem = Problem::at(tile.span, format!("column and row go from 1 to {TILE_MAX}"));
        log.push(problem.help("the first column and the first row are 1"));
        return None;
    }
    let place = (column as u8, row as u8);
    if let Some(first) = taken.insert(place, tile.span) {
        let problem = Problem::at(tile.span, "two tiles stand in one place").label("again here");
        log.push(problem.also(first, "first here").help("choose another column or row"));
    }
    Some(place)
}

fn modules(
    names: &Names,
    signals: &Signals,
    defaults: &Policy,
    topics: &mut Topics,
    log: &mut Log,
) -> Vec<ModuleSpec> {
    let mut specs = Vec::new();
    for (id, module) in names.modules() {
        let raw = module.raw;
        let policy = policy(&raw.policy, defaults, log);
        let when = raw.when.as_ref().and_then(|when| relations::when(when, signals, log));
        let depends_on = relations::depends_on(names, NodeId::Module(id), &raw.depends_on, log);
        // Without a monitor the model is not used; the module keeps its place so that cycles are found.
        let monitor = raw.monitor.as_ref().and_then(|monitor| monitors::resolve(monitor, topics, log));
        specs.push(ModuleSpec {
            id: module.path.clone(),
            name: raw.name.clone(),
            help: raw.help.clone(),
            group: module.group,
            policy,
            when,
            depends_on,
            monitor: monitor.unwrap_or_else(|| MonitorSpec::SelfState { status: "".into() }),
        });
    }
    names::check_statuses(names, log);
    specs
}

pub(super) fn twice(again: Span, first: Span, what: &str) -> Problem {
    let problem = Problem::at(again, format!("{what} is declared twice")).label("again here");
    problem.also(first, "first here").help("rename or remove one of the two")
}
