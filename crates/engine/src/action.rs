//! The actions of the operator and of developers, and the engine's answers.

use super::files::float;
use super::model::Stage;
use super::model::countermeasure::RequestKind;
use super::state::State;
use super::time::Span;
use serde::{Deserialize, Serialize};

/// An operator's action. The engine grants or refuses it: see [`Response`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OperatorAction {
    Login {
        name: Box<str>,
    },
    Logout,
    /// Ends the operator's work. The vehicle is locked, as by a logout.
    Shutdown,
    /// Tells Telltale the position of the vehicle.
    Localize {
        place: Place,
    },
    /// The first step of a clearance: checks everything and changes nothing.
    AskClearance {
        /// The display in front of the operator confirmed a recent frame.
        display_live: bool,
        /// The disk can store the action's record.
        storage_ok: bool,
    },
    /// The second step: checks everything again and clears the vehicle.
    Clear {
        display_live: bool,
        storage_ok: bool,
    },
    /// Requests the maneuver component's own safe stop.
    RequestStop,
    /// Takes the clearance back before the vehicle drives.
    Withdraw,
    /// The first step of a release: checks everything and changes nothing.
    AskRelease {
        display_live: bool,
        storage_ok: bool,
    },
    /// The second step: checks everything again, and ends every request that keeps the vehicle from driving.
    Release {
        display_live: bool,
        storage_ok: bool,
    },
    /// Takes note of an alarm, or accepts a WARNING. It moves nothing.
    Acknowledge {
        alarm: AlarmRef,
    },
    /// Resets the latched ERROR of a module, named `group/module`.
    Reset {
        module: Box<str>,
    },
    /// Shelves a module, named `group/module`, for maintenance: its faults raise no alarm for `lasts`. For developers.
    Shelve {
        module: Box<str>,
        lasts: Span,
        /// The user.
        by: Box<str>,
    },
    /// Ends that before its time.
    Unshelve {
        module: Box<str>,
    },
}

/// The operator's choice of a position of the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// Id of a stop of the configuration.
    Stop(Box<str>),
    /// Metres and degrees in the map's frame.
    Pose {
        #[serde(with = "float")]
        x_m: f64,
        #[serde(with = "float")]
        y_m: f64,
        #[serde(with = "float")]
        yaw_deg: f64,
    },
}

/// The target of an acknowledgement.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlarmRef {
    /// The number of an alarm.
    Number(u64),
    /// All alarms that are over, up to this number: later ones were shown to nobody.
    Over { last: u64 },
    /// A node by its name: its alarm, its WARNING (of a group: the WARNINGs inside), and its part in
    /// countermeasures.
    Node(Box<str>),
}

/// The engine's answer to an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Response {
    Done,
    /// Nothing changed, but that a STOP is counted. One reason for each check that failed.
    Refused(Vec<Refusal>),
}

/// The reason for a refused action. The page has words for each.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// No operator is logged in.
    NobodyLoggedIn,
    /// The action is not possible in this stage, the present one.
    WrongStage(Stage),
    /// There is nothing to stop.
    NotDriving,
    /// The machine has no stages: it is neither localized nor cleared.
    NoStages,
    /// Logging out while the vehicle drives would leave it without a display.
    LogoutWhileActive,
    ShutdownWhileActive,
    /// The configuration has no stop of this id.
    NoSuchStop(Box<str>),
    /// A coordinate of the pose is infinite or no number.
    PoseNotFinite,
    /// The pose is farther than this from every stop: surely a typing error.
    PoseTooFar {
        nearest_m: u32,
        limit_m: u32,
    },
    /// The group `localization` has not confirmed the operator's pose yet.
    NotLocalized,
    /// No goal is set.
    NoGoal,
    /// A relevant top-level group is in ERROR or UNKNOWN, or is masked (IGNORE).
    Group {
        group: Box<str>,
        state: State,
    },
    /// A module's WARNING is not accepted: acknowledge it by this name.
    Warning {
        module: Box<str>,
    },
    /// A countermeasure is engaged, or not released yet.
    Countermeasure(RequestKind),
    /// No reader receives a request that the vehicle may need.
    NobodyListens(RequestKind),
    /// The configuration publishes no request to stop.
    StopNotPublished,
    /// The display has confirmed no recent frame.
    DisplayNotLive,
    /// The disk can store nothing now.
    StorageNotWritable,
    /// There is no alarm of this number.
    NoSuchAlarm(u64),
    /// There is no group and no module of this name.
    NoSuchNode(Box<str>),
    /// The node has no alarm and no WARNING, and causes no countermeasure.
    NothingToAcknowledge(Box<str>),
    /// No request keeps the vehicle from driving.
    NothingToRelease,
    /// The operator tapped STOP after the action was asked for.
    StoppedSince,
    /// A cause of a request is still there.
    CauseRemains {
        node: Box<str>,
    },
    /// There is no module of this name.
    NoSuchModule(Box<str>),
    /// The module holds no latched ERROR.
    NotLatched(Box<str>),
    /// The module is still in ERROR.
    StillInError(Box<str>),
    /// The vehicle may move, or nothing says that it stands.
    NotKnownToStand,
    /// The requested time is zero or longer than `limit_h`.
    ShelvedTooLong {
        limit_h: u32,
    },
    /// So many modules are shelved already.
    ShelvesFull {
        limit: u32,
    },
    /// The module is one of Telltale's own.
    NeverShelved(Box<str>),
    /// A request to slow down or to stop rests on the module.
    CountermeasureRests {
        module: Box<str>,
    },
    /// The module is not shelved.
    NotShelved(Box<str>),
}
