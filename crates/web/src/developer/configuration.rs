//! The page of the configuration: the differences between the file and the running configuration, the
//! button that takes the file, and the running configuration as it was read.

use askama::Template;

use axum::extract::State;
use axum::response::Html;
use tokio::sync::oneshot;

use crate::AppState;
use crate::texts::{HttpError, MESSAGE, NAME, clean, clean_lines};
use telltale_store::Role;

use super::request::PageRequest;
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_runtime::Published;
use telltale_runtime::Reread;
use telltale_runtime::{ConfigurationText, Rereading};

use super::page_query::address;
use super::pager::Pager;
use super::{DevFrame, Page, PageQuery};

/// Lines of one page.
pub(super) const LINES: usize = 100;
const LETTERS: usize = 400;
/// The page asks again until the file is judged.
const RENEW_MS: u32 = 1000;

struct NumberedLine {
    number: usize,
    text: String,
}

/// One of the files.
struct FileLink {
    name: String,
    address: String,
    chosen: bool,
}

#[derive(Template)]
#[template(path = "developer/configuration.html")]
struct ConfigurationHtml {
    frame: PageFrame,
    dev: DevFrame,
    taken: bool,
    differences: Vec<String>,
    problems: Option<String>,
    warnings: Option<String>,
    judged: bool,
    /// The reader may take the file.
    may_take: bool,
    /// The files have changed since they were shown, so they were not taken.
    is_other: bool,
    /// The digest of the files that are shown, for the button.
    shown: String,
    filter: String,
    kept: Vec<(&'static str, String)>,
    files: Vec<FileLink>,
    pager: Pager,
    lines: Vec<NumberedLine>,
}

/// `GET /developer/configuration?q=TEXT&file=NUMBER&page=N`
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Result<Html<String>, HttpError> {
    let read = reread(&app, false, None).await?;
    let offer = (request.session.role == Role::Developer).then_some(false);
    Ok(Html(page(&request.published, &read, offer, &request.context, &request.query)))
}

/// `offer` is `Some` for users who may take the files, and true if the files have changed since they were shown.
pub fn page(
    published: &Published,
    read: &Rereading,
    offer: Option<bool>,
    context: &PageContext,
    query: &PageQuery,
) -> String {
    let view = &View::new(published, context.lang, false);
    let mut dev = DevFrame::new(view, context, Page::Configuration, RENEW_MS);
    // The file is no diagnosis: it may be mended before anybody logs in.
    dev.locked = false;
    dev.fixed = read.judged;
    let whole = |text: &Option<String>| text.as_deref().map(clean_lines);
    let chosen = (query.number("file").unwrap_or(0) as usize).min(read.running.len().saturating_sub(1));
    let file = |(index, file): (usize, &ConfigurationText)| FileLink {
        name: clean(&file.name, 2 * NAME),
        address: address([("file", &*index.to_string())].into_iter()),
        chosen: index == chosen,
    };
    let (pager, lines) = lines(read.running.get(chosen), query);
    html(&ConfigurationHtml {
        frame: super::frame(context),
        dev,
        taken: read.taken,
        differences: read.differences.iter().map(|text| clean(text, 4 * MESSAGE)).collect(),
        problems: whole(&read.problems),
        warnings: whole(&read.warnings),
        judged: read.judged,
        may_take: offer.is_some(),
        is_other: offer == Some(true),
        shown: read.digest.clone(),
        filter: clean(query.get("q"), MESSAGE),
        kept: query.kept(&["file"]),
        files: read.running.iter().enumerate().map(file).collect(),
        pager,
        lines,
    })
}

/// The lines that the filter leaves, with their numbers in the file.
fn lines(file: Option<&ConfigurationText>, query: &PageQuery) -> (Pager, Vec<NumberedLine>) {
    let filter = query.get("q").to_lowercase();
    let all = file.map_or("", |file| &*file.text).lines().enumerate();
    let wanted = |text: &str| filter.is_empty() || text.to_lowercase().contains(&filter);
    let found: Vec<(usize, &str)> = all.filter(|(_, text)| wanted(text)).collect();
    let (pager, shown) = Pager::of(query, "matching", "page", found.len(), LINES);
    let line = |&(index, text): &(usize, &str)| {
        let kept: String = text.chars().take(LETTERS).collect();
        NumberedLine { number: index + 1, text: clean_lines(&kept) }
    };
    (pager, found[shown].iter().map(line).collect())
}

pub async fn reread(app: &AppState, take: bool, shown: Option<String>) -> Result<Rereading, HttpError> {
    let rereads = app.settings.rereads.as_ref().ok_or(HttpError::NotFound)?;
    let (reply, answer) = oneshot::channel();
    rereads.send(Reread { take, shown, reply }).await.map_err(|_| HttpError::Unavailable)?;
    answer.await.map_err(|_| HttpError::Unavailable)
}
