//! From observations to a draft of a configuration.

use std::collections::{BTreeMap, BTreeSet};

use super::grouping::Grouping;
use super::names::{self, comment, is_full_name, is_tool, prefix};
use super::observations::{
    Frame, Messages, Observations, STATUSES_MAX, Status, is_of_components, measured_type,
};
use super::passing::{self, Passing};
use super::proposals::{Proposal, propose};
use super::rhythm::{Steady, at_least_ms};
use super::values::{self, Meaning};
use telltale_engine::discovery::{Endpoint, TopicSeen};
use telltale_engine::model::lateness::KILLED_NODE;
use telltale_engine::pace::RateLimits;
use telltale_engine::time::Timestamp;

/// Modules that are written out in one group; further statuses join it by their names.
const MODULES_MAX: usize = 100;
/// Nodes of one group that are watched.
const NODES_MAX: usize = 20;
/// A node that is not announced at so many looks in a row, this far apart, does not run.
pub const NODE_EVERY_S: u64 = 1;
pub const NODE_MISSES: u64 = 3;
/// A value that repeats for as long as this many messages take is frozen.
const FROZEN_MESSAGES: f64 = 10.0;
/// Lines on one subject.
const LINES_MAX: usize = 10;
/// How a remark on what is left out begins.
const FURTHER: &str = "further ";
/// Ages outside of these seconds come from another clock. A transform may be dated ahead.
const AGES_S: (f64, f64) = (-5.0, 60.0);

#[derive(Debug, Default)]
pub struct Draft {
    pub groups: Vec<Group>,
    /// The first facts for a reader.
    pub notes: Vec<String>,
    /// Topics of diagnostics beside `/diagnostics`.
    pub diagnostics: Vec<String>,
    /// Folders with the definitions of types that are not built in.
    pub message_folders: Vec<String>,
    /// Nodes that publish nothing that can be judged.
    pub quiet: Vec<String>,
    pub observed_s: u64,
}

#[derive(Debug, Default)]
pub struct Group {
    pub id: String,
    /// The words for people.
    pub title: String,
    /// Its content, for a comment.
    pub about: String,
    /// Namespaces of statuses that join it.
    pub namespaces: Vec<String>,
    /// Statuses that join it by their whole names.
    pub names: Vec<String>,
    /// Statuses that come and go.
    pub passing: Vec<Passing>,
    pub modules: Vec<Module>,
    /// Sightings that became no module.
    pub remarks: Vec<String>,
    /// Further ones, which are only counted.
    pub more_remarks: usize,
}

#[derive(Debug)]
pub struct Module {
    pub id: String,
    pub kind: ModuleKind,
    /// The evidence, for a comment.
    pub about: String,
    /// The nodes that it tells about.
    pub nodes: Vec<String>,
    pub proposals: Vec<Proposal>,
}

#[derive(Debug)]
pub enum ModuleKind {
    Status {
        name: String,
        timeout_ms: u64,
    },
    Rate {
        topic: String,
        type_name: String,
        limits: RateLimits,
        /// For how long it may repeat itself, if it never did.
        frozen_ms: Option<u64>,
        transforms: Vec<Transform>,
    },
    Age {
        topic: String,
        type_name: String,
        warning_ms: u64,
    },
    Value {
        topic: String,
        type_name: String,
        meaning: Meaning,
        /// `None`: its messages are events.
        timeout_ms: Option<u64>,
    },
    Node {
        name: String,
        /// Whether it is a lifecycle node, which must be active.
        has_lifecycle: bool,
    },
}

impl ModuleKind {
    /// The longest time until a fault is noticed, as `check` reckons it.
    pub fn noticed_s(&self) -> u64 {
        match self {
            ModuleKind::Rate { limits, .. } => limits.window_s,
            ModuleKind::Node { has_lifecycle: true, .. } => NODE_EVERY_S * NODE_MISSES,
            ModuleKind::Node { .. } => KILLED_NODE.as_millis() / 1000 + NODE_EVERY_S * NODE_MISSES,
            ModuleKind::Status { .. } | ModuleKind::Age { .. } | ModuleKind::Value { .. } => 0,
        }
    }
}

/// A transform that came on a topic again and again.
#[derive(Debug)]
pub struct Transform {
    pub parent: String,
    pub child: String,
    pub rate_hz: f64,
    pub warning_ms: u64,
}

/// The conclusions from observations that began and ended then.
pub fn draft(seen: &Observations, start: Timestamp, end: Timestamp) -> Draft {
    let grouping = Grouping::of(seen);
    let mut parts: BTreeMap<&str, Parts> = BTreeMap::new();
    for (name, key) in &grouping.of_status {
        let Some(status) = seen.statuses.get(name) else { continue };
        parts.entry(key).or_default().statuses.push((name, status));
    }
    for (node, key) in grouping.of_node.iter().filter(|(node, _)| is_full_name(node)) {
        parts.entry(key).or_default().nodes.push(node);
    }
    for topic in seen.discovery.topics.iter().filter(|topic| is_of_components(topic)) {
        if let Some(key) = owner(topic, &grouping) {
            parts.entry(key).or_default().topics.push(topic);
        }
    }
    let mut taken = BTreeSet::new();
    let groups = parts.iter().map(|(key, parts)| group(key, parts, seen, &grouping, end, &mut taken));
    let mut groups: Vec<Group> = groups.collect();
    let keys: Vec<&str> = parts.keys().copied().collect();
    let order = propose(&mut groups, &keys, seen, &grouping);
    let mut by_place: Vec<Option<Group>> = groups.into_iter().map(Some).collect();
    let groups = order.into_iter().filter_map(|place| by_place[place].take());
    let mut groups: Vec<Group> = groups.filter(Group::is_judged).collect();
    let ids: BTreeSet<String> = groups.iter().map(|group| group.id.clone()).collect();
    for module in groups.iter_mut().flat_map(|group| &mut group.modules) {
        module.proposals.retain(|proposal| ids.contains(&proposal.group));
    }
    let quiet =
        seen.discovery.nodes.iter().filter(|node| !is_tool(node) && !grouping.of_node.contains_key(*node));
    let mut notes = notes(seen);
    if groups.iter().any(Group::is_cut) {
        notes.push(format!(
            "It is a start, not all that was heard: a group has up to {MODULES_MAX} statuses with modules of their own and \
             {NODES_MAX} nodes. \"Not judged\" says what each leaves out."
        ));
    }
    Draft {
        groups,
        notes,
        diagnostics: seen.more_diagnostics(),
        message_folders: Vec::new(),
        quiet: quiet.cloned().collect(),
        observed_s: (end.since(start).as_millis() + 500) / 1000,
    }
}

impl Draft {
    /// The types of the topics that are measured, and whether their stamps are read.
    pub fn types(&self) -> BTreeSet<(&str, bool)> {
        let modules = self.groups.iter().flat_map(|group| &group.modules);
        let measured = modules.filter_map(|module| match &module.kind {
            ModuleKind::Rate { type_name, .. } | ModuleKind::Value { type_name, .. } => {
                Some((type_name.as_str(), false))
            }
            ModuleKind::Age { type_name, .. } => Some((type_name.as_str(), true)),
            ModuleKind::Status { .. } | ModuleKind::Node { .. } => None,
        });
        measured.collect()
    }
}

impl Group {
    fn is_judged(&self) -> bool {
        !(self.modules.is_empty()
            && self.namespaces.is_empty()
            && self.names.is_empty()
            && self.passing.is_empty())
    }

    fn is_cut(&self) -> bool {
        self.remarks.iter().any(|remark| remark.starts_with(FURTHER)) || self.more_remarks > 0
    }
}

/// The members of one group.
#[derive(Default)]
struct Parts<'a> {
    nodes: Vec<&'a str>,
    statuses: Vec<(&'a str, &'a Status)>,
    topics: Vec<&'a TopicSeen>,
}

/// The group of the first publisher.
fn owner<'a>(topic: &TopicSeen, grouping: &'a Grouping) -> Option<&'a str> {
    let mut publishers = topic.publishers.iter().filter(|it| !it.ours);
    let of_node = publishers.find_map(|it| grouping.of_endpoint(it));
    of_node.or_else(|| grouping.of_topic.get(&topic.name).map(|key| &**key))
}

fn notes(seen: &Observations) -> Vec<String> {
    let mut notes = Vec::new();
    if seen.statuses.is_empty() {
        notes.push(
            "No status was heard on /diagnostics: the modules below are what can be measured from outside."
                .to_owned(),
        );
    }
    if seen.refused > 0 {
        notes.push(format!(
            "{} reports are left out: their names are empty or longer than 256 bytes, or there are more than {STATUSES_MAX} names.",
            seen.refused
        ));
    }
    if seen.discovery.more > 0 {
        notes.push(format!("{} further topics were not looked at.", seen.discovery.more));
    }
    if seen.discovery.topics.iter().any(|topic| topic.name == "/clock" && !topic.publishers.is_empty()) {
        notes.push(
            "/clock is published, perhaps by a simulation. If the messages are stamped by it, write: clock: ros".to_owned(),
        );
    }
    notes
}

fn group(
    key: &str,
    parts: &Parts,
    seen: &Observations,
    grouping: &Grouping,
    end: Timestamp,
    ids: &mut BTreeSet<String>,
) -> Group {
    let id = names::id(key, "group", ids);
    let title = Some(names::title(key)).filter(|title| !title.is_empty()).unwrap_or_else(|| id.clone());
    let mut group = Group { id, title, ..Group::default() };
    group.about = about(&parts.nodes);
    let mut taken = BTreeSet::new();
    let passing = passing::find(&parts.statuses, end);
    let passes = |name: &str| passing.iter().any(|(_, names)| names.contains(&name));
    for (name, status) in parts.statuses.iter().filter(|(name, _)| !passes(name)) {
        let namespace = prefix(name).map(|it| it.trim_start_matches('/'));
        match namespace.filter(|namespace| is_of_one_group(namespace, key, grouping)) {
            Some(namespace) if !group.namespaces.iter().any(|known| known == namespace) => {
                group.namespaces.push(namespace.to_owned());
            }
            Some(_) => {}
            None => group.names.push((*name).to_owned()),
        }
        if group.modules.len() < MODULES_MAX {
            let node = grouping.node_of_status.get(*name).cloned();
            let module = status_module(name, status, end, &mut taken);
            group.modules.push(Module { nodes: node.into_iter().collect(), ..module });
        }
    }
    for topic in &parts.topics {
        match measured_type(topic) {
            Some(type_name) => {
                judge(&mut group, topic, (type_name, seen.topics.get(&*topic.name)), end, &mut taken);
            }
            None => {
                let types = topic.types().join(", ");
                remark(
                    &mut group,
                    topic,
                    &types,
                    "published with several types, or none that Telltale reads",
                );
            }
        }
    }
    let announced: BTreeSet<&str> = seen.discovery.nodes.iter().map(|node| &**node).collect();
    let nodes: Vec<&str> = parts.nodes.iter().copied().filter(|node| announced.contains(node)).collect();
    let left_out = [
        (
            nodes.len(),
            NODES_MAX,
            "nodes: whether they run is not watched; add `node: NAME` for those that matter.",
        ),
        (
            parts.statuses.len() - passing.iter().map(|(_, names)| names.len()).sum::<usize>(),
            MODULES_MAX,
            "statuses: they join the group by `match` or `other`; add a module for those that must be there.",
        ),
    ];
    for (count, kept, what) in left_out.into_iter().filter(|(count, kept, _)| count > kept) {
        group.remarks.insert(0, format!("{FURTHER}{} {what}", count - kept));
    }
    group.passing = passing.into_iter().map(|(passing, _)| passing).collect();
    for node in nodes.iter().take(NODES_MAX) {
        let last = node.rsplit('/').next().unwrap_or(node);
        let get_state = format!("{node}/get_state");
        let has_lifecycle = seen.discovery.services.contains(&get_state);
        let (word, about) = match has_lifecycle {
            true => ("active", "It is a lifecycle node; Telltale calls its service get_state."),
            false => ("runs", "Its node is announced."),
        };
        let id = names::id(&format!("{last}_{word}"), &format!("node_{word}"), &mut taken);
        let (name, nodes) = ((*node).to_owned(), vec![(*node).to_owned()]);
        group.modules.push(Module {
            id,
            kind: ModuleKind::Node { name, has_lifecycle },
            about: about.to_owned(),
            nodes,
            proposals: Vec::new(),
        });
    }
    group
}

fn about(nodes: &[&str]) -> String {
    let more = nodes.len().saturating_sub(LINES_MAX);
    let listed: Vec<String> = nodes.iter().take(LINES_MAX).map(|node| comment(node)).collect();
    match (listed.is_empty(), more) {
        (true, _) => "No node is announced for it; its names say that it belongs together.".to_owned(),
        (false, 0) => format!("Of {}.", listed.join(", ")),
        (false, more) => format!("Of {}, and {more} further nodes.", listed.join(", ")),
    }
}

/// Whether all statuses with this prefix are in this group.
fn is_of_one_group(namespace: &str, key: &str, grouping: &Grouping) -> bool {
    let within = |name: &str| {
        let rest = name.trim_start_matches('/').strip_prefix(namespace);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['/', ':']))
    };
    grouping.of_status.iter().all(|(name, of)| of == key || !within(name))
}

fn status_module(name: &str, status: &Status, end: Timestamp, taken: &mut BTreeSet<String>) -> Module {
    let rest = prefix(name).and_then(|prefix| name.split_once(prefix)).map_or(name, |(_, rest)| rest);
    let words = if rest.chars().any(char::is_alphanumeric) { rest } else { name };
    let id = names::id(words, "status", taken);
    let longest_s = status.rhythm.longest_s(end);
    let (timeout_ms, rate) = match status.rhythm.rate_hz() {
        Some(rate) => {
            (at_least_ms((3.0 * longest_s).max(1.0)), format!("{rate:.1} Hz, longest pause {longest_s:.1} s"))
        }
        None => (600_000, "heard once, so its timeout is a guess".to_owned()),
    };
    let state = match (status.last, status.worst) {
        (last, worst) if last == worst => last.as_str().to_uppercase(),
        (last, worst) => {
            format!("{}, meanwhile {}", last.as_str().to_uppercase(), worst.as_str().to_uppercase())
        }
    };
    let kind = ModuleKind::Status { name: name.to_owned(), timeout_ms };
    let about = format!("{state}, {rate}.");
    Module { id, kind, about, nodes: Vec::new(), proposals: Vec::new() }
}

fn remark(group: &mut Group, topic: &TopicSeen, type_name: &str, why: &str) {
    if group.remarks.len() >= LINES_MAX {
        group.more_remarks += 1;
        return;
    }
    group.remarks.push(format!("{} ({}): {why}.", comment(&topic.name), comment(type_name)));
}

/// Those with a rhythm, and with one parent.
fn transforms(messages: &Messages, end: Timestamp) -> Vec<Transform> {
    let age_s = messages.age_ns.map_or(0.0, |(_, most)| (most as f64 / 1e9).clamp(0.0, AGES_S.1));
    let of = |(child, frame): (&str, &Frame)| {
        let steady = frame.rhythm.steady(end).filter(|_| !frame.has_two)?;
        let warning_ms = at_least_ms((3.0 * steady.longest_s + age_s).max(0.2));
        let (parent, child) = (frame.parent.to_string(), child.to_string());
        Some(Transform { parent, child, rate_hz: steady.rate_hz, warning_ms })
    };
    messages.frames.iter().map(|(child, frame)| (&**child, frame)).filter_map(of).take(LINES_MAX).collect()
}

/// The monitors of a topic: of its rate and age, and of its content where that has a known meaning.
fn judge(
    group: &mut Group,
    topic: &TopicSeen,
    (type_name, messages): (&str, Option<&Messages>),
    end: Timestamp,
    taken: &mut BTreeSet<String>,
) {
    let meaning = Meaning::of(&topic.name, type_name);
    let keeps = |it: &Endpoint| it.reliable && it.transient_local;
    let is_kept = !topic.publishers.is_empty() && topic.publishers.iter().all(keeps);
    let value = meaning.map(|meaning| values::propose(meaning, messages, is_kept, end));
    let timely = messages.filter(|it| it.rhythm.count > 0 && meaning != Some(Meaning::Goal));
    match (timely.and_then(|it| it.rhythm.steady(end)), timely) {
        (Some(steady), Some(messages)) => measure(group, topic, (type_name, messages), steady, end, taken),
        _ if value.is_some() => {}
        (_, None) => remark(group, topic, type_name, "no message was received"),
        (_, Some(messages)) => {
            let why = match messages.rhythm.count {
                1 => "one message, no rhythm".to_owned(),
                count => format!("{count} messages, no steady rhythm"),
            };
            remark(group, topic, type_name, &why);
        }
    }
    let value = match value {
        Some(Ok(_)) if group.modules.len() >= MODULES_MAX => {
            return remark(group, topic, type_name, "the group has enough modules");
        }
        Some(Ok(value)) => value,
        Some(Err(why)) => return remark(group, topic, type_name, &why),
        None => return,
    };
    let (of_topic, type_name) = (topic.name.clone(), type_name.to_owned());
    let (meaning, timeout_ms) = (value.meaning, value.timeout_ms);
    group.modules.push(Module {
        id: names::id(&meaning.words(&topic.name), "value", taken),
        kind: ModuleKind::Value { topic: of_topic, type_name, meaning, timeout_ms },
        about: value.about,
        nodes: topic.publishers.iter().filter_map(|it| it.node.clone()).collect(),
        proposals: Vec::new(),
    });
}

/// The monitors of the rate and the age of a topic that comes steadily.
fn measure(
    group: &mut Group,
    topic: &TopicSeen,
    (type_name, messages): (&str, &Messages),
    steady: Steady,
    end: Timestamp,
    taken: &mut BTreeSet<String>,
) {
    if group.modules.len() >= MODULES_MAX {
        return remark(group, topic, type_name, "the group has enough modules");
    }
    let (of_topic, of_type) = (topic.name.clone(), type_name.to_owned());
    let (limits, Steady { rate_hz: rate, longest_s }) = (steady.limits(), steady);
    let nodes: Vec<String> = topic.publishers.iter().filter_map(|it| it.node.clone()).collect();
    let publishers = topic.publishers.iter().filter(|it| !it.ours).count();
    let several = if publishers > 1 { format!(" from {publishers} publishers") } else { String::new() };
    let alarm = match steady.reaches(limits) {
        true => " (too long for the window: a pause like it is no longer OK)",
        false => "",
    };
    let about = format!("{rate:.1} Hz{several}, longest pause {longest_s:.2} s{alarm}.");
    let id = names::id(&format!("{}_rate", topic.name), "topic_rate", taken);
    // Several publishers say different things even if each repeats itself.
    let frozen_ms =
        (publishers == 1 && messages.never_repeats()).then(|| at_least_ms((FROZEN_MESSAGES / rate).max(1.0)));
    let transforms = transforms(messages, end);
    for (child, _) in messages.frames.iter().filter(|(_, frame)| frame.has_two) {
        remark(group, topic, type_name, &format!("the frame {child} has two parents"));
    }
    let kind = ModuleKind::Rate {
        topic: of_topic.clone(),
        type_name: of_type.clone(),
        limits,
        frozen_ms,
        transforms,
    };
    group.modules.push(Module { id, kind, about, nodes: nodes.clone(), proposals: Vec::new() });
    let Some((least, most)) = messages.age_ns.map(|(least, most)| (least as f64 / 1e9, most as f64 / 1e9))
    else {
        return;
    };
    if least < AGES_S.0 || most > AGES_S.1 {
        return remark(
            group,
            topic,
            type_name,
            "its stamps are not of this computer's clock, so no age is judged",
        );
    }
    let warning_ms = at_least_ms((3.0 * most).max(0.2));
    let about = format!("At most {:.0} ms old on arrival.", (most * 1000.0).max(0.0));
    let id = names::id(&format!("{}_age", topic.name), "topic_age", taken);
    group.modules.push(Module {
        id,
        kind: ModuleKind::Age { topic: of_topic, type_name: of_type, warning_ms },
        about,
        nodes,
        proposals: Vec::new(),
    });
}
