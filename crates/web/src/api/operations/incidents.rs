//! The operations about incidents and marks.

use super::{BAD_FORM, UNAVAILABLE, list};
use crate::api::incidents::ListQuery;
use crate::api::operation::{Content, Operation, Tag};
use crate::incidents::{KeepForm, Listed, MarkForm, Marked, NoteForm, Whole};
use crate::schema::of;

const ID: (&str, &str, &str) = ("id", "The number of an incident.", "1");
const NO_INCIDENT: (u16, &str) = (404, "There is no incident with this number.");

const INCIDENT_ONE: Operation = Operation { tag: Tag::Incidents, in_path: &[ID], ..Operation::PLAIN };

pub const INCIDENTS: Operation = Operation {
    id: "incidents",
    tag: Tag::Incidents,
    summary: "Incidents",
    about: "The newest first, filtered, in pages: `before` is the number of the last incident of the page before.",
    query: Some(of::<ListQuery>),
    answer: Content::Table(list::<Listed<'static>>),
    refusals: &[BAD_FORM, UNAVAILABLE],
    example: "?count=10",
    ..Operation::PLAIN
};

pub const INCIDENT: Operation = Operation {
    id: "incident",
    summary: "Everything of an incident",
    about: "With its story, which is read from its recording.",
    answer: Content::Json(of::<Whole<'static>>),
    refusals: &[NO_INCIDENT, UNAVAILABLE],
    ..INCIDENT_ONE
};

pub const RECORDING: Operation = Operation {
    id: "recording",
    summary: "The recording of an incident",
    about: "An MCAP file; ranges of it too.",
    path: Some("/incidents/{id}.mcap"),
    answer: Content::Mcap,
    refusals: &[
        (404, "There is no incident with this number, or its file is gone."),
        (409, "It is still recorded."),
    ],
    ..INCIDENT_ONE
};

pub const NOTE: Operation = Operation {
    id: "note",
    summary: "Write the note of an incident",
    about: "In place of the note before. The answer is the incident.",
    form: Some(of::<NoteForm>),
    answer: Content::Json(of::<Whole<'static>>),
    refusals: &[NO_INCIDENT, BAD_FORM, UNAVAILABLE],
    example: "note=a loose plug",
    ..INCIDENT_ONE
};

pub const KEEP: Operation = Operation {
    id: "keep",
    summary: "Keep an incident whatever its age and size, or no longer",
    about: "The answer is the incident.",
    form: Some(of::<KeepForm>),
    answer: Content::Json(of::<Whole<'static>>),
    refusals: &[NO_INCIDENT, BAD_FORM, UNAVAILABLE],
    example: "kept=true",
    ..INCIDENT_ONE
};

pub const MARK: Operation = Operation {
    id: "mark",
    tag: Tag::Incidents,
    summary: "Mark this moment in the recording",
    about: "It begins an incident, or is noted in the one that is recorded. The answer comes when both the recording and the \
            list of incidents have it, or after a second.",
    form: Some(of::<MarkForm>),
    answer: Content::Json(of::<Marked>),
    refusals: &[
        BAD_FORM,
        (
            503,
            "Nothing is recorded at present, or the disk has not taken the mark within a second: `error` says which.",
        ),
    ],
    example: "note=a bump",
    ..Operation::PLAIN
};
