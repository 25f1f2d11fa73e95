//! The parameters and answers of a route for programs.

use schemars::{Schema, SchemaGenerator};

/// Makes the schema of a type.
pub type SchemaOf = fn(&mut SchemaGenerator) -> Schema;

/// A route as programs use it. Who may use it stands in the table of routes.
#[derive(Debug)]
pub struct Operation {
    /// A name for generated code.
    pub id: &'static str,
    pub tag: Tag,
    pub summary: &'static str,
    /// Sentences.
    pub about: &'static str,
    /// The path, if the route's own takes the rest of an address.
    pub path: Option<&'static str>,
    /// The parts of the path in braces, each with its name, its meaning and an example.
    pub in_path: &'static [(&'static str, &'static str, &'static str)],
    pub query: Option<SchemaOf>,
    pub form: Option<SchemaOf>,
    pub answer: Content,
    /// Statuses of refusals beside those that every route has.
    pub refusals: &'static [(u16, &'static str)],
    /// The query of the example, or its form.
    pub example: &'static str,
    /// A token opens no session for it: it is about the session.
    pub session_alone: bool,
}

/// The answer of a route that succeeds.
#[derive(Debug, Clone, Copy)]
pub enum Content {
    Json(SchemaOf),
    /// A description in JSON, of this media type.
    Description(&'static str),
    /// JSON, or CSV.
    Table(SchemaOf),
    Text,
    /// Something began that takes a while.
    Begun,
    /// A recording.
    Mcap,
    /// Messages over a WebSocket.
    Stream(SchemaOf),
}

telltale_engine::words! {
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Tag {
        State = "state",
        Tables = "tables",
        Incidents = "incidents",
        Operator = "operator",
        Session = "session",
        Description = "description",
    }
}

impl Tag {
    pub const fn about(self) -> &'static str {
        match self {
            Tag::State => "The state of the vehicle, once and live.",
            Tag::Tables => "Tables in pages, as JSON or CSV.",
            Tag::Incidents => "Incidents, their recordings, and marks.",
            Tag::Operator => "What the operator does with the vehicle.",
            Tag::Session => "Logins, and whether the server runs.",
            Tag::Description => "This description, and schemas.",
        }
    }
}

fn nothing(_: &mut SchemaGenerator) -> Schema {
    Schema::default()
}

impl Operation {
    /// For the fields that most operations do not have.
    pub const PLAIN: Operation = Operation {
        id: "",
        tag: Tag::State,
        summary: "",
        about: "",
        path: None,
        in_path: &[],
        query: None,
        form: None,
        answer: Content::Json(nothing),
        refusals: &[],
        example: "",
        session_alone: false,
    };
}
