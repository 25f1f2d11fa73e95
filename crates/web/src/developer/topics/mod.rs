//! The page of topics: topics, types, publishers and subscribers from discovery, mismatches between them, the rates that
//! come beside those that monitors want, and what the recorder's memory holds.

mod draft;
mod then;
pub mod wanted;

use askama::Template;

use axum::extract::State;
use axum::response::Html;

use crate::AppState;
use crate::source::Source;

use super::request::PageRequest;
use crate::texts::{DevWords, Lang, MESSAGE, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_engine::discovery::{Discovery, Endpoint, Mismatch, TopicSeen};
use telltale_record::recorder::Meter;
use telltale_runtime::Published;

use super::incidents::content::broken;
use super::pager::Pager;
use super::{DevFrame, NodeLink, Page, PageQuery};
use draft::{Draft, draft};
use telltale_engine::model::NodeId;
use wanted::{Wanted, all_wanted};

/// Rows of one page.
const ROWS: usize = 40;
/// Endpoints listed of one topic.
const LISTED: usize = 24;
/// Monitors of one topic that are named.
const MONITORS: usize = 6;
const NODES: usize = 500;
const RENEW_MS: u32 = 1000;

struct EndpointList {
    count: usize,
    /// The node, or the participant if no node is announced, with its quality of service; or Telltale itself.
    listed: Vec<(String, &'static str, bool)>,
}

struct TopicRow {
    name: String,
    /// The name as HTML, with places where its line may break.
    broken: String,
    /// Packages, with such places, and names.
    types: Vec<TypeParts>,
    /// Publishers, then subscribers.
    sides: [EndpointList; 2],
    rate: Option<String>,
    jitter: Option<String>,
    /// The rate that monitors want, and whether that matters now.
    wanted: Option<(String, bool)>,
    /// `too_slow`, `too_fast` or empty, and its word.
    pace: (&'static str, &'static str),
    monitors: Vec<NodeLink>,
    more_monitors: usize,
    /// The page with or without its draft of a monitor.
    draft_address: Option<String>,
    draft: Option<Draft>,
    held: Option<HeldCell>,
    mismatches: Vec<&'static str>,
}

/// The share of a topic in the recorder's memory.
struct HeldCell {
    /// Seconds.
    seconds: String,
    /// Bytes a second.
    flow: Option<String>,
    /// How many messages had to make room for others.
    dropped: u64,
    /// Less is held than a recording needs.
    is_short: bool,
    /// Only the times and sizes of the messages are recorded.
    is_sizes_only: bool,
}

#[derive(Template)]
#[template(path = "developer/topics.html")]
struct TopicsHtml {
    frame: PageFrame,
    dev: DevFrame,
    filter: String,
    looked: bool,
    rows: Vec<TopicRow>,
    pager: Pager,
    participants: usize,
    nodes: Vec<String>,
    node_count: usize,
    more: usize,
    /// The sizes of a recording and of the memory for it, if anything is recorded.
    memory: Option<(String, String)>,
    columns: usize,
}

/// `GET /developer/topics?q=TEXT&page=N`: what discovery sees; in a replay what the recording holds.
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Html<String> {
    if let Source::Replay(replay) = &app.source {
        return Html(then::page(&request.published, &request.context, &request.query, &replay.flows));
    }
    let seen = app.settings.discovery.as_ref().map(|seen| seen.borrow().clone()).unwrap_or_default();
    let meter = app.settings.recording.as_ref().map(|recording| recording.recorder.meter());
    Html(page(&request.published, &request.context, &request.query, &seen, meter.as_ref()))
}

pub fn page(
    published: &Published,
    context: &PageContext,
    query: &PageQuery,
    seen: &Discovery,
    meter: Option<&Meter>,
) -> String {
    let view = &View::new(published, context.lang, false);
    let filter = query.get("q").to_lowercase();
    let mut topics: Vec<&TopicSeen> = seen.topics.iter().filter(|topic| matches(topic, &filter)).collect();
    let wanted = all_wanted(view.snapshot);
    let nothing = Wanted::default();
    let of = |topic: &TopicSeen| wanted.get(&*topic.name).unwrap_or(&nothing);
    // Topics that are too slow stand first, then those with another fault.
    topics.sort_by_key(|topic| {
        let is_wrong = of(topic).is_too_fast(topic) || !topic.mismatches().is_empty();
        (!of(topic).is_too_slow(topic), !is_wrong && !topic.is_published_beside_us())
    });
    let (pager, shown) = Pager::of(query, "matching", "page", topics.len(), ROWS);
    html(&TopicsHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Topics, RENEW_MS),
        filter: clean(query.get("q"), MESSAGE),
        looked: seen.at.is_some(),
        pager,
        rows: topics[shown].iter().map(|topic| row(view, query, topic, of(topic), meter)).collect(),
        participants: seen.participants,
        nodes: seen.nodes.iter().take(NODES).map(|name| clean(name, 2 * NAME)).collect(),
        node_count: seen.nodes.len(),
        more: seen.more,
        columns: 8 + usize::from(meter.is_some()),
        memory: meter.map(|meter| {
            (format!("{} s", meter.wanted.as_millis() / 1000), view.lang.size(meter.memory as u64))
        }),
    })
}

/// Whether a topic, one of its types or of its nodes has this in its name, in small letters.
pub fn matches(topic: &TopicSeen, lower: &str) -> bool {
    let holds = |text: &str| text.to_lowercase().contains(lower);
    let mut ends = topic.publishers.iter().chain(&topic.subscribers);
    lower.is_empty()
        || holds(&topic.name)
        || topic.types().into_iter().any(holds)
        || ends.any(|end| end.node.as_deref().is_some_and(holds))
}

fn row(
    view: &View<'_>,
    query: &PageQuery,
    topic: &TopicSeen,
    wanted: &Wanted,
    meter: Option<&Meter>,
) -> TopicRow {
    let (lang, words) = (view.lang, DevWords::of(view.lang));
    let word = |mismatch: Mismatch| match mismatch {
        Mismatch::Type => words.mismatch_type,
        Mismatch::Reliability => words.mismatch_reliability,
        Mismatch::Durability => words.mismatch_durability,
        Mismatch::Deadline => words.mismatch_deadline,
        Mismatch::Liveliness => words.mismatch_liveliness,
    };
    let twice = topic.is_published_beside_us().then_some(words.published_twice);
    let draft = draft(words, topic);
    let is_asked = query.all("monitor").any(|name| name == topic.name);
    TopicRow {
        name: clean(&topic.name, 2 * NAME),
        broken: broken(&topic.name),
        types: topic.types().into_iter().map(TypeParts::of).collect(),
        sides: [
            endpoints(&topic.publishers, topic.publishers.iter().any(|it| it.ours)),
            endpoints(&topic.subscribers, topic.rate_hz.is_some()),
        ],
        rate: topic.rate_hz.map(|rate| lang.decimals(&format!("{rate:.1} Hz"))),
        jitter: topic
            .jitter_ms
            .map(|ms| if ms < 9.95 { lang.decimals(&format!("{ms:.1} ms")) } else { format!("{ms:.0} ms") }),
        wanted: wanted.in_words().map(|rate| (lang.decimals(&rate), wanted.is_now)),
        pace: match (wanted.is_too_slow(topic), wanted.is_too_fast(topic)) {
            (true, _) => ("too_slow", words.too_slow),
            (_, true) => ("too_fast", words.too_fast),
            _ => ("", ""),
        },
        monitors: wanted
            .monitors
            .iter()
            .take(MONITORS)
            .map(|&id| NodeLink::of(view, NodeId::Module(id)))
            .collect(),
        more_monitors: wanted.monitors.len().saturating_sub(MONITORS),
        draft_address: draft.is_some().then(|| query.toggled("monitor", &topic.name)),
        draft: draft.filter(|_| is_asked),
        held: meter.and_then(|meter| held(lang, &topic.name, meter)),
        mismatches: topic.mismatches().into_iter().map(word).chain(twice).collect(),
    }
}

/// A type, its package as HTML with places where its line may break, and its name.
struct TypeParts {
    whole: String,
    package: String,
    own: String,
}

impl TypeParts {
    fn of(name: &str) -> TypeParts {
        let (package, own) = name.rfind('/').map_or(("", name), |slash| name.split_at(slash + 1));
        TypeParts { whole: clean(name, 2 * NAME), package: broken(package), own: clean(own, 2 * NAME) }
    }
}

fn held(lang: Lang, topic: &str, meter: &Meter) -> Option<HeldCell> {
    let index = meter.topics.binary_search_by(|held| (*held.topic).cmp(topic)).ok()?;
    let held = &meter.topics[index];
    Some(HeldCell {
        seconds: (held.span.as_millis() / 1000).to_string(),
        flow: held
            .bytes_per_s()
            .filter(|_| !held.is_sizes_only)
            .map(|bytes| format!("{}/s", lang.size(bytes))),
        dropped: held.dropped,
        is_short: held.is_short_of(meter.wanted),
        is_sizes_only: held.is_sizes_only,
    })
}

/// Discovery does not list Telltale's own endpoints: `ours` says whether there is one.
fn endpoints(endpoints: &[Endpoint], ours: bool) -> EndpointList {
    let listed = endpoints.iter().filter(|endpoint| !endpoint.ours).take(LISTED).map(|endpoint| {
        let quality = match (endpoint.reliable, endpoint.transient_local) {
            (true, true) => "reliable, transient local",
            (true, false) => "reliable",
            (false, true) => "best effort, transient local",
            (false, false) => "best effort",
        };
        // The start of a participant is its maker and machine, the same for many.
        let participant = endpoint.participant.get(8..).unwrap_or(&endpoint.participant);
        (clean(endpoint.node.as_deref().unwrap_or(participant), 2 * NAME), quality, false)
    });
    let own = ours.then(|| (String::new(), "", true));
    let others = endpoints.iter().filter(|endpoint| !endpoint.ours).count();
    EndpointList { count: others + usize::from(ours), listed: own.into_iter().chain(listed).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Palette;
    use crate::view::tests::{context, jump};
    use telltale_engine::time::{Span, Timestamp};
    use telltale_record::ring::Held;

    #[test]
    fn a_topic_says_what_the_recorder_holds_of_it() {
        let seen = |name: &str| TopicSeen {
            name: name.into(),
            publishers: Vec::new(),
            subscribers: Vec::new(),
            ..TopicSeen::default()
        };
        let topics = ["/diagnostics", "/points", "/unread"].map(seen).to_vec();
        let discovery = Discovery { at: Some(Timestamp::ZERO), topics, ..Discovery::default() };
        let held = |topic: &str, span_s, dropped, dropped_age: Option<u64>| Held {
            topic: topic.into(),
            messages: 10,
            bytes: 90_000_000,
            span: Span::from_secs(span_s),
            dropped,
            dropped_age: dropped_age.map(Span::from_secs),
            is_sizes_only: false,
        };
        let meter = |topics| Meter {
            wanted: Span::from_secs(45),
            memory: 256_000_000,
            topics,
            has_too_many_topics: false,
        };
        let page = |meter: Option<&Meter>| {
            let context = context(Lang::En, Palette::Night);
            page(&jump().published(), &context, &PageQuery::default(), &discovery, meter)
        };
        let short = meter(vec![held("/diagnostics", 300, 0, None), held("/points", 9, 70, Some(9))]);
        let html = page(Some(&short));
        for part in [
            "45 s",
            "256.0 MB",
            ">300 s <small>300.0 kB/s",
            ">9 s <small>10.0 MB/s",
            "class=\"bad\">70 made room",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
        let enough = page(Some(&meter(vec![held("/points", 50, 70, Some(50))])));
        assert!(enough.contains("<small>70 made room") && !enough.contains("class=\"bad\">70"), "{enough}");
        assert!(!enough.contains("times and sizes only"));
        let sizes = Held { is_sizes_only: true, ..held("/points", 50, 0, None) };
        assert!(page(Some(&meter(vec![sizes]))).contains("50 s <small>times and sizes only"));
        assert!(!page(None).contains("Recorder"));
    }
}
