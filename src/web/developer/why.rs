//! The page that explains a node's state: each step from the report to the shown state, and the node's
//! messages.

use askama::Template;

use axum::extract;
use axum::response::{Html, IntoResponse, Response};

use crate::web::AppState;
use crate::web::http::errors::HttpError;
use crate::web::http::respond::refusal;

use super::request::PageRequest;
use crate::engine::model::NodeId;
use crate::engine::state::State;
use crate::engine::view::why::WhyStep;
use crate::runtime::Published;
use crate::web::view::page::frame::PageFrame;
use crate::web::view::text::{MESSAGE, NAME, clean};
use crate::web::view::trends::POINTS_WIDE;
use crate::web::view::{Lang, PageContext, Trends, View, html};

use super::{DevFrame, NodeLink, Page, ReportValue, report_values};

/// Nodes named in one step; a group may have thousands of members.
const NAMED: usize = 20;
const VALUES: usize = 64;
const RENEW_MS: u32 = 1000;

/// A sentence, and the nodes that it is about.
struct Explanation {
    text: String,
    nodes: Vec<NodeLink>,
    more: Option<String>,
}

#[derive(Template)]
#[template(path = "developer/why.html")]
struct WhyHtml {
    frame: PageFrame,
    dev: DevFrame,
    node: String,
    state: &'static str,
    word: &'static str,
    since: String,
    message: String,
    hardware: String,
    class: String,
    steps: Vec<Explanation>,
    paths: Vec<Vec<NodeLink>>,
    values: Vec<ReportValue>,
    members: Vec<(NodeLink, &'static str, &'static str)>,
    more_members: Option<String>,
    /// Where the page of the timeline shows this node.
    timeline: String,
}

/// `GET /developer/why?node=group/module`
pub async fn get(extract::State(app): extract::State<AppState>, request: PageRequest) -> Response {
    let Some(node) = request.published.snapshot.node(request.query.get("node")) else {
        return refusal(&request.reader, HttpError::NotFound);
    };
    Html(page(&request.published, node, &request.context, &app.trends)).into_response()
}

pub fn page(published: &Published, node: NodeId, context: &PageContext, trends: &Trends) -> String {
    let view = &View::new(published, context.lang, false);
    let snapshot = view.snapshot;
    let name = clean(snapshot.node_name(node), 2 * NAME);
    let link = |node: NodeId| NodeLink::of(view, node);
    let mut dev = DevFrame::new(view, context, Page::Statuses, RENEW_MS);
    dev.title = format!("{}: {name}", dev.words.why);
    let (state, _) = snapshot.shown(node);
    let steps = snapshot.why(node).into_iter().map(|step| {
        let (text, nodes) = explain(view, &step);
        let more = nodes.len().saturating_sub(NAMED);
        Explanation {
            text,
            nodes: nodes.into_iter().take(NAMED).map(link).collect(),
            more: (more > 0).then(|| view.lang.and_more(more)),
        }
    });
    let mut page = WhyHtml {
        state: state.as_str(),
        word: view.lang.state(state),
        since: String::new(),
        message: String::new(),
        hardware: String::new(),
        class: String::new(),
        steps: steps.collect(),
        paths: Vec::new(),
        values: Vec::new(),
        members: Vec::new(),
        more_members: None,
        timeline: format!(
            "/developer/timeline{}",
            super::page_query::address([("node", &**snapshot.node_name(node))].into_iter())
        ),
        node: name,
        frame: super::frame(context),
        dev,
    };
    match node {
        NodeId::Module(id) => {
            let (info, module) = snapshot.module(id);
            page.since = view.wall(module.since);
            page.message = view.message_text(module);
            page.hardware = clean(&module.report.hardware_id, NAME);
            page.class = super::statuses::class(info);
            let past = trends.of(id.0 as usize, &info.id, POINTS_WIDE);
            page.values = report_values(module, VALUES, MESSAGE, past);
        }
        NodeId::Group(id) => {
            let (info, group) = snapshot.group(id);
            page.since = view.wall(group.since);
            let paths = group.paths.iter().take(NAMED);
            page.paths = paths.map(|path| path.iter().map(|&node| link(node)).collect()).collect();
            let inner = info.groups.iter().map(|&id| NodeId::Group(id));
            let members = inner.chain(info.modules.iter().map(|&id| NodeId::Module(id)));
            let member = |node: NodeId| {
                let (state, _) = snapshot.shown(node);
                (link(node), state.as_str(), view.lang.state(state))
            };
            let count = info.groups.len() + info.modules.len();
            page.members = members.take(5 * NAMED).map(member).collect();
            page.more_members = (count > 5 * NAMED).then(|| view.lang.and_more(count - 5 * NAMED));
        }
    }
    html(&page)
}

fn explain(view: &View<'_>, step: &WhyStep) -> (String, Vec<NodeId>) {
    let lang = view.lang;
    let state = |state: State| lang.state(state).to_owned();
    let text = |en: &str, de: &str| match lang {
        Lang::En => en.to_owned(),
        Lang::De => de.to_owned(),
    };
    match step {
        WhyStep::OnlyFrom(writers) => {
            let only = text("It counts only from", "Es zählt nur von");
            (format!("{only} {}.", clean(&writers.join(", "), 2 * NAME)), Vec::new())
        }
        WhyStep::NeverReported => (text("It has never reported.", "Es hat sich nie gemeldet."), Vec::new()),
        WhyStep::Reported(is) => (format!("{}: {}", text("It reports", "Es meldet"), state(*is)), Vec::new()),
        WhyStep::Silent(is) => {
            let silent = text(
                "Nothing came for its timeout; it counts as",
                "Nichts kam innerhalb der Frist; es gilt als",
            );
            (format!("{silent}: {}", state(*is)), Vec::new())
        }
        WhyStep::Debounced(is) => {
            let still = text(
                "The change is too fresh; it still counts as",
                "Der Wechsel ist zu frisch; es gilt noch als",
            );
            (format!("{still}: {}", state(*is)), Vec::new())
        }
        WhyStep::Latched => (
            text("An error is held until it is reset.", "Ein Fehler wird bis zum Zurücksetzen festgehalten."),
            Vec::new(),
        ),
        WhyStep::Grace => {
            (text("It is given time to report.", "Es hat noch Zeit, sich zu melden."), Vec::new())
        }
        WhyStep::Members { own, responsible } => {
            let members =
                text("Its members make it, by themselves,", "Seine Teile ergeben, für sich genommen,");
            (format!("{members} {}", state(*own)), responsible.clone())
        }
        WhyStep::NotRelevant(because) => {
            let out = text("It does not matter now", "Es ist jetzt nicht wichtig");
            (format!("{out}: {}", lang.not_relevant(because, &view.snapshot.layout)), Vec::new())
        }
        WhyStep::Waits { holder, on } => {
            let needs = text("needs what fails or waits itself", "braucht, was ausfällt oder selbst wartet");
            (format!("{} {needs}", clean(view.snapshot.node_name(*holder), 2 * NAME)), vec![*on])
        }
        WhyStep::Masked { by } => {
            (text("It is put aside because of", "Es wird zurückgestellt wegen"), by.clone())
        }
        WhyStep::Shown(is) => (format!("{}: {}", text("It shows", "Es zeigt"), state(*is)), Vec::new()),
    }
}
