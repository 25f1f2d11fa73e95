//! Converts the written configuration into the model.

mod countermeasures;
pub(crate) mod filters;
mod fleet;
mod implied;
mod monitors;
mod motion;
mod names;
mod publishing;
mod recording;
mod relations;
mod services;
mod signals;
mod topics;

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::describe::places::{NodePlace, Places};
use super::describe::words;
use super::file::nodes::other::RawOther;
use super::file::publishing::RawPublishing;
use super::{Loaded, file};
use crate::decode::{All, Spanned};
use filters::Room;
use names::{Names, check_id};
use relations::Signals;
use telltale_engine::model::wording::Wording;
use telltale_engine::model::{
    Combine, CountsAs, DISPLAY_DPI, Driving, GroupSpec, Limits, Model, ModuleMonitor, ModuleSpec, NodeId,
    NodeNames, Parts, Policy, StageModel, Stop, Unclaimed, Within,
};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_yaml::{Log, Problem, Sources, Span};
use topics::Topics;

/// The model of a file in the folder `base`, if it is valid enough for one; the log has the problems.
pub(super) fn resolve(
    file: &file::File,
    base: &Path,
    message_folders: Vec<PathBuf>,
    log: &mut Log,
) -> Option<Loaded> {
    let vehicle = file.vehicle.as_ref();
    let id = vehicle.and_then(|vehicle| vehicle.id.as_ref());
    let fleet = fleet::fleet(file.fleet.as_ref(), id, base, log);
    let id: Arc<str> = id.filter(|id| check_id(id, "vehicle", log)).map_or("vehicle", |id| &id.value).into();
    let name = vehicle.and_then(|vehicle| vehicle.name.clone()).unwrap_or_else(|| Text::plain(&id));
    let explains = file.defaults.as_ref().and_then(|defaults| defaults.explains_within).unwrap_or_default();
    let defaults = file.defaults.as_ref().map(|defaults| defaults.policy).unwrap_or_default();
    let discovered = policy(&defaults, &Policy::default(), log);
    // Declared modules are expected: only their own `forget_after` ends their silence.
    let declared = Policy { forget_after: None, ..discovered.clone() };

    let mut topics = Topics::new(file.diagnostics.as_ref(), file.clock.unwrap_or_default(), log);
    let (mut signals, signal_places) = signals::signals(&file.signals.0, &mut topics, log);
    let names = Names::of(file, log);
    let index = signals.iter().enumerate().map(|(index, signal)| (&*signal.name, index)).collect();
    let countermeasures = countermeasures::rules(&file.countermeasures, &names, &index, log);
    let localized_after = file.localized_after.unwrap_or(Driving::default().localized_after);
    let (stops, unpublished) = (stops(file, log), Vec::new());
    let speed = motion::speed(file.motion.as_ref(), &mut topics, log);
    let position = motion::position(file.motion.as_ref(), &mut topics, log);
    let mut driving =
        Driving { stops, localized_after, countermeasures, unpublished, speed, position, goal: None };
    let mut room = Room::default();
    let groups = groups(&names, &index, (&discovered, explains), &mut room, log);
    let mut modules = modules(&names, &index, (&declared, explains), &mut topics, log);
    let implied = implied::modules(&names, &declared, log);
    let implied_places: Vec<Span> = implied.iter().map(|(_, span)| *span).collect();
    modules.extend(implied.into_iter().map(|(module, _)| module));
    let written = vehicle.and_then(|vehicle| vehicle.stages.as_ref());
    let stages = written.map_or(StageModel::Shuttle, |stages| stages.value);
    let rules = &driving.countermeasures;
    let publishing = publishing::publishing(file.publish.as_ref(), stages, rules, &topics, log);
    signals::complete(&mut signals, &topics);
    if !driving.stops.is_empty() {
        driving.goal = motion::goal(&signals, &mut topics, log);
    }
    let recording = recording::recording(file.recording.as_ref(), log);
    let services = services::services(file.services.as_ref(), stages, log);
    driving.unpublished = publishing.switched_off();
    let (mut watched, topics) = topics.finish();
    watched.recorded = recording.as_ref().map_or_else(Vec::new, |recording| recording.topics.clone());
    watched.published = publishing.topics();
    let limits = limits(file.limits.as_ref(), log);
    let dpi = file.display.as_ref().and_then(|display| display.dpi);
    let display_dpi = within(dpi, DISPLAY_DPI as usize, file::DPI, log) as u32;
    let unclaimed =
        file.other.as_ref().map(|other| unclaimed(other, &discovered, &mut room, log)).unwrap_or_default();
    let parts = Parts {
        vehicle_id: id,
        vehicle_name: name,
        stages,
        signals,
        groups,
        modules,
        watched,
        driving,
        discovered,
        other: file.other.as_ref().and_then(|other| other.show).unwrap_or_default(),
        unclaimed,
        limits,
        display_dpi,
    };
    let model = match Model::new(parts) {
        Ok(model) => Arc::new(model),
        Err(cycle) => {
            log.push(relations::describe_cycle(&names, &cycle));
            return None;
        }
    };
    let rules = countermeasures::spans(&file.countermeasures);
    let stop_off = file.publish.as_ref().and_then(RawPublishing::stop_off);
    let diagnostics = file.diagnostics.iter().flat_map(|raw| &raw.topics);
    let diagnostics = diagnostics.filter_map(|raw| raw.topic.as_ref()).map(|topic| topic.span);
    let places = Places {
        topics,
        signals: signal_places,
        diagnostics: diagnostics.collect(),
        rules,
        stop_off,
        stages: written.map(|stages| stages.span),
        ..places(&names, &implied_places)
    };
    Some(Loaded { model, publishing, recording, services, fleet, message_folders, places: Arc::new(places) })
}

fn places(names: &Names, implied: &[Span]) -> Places {
    let place = |node: NodeId, when: Option<&file::When>, targets: Vec<Span>| NodePlace {
        id: names.span(node),
        when: when.map(|when| when.span),
        depends_on: names.dependencies(node).iter().map(|dependency| dependency.span).collect(),
        targets,
    };
    let groups = names.groups().map(|(id, group)| {
        let patterns = group.raw.filters.iter().filter_map(|filter| filter.pattern.as_ref());
        let patterns = patterns.map(|pattern| pattern.text.span).collect();
        place(NodeId::Group(id), group.raw.when.as_ref(), patterns)
    });
    let modules = names.modules().map(|(id, module)| {
        let target = module.raw.target().into_iter().collect();
        place(NodeId::Module(id), module.raw.when.as_ref(), target)
    });
    let implied =
        implied.iter().map(|&id| NodePlace { id, when: None, depends_on: Vec::new(), targets: vec![id] });
    Places {
        sources: Sources::default(),
        groups: groups.collect(),
        modules: modules.chain(implied).collect(),
        topics: Vec::new(),
        signals: Vec::new(),
        diagnostics: Vec::new(),
        rules: Vec::new(),
        stop_off: None,
        stages: None,
    }
}

pub(super) fn policy(raw: &file::Policy, around: &Policy, log: &mut Log) -> Policy {
    if let Some(timeout) = raw.timeout.filter(|timeout| timeout.value.is_zero()) {
        let problem = Problem::at(timeout.span, "a timeout of nothing would make everything stale at once");
        log.push(problem.help("write a duration above 0, for example `2s`"));
    }
    let timeout = raw.timeout.map_or(around.timeout, |timeout| timeout.value);
    let forget_after = raw.forget_after.map(|after| after.value).or(around.forget_after);
    if let Some(after) = forget_after.filter(|&after| after < timeout) {
        let text = "it would be forgotten before it counts as silent";
        let (above, after) = (words::span(timeout), words::span(after));
        match (raw.forget_after, raw.timeout) {
            (Some(written), _) => {
                let problem = Problem::at(written.span, text).label("`forget_after`");
                log.push(
                    problem
                        .help(format!("write a duration that is not below its `timeout`, which is {above}")),
                );
            }
            (None, Some(written)) => {
                let problem = Problem::at(written.span, text).label("`timeout`");
                log.push(problem.help(format!(
                    "add a `forget_after` here that is not below it, or write a duration up to that of `defaults`, which is {after}"
                )));
            }
            (None, None) => {}
        }
    }
    Policy {
        timeout,
        stale: raw.stale.unwrap_or(around.stale),
        raise_after: raw.raise_after.unwrap_or(around.raise_after),
        clear_after: raw.clear_after.unwrap_or(around.clear_after),
        no_publisher: raw.no_publisher.unwrap_or(around.no_publisher),
        latch: raw.latch.or(around.latch),
        forget_after,
        writers: None,
        counts_as: raw.counts_as.unwrap_or(around.counts_as),
    }
}

/// The policy for statuses that no group takes.
fn unclaimed(raw: &RawOther, around: &Policy, room: &mut Room, log: &mut Log) -> Unclaimed {
    let policy = Policy {
        counts_as: raw.state.map_or(CountsAs::Reported, |_| CountsAs::Error),
        ..policy(&raw.policy, around, log)
    };
    let except = raw.except.iter().filter_map(|pattern| filters::resolve(pattern, room, log)).collect();
    Unclaimed { policy: Some(policy).filter(|policy| policy != around), except }
}

/// Full names of nodes.
pub(super) fn writers(raw: Option<&file::Writers>, log: &mut Log) -> Option<NodeNames> {
    let file::Writers { value: All(written), span } = raw?;
    if written.is_empty() {
        let problem = Problem::at(*span, "without a node nobody could say it");
        log.push(problem.help("name the nodes, or remove `writers`"));
    }
    let word = |word: &str| {
        let first = word.chars().next().is_some_and(|first| first.is_ascii_alphabetic() || first == '_');
        first && word.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
    };
    let mut names = Vec::new();
    for node in written {
        let whole = node.value.strip_prefix('/');
        if !whole.is_some_and(|whole| whole.split('/').all(word)) {
            let problem = Problem::at(node.span, format!("`{}` is not the whole name of a node", node.value));
            log.push(
                problem.help("write it as `ros2 node list` does, with its namespace: `/sensors/driver`"),
            );
        }
        names.push(node.value.as_str().into());
    }
    Some(names.into())
}

fn stops(file: &file::File, log: &mut Log) -> Vec<Stop> {
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

fn limits(raw: Option<&file::Limits>, log: &mut Log) -> Limits {
    let default = Limits::default();
    let Some(raw) = raw else { return default };
    let mut limit = |value, otherwise, range| within(value, otherwise, range, log);
    let status_bytes = limit(raw.status_bytes, default.status_bytes, file::STATUS_BYTES);
    let source_bytes =
        limit(raw.source_bytes, status_bytes / 2, file::SOURCE_BYTES_MIN..=status_bytes as u64);
    Limits {
        status_bytes,
        source_bytes,
        discovered_modules: limit(
            raw.discovered_modules,
            default.discovered_modules,
            file::DISCOVERED_MODULES,
        ),
        values_per_status: limit(raw.values_per_status, default.values_per_status, file::VALUES_PER_STATUS),
        string_bytes: limit(raw.string_bytes, default.string_bytes, file::STRING_BYTES),
    }
}

/// A whole number in its range, or its default.
fn within(value: Option<Spanned<u64>>, otherwise: usize, range: RangeInclusive<u64>, log: &mut Log) -> usize {
    let Some(value) = value else { return otherwise };
    if !range.contains(&value.value) {
        let (least, most) = range.into_inner();
        let problem = Problem::at(value.span, format!("{} is not between {least} and {most}", value.value));
        log.push(problem.help(format!("the default is {otherwise}")));
    }
    value.value as usize
}

fn groups(
    names: &Names,
    signals: &Signals,
    (defaults, explains): (&Policy, Within),
    room: &mut Room,
    log: &mut Log,
) -> Vec<GroupSpec> {
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
            depends_on: relations::depends_on(names, NodeId::Group(id), (&raw.depends_on, explains), log),
            filters: filters::filters(&raw.filters, names, defaults, room, log),
            may_be_empty: raw.empty == Some(State::Ok),
            tile,
        });
    }
    specs
}

fn check_tile(
    tile: &Spanned<file::Tile>,
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
    if !(1..=file::TILE_MAX).contains(&column) || !(1..=file::TILE_MAX).contains(&row) {
        let problem = Problem::at(tile.span, format!("column and row go from 1 to {}", file::TILE_MAX));
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
    (defaults, explains): (&Policy, Within),
    topics: &mut Topics,
    log: &mut Log,
) -> Vec<ModuleSpec> {
    let mut specs = Vec::new();
    for (id, module) in names.modules() {
        let raw = module.raw;
        let policy = policy(&raw.policy, defaults, log);
        let writers = writers(raw.writers.as_ref(), log);
        let when = raw.when.as_ref().and_then(|when| relations::when(when, signals, log));
        let depends_on = relations::depends_on(names, NodeId::Module(id), (&raw.depends_on, explains), log);
        // Without a monitor the model is discarded; the module keeps its index so that cycles are found.
        let monitor = raw.monitor.as_ref().and_then(|monitor| monitors::resolve(monitor, topics, log));
        let by_the_clock = monitor.as_ref().is_some_and(ModuleMonitor::by_the_clock);
        if let Some(forget_after) = raw.policy.forget_after.filter(|_| by_the_clock) {
            let problem =
                Problem::at(forget_after.span, "this monitor judges by the clock: it is never silent");
            log.push(problem.help("remove `forget_after`"));
        }
        let takes_status = monitor.as_ref().is_none_or(|monitor| monitor.status().is_some());
        if let Some(misplaced) = raw.writers.as_ref().filter(|_| !takes_status) {
            let problem = Problem::at(misplaced.span, "`writers` is only for a module that takes a status");
            log.push(problem.help("remove it, or put it beside the `status` of a module"));
        }
        specs.push(ModuleSpec {
            id: module.path.clone(),
            name: raw.name.as_ref().map(|name| name.resolve(Wording::name).into()),
            help: raw.help.as_ref().map(|help| help.resolve(Wording::help).into()),
            group: module.group,
            policy: Policy { writers, ..policy },
            when: when.map(Box::new),
            depends_on,
            monitor: monitor.unwrap_or_else(|| ModuleMonitor::SelfState("".into())),
            expected: None,
        });
    }
    names::check_statuses(names, log);
    specs
}

pub(super) fn twice(again: Span, first: Span, what: &str) -> Problem {
    let problem = Problem::at(again, format!("{what} is declared twice")).label("again here");
    problem.also(first, "first here").help("rename or remove one of the two")
}
