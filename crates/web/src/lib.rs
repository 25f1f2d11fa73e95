//! The HTTP server: pages, sessions, the WebSocket and the wire.

mod admission;
mod api;
pub mod assets;
mod auth;
mod demo;
pub mod developer;
mod engine_link;
mod http;
pub mod incidents;
pub mod live;
mod operator;
mod pages;
mod replays;
mod router;
mod schema;
mod self_check;
mod serve;
pub mod services;
mod source;
pub mod texts;
mod vehicle_memory;
pub mod view;

use std::ops::Deref;
use std::path::PathBuf;
use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use self::view::Trends;
use admission::connections::Connections;
use admission::recorded::Recorded;
use auth::handover::HandOvers;
use auth::login::Proofs;
use auth::session_ends::SessionEnds;
use auth::sign_in_out::OperatorChange;
use auth::take_over::TakeOvers;
use developer::audit::AuditReading;
use developer::learn::{Learner, Learning};
use developer::reload::Reloading;
use http::readers::Readers;
use live::byte_budget::Accounts;
use live::displays::Displays;
use live::first_changes::FirstChanges;
use live::frame::Frames;
use operator::act::Turns;
use operator::stop_once::Stops;
use operator::two_steps::PendingConfirmation;
use replays::Replays;
pub use replays::{ServedFile, ServedFiles};
use serve::accept::Listening;
use telltale_clock::Clock;
use telltale_clock::latency::Latency;
use telltale_engine::discovery::Discovery;
use telltale_engine::time::Timestamp;
use telltale_runtime::{Published, Reread, Written};
use telltale_store::{History, Store, StoreError};
use texts::HttpError;

pub use admission::peer::Peer;
pub use admission::proxies::{Network, NoNetwork, Proxies};
pub use admission::vehicle_displays::{Enrolled, NoDisplay, VehicleDisplay};
pub use auth::expiry::DEVELOPER_IDLE_MAX;
pub use demo::{DemoFaults, FaultSwitch};
pub use http::guard::{Access, cookie_name};
pub use http::origins::{NoOrigin, Origins};
use incidents::WhatIfs;
pub use incidents::{Examiner, Marker, Marking, NotMarked, RecordingState};
pub use live::frame::{snapshot_schema, stream_schema};
pub use router::{BODY_BYTES_MAX, Route, TEXT_BYTES_MAX, openapi, router, routes, shown_files};
pub use self_check::{SelfCheck, Stuck};
pub use serve::accept::{serve, serve_router};
pub use serve::tls::{CertificateValidity, RENEW_BEFORE, Tls, TlsError};
pub use source::{Live, Player, Replay, Source};
pub use view::DemoFault;

/// What a fleet's console has in common with a vehicle's server.
pub mod common {
    pub use crate::admission::login_throttle::{Source, Throttle};
    pub use crate::admission::peer::{CameFrom, network, source_of};
    pub use crate::api::query::{Asked, Moment};
    pub use crate::api::table::{Format, Table};
    pub use crate::auth::login::{known_device, make_known, set_cookie, set_lax_cookie};
    pub use crate::developer::incidents::what_if::{Row as JudgedRow, sent as sent_configuration};
    pub use crate::http::guard::{SignedIn, admitted, bearer, has_own_origin, one_session};
    pub use crate::http::headers::secure as secure_headers;
    pub use crate::http::plain_errors::in_words;
    pub use crate::http::readers::lower_priority;
    pub use crate::http::respond::{FormOf, Reader, Speaks, bad_field, cookie, json_answer, refusal};
    pub use crate::incidents::{sent_recording, wall_time};
    pub use crate::pages::{asset, healthz, not_found, wrong_method};
    pub use crate::replays::{asked_ms, passed_on};
    pub use crate::view::Home;
    pub use crate::view::page::frame::PageFrame;
}

/// The description of an interface for programs.
pub mod describe {
    pub use crate::api::openapi::{About, Described, Description, OPENAPI, document, get as openapi};
    pub use crate::api::operation::{Content, Operation, Tag};
    pub use crate::schema::{of, words};
}

/// The settings of the server from the command line.
#[derive(Debug, Default)]
pub struct Settings {
    pub origins: Origins,
    /// Browsers connect over TLS, so cookies are marked for TLS only.
    pub secure: bool,
    /// The displays at which a PIN is enough.
    pub enrolled: Enrolled,
    /// Switches of the simulated machine; `None` on a real one.
    pub demo: Option<DemoFaults>,
    /// Requests to read the configuration file again; `None` without a file.
    pub rereads: Option<mpsc::Sender<Reread>>,
    /// The running configuration as it is written; `None` where it is not known.
    pub written: Option<watch::Receiver<Arc<Written>>>,
    /// The history; `None` if it cannot be stored.
    pub history: Option<History>,
    /// The participants and topics that DDS discovery knows; `None` without DDS.
    pub discovery: Option<watch::Receiver<Arc<Discovery>>>,
    /// When the listening task and the sending task last did their work; empty without DDS.
    pub working: Vec<watch::Receiver<Timestamp>>,
    /// The folder of the recordings.
    pub recordings: Option<PathBuf>,
    /// Reads the configurations of what-ifs; `None` where nothing is run.
    pub what_if: Option<Examiner>,
    /// Learns dependencies from the history; `None` where that is not offered.
    pub learner: Option<Learner>,
    /// Marks moments in the recording; `None` if nothing is recorded.
    pub marker: Option<Marker>,
    /// The words of the pages about the recording; `None` if nothing is recorded.
    pub recording: Option<RecordingState>,
    /// The recordings that are shown instead of a vehicle.
    pub replayed: Option<ServedFiles>,
}

impl Settings {
    /// Of a vehicle without history, simulation, reloads and recordings.
    pub fn plain(origins: Origins, secure: bool) -> Settings {
        Settings { origins, secure, ..Settings::default() }
    }
}

/// Shared by all requests; clones are the same.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

#[derive(Debug)]
pub struct Shared {
    pub source: Source,
    pub store: Store,
    pub clock: Clock,
    pub settings: Settings,
    pub frames: Frames,
    pub displays: Displays,
    pub connections: Connections,
    readers: Readers,
    recorded: Recorded,
    /// From the arrival of an operator's action until it is done or refused.
    pub action_latency: Latency,
    first_changes: FirstChanges,
    /// The budgets of bytes that accounts may send over their sockets.
    accounts: Accounts,
    pub session_ends: SessionEnds,
    pub trends: Trends,
    replays: Replays,
    what_ifs: WhatIfs,
    learning: Learning,
    pub pending: PendingConfirmation,
    pub stops: Stops,
    pub hand_overs: HandOvers,
    pub take_overs: TakeOvers,
    pub proofs: Proofs,
    audit_reading: AuditReading,
    operator_change: OperatorChange,
    turns: Turns,
    reloading: Reloading,
    listening: Listening,
}

impl AppState {
    pub fn new(source: impl Into<Source>, store: Store, clock: Clock, settings: Settings) -> AppState {
        AppState(Arc::new(Shared {
            source: source.into(),
            store,
            clock,
            settings,
            frames: Frames::default(),
            displays: Displays::default(),
            connections: Connections::default(),
            readers: Readers::default(),
            recorded: Recorded::default(),
            action_latency: Latency::default(),
            first_changes: FirstChanges::default(),
            accounts: Accounts::default(),
            session_ends: SessionEnds::default(),
            trends: Trends::default(),
            replays: Replays::new(router),
            what_ifs: WhatIfs::default(),
            learning: Learning::default(),
            pending: PendingConfirmation::default(),
            stops: Stops::default(),
            hand_overs: HandOvers::default(),
            take_overs: TakeOvers::default(),
            proofs: Proofs::default(),
            audit_reading: AuditReading::default(),
            operator_change: OperatorChange::default(),
            turns: Turns::default(),
            reloading: Reloading::default(),
            listening: Listening::default(),
        }))
    }

    /// The present snapshot for programs; nothing is shown while the vehicle is locked.
    fn unlocked(&self) -> Result<Published, HttpError> {
        let published = self.published();
        unlocked(&published)?;
        Ok(published)
    }

    /// Reads from the history. While the vehicle is locked, its past is not shown either.
    async fn past<'a, T, F>(
        &'a self,
        published: &Published,
        read: impl FnOnce(&'a History) -> F,
    ) -> Result<T, HttpError>
    where
        F: Future<Output = Result<T, StoreError>>,
    {
        unlocked(published)?;
        let history = self.settings.history.as_ref().ok_or(HttpError::Unavailable)?;
        let past = read(history).await;
        past.inspect_err(|error| tracing::warn!(%error, "the history cannot be read"))
            .map_err(|_| HttpError::Unavailable)
    }
}

fn unlocked(published: &Published) -> Result<(), HttpError> {
    if published.is_locked() { Err(HttpError::Locked) } else { Ok(()) }
}

impl Deref for AppState {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

/// Waits until the server ends.
pub async fn turned(closing: &mut watch::Receiver<bool>) {
    // A sender that is gone has ended with the server.
    let _ = closing.wait_for(|closing| *closing).await;
}
