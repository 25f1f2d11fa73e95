//! The operator's actions, and the engine's answers.

use super::model::Stage;
use super::model::countermeasure::RequestKind;
use super::state::State;

/// What an operator may do. Whether it is granted is the engine's answer, see [`Response`].
#[derive(Debug, Clone, PartialEq)]
pub enum OperatorAction {
    Login {
        name: Box<str>,
    },
    Logout,
    /// Ends the work with the vehicle; it is locked as by a logout.
    Shutdown,
    /// Says where the vehicle stands.
    Localize {
        place: Place,
    },
    /// The first step of a clearance: checks everything and changes nothing.
    AskClearance {
        /// The display in front of the operator confirmed a recent frame.
        display_live: bool,
        /// What is granted can be written down.
        storage_ok: bool,
    },
    /// The second step: checks everything again and clears the vehicle.
    Clear {
        display_live: bool,
        storage_ok: bool,
    },
    /// Asks the maneuver component for its own safe stop.
    RequestStop,
    /// Takes note of an alarm, accepts a WARNING, or agrees to the release of a countermeasure.
    Acknowledge {
        alarm: AlarmRef,
    },
    /// Forgets the latched ERROR of a module, named `group/module`.
    Reset {
        module: Box<str>,
    },
}

/// Where a vehicle stands, as an operator says it.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// Id of a stop of the configuration.
    Stop(Box<str>),
    /// Metres and degrees in the map's frame.
    Pose { x_m: f64, y_m: f64, yaw_deg: f64 },
}

/// What is acknowledged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AlarmRef {
    /// The number of an alarm.
    Number(u64),
    /// A node by its name: its alarm, its WARNING (of a group: the WARNINGs inside), and the
    /// countermeasures that it causes.
    Node(Box<str>),
    /// The stop that the operator asked for.
    OperatorStop,
}

/// The engine's answer to an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Response {
    Done,
    /// Nothing was changed; one reason for each check that failed.
    Refused(Vec<Refusal>),
}

/// Why an operator's action was refused. The page puts it into words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// Nobody leads the vehicle.
    NobodyLoggedIn,
    /// The action has no meaning in this stage, which is the present one.
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
    /// The pose is farther than this from every stop: surely a slip.
    PoseTooFar {
        nearest_m: u32,
        limit_m: u32,
    },
    /// The pose that was given is not confirmed by the group `localization` yet.
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
    /// A countermeasure is engaged or not released yet.
    Countermeasure(RequestKind),
    /// Nobody hears what the vehicle may have to be asked for.
    NobodyListens(RequestKind),
    /// The configuration publishes no request to stop.
    StopNotPublished,
    /// The display confirmed no recent frame.
    DisplayNotLive,
    /// Nothing can be written down now.
    StorageNotWritable,
    /// There is no alarm of this number.
    NoSuchAlarm(u64),
    /// There is no group and no module of this name.
    NoSuchNode(Box<str>),
    /// The node has no alarm, no WARNING and no part in a countermeasure.
    NothingToAcknowledge(Box<str>),
    /// The operator asked for no stop.
    NoStopRequested,
    /// There is no module of this name.
    NoSuchModule(Box<str>),
    /// The module holds no latched ERROR.
    NotLatched(Box<str>),
    /// The module is in ERROR still.
    StillInError(Box<str>),
}
