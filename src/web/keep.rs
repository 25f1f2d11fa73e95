//! Keeps what of the vehicle has to outlive a restart: at once when an operator acted, and else
//! whenever it changed, at most every second.

use std::time::Duration;

use tokio::time::sleep;

use super::state::AppState;
use crate::engine::model::Stage;
use crate::runtime::Published;
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{StoreError, VehicleMemory};

/// Alarms that come and go must not wear the disk out.
const KEEP_EVERY: Duration = Duration::from_secs(1);

const CAUSES_NAMED: usize = 4;

/// What is asked of the vehicle, by name and state.
type Measures = Vec<(&'static str, &'static str)>;

impl AppState {
    /// Keeps the vehicle as it is now together with the record of what led there. Only when this
    /// returns may an operator's action be acknowledged.
    ///
    /// # Errors
    /// If it cannot be kept.
    pub async fn keep(&self, record: Record) -> Result<(), StoreError> {
        self.store.remember(memory_of(&self.published()), vec![record]).await
    }

    /// The vehicle as it is now.
    pub fn memory(&self) -> VehicleMemory {
        memory_of(&self.published())
    }

    /// Whether what is granted can be written down.
    pub fn is_storage_ok(&self) -> bool {
        self.store.fault().borrow().is_none()
    }
}

/// Follows the vehicle for as long as the server runs.
pub async fn follow(app: AppState) {
    let mut snapshots = app.link.snapshots.clone();
    let mut kept = Kept::default();
    loop {
        let published = snapshots.borrow_and_update().clone();
        let memory = memory_of(&published);
        let records = kept.records(&published);
        let is_same = kept.memory.as_ref().is_some_and(|kept| memory.says_the_same(kept));
        if !is_same || !records.is_empty() {
            match app.store.remember(memory.clone(), records).await {
                Ok(()) => kept.take(memory, &published),
                // The store's own watch over the disk tells of it.
                Err(error) => tracing::debug!(%error, "the vehicle cannot be remembered"),
            }
            sleep(KEEP_EVERY).await;
        }
        if snapshots.changed().await.is_err() {
            return;
        }
    }
}

/// What was kept last.
#[derive(Debug, Default)]
struct Kept {
    memory: Option<VehicleMemory>,
    stage: Option<Stage>,
    measures: Measures,
}

impl Kept {
    /// What happened since, for the audit log. What came and went in between is not in it.
    fn records(&self, published: &Published) -> Vec<Record> {
        let snapshot = &published.snapshot;
        let mut records = Vec::new();
        if self.stage != Some(snapshot.stage) {
            records.push(Record::of(Action::Stage, TELLTALE).on(snapshot.stage.as_str()));
        }
        let measures = measures_of(published);
        for (request, state) in measures.iter().filter(|measure| !self.measures.contains(measure)) {
            let target = format!("{request}: {state}{}", causes(published, request));
            records.push(Record::of(Action::Countermeasure, TELLTALE).on(target));
        }
        for (request, _) in &self.measures {
            if !measures.iter().any(|(is, _)| is == request) {
                records.push(Record::of(Action::Countermeasure, TELLTALE).on(format!("{request}: ended")));
            }
        }
        records
    }

    fn take(&mut self, memory: VehicleMemory, published: &Published) {
        self.memory = Some(memory);
        self.stage = Some(published.snapshot.stage);
        self.measures = measures_of(published);
    }
}

/// Why something is asked of the vehicle, in a few names.
fn causes(published: &Published, request: &str) -> String {
    let snapshot = &published.snapshot;
    let Some(measure) = snapshot.countermeasures.iter().find(|it| it.request.as_str() == request) else {
        return String::new();
    };
    let operator = measure.by_operator.then_some("the operator");
    let nodes =
        measure.causes.iter().filter(|cause| cause.present).map(|cause| &**snapshot.node_name(cause.node));
    let names: Vec<&str> = operator.into_iter().chain(nodes).take(CAUSES_NAMED).collect();
    if names.is_empty() { String::new() } else { format!(", because of {}", names.join(", ")) }
}

fn measures_of(published: &Published) -> Measures {
    let measures = published.snapshot.countermeasures.iter();
    measures.map(|measure| (measure.request.as_str(), measure.state.as_str())).collect()
}

fn memory_of(published: &Published) -> VehicleMemory {
    let snapshot = &published.snapshot;
    VehicleMemory { seq: snapshot.seq, at: published.at, vehicle: snapshot.to_restore() }
}
