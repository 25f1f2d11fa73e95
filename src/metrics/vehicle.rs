//! The metrics of the vehicle, from one snapshot. Labels are names of the configuration alone: a flood of
//! statuses makes no new series.

use super::families::Families;
use crate::engine::input::TroubleKind;
use crate::engine::model::countermeasure::RequestKind;
use crate::engine::model::{GroupId, NodeId, Stage};
use crate::engine::snapshot::{CountermeasureState, ModuleInfo, Snapshot};
use crate::engine::state::{State, Tally};

const PROGRESS: [CountermeasureState; 3] =
    [CountermeasureState::Requested, CountermeasureState::Engaged, CountermeasureState::Unconfirmed];

pub fn write(families: &mut Families<'_>, snapshot: &Snapshot) -> std::fmt::Result {
    states(families, snapshot)?;
    causes(families, snapshot)?;
    requests(families, snapshot)?;
    received(families, snapshot)
}

fn states(families: &mut Families<'_>, snapshot: &Snapshot) -> std::fmt::Result {
    families.gauges(
        "telltale_vehicle_info",
        "The vehicle, and the version of Telltale on it.",
        [(
            [
                ("vehicle", snapshot.layout.vehicle_id.to_string()),
                ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ],
            1.0,
        )],
    )?;
    families.gauges(
        "telltale_stage",
        "1 for the present stage, 0 for the others.",
        Stage::ALL.map(|stage| ([("stage", stage.as_str().to_owned())], flag(stage == snapshot.stage))),
    )?;
    families.gauges(
        "telltale_overall_state",
        "1 for the state of the whole vehicle, 0 for the others.",
        State::ALL.map(|it| ([("state", it.as_str().to_owned())], flag(it == snapshot.overall))),
    )?;
    let groups = || (0..snapshot.layout.groups.len() as u32).map(GroupId);
    families.gauges(
        "telltale_group_state",
        "1 for the state that a group shows, 0 for the others.",
        groups().flat_map(|id| {
            let (info, view) = snapshot.group(id);
            State::ALL.map(|state| {
                let labels = [("group", info.path.to_string()), ("state", state.as_str().to_owned())];
                (labels, flag(state == view.state))
            })
        }),
    )?;
    families.gauges(
        "telltale_module_state",
        "1 for the state that a module of the configuration shows, 0 for the others.",
        snapshot.module_ids().map(|id| snapshot.module(id)).filter(|(info, _)| !info.discovered).flat_map(
            |(info, view)| {
                State::ALL.map(|state| {
                    let labels = [
                        ("group", group_of(snapshot, info)),
                        ("module", info.id.to_string()),
                        ("state", state.as_str().to_owned()),
                    ];
                    (labels, flag(state == view.state))
                })
            },
        ),
    )?;
    let mut tallies = vec![Tally::default(); snapshot.layout.groups.len()];
    let mut discovered = 0_u32;
    for (info, view) in snapshot.module_ids().map(|id| snapshot.module(id)) {
        tallies[info.group.0 as usize].add(view.state);
        discovered += u32::from(info.discovered);
    }
    families.gauges(
        "telltale_modules",
        "Modules of a group by the state that they show, discovered ones included.",
        groups().flat_map(|id| {
            let (group, tally) = (&snapshot.layout.groups[id.0 as usize].path, tallies[id.0 as usize]);
            State::ALL.map(|state| {
                let labels = [("group", group.to_string()), ("state", state.as_str().to_owned())];
                (labels, f64::from(tally.of(state)))
            })
        }),
    )?;
    families.gauge(
        "telltale_discovered_modules",
        "Modules that were made of received names; `limits.discovered_modules` bounds them.",
        f64::from(discovered),
    )
}

fn causes(families: &mut Families<'_>, snapshot: &Snapshot) -> std::fmt::Result {
    families.gauge("telltale_root_causes", "Root causes at present.", snapshot.roots.len() as f64)?;
    families.gauges(
        "telltale_root_cause_masked_nodes",
        "Modules and groups that a root cause masks, for each root cause that stands in the configuration.",
        snapshot
            .roots
            .iter()
            .filter(|root| is_configured(snapshot, root.node))
            .map(|root| ([("node", snapshot.node_name(root.node).to_string())], f64::from(root.masks))),
    )?;
    families.gauges(
        "telltale_alarms",
        "Alarms that are active or not acknowledged.",
        [(true, true), (true, false), (false, true), (false, false)].map(|(active, acknowledged)| {
            let alike = |alarm: &&crate::engine::snapshot::Alarm| {
                (alarm.active, alarm.acknowledged) == (active, acknowledged)
            };
            let labels = [("active", active.to_string()), ("acknowledged", acknowledged.to_string())];
            (labels, snapshot.alarms.iter().filter(alike).count() as f64)
        }),
    )?;
    families.counter(
        "telltale_alarms_raised",
        "Alarms that were ever raised; kept over restarts.",
        snapshot.last_alarm,
    )
}

fn requests(families: &mut Families<'_>, snapshot: &Snapshot) -> std::fmt::Result {
    families.gauges(
        "telltale_countermeasure",
        "1 for each request to the vehicle in its present progress, 0 otherwise.",
        RequestKind::ALL.iter().flat_map(|kind| {
            PROGRESS.map(|progress| {
                let labels = [("request", kind.as_str().to_owned()), ("state", progress.as_str().to_owned())];
                let mut requests = snapshot.countermeasures.iter();
                (labels, flag(requests.any(|it| it.request.kind() == *kind && it.state == progress)))
            })
        }),
    )?;
    families.gauge(
        "telltale_requested_deceleration_metres_per_second_squared",
        "The requested deceleration; 0 without one.",
        snapshot.deceleration().unwrap_or(0.0),
    )?;
    families.gauge("telltale_clearance", "1 while the vehicle may start.", flag(snapshot.clearance))?;
    families.gauge(
        "telltale_outputs_unreached",
        "Outputs to the vehicle that nobody receives.",
        snapshot.unreached.len() as f64,
    )
}

fn received(families: &mut Families<'_>, snapshot: &Snapshot) -> std::fmt::Result {
    let counters = &snapshot.counters;
    let faults =
        |kind| snapshot.reception.iter().filter(|it| it.kind == kind).map(|it| it.count).sum::<u64>();
    families.counter(
        "telltale_diagnostic_arrays_received",
        "Received messages on `/diagnostics`.",
        counters.arrays,
    )?;
    families.counter("telltale_statuses_received", "Statuses in these messages.", counters.statuses)?;
    families.counter(
        "telltale_samples_received",
        "Received messages of topics that monitors and signals watch.",
        counters.samples,
    )?;
    families.counter(
        "telltale_messages_lost",
        "Messages that DDS lost, or that came faster than they could be read.",
        faults(TroubleKind::Lost),
    )?;
    families.counter(
        "telltale_messages_malformed",
        "Messages that could not be decoded.",
        faults(TroubleKind::Malformed),
    )?;
    families.counter(
        "telltale_messages_wrong_type",
        "Publishers with another type than the configuration names.",
        faults(TroubleKind::WrongType),
    )?;
    families.counter(
        "telltale_statuses_refused",
        "Statuses with new names past `limits.discovered_modules`.",
        counters.dropped_names,
    )?;
    families.gauge(
        "telltale_status_memory_bytes",
        "Texts that are kept of all statuses; `limits.status_bytes` bounds them.",
        counters.status_bytes as f64,
    )?;
    families.gauge(
        "telltale_statuses_cut",
        "Modules whose texts are cut at present to stay within the bound.",
        counters.cut_statuses as f64,
    )
}

fn group_of(snapshot: &Snapshot, info: &ModuleInfo) -> String {
    snapshot.group(info.group).0.path.to_string()
}

/// A name that came from the network makes no series: it could be another one each second.
fn is_configured(snapshot: &Snapshot, node: NodeId) -> bool {
    match node {
        NodeId::Group(_) => true,
        NodeId::Module(id) => !snapshot.module(id).0.discovered,
    }
}

pub fn flag(is: bool) -> f64 {
    f64::from(u8::from(is))
}
