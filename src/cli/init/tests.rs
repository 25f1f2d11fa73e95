//! How well the graph of the simulated machines tells the dependencies that their configurations have. The table
//! of `docs/first-configuration.md` is compared with the result.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::cli::vehicle::machine::{Kind, Machine};
use crate::config::{self, Loaded};
use crate::engine::discovery::{Discovery, Endpoint, TopicSeen};
use crate::engine::input::Input;
use crate::engine::model::{DependsOn, Limits, Model, NodeId};
use crate::engine::time::{Span, Timestamp};
use crate::init::{self, Observations};
use crate::msg::cdr::Endian;
use crate::msg::messages;
use crate::ros::DIAGNOSTICS;

const PAGE: &str = include_str!("../../../docs/first-configuration.md");

/// The group of each node, as a person would sort them.
const SHUTTLE: [(&str, &str); 11] = [
    ("lidar_drivers", "sensors"),
    ("camera_driver", "sensors"),
    ("imu_driver", "sensors"),
    ("gnss_driver", "sensors"),
    ("can_gateway", "can"),
    ("localization", "localization"),
    ("perception", "perception"),
    ("prediction", "prediction"),
    ("mission", "mission"),
    ("planner", "planning"),
    ("controller", "execution"),
];
const ROBOT: [(&str, &str); 9] = [
    ("lidar_front", "lidars"),
    ("lidar_rear", "lidars"),
    ("imu", "imu"),
    ("base_driver", "base"),
    ("battery_driver", "battery"),
    ("amcl", "localization"),
    ("planner_server", "navigation"),
    ("controller_server", "navigation"),
    ("docking_server", "docking"),
];

type Edges = BTreeSet<(String, String)>;

/// What discovery sees of a machine whose nodes all run.
fn discovery(machine: &Machine) -> Discovery {
    let nodes = machine.nodes();
    let endpoints = |type_name: &str, of: &dyn Fn(&str) -> bool| {
        let endpoint = |node: &&str| Endpoint {
            participant: "simulation".to_owned(),
            node: Some(format!("/{node}")),
            type_name: type_name.to_owned(),
            ..Endpoint::default()
        };
        nodes.iter().filter(|node| of(node)).map(endpoint).collect::<Vec<_>>()
    };
    let topics = machine.offers().into_iter().map(|(name, type_name, _)| TopicSeen {
        name: name.to_owned(),
        publishers: endpoints(type_name, &|node| machine.topics_of(node).contains(&name)),
        subscribers: endpoints(type_name, &|node| machine.subscriptions_of(node).contains(&name)),
        rate_hz: None,
    });
    let nodes = nodes.iter().map(|node| format!("/{node}")).collect();
    Discovery { topics: topics.collect(), nodes, participants: 1, ..Discovery::default() }
}

/// The dependencies between groups that a configuration has.
fn true_edges(model: &Model) -> Edges {
    let top = |node: &NodeId| {
        let path = match node {
            NodeId::Group(id) => &*model.groups[id.0 as usize].path,
            NodeId::Module(id) => &*model.modules[id.0 as usize].id,
        };
        path.split('/').next().unwrap_or(path).to_owned()
    };
    let mut edges = Edges::new();
    for group in &model.groups {
        for dependency in &group.depends_on {
            let on = match &dependency.on {
                DependsOn::Node(node) => vec![top(node)],
                DependsOn::AnyOf(nodes) => nodes.iter().map(top).collect(),
            };
            edges.extend(on.into_iter().map(|on| (group.path.to_string(), on)));
        }
    }
    edges
}

/// Those that `init` proposes, between the groups of a person.
fn proposed_edges(mut machine: Machine, sorted: &[(&str, &str)]) -> Edges {
    let mut seen = Observations::default();
    seen.see(Arc::new(discovery(&machine)));
    let heard = Timestamp::ZERO + Span::from_secs(3);
    for (topic, body) in machine.advance(heard, |_| std::time::UNIX_EPOCH) {
        if topic == DIAGNOSTICS {
            let (array, fault) = messages::diagnostic_array(&body, Endian::Little, &Limits::default());
            assert_eq!(fault, None);
            seen.take(&Input::Diagnostics(array), heard);
        }
    }
    let draft = init::draft(&seen, Timestamp::ZERO, Timestamp::ZERO + Span::from_secs(10));
    let sorted: BTreeMap<&str, &str> = sorted.iter().copied().collect();
    let mut edges = Edges::new();
    for group in &draft.groups {
        let proposals = group.modules.iter().flat_map(|module| &module.proposals);
        for proposal in proposals.filter(|proposal| !proposal.circular) {
            let ends = sorted.get(&*group.id).zip(sorted.get(&*proposal.group));
            let (user, provider) = ends.unwrap_or_else(|| panic!("{} on {}", group.id, proposal.group));
            if user != provider {
                edges.insert(((*user).to_owned(), (*provider).to_owned()));
            }
        }
    }
    edges
}

fn listed(edges: impl Iterator<Item = (String, String)>) -> String {
    edges.map(|(user, provider)| format!("{user} → {provider}")).collect::<Vec<_>>().join(", ")
}

#[track_caller]
fn documented(name: &str, kind: Kind, loaded: &Loaded, sorted: &[(&str, &str)]) {
    let expected = true_edges(&loaded.model);
    let proposed = proposed_edges(Machine::new(kind, loaded, Timestamp::ZERO), sorted);
    let right = expected.intersection(&proposed).count();
    let precision = right as f64 / proposed.len() as f64;
    let recall = right as f64 / expected.len() as f64;
    let row = format!(
        "| {name} | {} | {} | {right} | {precision:.2} | {recall:.2} | {} | {} |",
        expected.len(),
        proposed.len(),
        listed(proposed.difference(&expected).cloned()),
        listed(expected.difference(&proposed).cloned()),
    );
    assert!(PAGE.contains(&row), "docs/first-configuration.md lacks:\n{row}");
}

#[test]
fn the_documentation_says_how_well_the_graph_tells_the_dependencies_of_the_shuttle() {
    let loaded = config::parse("c", include_str!("../../../config/shuttle.yaml")).unwrap();
    documented("shuttle", Kind::of(false, true), &loaded, &SHUTTLE);
}

#[test]
fn the_documentation_says_how_well_the_graph_tells_the_dependencies_of_the_robot() {
    let loaded = config::parse("c", include_str!("../../../config/robot.yaml")).unwrap();
    documented("robot", Kind::Robot, &loaded, &ROBOT);
}
