//! The page of a node: why it has its state, its states and values over time, its place in the configuration,
//! its neighbours and its incidents.

mod excerpt;
mod past;
mod plots;

use std::sync::Arc;

use askama::Template;

use axum::extract;
use axum::response::{Html, IntoResponse, Response};

use crate::AppState;
use crate::texts::{HttpError, MESSAGE, NAME, clean};

use super::request::PageRequest;
use crate::incidents::wall_time;
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, Trends, View, html};
use telltale_engine::input::{OperatorAction, Refusal};
use telltale_engine::model::{NodeId, Stage};
use telltale_engine::time::Span;
use telltale_engine::view::why::WhyStep;
use telltale_picture::bars::patterns;
use telltale_picture::graph::Drawing;
use telltale_runtime::{Published, Written};
use telltale_store::{Incident, IncidentFilter, Past, Resolution, Role, Trend, TrendQuery};

use super::incidents::list::length;
use super::page_query::address;
use super::timeline::strips::{Explained, legend};
use super::timeline::{SpanOption, Window, spans};
use super::{DevFrame, NodeLink, Page, PageQuery, graph};
use excerpt::{Excerpt, excerpt};
use past::{NodeStates, states};
use plots::{Plots, Second, plots, plots_of, resolution};

/// Nodes named in one step; a group may have thousands of members.
const NAMED: usize = 20;
const VALUES: usize = 64;
const INCIDENTS: u32 = 8;
/// The span of the strip if the address names none: as long as numbers are kept.
const SPAN_S: u64 = 300;
const RENEW_MS: u32 = 1000;
/// Where minutes or hours are drawn.
const RENEW_SLOWLY_MS: u32 = 10_000;

/// The data that are read for the page in addition to the snapshot.
#[derive(Default)]
pub struct NodeRead {
    /// `None` if it cannot be read.
    pub past: Option<Past>,
    /// The numbers in minutes or hours, if the span asks for these and they can be read.
    pub trend: Option<(Resolution, Trend)>,
    /// The same of a second node that is drawn into the plots.
    pub second: Option<Trend>,
    /// The newest first.
    pub incidents: Vec<Incident>,
    pub written: Option<Arc<Written>>,
    /// Why this module can never be shelved.
    pub never_shelved: Option<Refusal>,
}

/// A sentence, and the nodes that it is about.
struct Explanation {
    text: String,
    nodes: Vec<NodeLink>,
    more: Option<String>,
}

struct IncidentRow {
    id: u64,
    since: String,
    /// Empty while it lasts.
    length: String,
    note: String,
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
    /// When its present fault is estimated to have begun; empty if at its notice.
    began: String,
    message: String,
    /// A word and what stands beside it.
    facts: Vec<(&'static str, String)>,
    steps: Vec<Explanation>,
    paths: Vec<Vec<NodeLink>>,
    /// Keys with their values.
    values: Vec<(String, String)>,
    more_values: usize,
    plots: Plots,
    /// What is asked to be drawn into the plots, and why it is not.
    with: String,
    not_drawn: Option<String>,
    offered: Vec<String>,
    members: Vec<(NodeLink, &'static str, &'static str)>,
    more_members: Option<String>,
    /// The patterns of states; the stylesheet says their colours.
    patterns: String,
    /// A developer may shelve this module, unless `never_shelved` says why nobody can.
    may_shelve: bool,
    never_shelved: Option<String>,
    is_shelved: bool,
    states: Option<NodeStates>,
    legend: Vec<Explained>,
    spans: Vec<SpanOption>,
    from_ms: i64,
    to_ms: i64,
    live: bool,
    present: String,
    /// Where the page of the timeline shows this node.
    timeline: String,
    around: Option<(Drawing, usize)>,
    excerpt: Option<Excerpt>,
    /// The excerpt is that of its group.
    is_matched: bool,
    incidents: Vec<IncidentRow>,
    incidents_address: String,
    /// The kind of the numbers: of instants, minutes or hours.
    drawn: &'static str,
    /// From when on there are minutes and hours.
    kept: Option<(String, String)>,
    /// The numbers for a spreadsheet.
    csv: String,
    has_incidents: bool,
}

/// `GET /developer/why?node=group/module&span=SECONDS&until=MS&with=group/module KEY`
pub async fn get(
    extract::State(app): extract::State<AppState>,
    request: PageRequest,
) -> Result<Response, HttpError> {
    let PageRequest { published, context, query, .. } = request;
    let Some(node) = published.snapshot.node(query.get("node")) else {
        return Err(HttpError::NotFound);
    };
    let window = Window::over(&published, &only(&query), SPAN_S);
    let read = match published.snapshot.stage {
        // While the vehicle is locked, its past is not shown either.
        Stage::Locked => NodeRead::default(),
        _ => read(&app, &published, (&query, &window), node, &context).await,
    };
    Ok(Html(page((&published, &app.trends), node, &context, (&query, &window), &read)).into_response())
}

/// One node, with the span of time.
fn only(query: &PageQuery) -> PageQuery {
    let kept = ["node", "span", "until"].map(|name| (name.to_owned(), query.get(name).to_owned()));
    PageQuery::of(kept.into())
}

async fn read(
    app: &AppState,
    published: &Published,
    (query, window): (&PageQuery, &Window),
    node: NodeId,
    context: &PageContext,
) -> NodeRead {
    let past = app.past(published, |history| history.past(window.query.clone())).await.ok();
    let numbers = async |node: String, resolution| {
        let (from_ms, to_ms) = window.span_ms();
        let query = TrendQuery { node, from_ms, to_ms, resolution };
        app.past(published, |history| history.trend(query)).await.ok()
    };
    // A replay has the numbers of its recording.
    let resolution = resolution(window.span_ms(), window.live).filter(|_| !context.replay);
    let (mut trend, mut second) = (None, None);
    if let (NodeId::Module(_), Some(resolution)) = (node, resolution) {
        let node = window.query.nodes.first().cloned().unwrap_or_default();
        trend = numbers(node, resolution).await.map(|trend| (resolution, trend));
        if let Some(it) = Second::find(&published.snapshot, query.get("with")) {
            second = numbers(published.snapshot.module(it.node).0.id.to_string(), resolution).await;
        }
    }
    let name = window.query.nodes.first().cloned().unwrap_or_default();
    let filter = match node {
        // Causes stand on lines of their own.
        NodeId::Module(_) => IncidentFilter { cause: format!("\n{name}\n"), ..IncidentFilter::default() },
        NodeId::Group(_) => IncidentFilter { group: name, ..IncidentFilter::default() },
    };
    let incidents = match context.replay {
        true => Vec::new(),
        false => {
            let found = app.store.incidents(IncidentFilter { count: INCIDENTS, ..filter }).await;
            found
                .inspect_err(|error| tracing::warn!(%error, "the incidents cannot be read"))
                .unwrap_or_default()
        }
    };
    let written = app.settings.written.as_ref().map(|it| it.borrow().clone());
    let never_shelved = never_shelved(app, published, node, context).await;
    NodeRead { past, trend, second, incidents, written, never_shelved }
}

/// The first lasting reason of the engine against shelving a module.
async fn never_shelved(
    app: &AppState,
    published: &Published,
    node: NodeId,
    context: &PageContext,
) -> Option<Refusal> {
    let live = app.live().filter(|_| may_shelve(node, context))?;
    let module = published.snapshot.node_name(node).to_string().into();
    let lasts = Span::from_secs(60);
    let refused = live.rehearse(OperatorAction::Shelve { module, lasts, by: "".into() }).await.ok()?.err()?;
    let lasting =
        |why: &Refusal| matches!(why, Refusal::NeverShelved(_) | Refusal::CountermeasureRests { .. });
    refused.into_iter().find(lasting)
}

fn may_shelve(node: NodeId, context: &PageContext) -> bool {
    matches!(node, NodeId::Module(_)) && context.role == Role::Developer && !context.replay
}

pub fn page(
    (published, trends): (&Published, &Trends),
    node: NodeId,
    context: &PageContext,
    (query, window): (&PageQuery, &Window),
    read: &NodeRead,
) -> String {
    let view = &View::new(published, context.lang, false);
    let snapshot = view.snapshot;
    let raw_name = snapshot.node_name(node);
    let name = clean(raw_name, 2 * NAME);
    let link = |node: NodeId| NodeLink::of(view, node);
    let renew_ms = if read.trend.is_some() { RENEW_SLOWLY_MS } else { RENEW_MS };
    let mut dev = DevFrame::new(view, context, Page::Statuses, renew_ms);
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
    let (from_ms, to_ms) = (window.query.from_ms, window.query.to_ms);
    let written = read.written.as_deref();
    let own_excerpt = written.and_then(|written| excerpt(written, raw_name));
    let is_matched = own_excerpt.is_none();
    let of_group = || {
        let NodeId::Module(id) = node else { return None };
        excerpt(written?, snapshot.node_name(NodeId::Group(snapshot.module(id).0.group)))
    };
    let is_shelved = snapshot.shelved.iter().any(|it| NodeId::Module(it.module) == node);
    let with = query.get("with");
    let second = Second::find(snapshot, with);
    let plots = match &read.trend {
        Some((resolution, trend)) => {
            let second = second.as_ref().zip(read.second.as_ref());
            plots_of(published, node, second, trend, *resolution, (from_ms, to_ms))
        }
        None => plots(published, node, second.as_ref(), trends, (from_ms, to_ms)),
    };
    let is_drawn = plots.plots.iter().any(|plot| plot.second.is_some());
    let asked = clean(with, 2 * NAME);
    let not_drawn = match second {
        _ if with.is_empty() || is_drawn => None,
        None => Some(view.lang.no_number(&asked)),
        Some(_) => Some(view.lang.nothing_drawn(&asked)),
    };
    let field = if matches!(node, NodeId::Group(_)) { "group" } else { "cause" };
    let mut page = WhyHtml {
        state: state.as_str(),
        word: view.lang.state(state),
        since: String::new(),
        began: String::new(),
        message: String::new(),
        facts: Vec::new(),
        steps: steps.collect(),
        paths: Vec::new(),
        values: Vec::new(),
        more_values: 0,
        plots,
        with: asked,
        not_drawn,
        offered: match node {
            NodeId::Module(_) => Second::offered(snapshot),
            NodeId::Group(_) => Vec::new(),
        },
        drawn: match &read.trend {
            Some((Resolution::Minute, _)) => dev.words.numbers_minutes,
            Some((Resolution::Hour, _)) => dev.words.numbers_hours,
            None => dev.words.numbers_kept,
        },
        kept: read.trend.as_ref().and_then(|(_, trend)| {
            Some((wall_time(trend.minutes_from_ms?), wall_time(trend.hours_from_ms?)))
        }),
        members: Vec::new(),
        more_members: None,
        may_shelve: may_shelve(node, context),
        never_shelved: read.never_shelved.as_ref().map(|why| view.lang.refusal(why)),
        is_shelved,
        legend: legend(context.lang),
        patterns: patterns("p-", |paint| format!("class=\"p-{paint}\"")),
        states: read.past.as_ref().map(|past| states(context.lang, query, window, past)),
        spans: spans(window),
        from_ms,
        to_ms,
        live: window.live,
        present: query.without(&["until"]),
        timeline: format!("/developer/timeline{}", address([("node", &**raw_name)].into_iter())),
        around: graph::neighbourhood(view, node),
        excerpt: own_excerpt.or_else(of_group),
        is_matched,
        incidents: read.incidents.iter().map(incident_row).collect(),
        incidents_address: format!("/incidents{}", address([(field, &**raw_name)].into_iter())),
        csv: csv(raw_name, read, (from_ms, to_ms)),
        has_incidents: !context.replay,
        node: name,
        frame: super::frame(context),
        dev,
    };
    match node {
        NodeId::Module(id) => {
            let (info, module) = snapshot.module(id);
            page.since = view.wall(module.since);
            page.began = module.began.map(|began| view.wall(began)).unwrap_or_default();
            page.message = view.message_text(module);
            let it = page.dev.words;
            let facts = [
                (it.status, info.status.as_deref().unwrap_or_default()),
                (it.monitor, info.kind),
                (it.class, &super::statuses::class(it, info)),
                (it.hardware, &module.report.hardware_id),
            ];
            let said = facts.into_iter().filter(|(_, text)| !text.is_empty());
            page.facts = said.map(|(word, text)| (word, clean(text, 2 * NAME))).collect();
            let values = module.report.values.iter().take(VALUES);
            page.values = values.map(|(key, value)| (clean(key, NAME), clean(value, MESSAGE))).collect();
            page.more_values = module.report.values.len().saturating_sub(VALUES);
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

/// The address of the numbers of the span: of minutes or hours, as many as one answer has.
fn csv(node: &str, read: &NodeRead, (from_ms, to_ms): (i64, i64)) -> String {
    let (since, until) = (wall_time(from_ms), wall_time(to_ms));
    let resolution = match &read.trend {
        Some((Resolution::Hour, _)) => "hour",
        _ => "minute",
    };
    let span = [("since", &*since), ("until", &*until), ("resolution", resolution), ("count", "50000")];
    let asked = [("node", node), ("format", "csv")].into_iter();
    let of_span = span.into_iter().filter(|_| read.trend.is_some());
    format!("/api/v1/values{}", address(asked.chain(of_span)))
}

fn incident_row(incident: &Incident) -> IncidentRow {
    IncidentRow {
        id: incident.summary.id,
        since: wall_time(incident.summary.since_ms),
        length: length(incident),
        note: incident.note.as_ref().map(|note| clean(&note.text, MESSAGE)).unwrap_or_default(),
    }
}

fn explain(view: &View<'_>, step: &WhyStep) -> (String, Vec<NodeId>) {
    let what = match step {
        WhyStep::OnlyFrom(writers) => clean(&writers.join(", "), 2 * NAME),
        WhyStep::Reported(is) | WhyStep::Silent(is) | WhyStep::Debounced(is) | WhyStep::Shown(is) => {
            view.lang.state(*is).to_owned()
        }
        WhyStep::Members { own, .. } => view.lang.state(*own).to_owned(),
        WhyStep::NotRelevant(because) => view.lang.not_relevant(because, &view.snapshot.layout),
        WhyStep::Waits { holder, .. } => clean(view.snapshot.node_name(*holder), 2 * NAME),
        _ => String::new(),
    };
    let nodes = match step {
        WhyStep::Members { responsible: nodes, .. } | WhyStep::Masked { by: nodes } => nodes.clone(),
        WhyStep::Waits { on, .. } => vec![*on],
        _ => Vec::new(),
    };
    (view.lang.why_step(step, &what), nodes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::developer::tests::{english, holds, query};
    use crate::texts::Lang;
    use crate::view::tests::jump;
    use crate::view::tests::sample::Sample;
    use telltale_store::{TrendPoint, ValueTrend};

    #[test]
    fn a_why_page_leads_to_what_it_names() {
        let published = jump().pass(4).published();
        let node = published.snapshot.node("perception").expect("it is there");
        let query = query(&[("node", "perception")]);
        let window = Window::over(&published, &query, 300);
        let (trends, read) = (Trends::default(), NodeRead::default());
        let page = page((&published, &trends), node, &english(), (&query, &window), &read);
        holds(&page, &["/developer/why?node=localization%2Ftf_quality", "perception/costmap_delay"]);
    }

    #[test]
    fn a_number_of_a_second_module_is_drawn_into_each_plot_and_what_is_not_there_is_said() {
        let (trends, mut sample) = (Trends::default(), Sample::shuttle(true));
        for value in ["1.5", "3", "2"] {
            let other = [("volts", value), ("volts_error_below", "0.5")];
            sample = sample.report("can/battery", 0, "fine", &[("volts", value), ("amps", "<7>")]);
            sample = sample.report("sensors/imu", 0, "fine", &other).pass(2);
            trends.sample(&Published::recorded(sample.snapshot(), std::time::UNIX_EPOCH));
        }
        let published = sample.published();
        let node = published.snapshot.node("can/battery").expect("it is there");
        let page = |with: &str| {
            let query = query(&[("node", "can/battery"), ("with", with)]);
            let window = Window::over(&published, &only(&query), 300);
            page((&published, &trends), node, &english(), (&query, &window), &NodeRead::default())
        };
        let plain = page("");
        holds(&plain, &[r#"<option value="sensors/imu volts">"#, r#"name="with" value="""#]);
        let none = |page: &str| {
            assert!(!page.contains("data-second") && !page.contains("class=\"second\""), "{page}")
        };
        none(&plain);
        assert!(!plain.contains("volts_error_below\">") && !plain.contains("not-drawn"), "{plain}");
        for with in ["sensors/imu volts", "sensors/imu"] {
            let drawn = page(with);
            let second = r#"<span class="second">sensors/imu volts</span><small>1.5 … 3</small>"#;
            holds(
                &drawn,
                &["data-second=\"[1.5,3,2]\" data-same-scale", second, "<g class=\"second\"><path d=\"M"],
            );
            assert!(!drawn.contains("not-drawn"), "{drawn}");
        }
        // The same in minutes, of which each has its own.
        let minutes = |from: i64| {
            let point = |(at_ms, mean)| TrendPoint { at_ms, known_s: 60.0, least: mean, mean, most: mean };
            let points = [(from, 1.0), (from + 60_000, 2.0)].map(point).to_vec();
            Trend { values: vec![ValueTrend { key: "volts".into(), points }], ..Trend::default() }
        };
        let query = query(&[("node", "can/battery"), ("with", "sensors/imu volts")]);
        let window = Window::over(&published, &only(&query), 300);
        let from = window.query.from_ms;
        let trend = Some((Resolution::Minute, minutes(from)));
        let read = NodeRead { trend, second: Some(minutes(from + 60_000)), ..NodeRead::default() };
        let drawn = super::page((&published, &trends), node, &english(), (&query, &window), &read);
        holds(&drawn, &["data-numbers=\"[1,2,null,null]\"", "data-second=\"[null,1,2,null]\""]);
        for with in
            ["nowhere/<b>", "sensors/imu amps", "sensors/im", "sensors", "sensors/imu volts_error_below"]
        {
            let wrong = page(with);
            holds(&wrong, &["id=\"not-drawn\"", "There is no module with a number called"]);
            none(&wrong);
            assert!(!wrong.contains("<b>&") && !wrong.contains("nowhere/<b>"), "{wrong}");
        }
    }

    #[test]
    fn the_neighbours_of_a_node_are_what_it_needs_and_what_needs_it() {
        let published = jump().pass(4).published();
        let view = &View::new(&published, Lang::En, false);
        let around = |name: &str| {
            let node = published.snapshot.node(name).expect("it is there");
            graph::neighbourhood(view, node).map(|(drawing, more)| (drawing.svg, more))
        };
        let (svg, more) = around("localization").expect("it has neighbours");
        holds(&svg, &["data-here", "sensors", "perception", "data-hot"]);
        assert_eq!((more, svg.matches("data-here").count()), (0, 1));
        assert!(!svg.contains("toggle"), "the page of a node has nothing to open: {svg}");
        // A member has the dependencies of its group, and is shown in it without the others.
        let (svg, _) = around("localization/tf_quality").expect("its group has neighbours");
        holds(&svg, &["sensors", "tf_quality"]);
        assert!(!svg.contains("localization%2Fodometry"), "{svg}");
    }
}
