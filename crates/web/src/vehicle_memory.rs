//! Stores the vehicle's state for a restart whenever it has changed, at most every second but for a new request to the
//! vehicle, and records each change of the stage and of countermeasures. The state after an operator's action is stored before the
//! action is done.

use std::time::{Duration, Instant};

use tokio::sync::broadcast::{self, error::TryRecvError};
use tokio::sync::{oneshot, watch};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout_at};

use super::source::Live;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::Request;
use telltale_engine::restart::preview::Preview;
use telltale_engine::snapshot::Countermeasure;
use telltale_engine::time::Since;
use telltale_runtime::Published;
use telltale_store::VehicleMemory;
use telltale_store::audit::{Action, Record, TELLTALE};

/// Alarms that come and go must not wear the disk out.
const WRITE_EVERY: Duration = Duration::from_secs(1);

/// A new request to the vehicle waits no longer than this.
const REQUEST_WITHIN: Duration = Duration::from_millis(50);

const CAUSES_NAMED: usize = 4;

/// The requests to the vehicle, by name and state.
type Requests = Vec<(&'static str, &'static str)>;

/// A request to the vehicle, and since when it is made.
type Asked = (Request, Since);

/// Stores the vehicle's state for as long as the server runs.
#[derive(Debug)]
pub struct VehicleMemoryTask {
    end: oneshot::Sender<()>,
    task: JoinHandle<()>,
}

impl VehicleMemoryTask {
    pub fn start(app: Live) -> VehicleMemoryTask {
        let (end, ends) = oneshot::channel();
        VehicleMemoryTask { end, task: tokio::spawn(follow(app, ends)) }
    }

    /// Stores the last change by `until`, and ends.
    pub async fn end(mut self, until: Instant) {
        // It has ended by itself if the engine has.
        let _ = self.end.send(());
        if timeout_at(until.into(), &mut self.task).await.is_err() {
            tracing::error!("the disk does not answer: the last change of the vehicle is not stored");
            self.task.abort();
        }
    }
}

impl Live {
    /// The vehicle's present state, to be stored.
    pub fn memory(&self) -> VehicleMemory {
        memory_of(&self.published())
    }

    /// The vehicle's state after an action, to be stored.
    pub fn remembering(&self, preview: Preview) -> VehicleMemory {
        VehicleMemory { seq: preview.seq, at: self.clock.wall(), vehicle: preview.vehicle }
    }

    /// Whether what is granted can be written down.
    pub fn is_storage_ok(&self) -> bool {
        self.store.fault().borrow().is_none()
    }

    /// Whether a drive that begins now will be recorded.
    pub fn is_recorded(&self) -> bool {
        let recording = self.settings.recording.as_ref();
        self.is_storage_ok() && recording.is_none_or(|recording| recording.fault.borrow().is_none())
    }
}

async fn follow(app: Live, mut ends: oneshot::Receiver<()>) {
    let mut turns = app.link.turns.subscribe();
    let mut snapshots = app.link.afterwards.clone();
    let mut last = LastSeen::default();
    loop {
        let is_new = last.store_changes(&app, &mut snapshots, &mut turns).await;
        let next = async {
            if is_new {
                tokio::select! {
                    () = sleep(WRITE_EVERY) => {}
                    () = more_is_asked(snapshots.clone(), &last.asked) => {}
                }
            }
            !turns.is_empty() || snapshots.changed().await.is_ok()
        };
        let goes_on = tokio::select! {
            goes_on = next => goes_on,
            _ = &mut ends => {
                last.store_changes(&app, &mut snapshots, &mut turns).await;
                false
            }
        };
        if !goes_on {
            return;
        }
    }
}

/// Waits for a request to the vehicle that is not stored.
async fn more_is_asked(mut snapshots: watch::Receiver<Published>, stored: &[Asked]) {
    sleep(REQUEST_WITHIN).await;
    if snapshots.wait_for(|it| asks_for_more(it, stored)).await.is_err() {
        std::future::pending::<()>().await;
    }
}

/// Whether a request to the vehicle is not stored: one of its kind that is may have been released meanwhile, or weaker.
fn asks_for_more(published: &Published, stored: &[Asked]) -> bool {
    let is_new = |it: &Countermeasure| it.request.kind().moves() && !stored.contains(&(it.request, it.since));
    published.snapshot.countermeasures.iter().any(is_new)
}

/// The state that was recorded last.
#[derive(Debug, Default)]
struct LastSeen {
    seq: u64,
    stage: Option<Stage>,
    requests: Requests,
    asked: Vec<Asked>,
}

impl LastSeen {
    /// Records and stores what is new. Returns whether the disk had to take anything.
    async fn store_changes(
        &mut self,
        app: &Live,
        snapshots: &mut watch::Receiver<Published>,
        turns: &mut broadcast::Receiver<Published>,
    ) -> bool {
        let _acting = app.turns.take().await;
        loop {
            let records = match turns.try_recv() {
                Ok(published) => self.look(&published),
                Err(TryRecvError::Lagged(missed)) => vec![missed_changes(missed)],
                Err(TryRecvError::Empty | TryRecvError::Closed) => break,
            };
            records.into_iter().for_each(|record| app.store.note(record));
        }
        let published = snapshots.borrow_and_update().clone();
        self.look(&published).into_iter().for_each(|record| app.store.note(record));
        let stored = app.store.remember(memory_of(&published)).await;
        // The store's own watch over the disk reports the fault.
        stored.inspect_err(|error| tracing::debug!(%error, "the vehicle cannot be stored")).unwrap_or(true)
    }

    /// The records of what is new in a state, unless a later one was looked at before.
    fn look(&mut self, published: &Published) -> Vec<Record> {
        let snapshot = &published.snapshot;
        if snapshot.seq < self.seq {
            return Vec::new();
        }
        let records = self.records(published);
        *self = LastSeen {
            seq: snapshot.seq,
            stage: Some(snapshot.stage),
            requests: requests_of(published),
            asked: snapshot.countermeasures.iter().map(|it| (it.request, it.since)).collect(),
        };
        records
    }

    /// The differences from the state before.
    fn records(&self, published: &Published) -> Vec<Record> {
        let snapshot = &published.snapshot;
        let mut records = Vec::new();
        if self.stage != Some(snapshot.stage) {
            records.push(Record::of(Action::Stage, TELLTALE).on(snapshot.stage.as_str()));
        }
        let requests = requests_of(published);
        for (request, state) in
            requests.iter().filter(|countermeasure| !self.requests.contains(countermeasure))
        {
            let target = format!("{request}: {state}{}", causes(published, request));
            records.push(Record::of(Action::Countermeasure, TELLTALE).on(target));
        }
        for (request, _) in &self.requests {
            if !requests.iter().any(|(is, _)| is == request) {
                records.push(Record::of(Action::Countermeasure, TELLTALE).on(format!("{request}: ended")));
            }
        }
        records
    }
}

fn missed_changes(count: u64) -> Record {
    let changes = if count == 1 { "change" } else { "changes" };
    let target = format!("{count} {changes} of the stage or of countermeasures");
    Record::of(Action::Omitted, TELLTALE).on(target)
}

/// Why something is requested of the vehicle, in a few names.
fn causes(published: &Published, request: &str) -> String {
    let snapshot = &published.snapshot;
    let Some(countermeasure) = snapshot.countermeasures.iter().find(|it| it.request.as_str() == request)
    else {
        return String::new();
    };
    let operator = countermeasure.by_operator.map(|_| "the operator");
    let nodes = countermeasure
        .causes
        .iter()
        .filter(|cause| cause.present)
        .map(|cause| &**snapshot.node_name(cause.node));
    let names: Vec<&str> = operator.into_iter().chain(nodes).take(CAUSES_NAMED).collect();
    if names.is_empty() { String::new() } else { format!(", because of {}", names.join(", ")) }
}

fn requests_of(published: &Published) -> Requests {
    let requests = published.snapshot.countermeasures.iter();
    requests.map(|countermeasure| (countermeasure.request.as_str(), countermeasure.state.as_str())).collect()
}

fn memory_of(published: &Published) -> VehicleMemory {
    let snapshot = &published.snapshot;
    VehicleMemory { seq: snapshot.seq, at: published.at, vehicle: snapshot.to_restore() }
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;
    use crate::view::tests::sample::Sample;
    use telltale_engine::action::OperatorAction;

    fn published(vehicle: &mut Sample) -> Published {
        Published::recorded(vehicle.snapshot(), SystemTime::UNIX_EPOCH)
    }

    #[test]
    fn a_request_that_comes_again_after_its_release_is_to_be_stored() {
        let release = OperatorAction::Release { display_live: true, storage_ok: true };
        let mut last = LastSeen::default();
        let mut vehicle = Sample::shuttle(true).act(OperatorAction::RequestStop);
        assert!(asks_for_more(&published(&mut vehicle), &last.asked));
        last.look(&published(&mut vehicle));
        assert!(!asks_for_more(&published(&mut vehicle), &last.asked));
        vehicle = vehicle.pass(1).act(release).pass(1).act(OperatorAction::RequestStop);
        assert!(asks_for_more(&published(&mut vehicle), &last.asked));
    }

    #[test]
    fn each_turn_of_a_countermeasure_is_a_record_with_its_causes() {
        let (mut last, mut vehicle) = (LastSeen::default(), Sample::shuttle(true));
        let mut records = last.look(&published(&mut vehicle));
        vehicle = vehicle.act(OperatorAction::RequestStop);
        records.extend(last.look(&published(&mut vehicle)));
        records.extend(last.look(&published(&mut vehicle)));
        vehicle = vehicle.act(OperatorAction::Release { display_live: true, storage_ok: true });
        records.extend(last.look(&published(&mut vehicle)));
        let records: Vec<_> = records.iter().map(|record| (record.action, &*record.target)).collect();
        let expected = [
            (Action::Stage, "active"),
            (Action::Countermeasure, "maneuver_stop: requested, because of the operator"),
            (Action::Countermeasure, "maneuver_stop: ended"),
        ];
        assert_eq!(records, expected);
    }
}
