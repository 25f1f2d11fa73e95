//! Compares what a scenario expects with what the engine shows.

use super::scenario::{Expected, seconds, why_of, why_word};
use telltale_engine::model::NodeId;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::snapshot::{NotRelevant, Reason, Snapshot};
use telltale_engine::state::State;
use telltale_yaml::plain;

/// Subject, expected, got, why.
pub(super) type Difference = (String, String, String, Option<String>);

pub(super) fn compare(snapshot: &Snapshot, alarms: u64, what: &Expected) -> Result<(), Difference> {
    let plain = |subject: &str, expected: String, got: String| equal(subject.into(), expected, got, || None);
    match what {
        Expected::Stage(stage) => plain("the stage", stage.as_str().into(), snapshot.stage.as_str().into()),
        Expected::Overall(state) => plain("the vehicle", state.to_string(), snapshot.overall.to_string()),
        Expected::Alarms(count) => plain("the number of alarms", count.to_string(), alarms.to_string()),
        Expected::Countermeasure(kind) => {
            let word = |kind: Option<RequestKind>| kind.map_or("none", RequestKind::as_str).to_owned();
            let got = snapshot.countermeasure().map(|it| it.request.kind());
            plain("the countermeasure", word(*kind), word(got))
        }
        Expected::Moving(moving) => {
            plain("the motion", moving.as_str().into(), snapshot.motion.moving.as_str().into())
        }
        Expected::Destination(stop) => {
            let got = snapshot.destination().map_or("none", |stop| &*stop.id).to_owned();
            plain("the destination", stop.as_deref().unwrap_or("none").to_owned(), got)
        }
        Expected::ActiveAlarms(wanted) => {
            let active = snapshot.alarms.iter().filter(|alarm| alarm.active);
            let got: Vec<String> =
                active.map(|alarm| format!("{} at {}", alarm.id, snapshot.node_name(alarm.node))).collect();
            let wanted: Vec<String> =
                wanted.iter().map(|(number, node)| format!("{number} at {node}")).collect();
            plain("the active alarms", list(&wanted), list(&got))
        }
        Expected::Ranking(names) => {
            let got: Vec<&str> = snapshot.roots.iter().map(|root| &**snapshot.node_name(root.node)).collect();
            plain("the ranking of root causes", list(names), list(&got))
        }
        Expected::Shown(name, state) => {
            of_node(snapshot, "", name, state.to_string(), |node| snapshot.shown(node).0.to_string())
        }
        Expected::Own(name, state) => {
            of_node(snapshot, "the own state of ", name, state.to_string(), |node| {
                snapshot.own(node).to_string()
            })
        }
        Expected::Why(name, why) => {
            of_node(snapshot, "the reason of ", name, why_word(*why).into(), |node| {
                why_word(why_of(snapshot.shown(node).1)).into()
            })
        }
        Expected::Counts(name, ok, counted) => {
            of_node(snapshot, "the count of ", name, format!("{ok}/{counted}"), |node| match node {
                NodeId::Group(id) => {
                    let view = snapshot.group(id).1;
                    format!("{}/{}", view.ok, view.counted)
                }
                NodeId::Module(_) => "a module, which counts nothing".into(),
            })
        }
        Expected::Roots(name, names) => {
            let sorted = |mut names: Vec<&str>| {
                names.sort_unstable();
                list(&names)
            };
            let expected = sorted(names.iter().map(|name| &**name).collect());
            of_node(snapshot, "the root causes of ", name, expected, |node| {
                sorted(roots(snapshot, node).into_iter().map(|root| &**snapshot.node_name(root)).collect())
            })
        }
    }
}

/// Compares a property of a node; `about` names both.
fn of_node(
    snapshot: &Snapshot,
    about: &str,
    name: &str,
    expected: String,
    got: impl Fn(NodeId) -> String,
) -> Result<(), Difference> {
    match snapshot.node(name) {
        Some(node) => equal(format!("{about}{name}"), expected, got(node), || Some(explain(snapshot, node))),
        None => Err((format!("{about}{name}"), expected, "no such node: no status made it yet".into(), None)),
    }
}

fn equal(
    subject: String,
    expected: String,
    got: String,
    why: impl FnOnce() -> Option<String>,
) -> Result<(), Difference> {
    if expected == got { Ok(()) } else { Err((subject, expected, got, why())) }
}

fn list(names: &[impl AsRef<str>]) -> String {
    format!("[{}]", names.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", "))
}

/// The cause of a node's state, which may be the node itself.
fn roots(snapshot: &Snapshot, node: NodeId) -> Vec<NodeId> {
    if let (_, Some(Reason::Masked { by })) = snapshot.shown(node) {
        return by.to_vec();
    }
    match node {
        NodeId::Group(id) => {
            snapshot.group(id).1.paths.iter().filter_map(|path| path.last().copied()).collect()
        }
        NodeId::Module(_) => {
            snapshot.roots.iter().map(|root| root.node).filter(|&root| root == node).collect()
        }
    }
}

/// The state of a node and its reason, for the author who looks for the fault in a scenario.
fn explain(snapshot: &Snapshot, node: NodeId) -> String {
    let (state, reason) = snapshot.shown(node);
    let name = snapshot.node_name(node);
    let reason = match reason {
        None => String::new(),
        Some(Reason::Masked { by }) => {
            let names: Vec<&str> = by.iter().map(|&root| &**snapshot.node_name(root)).collect();
            format!(", masked by {}", names.join(", "))
        }
        Some(Reason::NotRelevant(NotRelevant::Stage(stage))) => format!(", the stage is {}", stage.as_str()),
        Some(Reason::NotRelevant(NotRelevant::Signal { name, value })) => format!(", {name} is {value}"),
    };
    let own = snapshot.own(node);
    match node {
        NodeId::Module(id) => {
            let view = snapshot.module(id).1;
            let heard = match view.received {
                None => "never heard".into(),
                Some(_) if view.silent => "silent".into(),
                Some(at) => {
                    let message = view.report.message.to_string();
                    format!("heard at {}, \"{}\"", seconds(at), plain::line(&message))
                }
            };
            format!("{name} shows {state}{reason}; itself {own}, {heard}")
        }
        NodeId::Group(id) => {
            let info = &snapshot.layout.groups[id.0 as usize];
            let groups = info.groups.iter().map(|&id| NodeId::Group(id));
            let members = groups.chain(info.modules.iter().map(|&id| NodeId::Module(id)));
            let bad = members.filter(|&member| snapshot.shown(member).0 != State::Ok);
            let bad: Vec<String> = bad.map(|member| explain(snapshot, member)).collect();
            let bad = if bad.is_empty() { String::new() } else { format!("\n{}", bad.join("\n")) };
            format!("{name} shows {state}{reason}; its members' own states make {own}{bad}")
        }
    }
}
