//! Does what an operator asks for: judged, written down, judged anew, done. Nobody waits longer for
//! others or for the disk than a tap counts.

use std::time::Duration;

use tokio::time::{Instant, timeout, timeout_at};

use super::state::{AppState, NoAnswer};
use super::view::{self, Lang};
use super::wording::Trouble;
use crate::engine::input::{OperatorAction, Refusal, Response};
use crate::engine::restart::foresee::Foreseen;
use crate::engine::time::{Span, Timestamp};
use crate::store::audit::Record;
use crate::store::{StoreError, VehicleMemory};

/// Operator's actions that may wait for one another and for the disk: pages send three at once.
pub const PLACES: usize = 8;

/// What is to be recorded and stands already waits no longer for others than this, and no longer for
/// the disk: a page hears of it within the two seconds for which it waits.
const RECORDED_WITHIN: Span = Span::from_millis(800);

/// Why an operator's action changed nothing.
#[derive(Debug)]
pub enum NotActed {
    Refused(Vec<Refusal>),
    /// What it was asked for with counts no more.
    Void(Void),
    /// It cannot be written down.
    Storage,
    /// Too many wait already.
    Busy,
    /// The engine or the store does not answer.
    Unavailable,
}

impl NotActed {
    /// What is answered where there are no reasons to name.
    pub const fn trouble(&self) -> Trouble {
        match self {
            NotActed::Storage => Trouble::Storage,
            NotActed::Busy => Trouble::Busy,
            NotActed::Refused(_) | NotActed::Void(_) | NotActed::Unavailable => Trouble::Unavailable,
        }
    }
}

/// Why a tap counts for nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Void {
    /// The user who made it has no session any more.
    SessionEnded,
    /// Somebody else leads the vehicle.
    NotSeated,
    /// What it was made for is not as it was shown.
    Stale,
    /// It waited too long, on its way or here.
    Late,
    /// It confirms what was asked for too long ago.
    ConfirmedLate,
}

impl Void {
    pub fn words(self, lang: Lang) -> String {
        let words = lang.words();
        match self {
            Void::SessionEnded => Trouble::NoSession.say(lang).1.to_owned(),
            Void::NotSeated => words.not_in_seat.to_owned(),
            Void::Stale => words.refused_stale.to_owned(),
            Void::Late => words.refused_late.to_owned(),
            Void::ConfirmedLate => lang.not_pending(true),
        }
    }
}

impl AppState {
    /// Does what an operator asks for. It is judged, then written down with what is to be remembered
    /// of it, then done: what is done is on the disk, and what cannot be written is not done. If
    /// the program is killed in between, it is done after the restart, and nobody was told that yet.
    ///
    /// `ask` says what is asked for, if that counts in the moment in which it is called: before
    /// anything is written, and again when the disk has answered. `until` is how long it may wait.
    ///
    /// # Errors
    /// Why nothing has changed. It is in the audit log, or will be.
    pub async fn act(
        &self,
        until: Timestamp,
        record: Record,
        ask: impl Fn() -> Result<OperatorAction, Void> + Send,
    ) -> Result<(), NotActed> {
        let Ok(place) = self.places.clone().try_acquire_owned() else {
            self.owe(record.refused("too many others waited"));
            return Err(NotActed::Busy);
        };
        let Some(_acting) = self.by(until, self.acting.lock()).await else {
            self.owe(record.refused("it waited too long for others"));
            return Err(if self.is_storage_ok() { NotActed::Busy } else { NotActed::Storage });
        };
        // The engine may have taken its time, too.
        let judged = self.judge(ask()).await;
        let judged = judged.and_then(|foreseen| ask().map(|_| foreseen).map_err(NotActed::Void));
        let foreseen = match judged {
            Ok(foreseen) => foreseen,
            Err(not_acted) => {
                self.record(None, record.refused(self.why(&not_acted))).await;
                return Err(not_acted);
            }
        };
        let seq = foreseen.seq;
        self.write_ahead(Some(self.remembering(foreseen)), &record, until, place).await?;
        let Err(not_acted) = self.carry_out(ask()).await else { return Ok(()) };
        tracing::warn!("an action was written and is not done");
        let memory = self.memory();
        let memory = VehicleMemory { seq: memory.seq.max(seq), ..memory };
        self.record(Some(memory), record.refused(self.why(&not_acted))).await;
        Err(not_acted)
    }

    /// Does what must not wait for a disk, and tells whether it is kept: else it will be.
    ///
    /// # Errors
    /// Why nothing has changed.
    pub async fn act_at_once(&self, action: OperatorAction, record: Record) -> Result<bool, NotActed> {
        if let Err(not_acted) = self.carry_out(Ok(action)).await {
            self.record(None, record.refused(self.why(&not_acted))).await;
            return Err(not_acted);
        }
        let until = self.clock.now() + RECORDED_WITHIN;
        let Some(_acting) = self.by(until, self.acting.lock()).await else {
            self.owe(record);
            return Ok(false);
        };
        Ok(self.record(Some(self.memory()), record).await)
    }

    async fn judge(&self, asked: Result<OperatorAction, Void>) -> Result<Foreseen, NotActed> {
        match self.rehearse(asked.map_err(NotActed::Void)?).await {
            Ok(foreseen) => foreseen.map_err(NotActed::Refused),
            Err(error) => Err(unavailable(&error)),
        }
    }

    async fn carry_out(&self, asked: Result<OperatorAction, Void>) -> Result<(), NotActed> {
        match self.command(asked.map_err(NotActed::Void)?).await {
            Ok(Response::Done) => Ok(()),
            Ok(Response::Refused(reasons)) => Err(NotActed::Refused(reasons)),
            Err(error) => Err(unavailable(&error)),
        }
    }

    /// Writes down what is about to be done, until then or not at all. If the disk does not answer
    /// until then, what it holds is known later: that it was not done is written then. The place is
    /// free when the disk has answered.
    ///
    /// # Errors
    /// Why it must not be done.
    pub async fn write_ahead(
        &self,
        memory: Option<VehicleMemory>,
        record: &Record,
        until: Timestamp,
        place: impl Send + 'static,
    ) -> Result<(), NotActed> {
        let (store, records) = (self.store.clone(), vec![record.clone()]);
        let mut writing = Box::pin(async move { store.write_ahead(memory, records, until).await });
        let not_done = record.clone().refused("the disk did not answer in time");
        let Some(written) = self.by(until, &mut writing).await else {
            tracing::error!("the disk does not answer, so an action is not done");
            let app = self.clone();
            tokio::spawn(async move {
                let _place = place;
                // Whether it was written or not, it was not done.
                let _ = writing.await;
                app.owe(not_done);
            });
            return Err(NotActed::Storage);
        };
        written.map_err(|error| {
            tracing::error!(%error, "an action cannot be kept, so it is not done");
            let is_late = matches!(error, StoreError::TooLate);
            self.owe(if is_late { not_done } else { record.clone().refused("it could not be written") });
            if is_late || error.is_of_storage() { NotActed::Storage } else { NotActed::Unavailable }
        })
    }

    /// Records what stands already, and the vehicle if it is given. Tells whether it is on the disk;
    /// what the disk does not take waits and is written later.
    pub async fn record(&self, memory: Option<VehicleMemory>, record: Record) -> bool {
        let app = self.clone();
        let mut writing = Box::pin(async move {
            let written = match memory {
                Some(memory) => app.store.remember(memory, vec![record.clone()]).await,
                None => app.store.audit(record.clone()).await,
            };
            if let Err(error) = &written {
                let action = record.action.as_str();
                tracing::error!(%error, action, "the audit log lacks a record; it is written as soon as it can be");
                app.owe(record);
            }
            written.is_ok()
        });
        match timeout(Duration::from_nanos(RECORDED_WITHIN.as_nanos()), &mut writing).await {
            Ok(is_written) => is_written,
            Err(_) => {
                tokio::spawn(writing);
                false
            }
        }
    }

    /// Waits until then at most.
    pub(super) async fn by<T>(&self, until: Timestamp, what: impl Future<Output = T>) -> Option<T> {
        timeout_at(Instant::from_std(self.clock.instant(until)), what).await.ok()
    }

    /// Records what has happened, without making anybody wait.
    pub fn note(&self, record: Record) {
        let app = self.clone();
        tokio::spawn(async move { app.record(None, record).await });
    }

    /// The vehicle as it will be.
    pub fn remembering(&self, foreseen: Foreseen) -> VehicleMemory {
        VehicleMemory { seq: foreseen.seq, at: self.clock.wall(), vehicle: foreseen.vehicle }
    }

    /// Whether what is granted can be written down.
    pub fn is_storage_ok(&self) -> bool {
        self.store.fault().borrow().is_none()
    }

    /// For the audit log.
    fn why(&self, not_acted: &NotActed) -> String {
        match not_acted {
            NotActed::Refused(reasons) => view::refusals(&self.published(), Lang::En, reasons).join(" "),
            NotActed::Void(void) => void.words(Lang::En),
            NotActed::Storage => "it could not be written".to_owned(),
            NotActed::Busy => "too many others waited".to_owned(),
            NotActed::Unavailable => NoAnswer.to_string(),
        }
    }
}

fn unavailable(error: &NoAnswer) -> NotActed {
    tracing::error!(%error, "an action cannot be handed on");
    NotActed::Unavailable
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::super::enrolled::Enrolled;
    use super::super::origins::Origins;
    use super::super::state::Settings;
    use super::super::view::sample;
    use super::*;
    use crate::clock::Clock;
    use crate::engine::input::Place;
    use crate::engine::model::{Model, Stage};
    use crate::runtime;
    use crate::store::audit::{Action, Entry};
    use crate::store::{DemoSecrets, Store};

    const LONG: Span = Span::from_secs(60);

    /// A vehicle with an operator who has not said where it stands.
    async fn unlocked() -> AppState {
        let clock = Clock::start();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        let link = runtime::start(Arc::new(Model::new(sample::parts()).unwrap()), clock);
        let origins = Origins::of_listener(([127, 0, 0, 1], 80).into(), false);
        let settings = Settings {
            origins,
            secure: false,
            enrolled: Enrolled::default(),
            demo: None,
            rereads: None,
            history: None,
            discovery: None,
        };
        let app = AppState::new(link, store, clock, settings);
        app.command(OperatorAction::Login { name: "anna".into() }).await.unwrap();
        app
    }

    fn localize() -> OperatorAction {
        OperatorAction::Localize { place: Place::Stop("depot".into()) }
    }

    async fn log(app: &AppState) -> Vec<Entry> {
        app.store.audit_entries(None, 10).await.unwrap()
    }

    #[tokio::test]
    async fn what_counts_no_more_when_the_disk_has_answered_is_taken_back() {
        for void in [Void::SessionEnded, Void::NotSeated, Void::Stale, Void::Late, Void::ConfirmedLate] {
            // Before it is judged, before it is written, before it is done.
            for fails_at in 0..3 {
                let app = unlocked().await;
                let before = app.published().snapshot.localization.number;
                let asked = AtomicUsize::new(0);
                let ask = || match asked.fetch_add(1, Ordering::Relaxed) == fails_at {
                    true => Err(void),
                    false => Ok(localize()),
                };
                let until = app.clock.now() + LONG;
                let acted = app.act(until, Record::of(Action::Localize, "here"), ask).await;
                assert!(matches!(acted, Err(NotActed::Void(why)) if why == void), "{acted:?}");
                assert_eq!(app.published().snapshot.localization.number, before, "{void:?} {fails_at}");
                let log = log(&app).await;
                assert_eq!(log[0].outcome, format!("refused: {}", void.words(Lang::En)));
                let written = log[1..].iter().filter(|entry| !entry.was_refused()).count();
                assert_eq!(written, usize::from(fails_at == 2), "{void:?} {fails_at}: {log:?}");
                let remembered = app.store.recall().await.unwrap();
                let pose = remembered.map(|it| (it.stage, it.pose));
                assert_eq!(pose, (fails_at == 2).then_some((Stage::Localizing, None)));
            }
        }
    }

    #[tokio::test]
    async fn what_is_done_is_asked_for_anew_each_time_and_written_once() {
        let app = unlocked().await;
        let until = app.clock.now() + LONG;
        app.act(until, Record::of(Action::Localize, "here"), || Ok(localize())).await.unwrap();
        assert_eq!(log(&app).await.len(), 1);
        assert!(app.store.recall().await.unwrap().unwrap().pose.is_some());
    }

    #[tokio::test]
    async fn who_waits_for_others_past_the_end_is_refused_and_recorded_later() {
        let app = unlocked().await;
        let acting = app.acting.lock().await;
        let acted = app.act(app.clock.now(), Record::of(Action::Localize, "here"), || Ok(localize())).await;
        assert!(matches!(acted, Err(NotActed::Busy)), "{acted:?}");
        drop(acting);
        let owed = app.owed().all();
        assert_eq!(owed[0].refusal.as_deref(), Some("it waited too long for others"));
        assert!(log(&app).await.is_empty());
    }
}
