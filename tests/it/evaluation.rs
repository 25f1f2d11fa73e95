//! The figures of `docs/evaluation.md` are those that the program draws today, and a history can be drawn.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, SystemTime};

use telltale::clock::Clock;
use telltale::engine::event::Said;
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};
use telltale::engine::view::record::{Record, Recorded};
use telltale::store::History;

use crate::folder::TestFolder;
use crate::program::run;

/// All files of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, String> {
    let entries = fs::read_dir(folder).expect("the folder is there");
    let file = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry.expect("the folder can be listed");
        let text = fs::read_to_string(entry.path()).expect("figures are text");
        (entry.file_name().to_string_lossy().into_owned(), text)
    };
    entries.map(file).collect()
}

#[test]
fn the_committed_figures_are_what_the_command_draws() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let drawn = std::env::temp_dir().join(format!("telltale-figures-{}", std::process::id()));
    let status = Command::new(root.join("docs/evaluation.sh"))
        .arg(&drawn)
        .env("TELLTALE", env!("CARGO_BIN_EXE_telltale"))
        .stdout(std::process::Stdio::null())
        .status()
        .expect("the script can be run");
    assert!(status.success(), "{status}");
    let (drawn_files, committed) = (files(&drawn), files(&root.join("docs/figures")));
    fs::remove_dir_all(&drawn).expect("the folder is ours");
    let drawn_once = |name: &&String| name.starts_with("live-");
    let names = |files: &BTreeMap<String, String>| {
        files.keys().filter(|name| !drawn_once(name)).cloned().collect::<Vec<_>>()
    };
    assert_eq!(names(&drawn_files), names(&committed));
    let page = fs::read_to_string(root.join("docs/evaluation.md")).expect("the page is there");
    for (name, text) in &drawn_files {
        // Not assert_eq: nobody reads two drawings as text.
        assert!(*text == committed[name], "docs/figures/{name} is old: run docs/evaluation.sh");
    }
    for (name, text) in &committed {
        assert!(page.contains(&format!("figures/{name}")), "docs/evaluation.md does not show {name}");
        assert_readable(name, text);
    }
}

/// On any page, and without another figure beside it.
fn assert_readable(name: &str, text: &str) {
    let ground = text.find("<rect class=\"page\" width=\"100%\" height=\"100%\"/>");
    let first = text.find("<text").expect("it has words");
    assert!(ground.is_some_and(|at| at < first), "{name} has no ground of its own");
    let legend = &text[text.rfind("<g transform=\"translate(0 ").expect("it has a legend")..];
    for words in [
        ">OK<",
        ">WARNING<",
        ">ERROR<",
        "owed to the cause",
        "IGNORE, because what it depends on fails",
        "IGNORE, because the vehicle's state makes it pointless",
        ">UNKNOWN<",
        "signal is true",
        "signal is false",
        "signal is unknown",
        "a line at its foot what it reports itself",
    ] {
        assert!(legend.contains(words), "the legend of {name} does not explain {words}");
    }
}

#[test]
fn a_history_is_drawn_as_it_was() {
    let folder = TestFolder::new("drawn");
    fs::create_dir_all(&*folder).expect("it can be made");
    // A minute ago the position jumped; a second later the sensor behind it showed itself.
    let (clock, hand) = Clock::with_hand();
    hand.advance(Span::from_secs(60));
    let (_history, queue) = History::open(&folder, clock).expect("it can be made");
    let shown = |node: &str, state, own, cause: Option<&str>| Recorded::Shown {
        node: node.into(),
        state,
        own,
        cause: cause.map(Into::into),
        said: (state == State::Error)
            .then(|| Said::of("no \u{202e}data", Some(Span::from_secs(2))))
            .flatten(),
        began: None,
    };
    let records = [
        (0, Recorded::Started { anew: false }),
        (0, shown("sensors", State::Ok, State::Ok, None)),
        (0, shown("localization", State::Ok, State::Ok, None)),
        (0, Recorded::Signal { name: "active".into(), value: Some(true) }),
        (1000, shown("localization", State::Error, State::Error, None)),
        (2000, shown("sensors", State::Error, State::Error, None)),
        (2000, shown("localization", State::Ignore, State::Error, Some("sensors/lidar"))),
        (3000, shown("sensors", State::Ok, State::Ok, None)),
    ];
    let record =
        |(ms, what): &(u64, Recorded)| Record { at: Timestamp::from_millis(*ms), what: what.clone() };
    queue.send(records.iter().map(record).collect()).expect("somebody writes");
    let start: SystemTime = clock.wall() - Duration::from_nanos(clock.now().as_nanos());
    let at = humantime::format_rfc3339_millis(start + Duration::from_secs(1)).to_string();
    let figure = folder.join("figure.svg");
    let draw = |node: &str| {
        let folder = folder.to_string_lossy();
        let when = ["history", "--data", &folder, "--at", &at, "--before", "1s", "--after", "3s"];
        let what = ["--node", "sensors", "--node", node, "--signal", "active", "--event", "it jumps"];
        run([&when[..], &what, &["--figure", &figure.to_string_lossy()]].concat())
    };
    let deadline = clock.now() + Span::from_secs(30);
    while !draw("localization").status.success() {
        assert!(clock.now() < deadline, "{:?}", draw("localization"));
    }
    let drawn = fs::read_to_string(&figure).expect("it is drawn");
    for (what, from_s, to_s, more) in [
        ("localization: OK", -1.0, 0.0, ""),
        (
            "localization: ERROR, owed to the cause that showed itself later",
            0.0,
            1.0,
            ", owed to sensors/lidar: silent for 2 s; last: no \\u{202e}data",
        ),
        (
            "localization: IGNORE, because what it depends on fails",
            1.0,
            3.0,
            ", waits for sensors/lidar, reports error itself",
        ),
        ("sensors: ERROR", 1.0, 2.0, ": silent for 2 s; last: no \\u{202e}data"),
        ("active: signal is true", -1.0, 3.0, ""),
    ] {
        let titles = drawn.split("<title>").map(|rest| rest.split('<').next().unwrap_or_default());
        let found = titles.filter_map(|title| title.strip_prefix(what)?.strip_prefix(" from "));
        let found: Vec<&str> = found.collect();
        let [span] = found[..] else { panic!("{what}: {found:?} in {drawn}") };
        let (from, rest) = span.split_once(" s to ").expect("a span");
        let (to, said) = rest.split_once(" s").expect("a span");
        let seconds = |text: &str| text.replace('\u{2212}', "-").parse::<f64>().expect("seconds");
        // The wall's clock is read in milliseconds.
        let near = (seconds(from) - from_s).abs() < 0.1 && (seconds(to) - to_s).abs() < 0.1;
        assert!(near && said == more, "{what} from {span}");
    }
    assert!(drawn.contains(">it jumps<"), "{drawn}");
    assert_readable("the figure", &drawn);
    let nobody = draw("localisation");
    let said = String::from_utf8_lossy(&nobody.stderr).into_owned();
    assert!(nobody.status.code() == Some(1) && said.contains("nothing is recorded"), "{said}");
}
