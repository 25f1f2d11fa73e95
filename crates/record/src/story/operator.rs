//! The operator's actions as a story tells them.

use super::Happened;
use telltale_engine::input::{AlarmRef, OperatorAction};

/// What an action did; a first step of two does nothing.
pub(super) fn done(action: &OperatorAction) -> Option<Happened> {
    let is_first = matches!(action, OperatorAction::AskClearance { .. } | OperatorAction::AskRelease { .. });
    let (action, on) = word(action);
    (!is_first).then_some(Happened::Operator { action, on })
}

/// The word of an action, and on what it acts. Both steps of one have the same.
pub fn word(action: &OperatorAction) -> (&'static str, String) {
    match action {
        OperatorAction::Login { name } => ("login", name.to_string()),
        OperatorAction::Logout => ("logout", String::new()),
        OperatorAction::Shutdown => ("shutdown", String::new()),
        OperatorAction::Localize { .. } => ("localize", String::new()),
        OperatorAction::AskClearance { .. } | OperatorAction::Clear { .. } => ("clearance", String::new()),
        OperatorAction::RequestStop => ("stop", String::new()),
        OperatorAction::Withdraw => ("withdraw", String::new()),
        OperatorAction::AskRelease { .. } | OperatorAction::Release { .. } => ("release", String::new()),
        OperatorAction::Acknowledge { alarm: AlarmRef::Node(node) } => ("acknowledge", node.to_string()),
        OperatorAction::Acknowledge { alarm: AlarmRef::Number(number) } => {
            ("acknowledge", number.to_string())
        }
        OperatorAction::Acknowledge { alarm: AlarmRef::Over { .. } } => ("acknowledge", String::new()),
        OperatorAction::Reset { module } => ("reset", module.to_string()),
    }
}
