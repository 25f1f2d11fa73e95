//! Tests of the topics of diagnostics, and of the clock of stamps.

use super::*;
use telltale_engine::model::monitors::{DiagnosticsTopic, StampClock};

#[test]
fn components_may_report_on_several_topics() {
    let watched = |text: &str| {
        let loaded = parse("c", &format!("{GROUP}{text}")).unwrap_or_else(|problems| panic!("{problems}"));
        let watched = &loaded.model.watched;
        (watched.diagnostics.clone(), watched.stamps)
    };
    assert_eq!(watched(""), (Vec::new(), StampClock::System));
    let text = "clock: ros\ndiagnostics: { topics: [/diagnostics, { topic: /robot1/diagnostics, prefix: 'robot1: ' }] }\n";
    let topic = |topic: &str, prefix: &str| DiagnosticsTopic { topic: topic.into(), prefix: prefix.into() };
    let expected = vec![topic("/diagnostics", ""), topic("/robot1/diagnostics", "robot1: ")];
    assert_eq!(watched(text), (expected, StampClock::Ros));
}

#[test]
fn what_is_no_such_topic_is_said() {
    check_beside_group(
        "diagnostics: { topics: [diagnostics, /a, /a, { prefix: x }] }\nclock: sim\n",
        &[
            "2:25: `diagnostics` is no full topic name (begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`)",
            "2:42: /a is read already (name each topic once)",
            "2:46: a topic of diagnostics needs `topic` (add `topic: ...`)",
            "3:8: unknown clock `sim` (one of: system, ros)",
        ],
    );
    check_beside_group(
        "diagnostics: { topics: [] }\n",
        &[
            "2:14: 0 topics of diagnostics; it can be 1 to 32 (write `diagnostics: { topics: [/diagnostics] }`)",
        ],
    );
    check_beside_group(
        "diagnostics: { topics: [/robot1/diagnostics] }\npublish: { toplevel_state: { topic: /diagnostics } }\n",
        &[],
    );
    check_beside_group(
        "diagnostics: { topics: [/diagnostics_agg] }\n",
        &[
            "2:25: /diagnostics_agg is read here, and published by this program as `diagnostics_agg` (read another topic, or write `publish: { diagnostics_agg: { topic: /OTHER } }`, or `diagnostics_agg: false`)",
        ],
    );
}
