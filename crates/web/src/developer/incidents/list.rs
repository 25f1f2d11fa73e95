//! The list of incidents, with filters, and how long the disk's share for them lasts.

use askama::Template;
use axum::extract::State;
use axum::response::{Html, IntoResponse, Response};

use super::told::{Told, told};
use crate::AppState;
use crate::developer::pager::ROWS_MAX;
use crate::developer::request::PageRequest;
use crate::developer::{DevFrame, Page, PageQuery, frame};
use crate::incidents::{failed, wall_time};
use crate::texts::{HttpError, IncidentWords, Lang, MESSAGE, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{View, html};
use telltale_clock::unix_ms;
use telltale_engine::model::Stage;
use telltale_record::retention::Policy;
use telltale_store::{Incident, IncidentFilter, OnDisk, Role, StoreError};

/// Incidents on one page.
const ROWS: u32 = 50;
/// Causes that are named in a row.
const CAUSES: usize = 3;
const RENEW_MS: u32 = 2000;
const DAY_MS: i64 = 24 * 3600 * 1000;

struct Choice {
    value: String,
    word: String,
    chosen: bool,
}

struct Row {
    id: u64,
    told: Told,
    since: String,
    /// Empty while it lasts.
    length: String,
    causes: Vec<String>,
    more: usize,
    kinds: Vec<String>,
    stage: &'static str,
    flags: Vec<&'static str>,
    size: String,
    note: String,
}

#[derive(Template)]
#[template(path = "developer/incidents.html")]
struct ListHtml {
    frame: PageFrame,
    dev: DevFrame,
    it: &'static IncidentWords,
    cause: String,
    /// The name of a field, its word, and what can be chosen.
    selects: Vec<(&'static str, &'static str, Vec<Choice>)>,
    /// Without stages there is no column for them.
    has_stages: bool,
    /// The reader may mark this moment.
    may_mark: bool,
    is_off: bool,
    fault: Option<String>,
    on_disk: String,
    rows: Vec<Row>,
    is_filtered: bool,
    older: Option<String>,
}

/// `GET /incidents?cause=TEXT&group=PATH&stage=STAGE&marked=true&kept=true&before=ID`
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Result<Response, HttpError> {
    let query = &request.query;
    let now_ms = unix_ms(app.clock.wall());
    let read = async {
        let found = found(&app, query).await?;
        Ok((found, app.store.incidents_on_disk(now_ms.saturating_sub(DAY_MS)).await?))
    };
    let (found, on_disk) = read.await.map_err(failed)?;
    let state = app.settings.recording.as_ref();
    let policy = state.map(|state| *state.policy.borrow());
    let fault = state.and_then(|state| state.fault.borrow().as_deref().map(|why| clean(why, MESSAGE)));
    let lang = request.context.lang;
    let view = &View::new(&request.published, lang, false);
    let mut dev = DevFrame::new(view, &request.context, Page::Incidents, RENEW_MS);
    // Recordings are of the past, and can be downloaded too, while the vehicle is locked.
    dev.locked = false;
    let it = IncidentWords::of(lang);
    let count = if query.wants_all_rows() { ROWS_MAX } else { ROWS as usize };
    let is_full = found.len() > count;
    let rows: Vec<Row> = found.iter().take(count).map(|incident| row(it, view, incident)).collect();
    let older = rows.last().filter(|_| is_full).map(|last| query.with("before", &last.id.to_string()));
    let words = dev.words;
    let has_stages = view.snapshot.has_stages();
    let mut selects = vec![("group", words.group, groups(view, query, it))];
    if has_stages {
        selects.push(("stage", words.stage, stages(lang, query, it)));
    }
    selects.push(("marked", it.marked, yes_or_no(query, "marked", it)));
    selects.push(("kept", it.kept, yes_or_no(query, "kept", it)));
    let page = ListHtml {
        frame: frame(&request.context),
        cause: clean(query.get("cause"), MESSAGE),
        selects,
        has_stages,
        may_mark: state.is_some() && request.context.role == Role::Developer,
        is_off: state.is_none(),
        fault,
        on_disk: on_disk_words(lang, on_disk, policy),
        rows,
        is_filtered: ["cause", "group", "stage", "marked", "kept", "before"]
            .iter()
            .any(|name| !query.get(name).is_empty()),
        older,
        it,
        dev,
    };
    Ok(Html(html(&page)).into_response())
}

/// One more than the page shows; for a file, all that fit the filter.
async fn found(app: &AppState, query: &PageQuery) -> Result<Vec<Incident>, StoreError> {
    if !query.wants_all_rows() {
        return app.store.incidents(filter(query)).await;
    }
    let mut all: Vec<Incident> = Vec::new();
    while all.len() < ROWS_MAX {
        let before = all.last().map(|last| last.summary.id);
        let more = IncidentFilter { before, count: 0, ..filter(query) };
        let more = app.store.incidents(more).await?;
        if more.is_empty() {
            break;
        }
        all.extend(more);
    }
    Ok(all)
}

fn filter(query: &PageQuery) -> IncidentFilter {
    let is = |name| query.get(name).parse().ok();
    IncidentFilter {
        cause: query.get("cause").to_owned(),
        group: query.get("group").to_owned(),
        stage: query.get("stage").to_owned(),
        marked: is("marked"),
        kept: is("kept"),
        before: query.number("before"),
        count: ROWS + 1,
        ..IncidentFilter::default()
    }
}

fn choice(query: &PageQuery, name: &str, value: &str, word: &str) -> Choice {
    Choice { value: value.to_owned(), word: word.to_owned(), chosen: query.get(name) == value }
}

fn yes_or_no(query: &PageQuery, name: &str, it: &IncidentWords) -> Vec<Choice> {
    [("", it.any), ("true", it.yes), ("false", it.no)]
        .iter()
        .map(|(value, word)| choice(query, name, value, word))
        .collect()
}

fn stages(lang: Lang, query: &PageQuery, it: &IncidentWords) -> Vec<Choice> {
    let stage = |stage: &Stage| choice(query, "stage", stage.as_str(), lang.stage(*stage, true));
    std::iter::once(choice(query, "stage", "", it.any)).chain(Stage::ALL.iter().map(stage)).collect()
}

fn groups(view: &View<'_>, query: &PageQuery, it: &IncidentWords) -> Vec<Choice> {
    let group = query.get("group");
    let known = view.snapshot.layout.groups.iter().map(|group| &*group.path);
    let mut names: Vec<&str> = known.collect();
    if !group.is_empty() && !names.contains(&group) {
        names.push(group);
    }
    let named = names.iter().map(|name| choice(query, "group", name, &clean(name, NAME)));
    std::iter::once(choice(query, "group", "", it.any)).chain(named).collect()
}

fn row(it: &'static IncidentWords, view: &View<'_>, incident: &Incident) -> Row {
    let lang = view.lang;
    let summary = &incident.summary;
    let causes = summary.causes();
    let mut kinds: Vec<&str> = summary.triggers.iter().map(|trigger| &*trigger.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    Row {
        id: summary.id,
        told: told(view, summary),
        since: wall_time(summary.since_ms),
        length: length(incident),
        causes: causes.iter().take(CAUSES).map(|cause| clean(cause, 2 * NAME)).collect(),
        more: causes.len().saturating_sub(CAUSES),
        kinds: kinds.iter().map(|kind| clean(lang.trigger(kind).unwrap_or(kind), NAME)).collect(),
        stage: Stage::from_word(&summary.stage).map_or("", |stage| lang.stage(stage, true)),
        flags: flags(it, incident),
        size: lang.size(summary.recording.bytes),
        note: said(incident),
    }
}

/// Its note, and the notes of its marks.
fn said(incident: &Incident) -> String {
    let note = incident.note.iter().map(|note| &*note.text);
    let all = note.chain(incident.summary.marks().map(|mark| &*mark.note));
    let all: Vec<&str> = all.filter(|text| !text.is_empty()).collect();
    clean(&all.join("; "), MESSAGE)
}

/// How long it lasted; empty while it does.
pub(in crate::developer) fn length(incident: &Incident) -> String {
    let summary = &incident.summary;
    let long = summary.until_ms.map(|until_ms| until_ms.saturating_sub(summary.since_ms));
    long.map(|ms| format!("{} s", ms / 1000)).unwrap_or_default()
}

pub(super) fn flags(it: &IncidentWords, incident: &Incident) -> Vec<&'static str> {
    let summary = &incident.summary;
    let all = [
        (summary.is_marked(), it.marked),
        (incident.kept, it.kept),
        (summary.storm, it.storm),
        (summary.recording.interrupted, it.interrupted),
        (summary.recording.gone, it.gone),
        (summary.until_ms.is_some() && !summary.recording.finished, it.unfinished),
    ];
    all.into_iter().filter(|(is_so, _)| *is_so).map(|(_, word)| word).collect()
}

/// The size of the recordings, and how long their share of the disk lasts if every day is as this one.
fn on_disk_words(lang: Lang, on_disk: OnDisk, policy: Option<Policy>) -> String {
    let OnDisk { count, bytes, bytes_since } = on_disk;
    let disk = policy.map(|policy| lang.size(policy.disk));
    let taken = lang.on_disk(disk.as_deref(), count, &lang.size(bytes));
    let Some(policy) = policy else { return taken };
    let keep_days = policy.keep.as_nanos() / (DAY_MS as u64 * 1_000_000);
    let days = policy.disk.saturating_sub(bytes).checked_div(bytes_since);
    let rate = lang.disk_lasts(days, keep_days, &lang.size(bytes_since));
    format!("{taken} {rate}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_disk_lasts_as_long_as_the_day_says() {
        let policy = Some(Policy::default());
        let says =
            |bytes, bytes_since| on_disk_words(Lang::En, OnDisk { count: 2, bytes, bytes_since }, policy);
        for (bytes, since, end) in [
            (0, 0, "of 10.0 GB on the disk. Nothing in the last 24 hours."),
            (5_000_000_000, 500_000_000, "room for 10 more days."),
            (5_000_000_000, 1_000_000, "room for all 30 days that recordings are kept."),
            (9_900_000_000, 1_000_000_000, "the oldest go within a day."),
            (11_000_000_000, 1_000_000_000, "the oldest go within a day."),
        ] {
            assert!(says(bytes, since).ends_with(end), "{}", says(bytes, since));
        }
        assert_eq!(on_disk_words(Lang::En, OnDisk::default(), None), "0 recorded: 0 B on the disk.");
    }
}
