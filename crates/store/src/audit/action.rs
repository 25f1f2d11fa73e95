//! The actions that the audit log records, with the words under which the database stores them.

macro_rules! actions {
    ($($name:ident: $word:literal, $about:literal;)*) => {
        /// An action that somebody did or tried to do.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Action { $(#[doc = $about] $name,)* }

        impl Action {
            pub const ALL: &[Action] = &[$(Action::$name,)*];

            /// The word in the database.
            pub const fn as_str(self) -> &'static str {
                match self { $(Action::$name => $word,)* }
            }
        }
    };
}

actions! {
    Start: "start", "The server began.";
    End: "end", "The server ended as it was asked to.";
    Login: "login", "Somebody gave a name and a secret.";
    Logout: "logout", "A session was ended by who held it.";
    SessionEnded: "session ended", "A session was ended by its age, or by another login.";
    SessionElsewhere: "session elsewhere", "A session was used from another network than at its beginning.";
    HandOver: "hand-over", "An operator took charge from another.";
    Request: "request", "A request was refused: foreign origin, wrong role, false token.";
    Localize: "localize", "The operator gave the position of the vehicle.";
    ClearanceAsked: "clearance asked", "The first step of the clearance.";
    Clearance: "clearance", "The second step: the vehicle was cleared to drive.";
    ClearanceWithdrawn: "clearance withdrawn", "The operator took the clearance back.";
    ReleaseAsked: "release asked", "The first step of a release.";
    Release: "release", "The second step: the requests that kept the vehicle from driving ended.";
    Stop: "stop", "The operator stopped the vehicle.";
    Acknowledge: "acknowledge", "The operator acknowledged an alarm.";
    AcknowledgeOver: "acknowledge over", "The operator acknowledged all alarms that were over.";
    Reset: "reset", "A latched error was forgotten.";
    Shelved: "shelved", "A developer shelved a module for maintenance.";
    Unshelved: "shelving ended", "A developer ended that before its time.";
    Stage: "stage", "The vehicle came into another stage.";
    Countermeasure: "countermeasure", "A countermeasure was requested or ended.";
    Configuration: "configuration", "The configuration was read again.";
    Fault: "demo fault", "A fault of the simulated shuttle was switched.";
    UserAdded: "user added", "A user was added.";
    UserSecret: "user secret", "A user got another secret.";
    UserRole: "user role", "A user got another role.";
    UserRemoved: "user removed", "A user was removed.";
    UserKept: "user kept", "What an older record, which was pruned or has another key, said of a user.";
    UsersForeign: "foreign users", "Users or tokens were found that another program wrote into the database; they cannot log in.";
    TokenAdded: "token added", "A token for a program was made.";
    TokenRevoked: "token revoked", "A token of a program was taken back.";
    TokenKept: "token kept", "What an older record, which was pruned or has no key, said of a token.";
    DataRepaired: "data repaired", "A database was made anew of what could be read of a damaged one.";
    DataRestored: "data restored", "A backup was put in the place of the database.";
    Mark: "mark", "Somebody marked a moment in the recording.";
    IncidentRecorded: "incident recorded", "The recording of an incident was finished; with its hash.";
    IncidentFound: "incident found", "A recording was taken in that the store did not know; with its hash.";
    IncidentNote: "incident note", "A note about an incident was written.";
    IncidentKept: "incident kept", "An incident is kept from now on, or no longer.";
    IncidentRemoved: "incident removed", "An incident was removed with its recording; with its hash.";
    RecordingAsked: "recording asked for", "A fleet's console asked a vehicle for the recording of an incident.";
    RecordingStored: "recording stored", "A fleet's console stored a recording that it fetched; with its hash.";
    RecordingExported: "recording exported", "Somebody took a copy of a recording from a fleet's console.";
    WhatIfStarted: "what-if started", "Somebody had recordings at a fleet's console judged by another configuration; with its hash.";
    WhatIfCancelled: "what-if cancelled", "Somebody ended that before its end.";
    Omitted: "omitted", "Records that were left out, because there were too many of their kind.";
    Pruned: "pruned", "The oldest records were taken away.";
    HeadMissing: "head missing", "The note of where the chain ended was gone: it may have been cut before this.";
    BreachAcknowledged: "breach acknowledged", "An authority has looked into what was wrong with the log before.";
    ChainBroken: "chain broken", "The chain did not end where it had been noted to.";
}

impl Action {
    /// Whether the head of the chain is written to the program's log as soon as this action is recorded.
    /// Actions that strangers can cause are not.
    pub(super) const fn matters(self) -> bool {
        !matches!(self, Action::Request | Action::Omitted | Action::Pruned)
    }
}
