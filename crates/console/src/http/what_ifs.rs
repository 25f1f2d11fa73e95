//! What-ifs over groups of incidents: an engineer gives a configuration, and all who have the link see the result.

use askama::Template;
use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use telltale_fleet::message::VehicleId;
use telltale_record::ring::ConfigurationText;
use telltale_record::writer::digest;
use telltale_store::Role;
use telltale_store::audit::{Action, Record};
use telltale_web::common::{
    Asked, CameFrom, FormOf, Format, JudgedRow, PageFrame, Reader, Speaks, Table, bad_field, json_answer,
    sent_configuration,
};
use telltale_web::describe::words;
use telltale_web::incidents::{Mistake, texts_in};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, ID, IncidentWords, Lang, MESSAGE, NAME, address, clean};

use super::answers::{TableAsked, group, group_words};
use super::page::rendered;
use super::view::{SeenWhatIfs, View};
use crate::state::incidents::{GroupBy, IncidentRow, sort};
use crate::state::time;
use crate::what_ifs::{Judged, Progress, WhatIf};

/// Incidents that are named as not fetched, and differences of meaning that are listed.
const NOT_FETCHED_MAX: usize = 20;
const DIFFERENCES_MAX: usize = 50;

/// A what-if in one line.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "WhatIf")]
pub struct Line {
    pub number: u64,
    /// The kind of the group: `cause`, `version` or `config`. `of` names the group.
    pub group: &'static str,
    pub of: String,
    pub who: String,
    #[schemars(schema_with = "words::time")]
    pub began: String,
    /// `waiting`, `running`, `wrong`, `done`, `cancelled` or `ended`.
    pub progress: &'static str,
    /// The SHA-256 of the configuration.
    pub config: String,
    /// Incidents of the group, those with a recording at the console, and those of them that are judged.
    pub incidents: usize,
    pub fetched: usize,
    pub chosen: usize,
    /// Judged so far; of these with a difference, without one, and unreadable.
    pub judged: usize,
    pub differs: usize,
    pub same: usize,
    pub unread: usize,
    /// For people.
    #[serde(skip)]
    pub name: String,
    #[serde(skip)]
    pub so_far: String,
}

impl Line {
    pub fn of(it: &WhatIf, lang: Lang) -> Line {
        let (words, of_incidents) = (ConsoleWords::of(lang), IncidentWords::of(lang));
        let more = match it.progress {
            Progress::Waiting => of_incidents.waiting,
            Progress::Wrong(_) => of_incidents.wrong,
            Progress::Cancelled => words.cancelled,
            Progress::Ended => words.ended,
            Progress::Running | Progress::Done => "",
        };
        let so_far = lang.judged_so_far(it.judged.len(), it.chosen.len());
        let [differs, same, unread] = ["differs", "same", "unread"].map(|result| it.count(result));
        Line {
            number: it.number,
            group: it.by.as_str(),
            of: it.group.clone(),
            who: it.who.clone(),
            began: time(it.began_ms),
            progress: it.progress.word(),
            config: it.config.clone(),
            incidents: it.incidents,
            fetched: it.fetched,
            chosen: it.chosen.len(),
            judged: it.judged.len(),
            differs,
            same,
            unread,
            name: group_name(it.by, &it.group, lang),
            so_far: format!("{so_far} {more}").trim_end().to_owned(),
        }
    }
}

/// The result, for programs.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "WhatIfResult")]
pub struct Answer {
    #[serde(flatten)]
    line: Line,
    /// The differences in meaning from the configuration of the first recording that was judged.
    differences: Vec<String>,
    /// The mistakes of the configuration, each with its place.
    problems: Vec<String>,
    rows: Vec<AnswerRow>,
}

/// A recording that was judged.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "WhatIfRow")]
struct AnswerRow {
    vehicle: String,
    incident: u64,
    #[schemars(schema_with = "words::time")]
    since: String,
    /// `differs`, `same` or `unread`.
    result: &'static str,
    /// The first difference: when, how long after the beginning, and in what.
    #[schemars(schema_with = "words::some_time")]
    at: Option<String>,
    after: String,
    what: String,
    /// For people, in the language of `Accept-Language`.
    recorded: String,
    new: String,
    alarms_new: String,
    alarms_gone: String,
    /// Why it could not be judged.
    why: String,
}

impl AnswerRow {
    fn of(judged: &Judged, lang: Lang) -> AnswerRow {
        let JudgedRow { first, trouble, alarms_new, alarms_gone, .. } = judged.row(lang).clone();
        let (at, [after, what, recorded, new]) = match first {
            Some(it) => (Some(time(it.at_ms)), [it.after, it.what, it.was, it.is]),
            None => Default::default(),
        };
        AnswerRow {
            vehicle: judged.of.vehicle.clone(),
            incident: judged.of.number,
            since: judged.of.since.clone(),
            result: judged.result(),
            at,
            after,
            what,
            recorded,
            new,
            alarms_new,
            alarms_gone,
            why: trouble.unwrap_or_default(),
        }
    }
}

/// What incidents have in common, for people.
pub fn group_name(by: GroupBy, group: &str, lang: Lang) -> String {
    match by {
        GroupBy::Cause if group.is_empty() => ConsoleWords::of(lang).no_cause.to_owned(),
        GroupBy::Config => group.chars().take(12).collect(),
        _ => group.to_owned(),
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormAsked {
    #[serde(default, deserialize_with = "group")]
    group: GroupBy,
    #[serde(default)]
    of: String,
    /// The number of a what-if with the text to begin with.
    from: Option<u64>,
}

#[derive(Template)]
#[template(path = "console/what_if_form.html")]
struct FormHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    it: &'static IncidentWords,
    user: String,
    by: &'static str,
    group: String,
    name: String,
    counted: String,
    only_newest: Option<String>,
    is_any_fetched: bool,
    not_fetched: Vec<IncidentRow>,
    more: Option<String>,
    texts: Vec<ConfigurationText>,
}

/// The fields of the form. `name` and `text` may be there for each of several files, the main one first.
#[derive(JsonSchema)]
#[allow(dead_code, reason = "for the description")]
pub struct StartForm {
    #[schemars(schema_with = "group_words")]
    group: String,
    /// Which cause, version or configuration.
    of: String,
    name: String,
    text: String,
}

#[derive(Template)]
#[template(path = "console/what_if.html")]
struct PageHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    user: String,
    state: StateHtml,
    texts: Vec<ConfigurationText>,
}

#[derive(Template)]
#[template(path = "console/what_if_state.html")]
struct StateHtml {
    words: &'static ConsoleWords,
    it: &'static IncidentWords,
    line: Line,
    is_open: bool,
    /// Engineers may start and cancel.
    is_engineer: bool,
    frame_id: String,
    counted: String,
    only_newest: Option<String>,
    mistakes: Vec<MistakeHtml>,
    differing: Vec<RowHtml>,
    unread: Vec<RowHtml>,
    same: Vec<RowHtml>,
    heads: [String; 3],
    /// The recording with the configuration that it is compared with.
    compared_with: String,
    differences: Vec<String>,
    more: Option<String>,
    /// Where it is begun again.
    again: String,
}

struct MistakeHtml {
    place: String,
    /// The line of the text.
    line: String,
    message: String,
    help: String,
}

struct RowHtml {
    vehicle: String,
    number: u64,
    since: String,
    at: Option<String>,
    row: JudgedRow,
    /// The figures that differ.
    figures: String,
}

impl RowHtml {
    fn of(judged: &Judged, lang: Lang) -> RowHtml {
        let (row, it) = (judged.row(lang).clone(), IncidentWords::of(lang));
        let heads = [it.alarms, it.masked, it.requests, it.transitions, it.to_root];
        let figures = heads.iter().zip(&row.cells).filter(|(_, cell)| cell.differs());
        let figures = figures.map(|(head, cell)| format!("{head} {} \u{2192} {}", cell.was, cell.is));
        RowHtml {
            vehicle: judged.of.vehicle.clone(),
            number: judged.of.number,
            since: judged.of.since.clone(),
            at: row.first.as_ref().map(|it| time(it.at_ms)),
            figures: figures.collect::<Vec<_>>().join(", "),
            row,
        }
    }
}

/// The mistake, in the place where the text has it.
fn mistake(mistake: &Mistake, texts: &[ConfigurationText]) -> MistakeHtml {
    let text = texts.iter().find(|it| it.name == mistake.file).map_or("", |it| &it.text);
    let of_text = mistake.line.and_then(|line| text.lines().nth(line.checked_sub(1)?)).unwrap_or_default();
    MistakeHtml {
        place: clean(&mistake.place(), 2 * NAME),
        line: clean(of_text.trim(), MESSAGE),
        message: clean(&mistake.message, 4 * MESSAGE),
        help: clean(&mistake.help, 4 * MESSAGE),
    }
}

impl View {
    /// The incidents of a group that may be judged again, the newest first. A guest gets the incidents of vehicles where it is
    /// an engineer.
    fn incidents_of(&self, by: GroupBy, group: &str) -> Vec<IncidentRow> {
        let mut rows = self.fleet().incidents();
        let may = |it: &IncidentRow| !self.session.is_of_guest() || self.may(Role::Engineer, &it.vehicle);
        rows.retain(|it| by.key(it) == group && may(it));
        sort(&mut rows);
        rows
    }

    /// Refuses all but engineers, and records that.
    async fn for_engineers(&self, may: bool, record: &Record) -> Result<(), HttpError> {
        if may {
            return Ok(());
        }
        self.console.store.record(record.clone().refused("the role does not permit it"), None).await;
        Err(HttpError::Forbidden)
    }
}

/// The address of the form for a what-if over a group.
pub fn form_address(by: GroupBy, group: &str) -> String {
    format!("/incidents/what-if?group={}&of={}", by.as_str(), address(group))
}

fn only_newest(chosen: usize, fetched: usize, lang: Lang) -> Option<String> {
    (chosen < fetched).then(|| lang.newest_judged(chosen, fetched))
}

/// `GET /incidents/what-if?group=cause&of=NAME&from=NUMBER`: the recordings, and the configuration to change.
pub async fn form(
    view: View,
    Asked(FormAsked { group: by, of, from }): Asked<FormAsked>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let what_ifs = view.what_ifs()?;
    let incidents = view.incidents_of(by, &of);
    let (lang, planned) = (reader.lang, WhatIf::over(by, &of, &incidents, ""));
    if !what_ifs.may_run(&planned) {
        return Err(HttpError::Forbidden);
    }
    if incidents.is_empty() {
        return Err(HttpError::NotFound);
    }
    let sent = from.and_then(|number| what_ifs.with(&number.to_string(), |it| it.texts.clone()).ok());
    let newest = planned.chosen.first();
    let newest = newest.and_then(|it| VehicleId::new(&it.vehicle).map(|id| (id, it.number)));
    let texts = match (sent, newest) {
        (Some(texts), _) => texts,
        (None, Some((id, number))) => texts_in(view.recording(&id, number)?).await,
        (None, None) => Vec::new(),
    };
    let empty = || vec![ConfigurationText { name: "vehicle.yaml".to_owned(), text: String::new() }];
    let missing = planned.incidents - planned.fetched;
    let more = missing.saturating_sub(NOT_FETCHED_MAX);
    Ok(rendered(&FormHtml {
        frame: PageFrame::new(lang, reader.palette),
        words: ConsoleWords::of(lang),
        it: IncidentWords::of(lang),
        user: view.session.user.to_string(),
        by: by.as_str(),
        name: group_name(by, &of, lang),
        group: of,
        counted: lang.so_many_not_fetched(missing, planned.incidents),
        only_newest: only_newest(planned.chosen.len(), planned.fetched, lang),
        is_any_fetched: planned.fetched > 0,
        not_fetched: incidents.into_iter().filter(|it| !it.is_fetched).take(NOT_FETCHED_MAX).collect(),
        more: (more > 0).then(|| lang.so_many_more(more)),
        texts: if texts.is_empty() { empty() } else { texts },
    }))
}

/// `POST /incidents/what-if`: starts one.
pub async fn start(
    view: View,
    CameFrom(source): CameFrom,
    reader: Reader,
    FormOf(fields): FormOf<Vec<(String, String)>>,
) -> Result<Response, HttpError> {
    let what_ifs = view.what_ifs()?;
    let field = |key| fields.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str());
    let (Some(by), Some(of)) = (field("group").and_then(GroupBy::from_word), field("of")) else {
        return Ok(bad_field(&reader, "group, of"));
    };
    let texts = match sent_configuration(&reader, &fields) {
        Ok(texts) => texts,
        Err(refusal) => return Ok(refusal),
    };
    let what_if = WhatIf::over(by, of, &view.incidents_of(by, of), &view.session.user);
    let said = format!(
        "{} {}, {} recordings, sha256:{}",
        by.as_str(),
        clean(of, ID),
        what_if.chosen.len(),
        digest(&texts)
    );
    let record = Record::of_session(&view.session, Action::WhatIfStarted, source).on(said);
    view.for_engineers(what_ifs.may_run(&what_if), &record).await?;
    match () {
        () if what_if.incidents == 0 => return Err(HttpError::NotFound),
        () if what_if.chosen.is_empty() => return Err(HttpError::NoneFetched),
        () if !what_ifs.has_room() => return Err(HttpError::StillJudging),
        () if !view.console.store.record(record, None).await => return Err(HttpError::Storage),
        () => {}
    }
    // Others may have started meanwhile.
    let number = what_ifs.start(WhatIf { texts, ..what_if }).await.ok_or(HttpError::StillJudging)?;
    Ok(match reader.speaks {
        Speaks::Json => json_answer(StatusCode::ACCEPTED, &json!({ "number": number })),
        Speaks::Html => Redirect::to(&format!("/what-ifs/{number}")).into_response(),
    })
}

/// `POST /what-ifs/NUMBER/cancel`
pub async fn cancel(
    view: View,
    CameFrom(source): CameFrom,
    Path(number): Path<String>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let what_ifs = view.what_ifs()?;
    let about = |it: &WhatIf| (it.number, it.is_open(), what_ifs.may_run(it));
    let (number, is_open, may) = what_ifs.with(&number, about)?;
    let record =
        Record::of_session(&view.session, Action::WhatIfCancelled, source).on(format!("what-if {number}"));
    view.for_engineers(may, &record).await?;
    if is_open {
        if !view.console.store.record(record, None).await {
            return Err(HttpError::Storage);
        }
        what_ifs.cancel(number).await;
    }
    Ok(match reader.speaks {
        Speaks::Json => json_answer(StatusCode::ACCEPTED, &json!({})),
        Speaks::Html => Redirect::to(&format!("/what-ifs/{number}")).into_response(),
    })
}

/// `GET /what-ifs/NUMBER`: the result so far.
pub async fn page(view: View, Path(number): Path<String>, reader: Reader) -> Result<Response, HttpError> {
    let (lang, user) = (reader.lang, view.session.user.to_string());
    let frame = PageFrame::new(lang, reader.palette);
    let what_ifs = view.what_ifs()?;
    let of = |it: &WhatIf| (state_of(it, &what_ifs, lang), it.texts.clone());
    let (state, texts) = what_ifs.with(&number, of)?;
    Ok(rendered(&PageHtml { frame, words: ConsoleWords::of(lang), user, state, texts }))
}

/// `GET /what-ifs/NUMBER/state`: the part of the page that changes.
pub async fn state(view: View, Path(number): Path<String>, reader: Reader) -> Result<Response, HttpError> {
    let what_ifs = view.what_ifs()?;
    Ok(rendered(&what_ifs.with(&number, |it| state_of(it, &what_ifs, reader.lang))?))
}

fn state_of(what_if: &WhatIf, what_ifs: &SeenWhatIfs<'_>, lang: Lang) -> StateHtml {
    let line = Line::of(what_if, lang);
    let rows = |result| {
        let rows = what_if.judged.iter().filter(|it| it.result() == result);
        rows.map(|it| RowHtml::of(it, lang)).collect::<Vec<_>>()
    };
    let mistakes = match &what_if.progress {
        Progress::Wrong(mistakes) => mistakes.iter().map(|it| mistake(it, &what_if.texts)).collect(),
        _ => Vec::new(),
    };
    let compared = what_if.judged.iter().find(|it| it.result() != "unread").map(|it| &it.of);
    let differences = what_if.differences.iter().take(DIFFERENCES_MAX);
    let more = what_if.differences.len().saturating_sub(DIFFERENCES_MAX);
    StateHtml {
        words: ConsoleWords::of(lang),
        it: IncidentWords::of(lang),
        is_open: what_if.is_open(),
        is_engineer: what_ifs.may_run(what_if),
        frame_id: telltale_web::assets::url(lang.as_str()),
        counted: lang.so_many_not_fetched(line.incidents - line.fetched, line.incidents),
        only_newest: only_newest(line.chosen, line.fetched, lang),
        mistakes,
        differing: rows("differs"),
        unread: rows("unread"),
        same: rows("same"),
        heads: [
            lang.so_many_differ(line.differs),
            lang.so_many_unread(line.unread),
            lang.so_many_same(line.same),
        ],
        compared_with: compared.map(|it| format!("{} · {}", it.vehicle, it.number)).unwrap_or_default(),
        differences: differences.map(|it| clean(it, 4 * MESSAGE)).collect(),
        more: (more > 0).then(|| lang.so_many_more(more)),
        again: format!("{}&from={}", form_address(what_if.by, &what_if.group), line.number),
        line,
    }
}

/// `GET /api/v1/what-ifs?format`: all that are kept, the newest first.
pub async fn all(
    view: View,
    Asked(asked): Asked<TableAsked>,
    reader: Reader,
    headers: HeaderMap,
) -> Response {
    let rows: Vec<Line> =
        view.what_ifs().iter().flat_map(|it| it.each(|it| Line::of(it, reader.lang))).collect();
    let columns = &[
        "number",
        "group",
        "of",
        "who",
        "began",
        "progress",
        "config",
        "incidents",
        "fetched",
        "chosen",
        "judged",
        "differs",
        "same",
        "unread",
    ];
    let table = Table { name: "what-ifs", columns, rows: &rows, next: None };
    table.answer(Format::of(asked.format, &headers), &rows)
}

/// `GET /api/v1/what-ifs/NUMBER?format`: the result so far; a CSV has the rows alone.
pub async fn one(
    view: View,
    Path(number): Path<String>,
    Asked(asked): Asked<TableAsked>,
    reader: Reader,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let answer = view.what_ifs()?.with(&number, |it| Answer {
        line: Line::of(it, reader.lang),
        differences: it.differences.clone(),
        problems: match &it.progress {
            Progress::Wrong(mistakes) => {
                mistakes.iter().map(|problem| sentence(problem, &it.texts)).collect()
            }
            _ => Vec::new(),
        },
        rows: it.judged.iter().map(|it| AnswerRow::of(it, reader.lang)).collect(),
    })?;
    let columns = &[
        "vehicle",
        "incident",
        "since",
        "result",
        "at",
        "after",
        "what",
        "recorded",
        "new",
        "alarms_new",
        "alarms_gone",
        "why",
    ];
    let table = Table { name: "what-if", columns, rows: &answer.rows, next: None };
    Ok(table.answer(Format::of(asked.format, &headers), &answer))
}

fn sentence(problem: &Mistake, texts: &[ConfigurationText]) -> String {
    let MistakeHtml { place, message, help, .. } = mistake(problem, texts);
    [format!("{place}: {message}"), help].join(" ").trim_end().to_owned()
}
