//! The operations of the operator, and of sessions.

use super::BAD_FORM;
use crate::api::operation::{Content, Operation, Tag};
use crate::auth::login::{LoggedIn, LoginForm};
use crate::developer::shelving::{ShelveForm, UnshelveForm};
use crate::operator::actions::{AcknowledgeOverForm, ConfirmForm, Done, Granted, LocalizeForm, StopForm};
use crate::operator::tap::Versioned;
use crate::schema::of;

const REFUSED: (u16, &str) = (409, "It was not done: one reason for each check that fails.");
const STORAGE: (u16, &str) = (503, "It was not done: it cannot be recorded, or others wait.");

const ACTION: Operation = Operation {
    tag: Tag::Operator,
    form: Some(of::<Versioned>),
    answer: Content::Json(of::<Done>),
    refusals: &[REFUSED, BAD_FORM, STORAGE],
    example: "version=1",
    ..Operation::PLAIN
};

pub const LOCALIZE: Operation = Operation {
    id: "localize",
    summary: "Say where the vehicle stands",
    about: "At a stop, or at a pose.",
    form: Some(of::<LocalizeForm>),
    example: "stop=depot&version=1",
    ..ACTION
};

pub const CLEARANCE: Operation = Operation {
    id: "clearance",
    summary: "Ask for clearance",
    about: "The first of two steps. It needs a display that shows the state.",
    answer: Content::Json(of::<Granted>),
    ..ACTION
};

pub const CONFIRM_CLEARANCE: Operation = Operation {
    id: "confirm_clearance",
    summary: "Give clearance",
    about: "The second step.",
    form: Some(of::<ConfirmForm>),
    example: "token=OF-THE-FIRST-STEP",
    ..ACTION
};

pub const WITHDRAW: Operation = Operation {
    id: "withdraw_clearance",
    summary: "Withdraw the clearance",
    about: "The vehicle has not left yet.",
    ..ACTION
};

pub const STOP: Operation = Operation {
    id: "stop",
    summary: "Ask the vehicle to stop",
    about: "It counts for any state that the display showed. It forbids a clearance or a release that \
            was requested before it and is not confirmed yet.",
    form: Some(of::<StopForm>),
    refusals: &[
        REFUSED,
        BAD_FORM,
        (503, "It is requested, and not recorded or not heard: the answer says which."),
    ],
    example: "tap=1764259200123-8f3a",
    ..ACTION
};

pub const RELEASE: Operation = Operation {
    id: "release",
    summary: "Ask to release a stop",
    about: "The first of two steps. It needs a display that shows the state.",
    answer: Content::Json(of::<Granted>),
    ..ACTION
};

pub const CONFIRM_RELEASE: Operation = Operation {
    id: "confirm_release",
    summary: "Release a stop",
    about: "The second step: the vehicle may go on.",
    form: Some(of::<ConfirmForm>),
    example: "token=OF-THE-FIRST-STEP",
    ..ACTION
};

pub const SHUTDOWN: Operation = Operation {
    id: "shutdown",
    summary: "Shut the vehicle down",
    about: "It ends the work with the vehicle, and the session.",
    form: None,
    refusals: &[REFUSED, STORAGE],
    example: "",
    ..ACTION
};

pub const ACKNOWLEDGE: Operation = Operation {
    id: "acknowledge",
    summary: "Acknowledge an alarm or a warning",
    about: "An alarm by its number, a WARNING by the name of its node, with the slashes in it.",
    path: Some("/alarms/{id}/acknowledge"),
    in_path: &[("id", "The number of an alarm, or the name of a node.", "1")],
    ..ACTION
};

pub const ACKNOWLEDGE_OVER: Operation = Operation {
    id: "acknowledge_over",
    summary: "Acknowledge all alarms that are over",
    about: "Up to the last one that was shown.",
    form: Some(of::<AcknowledgeOverForm>),
    example: "last=1",
    ..ACTION
};

pub const RESET: Operation = Operation {
    id: "reset",
    summary: "Reset a module that is held",
    about: "The name of the module has slashes in it.",
    path: Some("/modules/{id}/reset"),
    in_path: &[("id", "The name of a module.", "sensors/velodyne_packet_alive")],
    ..ACTION
};

pub const SHELVE: Operation = Operation {
    id: "shelve",
    summary: "Shelve a module for maintenance",
    about: "Its faults raise no alarm for so long. Only while the vehicle stands, and for no module that a request to \
            slow down or to stop needs.",
    form: Some(of::<ShelveForm>),
    example: "module=sensors/camera_front&minutes=30",
    ..ACTION
};

pub const UNSHELVE: Operation = Operation {
    id: "unshelve",
    summary: "End the maintenance of a module",
    about: "A fault that is still there raises a new alarm.",
    form: Some(of::<UnshelveForm>),
    example: "module=sensors/camera_front",
    ..ACTION
};

pub const LOGIN: Operation = Operation {
    id: "login",
    tag: Tag::Session,
    summary: "Log in",
    about: "With `Accept: application/json`. The answer sets the cookie of the session. One operator leads the \
        vehicle: another one gives `take_over=1`.",
    form: Some(of::<LoginForm>),
    answer: Content::Json(of::<LoggedIn<'static>>),
    refusals: &[
        (401, "The name or the secret is wrong."),
        (409, "Another operator leads the vehicle, or it drives."),
        BAD_FORM,
        (429, "Too many attempts: wait as long as `Retry-After` says."),
    ],
    example: "name=anna&secret=975310",
    ..Operation::PLAIN
};

pub const LOGOUT: Operation = Operation {
    id: "logout",
    tag: Tag::Session,
    summary: "Log out",
    about: "A program's token ends with `telltale user revoke`.",
    answer: Content::Json(of::<Done>),
    refusals: &[(409, "The vehicle drives."), STORAGE],
    session_alone: true,
    ..Operation::PLAIN
};
