//! An operator's tap on a button: who made it, the state that it was shown with, and whether it counts.

use std::net::IpAddr;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::admission::peer::{Peer, source_of};
use crate::auth::expiry::is_in_charge;
use crate::http::guard::SignedIn;
use crate::http::respond::{Reader, Speaks};
use crate::texts::{HttpError, InvalidTap, Lang};
use crate::view::versions::Aspect;
use crate::view::{Home, PagePart, Palette};
use crate::{AppState, Live};
use telltale_clock::wall_at;
use telltale_engine::input::OperatorAction;
use telltale_engine::time::{Span, Timestamp};
use telltale_record::story::operator_word;
use telltale_record::transition::Change;
use telltale_store::Session;
use telltale_store::audit::{Action, Record};

/// Twice the time after which a page without heartbeats covers itself.
const TAP_LATE_MAX: Span = Span::from_secs(4);

/// Bytes of a reason in a recording.
const REASON_BYTES_MAX: usize = 500;

/// The `seq` that the button was shown with.
#[derive(Debug, Deserialize, JsonSchema)]
pub struct Versioned {
    pub version: u64,
    /// The wall time of the server's last heartbeat before the tap, as the heartbeat said it.
    pub beat: Option<String>,
}

/// A tap on a button, over HTTP or over the socket of the page.
#[derive(Debug, Clone)]
pub struct Tap {
    pub app: Live,
    pub session: Session,
    source: IpAddr,
    pub reader: Reader,
    pub arrived: Timestamp,
}

/// A tap with the action that it asks for.
#[derive(Debug)]
pub struct TappedAction {
    pub tap: Tap,
    pub validity: TapValidity,
    pub action: OperatorAction,
    /// The record of the action.
    pub record: Record,
}

/// The conditions under which a tap counts. They are checked again whenever the tap has waited.
#[derive(Debug, Clone, Copy)]
pub struct TapValidity {
    pub aspect: Aspect,
    /// The `seq` that it was shown with.
    pub version: u64,
    /// After this it is late.
    pub until: Timestamp,
    /// For a second step: after this the first one does not count any more.
    pub confirmed_until: Timestamp,
    /// For a second step: the number of the last STOP before the first. After another STOP it does not count.
    pub last_stop: Option<u64>,
    /// It is a stop, which counts whatever was shown and however late, and from the next operator too.
    pub is_stop: bool,
}

impl FromRequestParts<AppState> for Tap {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Tap, HttpError> {
        let arrived = app.clock.now();
        let SignedIn(session) = SignedIn::from_request_parts(parts, app).await?;
        let app = Live::from_request_parts(parts, app).await?;
        let source = source_of(parts.extensions.get::<Peer>().copied());
        let reader = Reader::of(&parts.uri, &parts.headers, &parts.extensions);
        Ok(Tap { app, session, source, reader, arrived })
    }
}

impl Tap {
    /// A tap that came over the socket of a page.
    pub fn over_socket(app: Live, session: &Session, source: IpAddr, lang: Lang) -> Tap {
        let (reader, arrived) = (Tap::socket_reader(lang), app.clock.now());
        Tap { app, session: session.clone(), source, reader, arrived }
    }

    /// How the answer to a tap over the socket is written.
    pub fn socket_reader(lang: Lang) -> Reader {
        Reader {
            speaks: Speaks::Json,
            lang,
            palette: Palette::default(),
            part: PagePart::default(),
            home: Home::default(),
        }
    }

    /// The conditions under which this tap counts. A tap that was delayed on its way was made while the
    /// display was live, and arrives when it may not be.
    pub fn validity(&self, shown: &Versioned, aspect: Aspect) -> TapValidity {
        let age = shown.beat.as_deref().map_or(Span::ZERO, |beat| self.age(beat));
        let until = self.arrived + (TAP_LATE_MAX - age);
        let (version, confirmed_until) = (shown.version, until);
        TapValidity { aspect, version, until, confirmed_until, last_stop: None, is_stop: false }
    }

    /// A stop counts whatever the page showed, and however late it comes.
    pub fn validity_of_stop(&self) -> TapValidity {
        let never = Timestamp::MAX;
        TapValidity {
            aspect: Aspect::Stage,
            version: 0,
            until: never,
            confirmed_until: never,
            last_stop: None,
            is_stop: true,
        }
    }

    /// How old a heartbeat was when the tap arrived. What cannot be read is as old as can be.
    fn age(&self, beat: &str) -> Span {
        let Ok(beat) = humantime::parse_rfc3339(beat) else { return TAP_LATE_MAX };
        let clock = &self.app.clock;
        let wall = wall_at(clock.wall(), clock.now(), self.arrived);
        let apart = wall.duration_since(beat).or_else(|_| beat.duration_since(wall)).unwrap_or_default();
        Span::from_nanos(u64::try_from(apart.as_nanos()).unwrap_or(u64::MAX))
    }

    /// Whether the tap counts now.
    fn check(&self, validity: &TapValidity) -> Result<(), InvalidTap> {
        let (app, now) = (&self.app, self.app.clock.now());
        if !self.session.is_open() || app.has_expired(&self.session) {
            return Err(InvalidTap::SessionEnded);
        }
        let published = app.published();
        let is_next = validity.is_stop && app.hand_overs.is_successor(&self.session);
        if !is_next && !is_in_charge(&self.session, &published.snapshot) {
            return Err(InvalidTap::NotInCharge);
        }
        if validity.is_stop {
            return Ok(());
        }
        if validity.last_stop.is_some_and(|number| number != published.snapshot.last_stop) {
            return Err(InvalidTap::StoppedSince);
        }
        if now >= validity.until {
            return Err(InvalidTap::Late);
        }
        if now >= validity.confirmed_until {
            return Err(InvalidTap::ConfirmedLate);
        }
        let holds = app.frames.observe(&published).holds(validity.aspect, validity.version);
        if holds { Ok(()) } else { Err(InvalidTap::Stale) }
    }

    /// The conditions that the engine cannot know: whether the operator's display is live, and whether the
    /// storage works.
    pub fn conditions(&self) -> (bool, bool) {
        let display_live = self.app.displays.is_live_for(&self.session, self.app.clock.now());
        (display_live, self.app.is_recorded())
    }

    /// The beginning of a record of what this tap asks for.
    pub fn record(&self, action: Action) -> Record {
        Record::of_session(&self.session, action, self.source)
    }

    /// Tells the recorder of incidents that this action was not done, and why.
    pub fn tell_recorder(&self, action: &OperatorAction, why: &str, why_de: &str) {
        let Some(recording) = &self.app.settings.recording else { return };
        let cut = |text: &str| text[..text.floor_char_boundary(REASON_BYTES_MAX)].to_owned().into();
        let (action, on) = operator_word(action);
        recording.recorder.tell(Change::Refused {
            action: action.into(),
            on: cut(&on),
            by: cut(&self.session.user),
            why: cut(why),
            why_de: cut(why_de),
        });
    }
}

impl TappedAction {
    /// The action with the conditions of this moment, if the tap counts now.
    ///
    /// # Errors
    /// Why it does not count.
    pub fn judged(&self) -> Result<OperatorAction, InvalidTap> {
        self.tap.check(&self.validity)?;
        let (display_live, storage_ok) = self.tap.conditions();
        Ok(match &self.action {
            OperatorAction::AskClearance { .. } => OperatorAction::AskClearance { display_live, storage_ok },
            OperatorAction::Clear { .. } => OperatorAction::Clear { display_live, storage_ok },
            OperatorAction::AskRelease { .. } => OperatorAction::AskRelease { display_live, storage_ok },
            OperatorAction::Release { .. } => OperatorAction::Release { display_live, storage_ok },
            other => other.clone(),
        })
    }

    /// Tells the recorder of incidents that it was not done, and why.
    pub fn tell_recorder(&self, why: &str, why_de: &str) {
        self.tap.tell_recorder(&self.action, why, why_de);
    }

    /// The tap counts until then.
    pub fn until(&self) -> Timestamp {
        self.validity.until.min(self.validity.confirmed_until)
    }
}
