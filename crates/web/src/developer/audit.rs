//! The page of the audit log, with whether its chain is whole.

use std::borrow::Cow;

use askama::Template;

use axum::extract::State;
use axum::response::{Html, IntoResponse, Response};
use tokio::sync::{Mutex, MutexGuard};

use crate::AppState;
use crate::http::errors::HttpError;
use crate::http::respond::refusal;
use telltale_store::StoreError;

use super::pager::ROWS_MAX;
use super::request::PageRequest;
use telltale_runtime::Published;
use telltale_store::audit::Entry;
use telltale_store::{Acknowledged, Verdict};

use crate::view::page::frame::PageFrame;
use crate::view::text::{MESSAGE, NAME, clean};
use crate::view::{Lang, PageContext, View, html};

use super::{DevFrame, Page};

/// What the page shows.
#[derive(Debug, Clone)]
pub struct AuditPage {
    /// The newest first.
    pub entries: Vec<Entry>,
    /// The number before which the next page begins, if there is one.
    pub older: Option<u64>,
    pub verdict: Verdict,
}

struct RecordRow {
    number: u64,
    at: String,
    who: String,
    role: String,
    source: String,
    action: String,
    target: String,
    outcome: String,
    refused: bool,
}

#[derive(Template)]
#[template(path = "developer/audit.html")]
struct AuditHtml {
    frame: PageFrame,
    dev: DevFrame,
    heads: [&'static str; 7],
    is_whole: bool,
    verdict: String,
    head: String,
    rows: Vec<RecordRow>,
    older: Option<u64>,
    older_word: &'static str,
}

/// Records on one page of the audit log.
const AUDIT_ROWS: u32 = 100;

/// One reader of the audit log at a time, because verifying a long chain takes a while.
#[derive(Debug, Default)]
pub struct AuditReading(Mutex<()>);

impl AuditReading {
    pub async fn turn(&self) -> MutexGuard<'_, ()> {
        self.0.lock().await
    }
}

/// `GET /developer/audit?before=NUMBER`: the audit log, newest first, and whether its chain is whole.
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Response {
    let before = request.query.get("before");
    if !before.is_empty() && request.query.number("before").is_none() {
        return refusal(&request.reader, HttpError::NotFound);
    }
    let (before, count) = match request.query.wants_all_rows() {
        true => (None, ROWS_MAX as u32),
        false => (request.query.number("before"), AUDIT_ROWS),
    };
    let _reader = app.audit_reading.turn().await;
    let read = async {
        let entries = app.store.audit_entries(before, count).await?;
        Ok::<_, StoreError>((entries, app.store.verify_audit().await?))
    };
    let (entries, verdict) = match read.await {
        Ok(read) => read,
        Err(error) => {
            tracing::error!(%error, "the audit log cannot be read");
            return refusal(&request.reader, HttpError::Unavailable);
        }
    };
    let is_full = entries.len() == count as usize;
    let older = entries.last().filter(|last| is_full && last.number > 1).map(|last| last.number);
    let audit = AuditPage { entries, older, verdict };
    Html(page(&request.published, &audit, &request.context)).into_response()
}

pub fn page(published: &Published, page: &AuditPage, context: &PageContext) -> String {
    let view = &View::new(published, context.lang, false);
    let mut dev = DevFrame::new(view, context, Page::Audit, 0);
    // Verifying the chain takes a while, so the page does not ask again by itself. The log is no diagnosis, so it is shown while the vehicle is locked.
    dev.fixed = true;
    dev.locked = false;
    let (heads, older_word) = match context.lang {
        Lang::En => (["No.", "Time", "Who", "From", "What", "On what", "Outcome"], "Older records"),
        Lang::De => (["Nr.", "Zeit", "Wer", "Woher", "Was", "Woran", "Ergebnis"], "Ältere Einträge"),
    };
    let rows = page.entries.iter().map(|entry| RecordRow {
        number: entry.number,
        at: humantime::format_rfc3339_millis(entry.at()).to_string(),
        who: clean(&entry.who, NAME),
        role: clean(word(&entry.role, context.lang), NAME),
        source: clean(word(&entry.source, context.lang), NAME),
        action: clean(word(&entry.action, context.lang), NAME),
        target: clean(&entry.target, MESSAGE),
        outcome: clean(&outcome(&entry.outcome, context.lang), MESSAGE),
        refused: entry.was_refused(),
    });
    html(&AuditHtml {
        frame: super::frame(context),
        dev,
        heads,
        is_whole: page.verdict.breach.is_none(),
        verdict: verdict(&page.verdict, context.lang),
        head: page.verdict.head.to_string(),
        rows: rows.collect(),
        older: page.older,
        older_word,
    })
}

/// A word of the log in the reader's language; an unknown one stays as it was written.
fn word(written: &str, lang: Lang) -> &str {
    if lang == Lang::En {
        return written;
    }
    match written {
        "operator" => "Fahrbegleitung",
        "developer" => "Entwicklung",
        "authority" => "Aufsicht",
        "command line" => "Kommandozeile",
        "done" => "ausgeführt",
        "start" => "Start",
        "end" => "Ende",
        "login" => "Anmeldung",
        "logout" => "Abmeldung",
        "session ended" => "Sitzung beendet",
        "hand-over" => "Übernahme",
        "request" => "Anfrage",
        "localize" => "Positionsangabe",
        "clearance asked" => "Freigabe angefragt",
        "clearance" => "Freigabe",
        "clearance withdrawn" => "Freigabe widerrufen",
        "release asked" => "Weiterfahrt angefragt",
        "release" => "Weiterfahrt",
        "stop" => "Anhalten",
        "acknowledge" => "Quittierung",
        "acknowledge over" => "Quittierung aller behobenen",
        "reset" => "Zurücksetzen",
        "stage" => "Phase",
        "countermeasure" => "Gegenmaßnahme",
        "configuration" => "Konfiguration",
        "demo fault" => "Demo-Fehler",
        "session elsewhere" => "Sitzung von anderer Adresse",
        "user added" => "Benutzer angelegt",
        "user secret" => "Zugangsgeheimnis geändert",
        "user role" => "Rolle geändert",
        "user removed" => "Benutzer entfernt",
        "user kept" => "Benutzer übernommen",
        "foreign users" => "Fremde Benutzer gefunden",
        "token added" => "Token angelegt",
        "token revoked" => "Token entzogen",
        "token kept" => "Token übernommen",
        "mark" => "Markierung",
        "incident recorded" => "Vorfall aufgezeichnet",
        "incident found" => "Vorfall wiedergefunden",
        "incident note" => "Notiz zu einem Vorfall",
        "incident kept" => "Vorfall aufbewahrt",
        "incident removed" => "Vorfall entfernt",
        "omitted" => "ausgelassen",
        "pruned" => "Älteste entfernt",
        "log keyed" => "Schlüssel eingeführt",
        "breach acknowledged" => "Bruch zur Kenntnis genommen",
        "chain broken" => "Kette beschädigt",
        "data repaired" => "Datenbank repariert",
        "data restored" => "Sicherung eingespielt",
        "head missing" => "Kettenende fehlt",
        other => other,
    }
}

/// Why something was refused stays as it was written.
fn outcome(written: &str, lang: Lang) -> Cow<'_, str> {
    match (lang, written.strip_prefix("refused: ")) {
        (Lang::De, Some(why)) => format!("abgelehnt: {why}").into(),
        _ => word(written, lang).into(),
    }
}

fn verdict(verdict: &Verdict, lang: Lang) -> String {
    let mut said = match (&verdict.breach, lang) {
        (None, Lang::En) if verdict.records == 1 => "The one record is as it was written.".to_owned(),
        (None, Lang::De) if verdict.records == 1 => "Der eine Eintrag ist unverändert.".to_owned(),
        (None, Lang::En) => format!("All {} records are as they were written.", verdict.records),
        (None, Lang::De) => format!("Alle {} Einträge sind unverändert.", verdict.records),
        (Some(breach), Lang::En) => format!("Record {} {}.", breach.number, clean(&breach.what, MESSAGE)),
        (Some(breach), Lang::De) => {
            format!("Die Kette ist beschädigt. Eintrag {}: {}.", breach.number, clean(&breach.what, MESSAGE))
        }
    };
    if let (more @ 1.., lang) = (verdict.breaches.saturating_sub(1), lang) {
        said += &match lang {
            Lang::En => format!(" There are {more} more such places."),
            Lang::De => format!(" Es gibt {more} weitere solche Stellen."),
        };
    }
    if let Some(Acknowledged { number, by, count, .. }) = &verdict.acknowledged {
        let by = clean(by, NAME);
        said += &match lang {
            Lang::En => format!(" {by} has acknowledged {count} earlier ones, in record {number}."),
            Lang::De => format!(" {by} hat {count} frühere zur Kenntnis genommen, in Eintrag {number}."),
        };
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_store::Role;
    use telltale_store::audit::{Action, COMMAND_LINE};

    #[test]
    fn what_a_record_says_by_itself_has_german_words() {
        let actions = Action::ALL.iter().map(|action| action.as_str());
        let roles = Role::ALL.iter().map(|role| role.as_str());
        for written in actions.chain(roles).chain([COMMAND_LINE, "done"]) {
            assert_eq!(word(written, Lang::En), written);
            assert!(word(written, Lang::De) != written, "{written}");
        }
        assert_eq!(outcome("refused: why", Lang::De), "abgelehnt: why");
    }
}
