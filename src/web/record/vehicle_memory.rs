//! Stores the vehicle's state for a restart whenever it has changed, at most every second. An operator's
//! action is stored before it is done.

use std::time::Duration;

use tokio::sync::broadcast::{self, error::TryRecvError};
use tokio::sync::{oneshot, watch};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

use crate::engine::model::Stage;
use crate::runtime::Published;
use crate::store::VehicleMemory;
use crate::store::audit::{Action, Record, TELLTALE};
use crate::web::AppState;

/// Alarms that come and go must not wear the disk out.
const WRITE_EVERY: Duration = Duration::from_secs(1);

const CAUSES_NAMED: usize = 4;

/// Records that may wait for a disk that takes nothing.
const WAITING_MAX: usize = 1024;

/// What is asked of the vehicle, by name and state.
type Requests = Vec<(&'static str, &'static str)>;

/// At the end a disk has this long to answer.
const LAST_WITHIN: Duration = Duration::from_secs(2);

/// Keeps the vehicle for as long as the server runs.
#[derive(Debug)]
pub struct VehicleMemoryTask {
    end: oneshot::Sender<()>,
    task: JoinHandle<()>,
}

impl VehicleMemoryTask {
    pub fn start(app: AppState) -> VehicleMemoryTask {
        let (end, ends) = oneshot::channel();
        VehicleMemoryTask { end, task: tokio::spawn(follow(app, ends)) }
    }

    /// Keeps what changed last, and ends.
    pub async fn end(mut self) {
        // It has ended by itself if the engine has.
        let _ = self.end.send(());
        if timeout(LAST_WITHIN, &mut self.task).await.is_err() {
            tracing::error!("the disk does not answer: what changed last is not kept");
            self.task.abort();
        }
    }
}

impl AppState {
    /// The vehicle as it is now.
    pub fn memory(&self) -> VehicleMemory {
        memory_of(&self.published())
    }
}

async fn follow(app: AppState, mut ends: oneshot::Receiver<()>) {
    let mut turns = app.link.turns.subscribe();
    let mut snapshots = app.link.snapshots.clone();
    let mut last = LastWritten::default();
    loop {
        let is_new = last.write_changes(&app, &mut snapshots, &mut turns).await;
        let next = async {
            if is_new {
                sleep(WRITE_EVERY).await;
            }
            !turns.is_empty() || snapshots.changed().await.is_ok()
        };
        let goes_on = tokio::select! {
            goes_on = next => goes_on,
            _ = &mut ends => {
                last.write_changes(&app, &mut snapshots, &mut turns).await;
                false
            }
        };
        if !goes_on {
            return;
        }
    }
}

/// What was kept last, and what is to be recorded since.
#[derive(Debug, Default)]
struct LastWritten {
    memory: Option<VehicleMemory>,
    /// Of the state that was looked at last.
    seq: u64,
    stage: Option<Stage>,
    requests: Requests,
    /// What the disk did not take yet; what comes past [`WAITING_MAX`] is counted.
    waiting: Vec<Record>,
    lost: u64,
}

impl LastWritten {
    /// Remembers what is new; tells whether there was anything.
    async fn write_changes(
        &mut self,
        app: &AppState,
        snapshots: &mut watch::Receiver<Published>,
        turns: &mut broadcast::Receiver<Published>,
    ) -> bool {
        let _acting = app.acting.lock().await;
        loop {
            match turns.try_recv() {
                Ok(published) => self.look(&published),
                Err(TryRecvError::Lagged(lost)) => self.lost += lost,
                Err(TryRecvError::Empty | TryRecvError::Closed) => break,
            }
        }
        let published = snapshots.borrow_and_update().clone();
        self.look(&published);
        let memory = memory_of(&published);
        let waiting_records = app.waiting_records();
        let mut records = waiting_records.all();
        let changes = if self.lost == 1 { "change" } else { "changes" };
        let omitted = || format!("{} {changes} of the stage or of countermeasures", self.lost);
        records.extend((self.lost > 0).then(|| Record::of(Action::Omitted, TELLTALE).on(omitted())));
        records.extend_from_slice(&self.waiting);
        let is_same = self.memory.as_ref().is_some_and(|kept| memory.says_the_same(kept));
        if is_same && records.is_empty() {
            return false;
        }
        match app.store.remember(memory.clone(), records).await {
            Ok(()) => {
                self.memory = Some(memory);
                self.waiting.clear();
                self.lost = 0;
                app.forget_written(&waiting_records);
            }
            // The store's own watch over the disk tells of it.
            Err(error) => tracing::debug!(%error, "the vehicle cannot be remembered"),
        }
        true
    }

    /// Notes what is to be recorded of a state, unless a later one was looked at before.
    fn look(&mut self, published: &Published) {
        let snapshot = &published.snapshot;
        if snapshot.seq < self.seq {
            return;
        }
        self.seq = snapshot.seq;
        for record in self.records(published) {
            if self.waiting.len() < WAITING_MAX { self.waiting.push(record) } else { self.lost += 1 }
        }
        self.stage = Some(snapshot.stage);
        self.requests = requests_of(published);
    }

    /// What is different from what was looked at last.
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

/// Why something is asked of the vehicle, in a few names.
fn causes(published: &Published, request: &str) -> String {
    let snapshot = &published.snapshot;
    let Some(countermeasure) = snapshot.countermeasures.iter().find(|it| it.request.as_str() == request)
    else {
        return String::new();
    };
    let operator = countermeasure.by_operator.then_some("the operator");
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
    use crate::engine::action::{AlarmRef, OperatorAction};
    use crate::web::view::sample::Sample;

    fn published(vehicle: &mut Sample) -> Published {
        Published { snapshot: vehicle.snapshot(), at: SystemTime::UNIX_EPOCH }
    }

    #[test]
    fn each_turn_of_a_countermeasure_is_a_record_with_its_causes() {
        let (mut kept, mut vehicle) = (LastWritten::default(), Sample::shuttle(true));
        kept.look(&published(&mut vehicle));
        vehicle = vehicle.act(OperatorAction::RequestStop);
        kept.look(&published(&mut vehicle));
        kept.look(&published(&mut vehicle));
        vehicle = vehicle.act(OperatorAction::Acknowledge { alarm: AlarmRef::OperatorStop });
        kept.look(&published(&mut vehicle));
        let records: Vec<_> = kept.waiting.iter().map(|record| (record.action, &*record.target)).collect();
        let expected = [
            (Action::Stage, "active"),
            (Action::Countermeasure, "maneuver_stop: requested, because of the operator"),
            (Action::Countermeasure, "maneuver_stop: ended"),
        ];
        assert_eq!(records, expected);
    }

    #[test]
    fn what_waits_for_a_disk_that_takes_nothing_has_a_bound_and_the_rest_is_counted() {
        let (mut kept, mut vehicle) = (LastWritten::default(), Sample::shuttle(true));
        let mut all = 0;
        for _ in 0..WAITING_MAX {
            vehicle = vehicle.act(OperatorAction::RequestStop);
            all += kept.records(&published(&mut vehicle)).len();
            kept.look(&published(&mut vehicle));
            vehicle = vehicle.act(OperatorAction::Acknowledge { alarm: AlarmRef::OperatorStop });
            all += kept.records(&published(&mut vehicle)).len();
            kept.look(&published(&mut vehicle));
        }
        assert!(all > 2 * WAITING_MAX - 2, "each turn is a record: {all}");
        assert_eq!((kept.waiting.len(), kept.lost), (WAITING_MAX, (all - WAITING_MAX) as u64));
    }
}
