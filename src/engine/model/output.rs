//! What is published for the vehicle.

/// What is published for the vehicle. All of it is a level that follows from snapshots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Output {
    Stage,
    Clearance,
    /// Where the operator says that the vehicle stands.
    Pose,
    Deceleration,
    ManeuverStop,
}
