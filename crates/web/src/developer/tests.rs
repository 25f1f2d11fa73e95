//! Tests of the developer's pages.

use std::sync::Arc;

use super::*;
use crate::texts::Lang;
use crate::view::tests::sample::{Sample, group, module, parts};
use crate::view::tests::{context, jump, operator_page};
use crate::view::{PageContext, PagePart, Palette, Trends};
use telltale_engine::input::TroubleKind;
use telltale_engine::model::{Parts as ModelParts, StageModel};
use telltale_engine::text::Text;
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;

use telltale_engine::discovery::{Discovery, Endpoint, TopicSeen};
use telltale_engine::event::Said;
use telltale_engine::model::monitors::Class;
use telltale_engine::model::monitors::{
    AgreementRule, Bands, ProbeTarget, TopicId, TopicSpec, ValueRule, ValueSource, WatchdogId, WatchdogSpec,
    Watched,
};
use telltale_engine::model::{ModuleMonitor, ModuleSpec, MonitorSpec};
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_runtime::{ConfigurationText, Rereading, Written};
use telltale_store::{NodePast, Past, PastEvent, Period, Stretch};

pub fn query(pairs: &[(&str, &str)]) -> PageQuery {
    PageQuery::of(pairs.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect())
}

/// Every page of the developer's. What is asked for, was recorded and is read from files is `text`.
pub fn pages(published: &Published, context: &PageContext, text: &str) -> Vec<(&'static str, String)> {
    let query = query(&[
        ("q", ""),
        ("pin", text),
        ("group", ""),
        ("sort", text),
        ("node", text),
        ("node", "localization"),
        ("cell", "0 localization"),
        ("open", "all"),
    ]);
    // Matches everything.
    let every_node = PageQuery::of(vec![("q".to_owned(), "a".to_owned())]);
    let trends = Trends::default();
    let window = Window::of(published, &query);
    let stretch = |from_ms: i64, state: State, cause: Option<&str>| Stretch {
        from_ms: window.query.from_ms + from_ms,
        to_ms: window.query.from_ms + from_ms + 30_000,
        state,
        own: State::Error,
        cause: cause.map(Into::into),
        said: Said::of(text, Some(Span::from_secs(3))),
    };
    let stretches = vec![
        stretch(0, State::Ok, None),
        stretch(30_000, State::Error, None),
        stretch(60_000, State::Ignore, Some(text)),
        stretch(90_000, State::Ignore, None),
    ];
    let node = |name: &String| NodePast { name: name.clone(), stretches: stretches.clone() };
    let moved = PastEvent::AlarmMoved { id: 1, symptom: text.to_owned(), cause: text.to_owned() };
    let (from_ms, to_ms) = (window.query.from_ms, window.query.to_ms);
    let past = Past {
        nodes: window.query.nodes.iter().map(node).collect(),
        stage: vec![Period { from_ms, to_ms, value: Stage::Active }],
        signals: vec![(text.to_owned(), vec![Period { from_ms, to_ms, value: Some(true) }])],
        events: vec![(to_ms, moved), (to_ms, PastEvent::Lost(3))],
        cut: false,
    };
    let read = Rereading {
        taken: false,
        differences: vec![text.to_owned()],
        problems: None,
        warnings: Some(text.to_owned()),
        judged: true,
        running: [ConfigurationText { name: text.to_owned(), text: text.to_owned() }].into(),
        digest: "0123".to_owned(),
    };
    let mut pages = vec![
        ("statuses", statuses::page(published, context, &query, &trends)),
        ("graph", graph::page(published, context, &query)),
        ("timeline", timeline::page(published, context, &query, (&window, String::new()), Some(&past))),
        ("timeline-none", timeline::page(published, context, &query, (&window, String::new()), None)),
        ("masking", masking::page(published, context, &query)),
        ("coverage", coverage::page(published, context, &query)),
        ("topics", topics::page(published, context, &query, &discovery(text), None)),
        ("search", search::page(published, context, &every_node, &discovery(text), &[])),
        ("configuration", configuration::page(published, &read, Some(true), context, &query)),
    ];
    // A hostile name in the files of the configuration, and a hostile line.
    let lines = published.snapshot.layout.modules.iter().map(|info| (Box::from(&*info.id), (0, 1)));
    let written = Arc::new(Written { texts: read.running.clone(), lines: lines.collect() });
    // Of a locked vehicle no node has a page.
    let locked = published.snapshot.stage == Stage::Locked;
    let modules = published.snapshot.layout.modules.iter().filter(|_| !locked).map(|info| &info.id);
    for name in
        modules.chain(published.snapshot.layout.groups.iter().filter(|_| !locked).map(|info| &info.path))
    {
        let node = published.snapshot.node(name).expect("it is there");
        let read = why::NodeRead {
            past: Some(past.clone()),
            written: Some(written.clone()),
            ..why::NodeRead::default()
        };
        pages.push(("why", why::page((published, &trends), node, context, (&query, &window), &read)));
    }
    pages
}

fn discovery(text: &str) -> Discovery {
    let endpoint =
        Endpoint { participant: text.to_owned(), type_name: text.to_owned(), ..Endpoint::default() };
    let endpoint = Endpoint { node: Some(format!("/{text}_driver")), ..endpoint };
    let other = Endpoint { type_name: "std_msgs/msg/Bool".to_owned(), reliable: true, ..endpoint.clone() };
    let topic = TopicSeen {
        name: format!("/{text}"),
        publishers: vec![endpoint],
        subscribers: vec![other],
        rate_hz: Some(9.96),
        ..TopicSeen::default()
    };
    Discovery {
        at: Some(Timestamp::ZERO),
        topics: vec![topic],
        nodes: vec![format!("/{text}")],
        participants: 1,
        ..Discovery::default()
    }
}

pub fn english() -> PageContext {
    context(Lang::En, Palette::Night)
}

#[track_caller]
pub fn holds(html: &str, parts: &[&str]) {
    for part in parts {
        assert!(html.contains(part), "lacks {part:?}:\n{html}");
    }
}

/// The modules in the table, in its order.
fn listed(published: &Published, pairs: &[(&str, &str)]) -> Vec<String> {
    let html = statuses::page(published, &english(), &query(pairs), &Trends::default());
    let rows = html.split("data-module=\"").skip(1);
    rows.map(|row| row.split('"').next().unwrap_or_default().to_owned()).collect()
}

#[test]
fn the_developer_sees_all_that_was_received() {
    let published = Sample::shuttle(false)
        .report("nobody: knows", 2, "mine alone", &[("key", "value")])
        .trouble("/diagnostics", TroubleKind::Malformed, 7, "string runs past the end")
        .pass(3)
        .published();
    let page = statuses::page(&published, &english(), &PageQuery::default(), &Trends::default());
    let all = ["nobody: knows", "mine alone", "string runs past the end", "malformed", ">7<", "can/battery"];
    holds(&page, &all);
    let operator = operator_page(&published, &english());
    assert!(!operator.contains("mine alone") && !operator.contains("developer.js"));
}

#[test]
fn statuses_are_filtered_sorted_and_pinned_as_the_address_says() {
    let published = jump().report("can/battery", 1, "Low: 20 %", &[("volt", "11.9")]).pass(4).published();
    assert_eq!(listed(&published, &[("q", "VOLT")]), ["can/battery"]);
    assert_eq!(listed(&published, &[("q", "low: 2")]), ["can/battery"]);
    assert_eq!(listed(&published, &[("level", "warning")]), ["can/battery"]);
    assert_eq!(listed(&published, &[("level", "abnormal")]).len(), 2);
    assert!(listed(&published, &[("group", "can")]).iter().all(|name| name.starts_with("can/")));
    let by_state = listed(&published, &[("sort", "state")]);
    assert_eq!(by_state[..2], ["localization/tf_quality", "can/battery"]);
    let backwards = listed(&published, &[("sort", "state"), ("desc", "1"), ("page", "99")]);
    assert_eq!(backwards.last(), by_state.first());
    let pinned = listed(&published, &[("q", "volt"), ("pin", "mission/server"), ("pin", "gone")]);
    assert_eq!(pinned, ["mission/server", "can/battery"]);
    assert!(listed(&published, &[("q", "nothing like this")]).is_empty());
    let pages = [listed(&published, &[]), listed(&published, &[("page", "99")])];
    assert_eq!(pages.concat().len(), published.snapshot.modules.len(), "the last page is the second");
}

#[test]
fn many_modules_come_in_pages_and_collapsed() {
    let modules = (0..5000).map(|index| module(&format!("g/{index:04}"), 0, &format!("{index:04}")));
    let parts = ModelParts {
        groups: vec![group("g", Text::plain("G"))],
        modules: modules.collect(),
        signals: Vec::new(),
        stages: StageModel::None,
        ..parts()
    };
    let published = Sample::of(parts).pass(1).published();
    let first = listed(&published, &[]);
    let second = listed(&published, &[("page", "2")]);
    assert_eq!((first.len(), second.len()), (30, 30));
    assert!(first.last() < second.first());
    let graph = graph::page(&published, &english(), &PageQuery::default());
    assert!(graph.len() < 20_000 && !graph.contains("g/0001"), "{}", graph.len());
    let open = graph::page(&published, &english(), &query(&[("open", "g")]));
    assert!(open.contains("g/0001") && !open.contains("g/4000") && open.len() < 60_000);
}

#[test]
fn the_audit_names_what_is_hidden_and_by_whom() {
    let published = jump().report("perception/costmap_delay", 2, "350 ms late", &[]).pass(4).published();
    let page = masking::page(&published, &english(), &PageQuery::default());
    let masked = page.split("id=\"not-relevant\"").next().unwrap_or_default();
    holds(masked, &["perception/costmap_delay", "localization/tf_quality", "350 ms late"]);
    assert!(!masked.contains(">sensors/imu<"), "{masked}");
    let filtered = masking::page(&published, &english(), &query(&[("q", "COSTMAP")]));
    assert!(filtered.contains("perception/costmap_delay") && !filtered.contains(">prediction<"));
}

#[test]
fn the_coverage_counts_every_module_once_and_marks_what_is_empty() {
    let published = Sample::shuttle(true).published();
    let page = coverage::page(&published, &english(), &query(&[("cell", "1 can")]));
    let all = published.snapshot.modules.len();
    holds(&page, &[&format!("<td class=\"sum\">{all}</td>"), "class=\"none\"", "can/battery"]);
    // Five columns, and no sixth where every class is in one of them.
    let row =
        page.split("<tr data-row data-group=\"can\">").nth(1).and_then(|rest| rest.split("</tr>").next());
    assert_eq!(row.map(|row| row.matches("<td").count()), Some(6), "{row:?}");
}

#[test]
fn techniques_are_of_components_or_of_data_streams() {
    let (topic, bands) = (TopicId(0), Bands { error_above: Some(9.0), ..Bands::default() });
    let (window, class) =
        (Span::from_secs(1), |location, information, flow| Class { location, information, flow });
    let key = |key: &str| ValueSource::Key { status: "s".into(), key: key.into(), unit: None };
    let status = || "s".into();
    let monitors = [
        MonitorSpec::Frequency { topic, window, bands },
        MonitorSpec::Latency { topic, window, bands },
        MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 1, bands: Bands::default() },
        MonitorSpec::Value { source: key("k"), rule: ValueRule::Bands(bands), empty: None },
        MonitorSpec::RateRatio { input: topic, output: topic, window, bands },
        MonitorSpec::External { status: status(), class: class("contextual", "content", Some("sequential")) },
        MonitorSpec::Sequence { earlier: key("k"), later: key("l"), max_gap: window, bands },
        MonitorSpec::Agreement {
            a: key("k"),
            b: key("l"),
            max_age: window,
            motion_over: None,
            rule: AgreementRule::Number(bands),
        },
    ];
    let target = ProbeTarget::Icmp { host: "lidar".into() };
    let topic =
        TopicSpec { topic: "/t".into(), type_name: "a/msg/B".into(), stamp: true, fields: Vec::new() };
    let monitors = monitors.into_iter().map(ModuleMonitor::from);
    let modules = monitors.chain([ModuleMonitor::SelfState("t".into())]).map(|monitor| {
        let name = monitor.kind();
        ModuleSpec { monitor, ..module("sensors", 0, name) }
    });
    let parts = ModelParts {
        groups: vec![group("sensors", Text::plain("Sensors"))],
        modules: modules.collect(),
        signals: Vec::new(),
        stages: StageModel::None,
        watched: Watched {
            topics: vec![topic.into()],
            watchdogs: vec![WatchdogSpec { target, every: window }.into()],
            ..Watched::default()
        },
        ..parts()
    };
    let published = Sample::of(parts).published();
    let page = |cell: &str| coverage::page(&published, &english(), &query(&[("cell", cell)]));
    let whole = page("");
    let rows: Vec<&str> = whole.split("<tr data-technique>").skip(1).collect();
    let cells = |row: &str| -> Vec<String> {
        let cells = row.split("</tr>").next().unwrap_or_default().split("<td").skip(1).take(5);
        let words = |cell: &str| {
            cell.split("<div>").skip(1).map(|it| it.split('<').next().unwrap()).collect::<Vec<_>>().join(", ")
        };
        cells.map(words).collect()
    };
    assert_eq!(rows.len(), 2);
    let components = cells(rows[0]);
    assert_eq!(
        [&*components[0], &components[2], &components[3], &components[4]],
        ["watchdog 1", "rate_ratio 1", "external 1", ""]
    );
    assert!(components[1].starts_with("self_state "), "{components:?}");
    assert_eq!(cells(rows[1]), ["frequency 1, latency 1", "value 1", "", "sequence 1", "agreement 1"]);
    let listed = page("0 sensors");
    let listed = listed.split("id=\"listed\"").nth(1).unwrap();
    let at = |text: &str| listed.find(text).unwrap_or_else(|| panic!("{text}: {listed}"));
    let order =
        ["Sensors: isolated, meta", "Components", "sensors/watchdog", "Data streams", "sensors/frequency"];
    assert!(order.map(at).is_sorted(), "{listed}");
}

#[test]
fn the_graph_draws_the_path_of_a_root_cause_and_no_other_hot() {
    let lines = |published: &Published, open: &str| {
        let page = graph::page(published, &english(), &query(&[("open", open)]));
        let lines = page.split("<g class=\"line\" data-hot><title>").skip(1);
        lines.map(|line| line.split('<').next().unwrap_or_default().to_owned()).collect::<Vec<_>>()
    };
    assert!(lines(&Sample::shuttle(true).published(), "all").is_empty());
    let hot = lines(&jump().pass(4).published(), "none");
    holds(&hot.join("\n"), &["localization \u{2192} perception", "perception \u{2192} prediction"]);
    assert!(!hot.iter().any(|line| line.starts_with("sensors") || line.starts_with("mission")), "{hot:?}");
    // Telltale's own modules are folded before somebody asks for them.
    let first = graph::page(&Sample::shuttle(true).published(), &english(), &PageQuery::default());
    assert!(first.contains("sensors/imu:") && !first.contains("telltale/storage:"), "{first}");
    holds(&first, &["href=\"?open=all\""]);
}

#[test]
fn of_many_modules_in_a_group_the_worst_are_drawn() {
    let paths = ["g0", "g1", "g2", "g3"];
    let modules = (0..400).map(|index| module(paths[index / 100], index as u32 / 100, &format!("{index}")));
    let parts = ModelParts {
        groups: paths.iter().map(|path| group(path, Text::plain(path))).collect(),
        modules: modules.collect(),
        signals: Vec::new(),
        stages: StageModel::None,
        ..parts()
    };
    let published = Sample::of(parts).report("g2/299", 2, "broken", &[]).pass(4).published();
    let graph = |pairs: &[(&str, &str)]| graph::page(&published, &english(), &query(pairs));
    let all = graph(&[("open", "all")]);
    holds(&all, &["g2/200:", "g2/299: Error", "g0/0:"]);
    assert!(!all.contains("g2/298:") && !all.contains("g0/99:"), "{all}");
    // An address names what is open or what is not: the shorter list.
    holds(&all, &["href=\"?open=all&amp;shut=g1\""]);
    holds(&graph(&[("open", "g1")]), &["href=\"?open=none\"", "href=\"?open=g1&amp;open=g2\""]);
    let shut = graph(&[("open", "all"), ("shut", "g1")]);
    assert!(shut.contains("g0/0:") && !shut.contains("g1/100:"), "{shut}");
    holds(&shut, &["href=\"?open=all\"", "href=\"?open=all&amp;shut=g1&amp;shut=g2\""]);
}

#[test]
fn a_part_of_a_page_is_what_the_whole_has_of_it() {
    let published = jump().pass(4).published();
    let pages_of = |part| pages(&published, &PageContext { part, ..english() }, "text");
    let parts = pages_of(PagePart::Main).into_iter().zip(pages_of(PagePart::Content));
    for ((name, whole), ((_, main), (_, content))) in pages_of(PagePart::Whole).into_iter().zip(parts) {
        let (main, content) = (main.trim(), content.trim());
        assert!(main.starts_with("<main ") && main.ends_with("</main>"), "{name}: {main}");
        assert!(content.starts_with("<div id=\"dev\"") && content.ends_with("</div>"), "{name}: {content}");
        assert!(whole.contains(main) && main.contains(content), "{name}");
    }
}

#[test]
fn a_node_is_found_by_the_name_of_its_fault() {
    let published = Sample::shuttle(true).published();
    let asks = query(&[("q", "position JUMPED")]);
    let page = search::page(&published, &english(), &asks, &Discovery::default(), &[]);
    holds(&page, &["localization/tf_quality</a>"]);
}

#[test]
fn topics_show_types_rates_and_what_does_not_match() {
    let page =
        topics::page(&jump().published(), &english(), &PageQuery::default(), &discovery("front"), None);
    holds(
        &page,
        &[
            "/front",
            "<small>std_<wbr>msgs/<wbr>msg/<wbr></small>Bool",
            "10.0 Hz",
            "data-mismatch",
            "Types differ",
            "best effort",
            "/front_driver",
        ],
    );
    let page =
        topics::page(&jump().published(), &english(), &query(&[("q", "rear")]), &discovery("front"), None);
    assert!(!page.contains("data-topic"), "{page}");
}
