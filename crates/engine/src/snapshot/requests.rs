//! What is requested of the vehicle, and whether it hears it.

use super::{Countermeasure, Snapshot, Unreached};
use crate::model::Stage;
use crate::model::countermeasure::RequestKind;
use crate::model::output::Output;
use crate::time::Since;

impl Snapshot {
    /// Whether the vehicle moves, or may: it is cleared or drives by itself, or is not known to stand.
    pub fn may_move(&self) -> bool {
        matches!(self.stage, Stage::Cleared | Stage::Active) || self.motion.may_move() || self.drive_unknown
    }

    /// The strongest countermeasure: the operator has to know it first.
    pub fn countermeasure(&self) -> Option<&Countermeasure> {
        self.countermeasures.first()
    }

    /// The requested deceleration in m/s²; a level for its topic.
    pub fn deceleration(&self) -> Option<f64> {
        self.countermeasures.iter().find_map(|it| it.request.mps2())
    }

    /// Whether the maneuver component's own stop is requested; a level for its topic. A stronger request does
    /// not end it.
    pub fn maneuver_stop(&self) -> bool {
        self.countermeasures.iter().any(|it| it.request.kind() == RequestKind::ManeuverStop)
    }

    /// Whether the operator requested a stop that is not over.
    pub fn stop_requested(&self) -> bool {
        self.stop_requested_since().is_some()
    }

    /// Since when the operator requests a stop.
    pub fn stop_requested_since(&self) -> Option<Since> {
        self.countermeasures.iter().find_map(|it| it.by_operator)
    }

    /// The reason why an output has no receiver.
    pub fn unreached(&self, output: Output) -> Option<Unreached> {
        self.unreached.iter().find(|(of, _)| *of == output).map(|(_, why)| *why)
    }

    /// Whether an output is known to have a reader.
    pub fn is_listened_to(&self, output: Output) -> bool {
        self.listened.contains(&output)
    }
}
