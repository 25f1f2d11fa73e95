//! What all requests share.

use std::hash::RandomState;
use std::ops::Deref;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::{Semaphore, mpsc, oneshot, watch};
use tokio::time::timeout;

use super::act::PLACES;
use super::audit::Limit;
use super::demo::DemoFaults;
use super::displays::Displays;
use super::enrolled::Enrolled;
use super::farewell::{Farewell, Farewells};
use super::frame::Frames;
use super::handover::HandOvers;
use super::meter::Accounts;
use super::origins::Origins;
use super::owed::Owed;
use super::pending::PendingClearance;
use super::seat::has_idled_out;
use super::stops::Stops;
use super::throttle::Throttle;
use super::view::Trends;
use crate::clock::Clock;
use crate::engine::discovery::Discovery;
use crate::engine::input::{OperatorAction, Refusal, Response};
use crate::engine::model::Stage;
use crate::engine::restart::foresee::Foreseen;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::Span;
use crate::runtime::{self, Command, Link, Published, Rehearsal, Reread};
use crate::store::{History, Role, Session, Store, Token};

/// The engine answers in well under a millisecond; one that takes this long hangs.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(2);

/// Four pulses of the engine.
const ENGINE_SILENT_MAX: Span = Span::from_millis(4 * runtime::PULSE_EVERY.as_millis());

/// What the command line says about the server.
#[derive(Debug)]
pub struct Settings {
    pub origins: Origins,
    /// Browsers come over TLS: cookies are for that alone.
    pub secure: bool,
    /// Where a PIN will do.
    pub enrolled: Enrolled,
    /// Switches of the simulated shuttle; `None` on a vehicle.
    pub demo: Option<DemoFaults>,
    /// Who reads the configuration's file again; `None` where it comes from no file.
    pub rereads: Option<mpsc::Sender<Reread>>,
    /// What happened; `None` where it cannot be kept.
    pub history: Option<History>,
    /// What DDS discovery sees; `None` without DDS.
    pub discovery: Option<watch::Receiver<Arc<Discovery>>>,
}

/// Shared by all requests; clones are the same.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

#[derive(Debug)]
pub struct Shared {
    pub link: Link,
    pub store: Store,
    pub clock: Clock,
    pub settings: Settings,
    pub frames: Frames,
    pub displays: Displays,
    /// What the accounts may still send over their sockets.
    pub(super) accounts: Accounts,
    pub farewells: Farewells,
    pub trends: Trends,
    pub pending: PendingClearance,
    pub stops: Stops,
    pub hand_overs: HandOvers,
    pub throttle: Mutex<Throttle>,
    /// Makes numbers of names that are no user's, by a key of this run.
    pub(super) unknown_names: RandomState,
    pub(super) audit_limit: Mutex<Limit>,
    /// Held while the audit log is read.
    pub(super) audit_readers: tokio::sync::Mutex<()>,
    /// Held while somebody takes the operator's seat or leaves it.
    pub(super) seat: tokio::sync::Mutex<()>,
    /// Held while a change of the seat is undone that the disk took too late.
    pub(super) undoing: Arc<tokio::sync::Mutex<()>>,
    /// Held from the judgement of an action until it is done, and while the vehicle is remembered:
    /// what is on the disk never falls behind an action that was written there. After `seat`.
    pub(super) acting: tokio::sync::Mutex<()>,
    /// For those who wait for `acting`, or for the disk, with an action.
    pub(super) places: Arc<Semaphore>,
    /// Records that wait for a disk that takes nothing.
    pub(super) owed: Mutex<Owed>,
    /// Held while somebody has the configuration taken.
    pub(super) reloading: tokio::sync::Mutex<()>,
    /// Turns true when the server ends.
    pub closing: watch::Sender<bool>,
}

/// The engine does not answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the engine does not answer")]
pub struct NoAnswer;

impl AppState {
    pub fn new(link: Link, store: Store, clock: Clock, settings: Settings) -> AppState {
        AppState(Arc::new(Shared {
            link,
            store,
            clock,
            settings,
            frames: Frames::default(),
            displays: Displays::default(),
            accounts: Accounts::default(),
            farewells: Farewells::default(),
            trends: Trends::default(),
            pending: PendingClearance::default(),
            stops: Stops::default(),
            hand_overs: HandOvers::default(),
            throttle: Mutex::default(),
            unknown_names: RandomState::new(),
            audit_limit: Mutex::default(),
            audit_readers: tokio::sync::Mutex::default(),
            seat: tokio::sync::Mutex::default(),
            undoing: Arc::default(),
            acting: tokio::sync::Mutex::default(),
            places: Arc::new(Semaphore::new(PLACES)),
            owed: Mutex::default(),
            reloading: tokio::sync::Mutex::default(),
            closing: watch::channel(false).0,
        }))
    }
}

impl Deref for AppState {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

impl Shared {
    pub fn published(&self) -> Published {
        self.link.snapshots.borrow().clone()
    }

    /// Whether the engine said something lately: it does even when nothing happens. What it said
    /// last is of no worth to a display once it hangs.
    pub fn is_engine_alive(&self) -> bool {
        let snapshots = &self.link.snapshots;
        let silent_since = snapshots.borrow().snapshot.now;
        snapshots.has_changed().is_ok() && self.clock.now().since(silent_since) < ENGINE_SILENT_MAX
    }

    /// The session of a token, unless it has expired.
    pub fn session(&self, token: &Token) -> Option<Session> {
        self.store.session(token).filter(|session| !self.has_expired(session))
    }

    /// Whether a session is over. The operator of a vehicle that drives keeps it.
    pub fn has_expired(&self, session: &Session) -> bool {
        if has_idled_out(session, self.clock.now()) {
            return true;
        }
        let published = self.link.snapshots.borrow();
        let drives = published.snapshot.stage == Stage::Active && is_seated(session, &published.snapshot);
        session.expires <= self.clock.now() && !drives
    }

    /// Has an operator's action judged, and not done.
    ///
    /// # Errors
    /// If the engine does not answer.
    pub async fn rehearse(&self, action: OperatorAction) -> Result<Result<Foreseen, Vec<Refusal>>, NoAnswer> {
        let (reply, answer) = oneshot::channel();
        let exchange = async {
            self.link.rehearsals.send(Rehearsal { action, reply }).await.map_err(|_| NoAnswer)?;
            answer.await.map_err(|_| NoAnswer)
        };
        timeout(COMMAND_TIMEOUT, exchange).await.map_err(|_| NoAnswer)?
    }

    /// Why a session that is over by itself is.
    pub fn overdue(&self, session: &Session) -> Farewell {
        if has_idled_out(session, self.clock.now()) { Farewell::Idle } else { Farewell::Expired }
    }

    /// Hands an operator's action to the engine.
    ///
    /// # Errors
    /// If it does not answer. Nothing has happened then and nothing will; a stop may.
    pub async fn command(&self, action: OperatorAction) -> Result<Response, NoAnswer> {
        let (reply, answer) = oneshot::channel();
        let exchange = async {
            self.link.commands.send(Command { action, reply }).await.map_err(|_| NoAnswer)?;
            answer.await.map_err(|_| NoAnswer)
        };
        timeout(COMMAND_TIMEOUT, exchange).await.map_err(|_| NoAnswer)?
    }
}

/// Whether this is a session of the operator in the seat.
pub fn is_seated(session: &Session, snapshot: &Snapshot) -> bool {
    session.role == Role::Operator && snapshot.operator.as_deref() == Some(&*session.user)
}

/// Waits until the server ends.
pub async fn turned(closing: &mut watch::Receiver<bool>) {
    // A sender that is gone has ended with the server.
    let _ = closing.wait_for(|closing| *closing).await;
}
