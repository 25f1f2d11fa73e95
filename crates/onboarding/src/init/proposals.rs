//! Proposes dependencies as the graph has them: what a node tells waits for the topics to which the node is
//! subscribed.

use std::collections::{BTreeMap, BTreeSet};

use super::dependencies::{self, Edges};
use super::draft::{Group, ModuleKind};
use super::grouping::Grouping;
use super::names::comment;
use super::observations::{Observations, is_of_components};
use super::values::{self, Meaning};
use telltale_engine::discovery::{Endpoint, TopicSeen};

/// Reasons that are given for one dependency.
const EVIDENCE_MAX: usize = 3;
/// Modules on which one module depends.
const TARGETS_MAX: usize = 20;
/// A circle is opened at its commands: a base is well and says where it is, also when nobody drives it.
const DATA_WEIGHT: i64 = 100;

/// A dependency of a module that the graph suggests.
#[derive(Debug, Default)]
pub struct Proposal {
    /// The id of the other group.
    pub group: String,
    /// The modules of it that are concerned.
    pub on: Vec<Target>,
    pub evidence: Vec<String>,
    /// It would close a circle.
    pub circular: bool,
    /// All that is received are commands.
    only_commands: bool,
}

/// A module on which another one depends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Target {
    /// Its whole name.
    pub name: String,
    /// The longest time until its fault is noticed.
    pub noticed_s: u64,
}

/// The nodes of each participant that belong to a group: they stand for its endpoints without a node.
type OfParticipant<'a> = BTreeMap<&'a str, BTreeSet<&'a str>>;

/// Adds what the graph suggests to the modules of the groups with these keys; returns the order of the groups.
pub fn propose(groups: &mut [Group], keys: &[&str], seen: &Observations, grouping: &Grouping) -> Vec<usize> {
    let is_of_data = |topic: &&TopicSeen| is_of_components(topic) && values::action(&topic.name).is_none();
    let topics = || seen.discovery.topics.iter().filter(is_of_data);
    let mut of_participant = OfParticipant::new();
    for it in topics().flat_map(|topic| topic.publishers.iter().chain(&topic.subscribers)) {
        if let Some((node, _)) = it.node.as_ref().and_then(|node| grouping.of_node.get_key_value(node)) {
            of_participant.entry(&it.participant).or_default().insert(node);
        }
    }
    let ends = |endpoints| by_group(endpoints, keys, grouping, &of_participant);
    let mut found: BTreeMap<(usize, usize, usize), Proposal> = BTreeMap::new();
    for topic in topics() {
        let (publishers, subscribers) = (ends(&topic.publishers), ends(&topic.subscribers));
        for (&user, subscriber) in &subscribers {
            let waiting: Vec<usize> = waiting(&groups[user], &subscriber.nodes).collect();
            for (&provider, publisher) in publishers.iter().filter(|(provider, _)| **provider != user) {
                let concerned = concerned(&groups[provider], topic, &publisher.nodes);
                if concerned.is_empty() {
                    continue;
                }
                let names = [&subscriber.name, &topic.name, &publisher.name].map(|it| comment(it));
                let [subscriber, name, publisher] = names;
                let evidence = format!("{subscriber} subscribes to {name}, published by {publisher}");
                for &module in &waiting {
                    let proposal = found.entry((user, module, provider)).or_default();
                    proposal.add(&groups[provider].id, &concerned, &evidence, is_command(topic));
                }
            }
        }
    }
    let mut edges = Edges::new();
    for (&(user, _, provider), proposal) in &found {
        let weight = edges.entry((user, provider)).or_default();
        *weight = (*weight).max(if proposal.only_commands { 1 } else { DATA_WEIGHT });
    }
    let order = dependencies::order(groups.len(), &edges);
    let rank: BTreeMap<usize, usize> = order.iter().enumerate().map(|(rank, &group)| (group, rank)).collect();
    for ((user, module, provider), proposal) in found {
        let circular = rank[&provider] > rank[&user];
        groups[user].modules[module].proposals.push(Proposal { circular, ..proposal });
    }
    groups.iter_mut().for_each(propose_own_nodes);
    order
}

/// What a lifecycle node says and publishes waits until the node is active.
fn propose_own_nodes(group: &mut Group) {
    let id = group.id.clone();
    let lifecycle = group.modules.iter().filter_map(|module| match &module.kind {
        ModuleKind::Node { name, has_lifecycle: true } => Some((
            name.clone(),
            Target { name: format!("{id}/{}", module.id), noticed_s: module.kind.noticed_s() },
        )),
        _ => None,
    });
    let lifecycle: BTreeMap<String, Target> = lifecycle.collect();
    for module in group.modules.iter_mut().filter(|it| !matches!(it.kind, ModuleKind::Node { .. })) {
        let [node] = &module.nodes[..] else { continue };
        if let Some(target) = lifecycle.get(node) {
            let mut own = Proposal::default();
            own.add(&id, std::slice::from_ref(target), &format!("it is of {}", comment(node)), false);
            module.proposals.push(own);
        }
    }
}

impl Proposal {
    fn add(&mut self, group: &str, modules: &[Target], evidence: &str, is_command: bool) {
        self.only_commands = is_command && (self.only_commands || self.on.is_empty());
        group.clone_into(&mut self.group);
        for module in modules {
            if self.on.len() < TARGETS_MAX && !self.on.contains(module) {
                self.on.push(module.clone());
            }
        }
        if self.evidence.len() < EVIDENCE_MAX && !self.evidence.iter().any(|known| known == evidence) {
            self.evidence.push(evidence.to_owned());
        }
    }
}

/// Whether a topic has orders to those who receive it, by its name or a type.
fn is_command(topic: &TopicSeen) -> bool {
    let last = topic.name.rsplit('/').next().unwrap_or_default();
    let named = ["cmd", "command", "setpoint"].iter().any(|word| last.contains(word));
    let types = ["Command", "CommandStamped", "/AckermannDrive", "/AckermannDriveStamped"];
    named || topic.types().iter().any(|it| types.iter().any(|end| it.ends_with(end)))
}

/// The endpoints of a topic in one group.
struct Ends<'a> {
    /// Of the first of them, for the evidence.
    name: String,
    nodes: BTreeSet<&'a str>,
}

fn by_group<'a>(
    endpoints: &'a [Endpoint],
    keys: &[&str],
    grouping: &'a Grouping,
    of_participant: &OfParticipant<'a>,
) -> BTreeMap<usize, Ends<'a>> {
    let mut found: BTreeMap<usize, Ends<'a>> = BTreeMap::new();
    for it in endpoints.iter().filter(|it| !it.ours) {
        let place = grouping.of_endpoint(it).and_then(|key| keys.binary_search(&key).ok());
        let Some(place) = place else { continue };
        let name = it.node.clone().unwrap_or_else(|| "a program".to_owned());
        let ends = found.entry(place).or_insert(Ends { name, nodes: BTreeSet::new() });
        match it.node.as_deref().filter(|&node| grouping.of_node.contains_key(node)) {
            Some(node) => drop(ends.nodes.insert(node)),
            None => ends.nodes.extend(of_participant.get(&*it.participant).into_iter().flatten()),
        }
    }
    found
}

/// The modules that wait for what these nodes receive: their statuses and what they publish. Whether a node runs
/// does not depend on it, and neither does a charge or an emergency stop.
fn waiting<'a>(group: &'a Group, nodes: &'a BTreeSet<&str>) -> impl Iterator<Item = usize> + 'a {
    let modules = group.modules.iter().enumerate();
    let waits = |module: &super::draft::Module| match &module.kind {
        ModuleKind::Value { meaning, .. } => *meaning == Meaning::Goal,
        kind => !matches!(kind, ModuleKind::Node { .. }),
    };
    let of_them = |it: &super::draft::Module| it.nodes.iter().any(|node| nodes.contains(&**node));
    modules.filter(move |(_, it)| waits(it) && of_them(it)).map(|(place, _)| place)
}

/// The modules that judge a topic; where none does, those that tell whether its publishers run; else their statuses.
fn concerned(group: &Group, topic: &TopicSeen, publishers: &BTreeSet<&str>) -> Vec<Target> {
    let of_publishers = |nodes: &[String]| nodes.iter().any(|node| publishers.contains(&**node));
    let targets = |wanted: &dyn Fn(&ModuleKind, &[String]) -> bool| -> Vec<Target> {
        let modules = group.modules.iter().filter(|module| wanted(&module.kind, &module.nodes));
        let name = |module: &super::draft::Module| format!("{}/{}", group.id, module.id);
        modules.map(|it| Target { name: name(it), noticed_s: it.kind.noticed_s() }).collect()
    };
    let judging = targets(&|kind, _| match kind {
        ModuleKind::Rate { topic: of, .. } | ModuleKind::Age { topic: of, .. } => *of == topic.name,
        ModuleKind::Status { .. } | ModuleKind::Value { .. } | ModuleKind::Node { .. } => false,
    });
    let running = || targets(&|kind, nodes| matches!(kind, ModuleKind::Node { .. }) && of_publishers(nodes));
    let saying = || targets(&|kind, nodes| matches!(kind, ModuleKind::Status { .. }) && of_publishers(nodes));
    [judging].into_iter().chain([running(), saying()]).find(|found| !found.is_empty()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use crate::init::text;
    use crate::pretend::Robot;

    #[test]
    fn a_dependency_explains_for_as_long_as_its_ends_may_be_noticed_apart() {
        let robot = Robot::default()
            .publishes("/slow", "/map", 2000)
            .publishes("/seldom", "/joy", 6000)
            .publishes("/lidar", "/scan", 100)
            .says("/base", "base: motors");
        let robot = ["/map", "/joy", "/scan"].into_iter().fold(robot, |robot, it| robot.listens("/base", it));
        let text = text(&robot.heard().draft, true);
        let on = "depends_on: [lidar/scan_rate, lidar/scan_age, { on: seldom/seldom_runs, within: 37s }, \
                  { on: slow/map_rate, within: 20s }, slow/map_age]";
        assert!(text.contains(on), "{text}");
        let (_, problems) = telltale_config::parse("draft", &text).expect("it is right").soundness();
        assert!(problems.is_none(), "{}\n{text}", problems.unwrap());
    }

    #[test]
    fn a_circle_is_opened_where_the_base_takes_its_commands() {
        let robot = Robot::default()
            .publishes("/wheels", "/odom", 50)
            .publishes("/ekf", "/pose", 50)
            .publishes("/drive", "/cmd_vel", 50)
            .listens("/wheels", "/cmd_vel")
            .listens("/ekf", "/odom")
            .listens("/drive", "/pose");
        let text = text(&robot.heard().draft, true);
        for on in
            ["depends_on: [wheels/odom_rate, wheels/odom_age]", "depends_on: [ekf/pose_rate, ekf/pose_age]"]
        {
            assert!(text.contains(on), "{text}");
        }
        assert!(!text.contains("depends_on: [drive/"), "{text}");
    }

    #[test]
    fn a_lifecycle_node_must_be_active_and_another_one_must_run() {
        let robot = Robot::default()
            .publishes("/planner_server", "/plan", 1000)
            .serves("/planner_server", "/planner_server/get_state")
            .publishes("/lidar", "/scan", 100);
        let text = text(&robot.heard().draft, true);
        assert!(text.contains("id: planner_server_active"), "{text}");
        assert!(text.contains("depends_on: [planner_server/planner_server_active]"), "{text}");
        for (node, target) in [("/planner_server", "lifecycle"), ("/lidar", "node")] {
            let asked = format!("watchdog: {{ {target}: {node}, every: 1s, misses: 3 }}");
            assert!(text.contains(&asked), "{text}");
        }
        telltale_config::parse("draft", &text).expect("it is right");
    }
}
