//! The metrics of the program itself: latencies, recorder, store, clients.

use super::families::Families;
use super::vehicle::flag;
use crate::record::recorder::Meter;
use crate::runtime::Published;
use crate::web::AppState;

pub fn write(families: &mut Families<'_>, app: &AppState, published: &Published) -> std::fmt::Result {
    latencies(families, app, published)?;
    recorder(families, app, published)?;
    store(families, app)?;
    clients(families, app)
}

fn latencies(families: &mut Families<'_>, app: &AppState, published: &Published) -> std::fmt::Result {
    let age = app.clock.now().since(published.received);
    families.gauge(
        "telltale_snapshot_age_seconds",
        "Time since the engine published last; it does so at least every 0.25 s.",
        age.as_secs_f64(),
    )?;
    if let Some(live) = app.live() {
        let queue = &live.link.inputs;
        families.gauge(
            "telltale_inputs_waiting",
            "Inputs that wait for the engine.",
            (queue.max_capacity() - queue.capacity()) as f64,
        )?;
        families.histogram(
            "telltale_input_latency_seconds",
            "From the receipt of an input to its judgement.",
            &live.link.latencies.judged,
        )?;
        families.histogram(
            "telltale_publish_latency_seconds",
            "From the receipt of the input that changed a state to the publication of that state.",
            &live.link.latencies.published,
        )?;
    }
    families.histogram(
        "telltale_display_latency_seconds",
        "From the sending of a state or a heartbeat to a page until the page confirms that it shows it.",
        &app.displays.latency(),
    )?;
    families.histogram(
        "telltale_action_latency_seconds",
        "From the arrival of an operator's action until it is done and stored, or refused.",
        &app.action_latency,
    )?;
    families.histogram(
        "telltale_store_job_latency_seconds",
        "From the moment a job is given to the database until it is done, its writing to the disk included.",
        app.store.job_latency(),
    )
}

fn recorder(families: &mut Families<'_>, app: &AppState, published: &Published) -> std::fmt::Result {
    let state = app.settings.recording.as_ref();
    let meter = state.map(|state| state.recorder.meter());
    let held = |of: fn(&Meter) -> f64| meter.as_ref().map_or(0.0, of);
    families.gauge(
        "telltale_recorder_on",
        "1 if incidents are recorded and nothing prevents it.",
        flag(state.is_some_and(|state| state.fault.borrow().is_none())),
    )?;
    families.gauge(
        "telltale_recorder_incident_open",
        "1 while an incident is being recorded.",
        flag(published.recording),
    )?;
    families.gauge(
        "telltale_recorder_memory_bytes",
        "Messages that are kept for the next incident.",
        held(|meter| meter.topics.iter().map(|topic| topic.bytes as f64).sum()),
    )?;
    families.gauge(
        "telltale_recorder_memory_limit_bytes",
        "The bound of that, `recording.memory`.",
        held(|meter| meter.memory as f64),
    )?;
    families.gauge(
        "telltale_recorder_topics_short",
        "Topics that keep less than a recording needs, for want of memory.",
        held(|meter| meter.short().count() as f64),
    )?;
    let waits = state.and_then(|state| state.recorder.waits_for_disk());
    families.gauge(
        "telltale_recorder_disk_wait_seconds",
        "How long the recorder has waited for the disk by now; 0 while it does not.",
        waits.unwrap_or_default().as_secs_f64(),
    )
}

fn store(families: &mut Families<'_>, app: &AppState) -> std::fmt::Result {
    families.gauge(
        "telltale_store_on",
        "1 if the database can be read and written.",
        flag(app.store.fault().borrow().is_none()),
    )?;
    families.gauge(
        "telltale_store_jobs_waiting",
        "Jobs that wait for the database, the present one included.",
        app.store.jobs_waiting() as f64,
    )?;
    families.gauge(
        "telltale_store_records_unwritten",
        "Records of the audit log that the disk has not taken.",
        app.store.records_unwritten() as f64,
    )
}

fn clients(families: &mut Families<'_>, app: &AppState) -> std::fmt::Result {
    families.gauges(
        "telltale_clients",
        "Open WebSockets: pages of people and streams of programs, by the role of the user.",
        app.displays.by_kind_and_role().into_iter().map(|(kind, role, count)| {
            ([("kind", kind.to_owned()), ("role", role.as_str().to_owned())], count as f64)
        }),
    )?;
    families.gauge(
        "telltale_connections",
        "Open HTTP connections, WebSockets included.",
        app.connections.count() as f64,
    )
}
