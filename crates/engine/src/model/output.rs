//! Telltale's publications, for the vehicle and for the tools of ROS 2.

use crate::text::words;
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

words! {
    /// The least severity of the published lines of the log. Its words are those of the configuration.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
    pub enum LogLevel {
        #[default]
        Warning = "warning",
        Error = "error",
    }
}

words! {
    /// The release of ROS 2's diagnostic_aggregator whose levels are followed. Those of 26 May 2026 changed the level
    /// of a group with silent members. The words are those of the configuration.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum Like {
        /// To 4.3.6 (Kilted), 4.2.6 (Jazzy), 4.0.6 (Humble): a group that is STALE in part is ERROR.
        Before = "4.3.6",
        /// From 4.3.7, 4.2.7, 4.0.7 on: it is STALE, where nothing in it is in WARN or ERROR.
        #[default]
        Since = "4.3.7",
    }
}

/// The form of the aggregated diagnosis.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TreeForm {
    /// The path of the whole as diagnostic_aggregator has it; `None`: the tree has Telltale's own form.
    pub path: Option<Box<str>>,
    pub like: Like,
    /// Whether statuses have values.
    pub values: bool,
    /// Whether it is published also when the level of the whole gets worse.
    pub at_once: bool,
}

impl Default for TreeForm {
    fn default() -> TreeForm {
        TreeForm { path: None, like: Like::default(), values: true, at_once: false }
    }
}
