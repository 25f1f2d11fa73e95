//! The parts of a snapshot that may be shown.

use std::sync::Arc;

use telltale_engine::persistent::PersistentVec;
use telltale_engine::snapshot::{Layout, Localization, Snapshot};
use telltale_engine::state::State;
use telltale_runtime::Published;

/// A snapshot without what nobody may see: in the stage `locked`, everything about the vehicle's parts.
/// Every page and every frame is made from this.
pub fn permitted(published: &Published) -> Published {
    let snapshot = &published.snapshot;
    if !published.is_locked() {
        return published.clone();
    }
    let layout = Layout {
        vehicle_id: snapshot.layout.vehicle_id.clone(),
        vehicle_name: snapshot.layout.vehicle_name.clone(),
        display_dpi: snapshot.layout.display_dpi,
        other: snapshot.layout.other,
        stops: Arc::new([]),
        signal_titles: Arc::new([]),
        groups: Vec::new(),
        modules: Vec::new(),
    };
    let withheld = Snapshot {
        seq: snapshot.seq,
        revision: snapshot.revision,
        now: snapshot.now,
        stage: snapshot.stage,
        operator: snapshot.operator.clone(),
        overall: State::Ignore,
        layout: Arc::new(layout),
        groups: PersistentVec::default(),
        modules: PersistentVec::default(),
        roots: Arc::new([]),
        asking: Arc::new([]),
        asked: None,
        alarms: Arc::new([]),
        last_alarm: snapshot.last_alarm,
        accepted: Arc::default(),
        shelved: Arc::new([]),
        countermeasures: Arc::new([]),
        localization: Localization::default(),
        motion: snapshot.motion,
        driven_m: snapshot.driven_m,
        clearance: snapshot.clearance,
        hold: snapshot.hold,
        last_stop: snapshot.last_stop,
        may_set_off: snapshot.may_set_off,
        clearance_refusals: Arc::new([]),
        release_refusals: Arc::new([]),
        unreached: Arc::new([]),
        listened: Arc::new([]),
        signals: Arc::new([]),
        reception: Arc::new([]),
        counters: snapshot.counters,
    };
    Published { snapshot: Arc::new(withheld), ..published.clone() }
}
