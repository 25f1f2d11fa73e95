//! Tests of the report of an incident: its contents, escaping and bounds.

use super::*;
use crate::texts::Lang;
use telltale_record::story::{Happened, Moment, NodeStrip, Period, Story, ToldTopic};
use telltale_record::summary::{FrozenNode, Recording, Summary, TriggerLine, kind};
use telltale_store::Note;

/// A name that a stranger gave.
const HOSTILE: &str = "</style><script src=//evil>\u{202e}'\"><img src=x onerror=alert(1)>&{{7*7}}\u{0}";

fn incident(name: &str) -> Incident {
    let trigger = TriggerLine {
        at_ms: 1_700_000_000_000,
        kind: kind::ROOT.into(),
        what: name.into(),
        alarm: Some(1),
        note: String::new(),
    };
    let frozen = FrozenNode {
        node: name.into(),
        state: "error".into(),
        message: name.into(),
        values: vec![(name.into(), name.into())],
        at_ms: None,
    };
    let recording = Recording {
        file: file_name(12),
        bytes: 2_500_000,
        pre_roll_s: 30.0,
        finished: true,
        sha256: Some("ab".repeat(32)),
        messages: 7,
        missing: 3,
        interrupted: false,
        gone: false,
        left_out: 4,
        left_out_bytes: 9_000_000,
    };
    let summary = Summary {
        id: 12,
        since_ms: 1_700_000_000_000,
        until_ms: Some(1_700_000_012_000),
        stage: "active".into(),
        triggers: vec![trigger],
        roots: vec![name.into()],
        vehicle: name.into(),
        configuration: "cd".repeat(32),
        version: "0.1.0".into(),
        freeze: vec![frozen],
        recording,
        ..Summary::default()
    };
    Incident { summary, kept: true, note: Some(Note { text: name.into(), by: name.into(), at_ms: 0 }) }
}

fn story(name: &str, periods: i64) -> Story {
    let from_ms = 1_699_999_970_000;
    let moment = |at_ms, what| Moment { at_ms, what };
    let fails =
        Happened::Fails { node: name.into(), state: "error".into(), message: name.into(), began_ms: None };
    let period = |index: i64, state: &str, by: Option<&str>| Period {
        from_ms: from_ms + index * 10,
        to_ms: from_ms + index * 10 + 10,
        state: state.into(),
        own: "error".into(),
        masked_by: by.map(str::to_owned),
        message: name.into(),
    };
    let states = ["ok", "warning", "error", "unknown"];
    let strip = |index: i64| NodeStrip {
        node: format!("{name}{index}"),
        periods: (0..periods).map(|at| period(at, states[(at % 4) as usize], None)).collect(),
    };
    Story {
        from_ms,
        to_ms: 1_700_000_012_000,
        moments: vec![
            moment(1_700_000_000_000, fails),
            moment(
                1_700_000_000_100,
                Happened::Masks { by: name.into(), nodes: vec![name.into(); 12], more: 2 },
            ),
            moment(1_700_000_000_200, Happened::Mark { by: name.into(), note: name.into() }),
            moment(1_700_000_001_000, Happened::Operator { action: "reset", on: name.into() }),
            moment(1_700_000_001_000, Happened::Signal { signal: "slowing".into(), value: Some(true) }),
            moment(1_700_000_001_000, Happened::Request { request: "decelerate".into() }),
        ],
        more_moments: 9,
        strips: (0..40).map(strip).collect(),
        more_periods: 5,
        stages: vec![period(0, "active", None)],
        signals: vec![NodeStrip { node: "slowing".into(), periods: vec![period(0, "true", None)] }],
        topics: vec![ToldTopic {
            topic: name.into(),
            type_name: name.into(),
            messages: 1,
            bytes: 1,
            left_out: 2,
            left_out_bytes: 3,
            first_ms: 0,
            last_ms: 500,
        }],
        complete: true,
        ..Story::default()
    }
}

/// The document without its stylesheet.
fn document(lang: Lang, incident: &Incident, read: &Read, proof: &Proof) -> String {
    let document = report(lang, incident, (read, proof), 1_700_000_100_000);
    let (head, rest) = document.split_once("<style>").unwrap();
    let (style, body) = rest.split_once("</style>").unwrap();
    assert_eq!(style, STYLE, "its hash is that of the policy");
    assert!(!style.contains("url(") && !style.contains("@import") && !style.contains('<'), "{style}");
    format!("{head}{body}")
}

fn told(name: &str, periods: i64) -> Read {
    Read::Told(Box::new(story(name, periods)))
}

#[test]
fn a_report_without_its_numbers_says_that_they_are_still_being_found() {
    let (incident, says) = (incident("sensors"), "still being found");
    assert!(!document(Lang::En, &incident, &told("sensors", 4), &Proof::Same).contains(says));
    let pending = Read::Told(Box::new(Story { series_pending: true, ..story("sensors", 4) }));
    assert!(document(Lang::En, &incident, &pending, &Proof::Same).contains(says));
}

#[test]
fn a_report_has_everything_and_says_how_to_verify_it() {
    let name = "sensors/velodyne_packet_alive";
    let document = document(Lang::En, &incident(name), &told(name, 4), &Proof::Same);
    for part in [
        "Incident report 12",
        "2023-11-14 22:13:20 UTC",
        "12 s",
        "Autonomous",
        "fault",
        "kept",
        "22:13:20.0",
        "+0.1 s",
        "hides: sensors/velodyne_packet_alive",
        "and 2 more",
        "Marked by sensors/velodyne_packet_alive",
        "The operator resets",
        "asked to slow down",
        "+9 not shown here",
        "+5 not shown here",
        "bar bar-error",
        "Signal slowing: true",
        "data-signal=\"slowing\"",
        "url(#p-warning)",
        "id=\"p-warning\"",
        "sensors/<wbr>velodyne_<wbr>packet_<wbr>alive0",
        "2.5 MB",
        "30.0 s before the first trigger",
        "Missing: 3",
        &"ab".repeat(32),
        &"cd".repeat(32),
        "<pre>$ sha256sum incident-12.mcap\nab",
        "abab  incident-12.mcap</pre>",
        "<pre>$ telltale incident verify 12 --data DIR</pre>",
        "still had it",
        "written 2023-11-14 22:15 UTC",
    ] {
        assert!(document.contains(part), "{part}: {document}");
    }
    let german = self::document(Lang::De, &incident(name), &told(name, 4), &Proof::None);
    for part in ["<html lang=\"de\">", "Vorfallbericht 12", "verdeckt: ", "So wird die Aufzeichnung geprüft"]
    {
        assert!(german.contains(part), "{part}: {german}");
    }
    assert!(!german.contains("hatte ihn noch"), "nothing was compared");
}

#[test]
fn nothing_in_a_report_acts_or_leads_elsewhere() {
    for lang in Lang::ALL {
        let document =
            document(lang, &incident(HOSTILE), &told(HOSTILE, 8), &Proof::Other(HOSTILE.to_owned()));
        let tags = document.split('<').skip(1).map(|tag| tag.split_once('>').expect("a tag ends").0);
        // Names of elements and of their attributes, without values.
        let words = tags.flat_map(|tag| tag.split('"').step_by(2)).flat_map(|part| part.split_whitespace());
        let acts = words.map(|word| word.trim_end_matches('=')).find(|word| {
            [
                "script", "img", "a", "link", "iframe", "object", "embed", "form", "input", "base", "image",
                "use",
            ]
            .contains(word)
                || ["src", "srcset", "href", "xlink:href", "style", "background"].contains(word)
                || word.starts_with("on")
        });
        assert_eq!(acts, None, "{document}");
        assert!(!document.contains(['\u{202e}', '\u{0}']), "{document}");
        assert!(document.contains("default-src &#39;none&#39;; style-src &#39;sha256-"), "{document}");
    }
}

#[test]
fn a_recording_that_cannot_be_read_leaves_what_the_database_knows() {
    let incident = incident("sensors/lidar");
    for (read, says) in [
        (Read::Missing, "its file is missing"),
        (
            Read::Bad("<no> MCAP".into()),
            "cannot be read: &#60;no&#62; MCAP. What follows is what the database",
        ),
    ] {
        let document = document(Lang::En, &incident, &read, &Proof::None);
        for part in [says, "sensors/lidar: Error", "id=\"freeze\"", &"ab".repeat(32)] {
            assert!(document.contains(part), "{part}: {document}");
        }
        assert!(!document.contains("id=\"states\"") && !document.contains("has no messages"), "{document}");
    }
    let hash = "ef".repeat(32);
    let document = document(Lang::En, &incident, &told("a/b", 1), &Proof::Other(hash.clone()));
    assert!(
        document.contains(&format!(
            "the file was changed, and what follows was read from it. Its hash is {hash}"
        ))
    );
    let mut open = incident;
    (open.summary.recording.finished, open.summary.recording.sha256) = (false, None);
    let document = self::document(Lang::En, &open, &told("a/b", 1), &Proof::None);
    assert!(document.contains("has no hash") && !document.contains("sha256sum"), "{document}");
}

#[test]
fn the_largest_report_can_be_used() {
    let long = "x".repeat(4000);
    let mut largest = story(&long, 100);
    largest.moments = vec![largest.moments[1].clone(); 400];
    largest.topics = vec![largest.topics[0].clone(); 1024];
    let mut incident = incident(&long);
    incident.summary.roots = (0..256).map(|index| format!("{long}{index}")).collect();
    let document = document(Lang::En, &incident, &Read::Told(Box::new(largest)), &Proof::Same);
    assert!(document.len() < 4_000_000, "{} bytes", document.len());
}
