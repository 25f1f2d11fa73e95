//! The page of the audit log, with whether its chain is whole.

use askama::Template;

use axum::extract::State;
use axum::response::Html;
use tokio::sync::{Mutex, MutexGuard};

use crate::AppState;
use crate::texts::{HttpError, Lang, MESSAGE, NAME, clean};
use telltale_store::StoreError;

use super::pager::ROWS_MAX;
use super::request::PageRequest;
use telltale_runtime::Published;
use telltale_store::audit::{Action, Entry};
use telltale_store::{Acknowledged, Verdict};

use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};

use super::{DevFrame, Page};
use crate::incidents::wall_time;

/// The content of the page.
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
    is_whole: bool,
    verdict: String,
    head: String,
    rows: Vec<RecordRow>,
    older: Option<u64>,
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
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Result<Html<String>, HttpError> {
    let before = request.query.get("before");
    if !before.is_empty() && request.query.number("before").is_none() {
        return Err(HttpError::NotFound);
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
            return Err(HttpError::Unavailable);
        }
    };
    let is_full = entries.len() == count as usize;
    let older = entries.last().filter(|last| is_full && last.number > 1).map(|last| last.number);
    let audit = AuditPage { entries, older, verdict };
    Ok(Html(page(&request.published, &audit, &request.context)))
}

pub fn page(published: &Published, page: &AuditPage, context: &PageContext) -> String {
    let view = &View::new(published, context.lang, false);
    let mut dev = DevFrame::new(view, context, Page::Audit, 0);
    // Verifying the chain takes a while, so the page does not ask again by itself. The log is no diagnosis, so it is shown while the vehicle is locked.
    dev.fixed = true;
    dev.locked = false;
    let rows = page.entries.iter().map(|entry| RecordRow {
        number: entry.number,
        at: wall_time(entry.at_ms),
        who: clean(&entry.who, NAME),
        role: clean(word(&entry.role, context.lang), NAME),
        source: clean(word(&entry.source, context.lang), NAME),
        action: clean(word(&entry.action, context.lang), NAME),
        target: clean(&target(&entry.action, &entry.target, context.lang), MESSAGE),
        outcome: clean(&outcome(&entry.outcome, context.lang), MESSAGE),
        refused: entry.was_refused(),
    });
    html(&AuditHtml {
        frame: super::frame(context),
        dev,
        is_whole: page.verdict.breach.is_none(),
        verdict: verdict(&page.verdict, context.lang),
        head: page.verdict.head.to_string(),
        rows: rows.collect(),
        older: page.older,
    })
}

/// A word of the log in the reader's language; an unknown one stays as it was written.
fn word(written: &str, lang: Lang) -> &str {
    lang.of_audit(written).unwrap_or(written)
}

/// A stage, and Telltale's own words of a countermeasure, `decelerate: requested, because of NODES`, in this language. All
/// others stay as they are.
fn target(action: &str, written: &str, lang: Lang) -> String {
    if action == Action::Stage.as_str() {
        return word(written, lang).to_owned();
    }
    let parts = written.split_once(": ").filter(|_| action == Action::Countermeasure.as_str());
    let Some((request, rest)) = parts else { return written.to_owned() };
    let (how, because) =
        rest.split_once(", because of ").map_or((rest, None), |(how, names)| (how, Some(names)));
    let operator = word("the operator", lang);
    let because = because
        .map(|names| lang.because_of(&names.replacen("the operator", operator, 1)))
        .unwrap_or_default();
    format!("{}: {}{because}", word(request, lang), word(how, lang))
}

/// Why something was refused stays as it was written.
fn outcome(written: &str, lang: Lang) -> String {
    match written.strip_prefix("refused: ") {
        Some(why) => lang.refused_because(why),
        None => word(written, lang).to_owned(),
    }
}

fn verdict(verdict: &Verdict, lang: Lang) -> String {
    let mut said = match &verdict.breach {
        None => lang.whole_chain(verdict.records),
        Some(breach) => lang.broken_chain(breach.number, &clean(&breach.what, MESSAGE)),
    };
    if verdict.breaches > 1 {
        said += &lang.more_breaches(verdict.breaches - 1);
    }
    if let Some(Acknowledged { number, by, count, .. }) = &verdict.acknowledged {
        said += &lang.acknowledged_breaches(&clean(by, NAME), *count, *number);
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_store::Role;
    use telltale_store::audit::COMMAND_LINE;

    #[test]
    fn what_a_record_says_by_itself_has_german_words() {
        let actions = Action::ALL.iter().map(|action| action.as_str());
        let roles = Role::ALL.iter().map(|role| role.as_str());
        for written in actions.chain(roles).chain([COMMAND_LINE, "done"]) {
            assert_eq!(word(written, Lang::En), written);
            assert!(word(written, Lang::De) != written, "{written}");
        }
        assert_eq!(outcome("refused: why", Lang::De), "abgelehnt: why");
        let written = "maneuver_stop: requested, because of the operator, sensors/lidar";
        assert_eq!(target("countermeasure", written, Lang::En), written);
        let german = "Sicher anhalten: verlangt, wegen Fahrbegleitung, sensors/lidar";
        assert_eq!(target("countermeasure", written, Lang::De), german);
        assert_eq!(target("stage", "active", Lang::De), "autonom");
        assert_eq!(target("demo fault", "notify: true", Lang::De), "notify: true");
    }
}
