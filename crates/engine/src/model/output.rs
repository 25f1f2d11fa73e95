//! Telltale's publications, for the vehicle and for the tools of ROS 2.

use serde::{Deserialize, Serialize};

/// An output to the vehicle. Each is a level that follows from snapshots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    Stage,
    Clearance,
    /// The pose that the operator gave.
    Pose,
    Deceleration,
    ManeuverStop,
    /// Whether the vehicle is held, by any request.
    Hold,
}

/// A published topic, by its content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Publication {
    /// The aggregated diagnosis.
    DiagnosticsAgg,
    /// The state of the whole vehicle.
    TopLevelState,
    /// Warnings and errors, and root causes, as lines of the ROS 2 log.
    Rosout,
    Vehicle(Output),
}

impl Publication {
    pub const ALL: [Publication; 9] = [
        Publication::DiagnosticsAgg,
        Publication::TopLevelState,
        Publication::Rosout,
        Publication::Vehicle(Output::Pose),
        Publication::Vehicle(Output::Stage),
        Publication::Vehicle(Output::Clearance),
        Publication::Vehicle(Output::Deceleration),
        Publication::Vehicle(Output::ManeuverStop),
        Publication::Vehicle(Output::Hold),
    ];

    /// Its key in the configuration.
    pub const fn as_str(self) -> &'static str {
        match self {
            Publication::DiagnosticsAgg => "diagnostics_agg",
            Publication::TopLevelState => "toplevel_state",
            Publication::Rosout => "rosout",
            Publication::Vehicle(Output::Pose) => "initialpose",
            Publication::Vehicle(Output::Stage) => "stage",
            Publication::Vehicle(Output::Clearance) => "clearance",
            Publication::Vehicle(Output::Deceleration) => "deceleration_request",
            Publication::Vehicle(Output::ManeuverStop) => "maneuver_stop_request",
            Publication::Vehicle(Output::Hold) => "hold",
        }
    }
}

/// The least severity of the published lines of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum LogLevel {
    #[default]
    Warning,
    Error,
}

impl LogLevel {
    pub const ALL: [LogLevel; 2] = [LogLevel::Warning, LogLevel::Error];

    /// Its word in the configuration.
    pub const fn as_str(self) -> &'static str {
        match self {
            LogLevel::Warning => "warning",
            LogLevel::Error => "error",
        }
    }
}
