//! The operator's actions in scenario files.

use telltale_config::decode::FromNode;
use telltale_config::fields::Fields;
use telltale_engine::input::{AlarmRef, OperatorAction, Place};
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::{Kind, Log, Node, Problem};

const CLEAR: OperatorAction = OperatorAction::Clear { display_live: true, storage_ok: true };
const RELEASE: OperatorAction = OperatorAction::Release { display_live: true, storage_ok: true };

/// An action without a value may be written alone: `operator: logout`.
const PLAIN: [(&str, OperatorAction); 6] = [
    ("logout", OperatorAction::Logout),
    ("shutdown", OperatorAction::Shutdown),
    ("withdraw", OperatorAction::Withdraw),
    ("stop", OperatorAction::RequestStop),
    ("clearance", CLEAR),
    ("release", RELEASE),
];

pub(super) fn operator(node: &Node, log: &mut Log) -> Option<OperatorAction> {
    if matches!(node.kind, Kind::Scalar { .. }) {
        let known: Vec<(&str, usize)> = PLAIN.iter().enumerate().map(|(index, it)| (it.0, index)).collect();
        return word(node, log, "action of the operator", &known).map(|index| PLAIN[index].1.clone());
    }
    let mut fields = Fields::of(node, "an operator's action", log)?;
    let mut found = Vec::new();
    for (key, action) in PLAIN {
        if matches!(key, "clearance" | "release") {
            found.extend(fields.node(key).and_then(|node| in_two_steps(node, action, fields.log)));
        } else {
            found.extend(fields.node(key).map(|_| action));
        }
    }
    found.extend(fields.optional("login").map(|name: String| OperatorAction::Login { name: name.into() }));
    found.extend(fields.optional("reset").map(|name: String| OperatorAction::Reset { module: name.into() }));
    found.extend(fields.optional("shelve").map(|ShelveTarget(action)| action));
    found.extend(
        fields.optional("unshelve").map(|name: String| OperatorAction::Unshelve { module: name.into() }),
    );
    found.extend(fields.optional("localize").map(|LocalizeTarget(place)| OperatorAction::Localize { place }));
    found.extend(
        fields.optional("acknowledge").map(|AcknowledgeTarget(alarm)| OperatorAction::Acknowledge { alarm }),
    );
    if !matches!(&node.kind, Kind::Mapping(entries) if entries.len() == 1) {
        let problem = Problem::at(node.span, "a step has one action of the operator");
        fields.log.push(problem.help("for example `operator: { login: operator }`"));
    }
    found.into_iter().next()
}

/// A stop, or `{ x: 1, y: 2, yaw_deg: 90 }`.
struct LocalizeTarget(Place);

impl FromNode for LocalizeTarget {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if let Some(stop) = scalar(node) {
            return Some(LocalizeTarget(Place::Stop(stop.into())));
        }
        let mut fields = Fields::of(node, "a pose", log)?;
        let (x, y, yaw) = (fields.required("x"), fields.required("y"), fields.required("yaw_deg"));
        Some(LocalizeTarget(Place::Pose { x_m: x?, y_m: y?, yaw_deg: yaw? }))
    }
}

/// `{ module: a/b, for: 30min }`
struct ShelveTarget(OperatorAction);

impl FromNode for ShelveTarget {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a module to shelve", log)?;
        let (module, lasts) = (fields.required::<String>("module"), fields.required("for"));
        let (module, lasts) = (module?.into(), lasts?);
        Some(ShelveTarget(OperatorAction::Shelve { module, lasts, by: "developer".into() }))
    }
}

/// The second step of a clearance or a release, with the state of display and store, which are fine unless
/// the step says otherwise. `ask: true` is the first step.
fn in_two_steps(node: &Node, action: OperatorAction, log: &mut Log) -> Option<OperatorAction> {
    if node.is_null() {
        return Some(action);
    }
    if !matches!(node.kind, Kind::Mapping(_)) {
        return bool::from_node(node, log).map(|_| action);
    }
    let mut fields = Fields::of(node, "a step that sets the vehicle in motion", log)?;
    let mut flag = |key, default| fields.optional::<bool>(key).unwrap_or(default);
    let (display_live, storage_ok) = (flag("display_live", true), flag("storage_ok", true));
    let ask = flag("ask", false);
    Some(match (action, ask) {
        (OperatorAction::Release { .. }, true) => OperatorAction::AskRelease { display_live, storage_ok },
        (OperatorAction::Release { .. }, false) => OperatorAction::Release { display_live, storage_ok },
        (_, true) => OperatorAction::AskClearance { display_live, storage_ok },
        (_, false) => OperatorAction::Clear { display_live, storage_ok },
    })
}

/// A number, the name of a node, or `over` for all alarms that are over.
struct AcknowledgeTarget(AlarmRef);

impl FromNode for AcknowledgeTarget {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let text = String::from_node(node, log)?;
        Some(AcknowledgeTarget(match text.parse() {
            Ok(number) => AlarmRef::Number(number),
            Err(_) if text == "over" => AlarmRef::Over { last: u64::MAX },
            Err(_) => AlarmRef::Node(text.into()),
        }))
    }
}
