//! How well the graph of the simulated machines tells the dependencies that their configurations have. The table
//! of `docs/guessed-dependencies.md` is compared with the result.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::message_folders;
use crate::cli::fields;
use crate::cli::running::vehicle::machine::{Kind, Machine, SEED};
use crate::config::{self, Loaded};
use crate::engine::discovery::{Discovery, Endpoint, TopicSeen};
use crate::engine::input::Input;
use crate::engine::model::monitors::TopicSpec;
use crate::engine::model::sample::Sample;
use crate::engine::model::{Dependency, Limits, Model, NodeId};
use crate::engine::time::Timestamp;
use crate::msg::cdr::Endian;
use crate::msg::fields::Definitions;
use crate::msg::messages;
use crate::onboarding::init::{self, Observations};
use crate::ros::DIAGNOSTICS;

const PAGE: &str = include_str!("../../../../docs/guessed-dependencies.md");

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

/// For so long the machine is listened to.
const HEARD_MS: u64 = 10_000;

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
        ..TopicSeen::default()
    });
    let nodes = nodes.iter().map(|node| format!("/{node}")).collect();
    Discovery { topics: topics.collect(), nodes, participants: 1, ..Discovery::default() }
}

/// A message without content: its time alone counts.
fn message_of(topic: &str) -> Sample {
    let source = TopicSpec { topic: topic.into(), type_name: "".into(), stamp: false, fields: Vec::new() };
    let (stamp_ns, received_wall_ns, values) = (None, Sample::NO_CLOCK, [].into());
    Sample { stamp_ns, received_wall_ns, ..Sample::of(Arc::new(source), values) }
}

/// The dependencies between groups that a configuration has, or between modules in them.
fn true_edges(model: &Model) -> Edges {
    let top = |node: &NodeId| {
        let path = model.node_name(*node);
        path.split('/').next().unwrap_or(path).to_owned()
    };
    let mut edges = Edges::new();
    for user in model.nodes() {
        let on = model.depends_on(user).iter().flat_map(Dependency::targets).map(top);
        edges.extend(on.map(|on| (top(&user), on)).filter(|(user, on)| user != on));
    }
    edges
}

/// Those that `init` proposes, between the groups of a person.
fn proposed_edges(mut machine: Machine, sorted: &[(&str, &str)]) -> Edges {
    let mut seen = Observations::default();
    seen.see(Arc::new(discovery(&machine)));
    let end = Timestamp::from_millis(HEARD_MS);
    for heard in (0..=HEARD_MS).step_by(20).map(Timestamp::from_millis) {
        for (topic, body) in machine.advance(heard, |_| std::time::UNIX_EPOCH) {
            if topic == DIAGNOSTICS {
                let (array, fault) = messages::diagnostic_array(&body, Endian::Little, &Limits::default());
                assert_eq!(fault, None);
                seen.take(&Input::Diagnostics(array), heard);
            } else {
                seen.take(&Input::Sample(message_of(topic)), heard);
            }
        }
    }
    let draft = init::draft(&seen, Timestamp::ZERO, end);
    let text = init::text(&draft, true);
    let (_, problems) = config::parse("draft", &text).expect("it is right").soundness();
    assert!(problems.is_none(), "{}\n{text}", problems.unwrap());
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
    let proposed = proposed_edges(Machine::new(kind, SEED, loaded, Timestamp::ZERO), sorted);
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
    assert!(PAGE.contains(&row), "docs/guessed-dependencies.md lacks:\n{row}");
}

#[test]
fn the_documentation_says_how_well_the_graph_tells_the_dependencies_of_the_shuttle() {
    let loaded = config::parse("c", include_str!("../../../../config/shuttle.yaml")).unwrap();
    documented("shuttle", Kind::of(false, true), &loaded, &SHUTTLE);
}

#[test]
fn the_documentation_says_how_well_the_graph_tells_the_dependencies_of_the_robot() {
    let loaded = config::parse("c", include_str!("../../../../config/robot.yaml")).unwrap();
    documented("robot", Kind::Robot, &loaded, &ROBOT);
}

#[test]
fn the_file_names_the_folders_with_its_types() {
    let folder = std::env::temp_dir().join(format!("telltale-init-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("my_msgs/msg")).unwrap();
    std::fs::create_dir_all(folder.join("std_msgs/msg")).unwrap();
    std::fs::write(folder.join("my_msgs/msg/Own.msg"), "std_msgs/Header header\n").unwrap();
    let mut seen = Observations::default();
    let end = |type_name: &str| Endpoint {
        node: Some("/own".to_owned()),
        type_name: type_name.to_owned(),
        ..Endpoint::default()
    };
    for (name, type_name) in [("/own", "my_msgs/msg/Own"), ("/scan", "sensor_msgs/msg/LaserScan")] {
        let topic = TopicSeen {
            name: name.to_owned(),
            publishers: vec![end(type_name)],
            subscribers: Vec::new(),
            ..TopicSeen::default()
        };
        let mut topics = seen.discovery.topics.clone();
        topics.push(topic);
        seen.see(Arc::new(Discovery { topics, participants: 1, ..Discovery::default() }));
        let spec =
            TopicSpec { topic: name.into(), type_name: type_name.into(), stamp: true, fields: Vec::new() };
        let source = Arc::new(spec);
        for at_ms in (0..HEARD_MS).step_by(100) {
            let (stamp_ns, received_wall_ns, values) = (Some(1_000_000), 2_000_000, [].into());
            let sample = Sample { stamp_ns, received_wall_ns, ..Sample::of(source.clone(), values) };
            seen.take(&Input::Sample(sample), Timestamp::from_millis(at_ms));
        }
    }
    let mut draft = init::draft(&seen, Timestamp::ZERO, Timestamp::from_millis(HEARD_MS));
    let is_known = |draft: &init::Draft| {
        let text = init::text(draft, false);
        let examined = config::examine_from("draft", text.as_bytes());
        let known = Definitions::default();
        fields::whole(examined, |loaded| known.with(&loaded.message_folders))
            .map(|_| ())
            .map_err(|it| it.lines())
    };
    let said = is_known(&draft).unwrap_err();
    assert!(said[0].contains("the type my_msgs/msg/Own is not known"), "{said:?}");
    let definitions = Definitions::new(vec!["/nowhere".into(), folder.clone()]);
    draft.message_folders = message_folders(&draft, &definitions);
    assert_eq!(draft.message_folders, [folder.display().to_string()]);
    assert_eq!(is_known(&draft), Ok(()));
    std::fs::remove_dir_all(folder).unwrap();
}
