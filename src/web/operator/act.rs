//! Executes an operator's action: judged, written, judged again, done. It waits for others and for the disk
//! no longer than a tap counts.

use super::not_done::{InvalidTap, NotActed};
use crate::engine::input::{OperatorAction, Response};
use crate::engine::restart::foresee::Foreseen;
use crate::engine::time::Timestamp;
use crate::store::VehicleMemory;
use crate::store::audit::Record;
use crate::web::AppState;
use crate::web::engine_link::NoAnswer;
use crate::web::record::write::RECORDED_WITHIN;
use crate::web::view;
use crate::web::view::Lang;

/// Operator's actions that may wait for one another and for the disk: pages send three at once.
pub const PLACES: usize = 8;

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
        ask: impl Fn() -> Result<OperatorAction, InvalidTap> + Send,
    ) -> Result<(), NotActed> {
        let Ok(place) = self.places.clone().try_acquire_owned() else {
            self.record_later(record.refused("too many others waited"));
            return Err(NotActed::Busy);
        };
        let Some(_acting) = self.by(until, self.acting.lock()).await else {
            self.record_later(record.refused("it waited too long for others"));
            return Err(if self.is_storage_ok() { NotActed::Busy } else { NotActed::Storage });
        };
        // The engine may have taken its time, too.
        let judged = self.judge(ask()).await;
        let judged = judged.and_then(|foreseen| ask().map(|_| foreseen).map_err(NotActed::Invalid));
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
            self.record_later(record);
            return Ok(false);
        };
        Ok(self.record(Some(self.memory()), record).await)
    }

    async fn judge(&self, asked: Result<OperatorAction, InvalidTap>) -> Result<Foreseen, NotActed> {
        match self.rehearse(asked.map_err(NotActed::Invalid)?).await {
            Ok(foreseen) => foreseen.map_err(NotActed::Refused),
            Err(error) => Err(unavailable(&error)),
        }
    }

    async fn carry_out(&self, asked: Result<OperatorAction, InvalidTap>) -> Result<(), NotActed> {
        match self.command(asked.map_err(NotActed::Invalid)?).await {
            Ok(Response::Done) => Ok(()),
            Ok(Response::Refused(reasons)) => Err(NotActed::Refused(reasons)),
            Err(error) => Err(unavailable(&error)),
        }
    }

    /// For the audit log.
    fn why(&self, not_acted: &NotActed) -> String {
        match not_acted {
            NotActed::Refused(reasons) => view::refusals(&self.published(), Lang::En, reasons).join(" "),
            NotActed::Invalid(invalid) => invalid.words(Lang::En),
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

    use super::*;
    use crate::clock::Clock;
    use crate::engine::input::Place;
    use crate::engine::model::{Model, Stage};
    use crate::engine::time::Span;
    use crate::runtime;
    use crate::store::audit::{Action, Entry};
    use crate::store::{DemoSecrets, Store};
    use crate::web::Settings;
    use crate::web::admission::vehicle_displays::Enrolled;
    use crate::web::http::origins::Origins;
    use crate::web::view::sample;

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
        for invalid in [
            InvalidTap::SessionEnded,
            InvalidTap::NotInCharge,
            InvalidTap::Stale,
            InvalidTap::Late,
            InvalidTap::ConfirmedLate,
        ] {
            // Before it is judged, before it is written, before it is done.
            for fails_at in 0..3 {
                let app = unlocked().await;
                let before = app.published().snapshot.localization.number;
                let asked = AtomicUsize::new(0);
                let ask = || match asked.fetch_add(1, Ordering::Relaxed) == fails_at {
                    true => Err(invalid),
                    false => Ok(localize()),
                };
                let until = app.clock.now() + LONG;
                let acted = app.act(until, Record::of(Action::Localize, "here"), ask).await;
                assert!(matches!(acted, Err(NotActed::Invalid(why)) if why == invalid), "{acted:?}");
                assert_eq!(app.published().snapshot.localization.number, before, "{invalid:?} {fails_at}");
                let log = log(&app).await;
                assert_eq!(log[0].outcome, format!("refused: {}", invalid.words(Lang::En)));
                let written = log[1..].iter().filter(|entry| !entry.was_refused()).count();
                assert_eq!(written, usize::from(fails_at == 2), "{invalid:?} {fails_at}: {log:?}");
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
        let waiting_records = app.waiting_records().all();
        assert_eq!(waiting_records[0].refusal.as_deref(), Some("it waited too long for others"));
        assert!(log(&app).await.is_empty());
    }
}
