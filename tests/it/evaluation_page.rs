//! What `docs/evaluation.md` says of the scenarios is computed from them, and of the live run from its figure.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use telltale::config;
use telltale::engine::input::Input;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use telltale::sim::scenario::{self, IgnoreReason, Outcome, Scenario, Transition};
use telltale::sim::scenario_file::{self, Config};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A scenario of the paper, and what became of it.
struct Played {
    scenario: Scenario,
    outcome: Outcome,
}

fn play(file: &str) -> Played {
    let path = root().join("config/scenarios").join(file);
    let file = scenario_file::load(&path).unwrap_or_else(|problems| panic!("{problems}"));
    let Config::Path(config) = &file.config else { panic!("it has the configuration of the shuttle") };
    let loaded = config::load(config).unwrap_or_else(|problems| panic!("{problems}"));
    let model = match file.dependencies {
        true => loaded.model,
        false => Arc::new(loaded.model.with_dependencies(Vec::clear)),
    };
    let scenario = file.bind(&model).unwrap_or_else(|problems| panic!("{problems}"));
    let outcome = scenario::run(model, &scenario);
    Played { scenario, outcome }
}

impl Played {
    /// Seconds after the fault.
    fn seconds(&self, at: Timestamp) -> f64 {
        let zero = self.scenario.figure.zero.as_ref().expect("it has a zero").0;
        (at.as_nanos() as f64 - zero.as_nanos() as f64) / 1e9
    }

    /// When this node changes to what is wanted for the first time after the fault.
    #[track_caller]
    fn when(&self, node: &str, wanted: impl Fn(&Transition) -> bool) -> f64 {
        let mut times = self.times(node, wanted).into_iter().filter(|at| *at >= 0.0);
        times.next().unwrap_or_else(|| panic!("{node} never does"))
    }

    fn times(&self, node: &str, wanted: impl Fn(&Transition) -> bool) -> Vec<f64> {
        let of_node = self.outcome.transitions.iter().filter(|it| &*it.node == node && wanted(it));
        of_node.map(|it| self.seconds(it.at)).collect()
    }

    /// When the last message came on a topic that falls silent.
    fn last(&self, topic: &str) -> f64 {
        let of_topic = |input: &Input| matches!(input, Input::Sample(it) if *it.source.topic == *topic);
        let steps = self.scenario.steps.iter().filter(|step| step.inputs.iter().any(of_topic));
        steps.filter_map(|step| step.repeat).map(|it| self.seconds(it.until)).next_back().expect("it is sent")
    }
}

fn error(it: &Transition) -> bool {
    it.state == State::Error
}

fn masked(it: &Transition) -> bool {
    it.why == IgnoreReason::Masked
}

fn ok(it: &Transition) -> bool {
    it.state == State::Ok
}

/// `0.2 s`: at most three places, without zeros at the end.
fn s(seconds: f64) -> String {
    let text = format!("{seconds:.3}");
    format!("{} s", text.trim_end_matches('0').trim_end_matches('.'))
}

#[track_caller]
fn says(page: &str, sentence: &str) {
    assert!(page.contains(sentence), "docs/evaluation.md should say: {sentence}");
}

fn page() -> String {
    fs::read_to_string(root().join("docs/evaluation.md")).expect("the page is there")
}

const LIDAR: &str = "sensors/velodyne_packet_alive";

#[test]
fn it_says_of_a_sensor_outage_what_the_scenarios_do() {
    let alone = play("1-sensor-outage-without-dependencies.yaml");
    let [localization, perception, sensors] =
        ["localization", "perception", "sensors"].map(|it| s(alone.when(it, error)));
    let alarms = alone.outcome.alarms;
    says(
        &page(),
        &format!(
            "Localization shows ERROR after {localization}, Perception after {perception} and Sensors, which counts packets in a sliding window, after {sensors}: {alarms} alarms for one broken sensor."
        ),
    );

    let known = play("2-sensor-outage.yaml");
    let (begins, ends) = (known.when("localization", error), known.when("localization", masked));
    assert_eq!(ends, known.when("sensors", error));
    says(&page(), &format!("Localization is in ERROR from {} to {},", s(begins), s(ends)));
    let behind = known.outcome.transitions.iter().find(|it| &*it.node == "perception" && masked(it));
    assert_eq!(&*behind.expect("it waits").causes[0], "localization/tf_quality");
    says(
        &page(),
        &format!(
            "Perception is in IGNORE from {} on, with Localization",
            s(known.when("perception", masked))
        ),
    );
    let [moved] = &known.outcome.moved[..] else { panic!("{:?}", known.outcome.moved) };
    assert_eq!((&*moved.symptom, &*moved.cause), ("localization/tf_quality", LIDAR));
    let (alarms, sounds) = (known.outcome.alarms, known.outcome.sounds);
    assert_eq!(sounds, 1);
    says(&page(), &format!("Localization raises {alarms} alarms, and a display sounds once."));
    let well = known.when("localization", ok);
    let sensor_ends = known.when("sensors", |it| it.state == State::Warning && known.seconds(it.at) > ends);
    assert_eq!((well, known.when("perception", ok)), (sensor_ends, sensor_ends));
    let sensor_ok = known.when("sensors", ok);
    says(
        &page(),
        &format!(
            "They show OK at {}, when the sensor leaves ERROR for WARNING, {} before it is OK.",
            s(well),
            s(sensor_ok - well)
        ),
    );
}

#[test]
fn it_says_of_the_other_scenarios_what_they_do() {
    let jump = play("3-localization-failure.yaml");
    let at = jump.when("localization", error);
    assert_eq!(at, jump.when("perception", masked));
    assert_eq!(
        jump.times("sensors", |it| it.state != State::Ok && jump.seconds(it.at) >= 0.0),
        Vec::<f64>::new()
    );
    says(&page(), &format!("Localization shows ERROR at {}, with the first position that jumped", s(at)));

    let stop = play("4-planner-error-at-a-stop.yaml");
    let own = stop.when("planning/planning: planner", |it| it.own == State::Error);
    assert_eq!((stop.outcome.alarms, stop.times("planning", |it| it.state != State::Ignore).len()), (0, 0));
    says(&page(), &format!("reports ERROR from {} on", s(own)));

    let starts = play("5-becoming-active.yaml");
    let from = starts.when("planning", |it| it.state == State::Unknown);
    let until = starts.when("planning", ok);
    let again = starts.when("planning", |it| it.why == IgnoreReason::NotRelevant);
    says(&page(), &format!("Planning is UNKNOWN from {} to {}, because the rate", s(from), s(until)));
    says(&page(), &format!("and IGNORE again on arrival, at {}", s(again)));

    let drives = play("6-planner-error-while-active.yaml");
    let noticed = drives.when("planning", error);
    assert_eq!(noticed, drives.when("execution", masked));
    says(&page(), &format!("{} after the last plan", s(noticed - drives.last("/planning/trajectory"))));
}

/// What a strip of a figure shows: ERROR and IGNORE, with what is reported behind that, from when on.
struct Bar {
    node: String,
    shown: &'static str,
    own_error: bool,
    from_s: f64,
}

/// The bars of a figure, from left to right, node by node.
fn bars(figure: &str) -> Vec<Bar> {
    let text = fs::read_to_string(root().join("docs/figures").join(figure)).expect("the figure is there");
    let titles = text.split("<title>").skip(1).filter_map(|rest| rest.split('<').next());
    let bar = |title: &str| {
        let (what, rest) = title.split_once(" from ")?;
        let (node, look) = what.split_once(": ")?;
        let shown = ["ERROR", "IGNORE"].into_iter().find(|word| look.starts_with(word)).unwrap_or("");
        let from_s = rest.split_once(" s to ")?.0.replace('\u{2212}', "-").parse().ok()?;
        Some(Bar { node: node.to_owned(), shown, own_error: title.contains("reports error itself"), from_s })
    };
    titles.filter_map(bar).collect()
}

/// When each node enters or leaves ERROR and IGNORE.
fn changes(bars: &[Bar]) -> Vec<(&str, &str, f64)> {
    let pairs = bars.windows(2).filter(|pair| pair[0].node == pair[1].node && pair[0].shown != pair[1].shown);
    pairs.map(|pair| (&*pair[1].node, pair[1].shown, pair[1].from_s)).collect()
}

#[test]
fn it_says_of_the_live_run_how_far_it_is_from_virtual_time() {
    let (live, virtual_time) = (bars("live-sensor-outage.svg"), bars("scenario-2.svg"));
    let (live_changes, virtual_changes) = (changes(&live), changes(&virtual_time));
    let steps = |changes: &[(&str, &str, f64)]| {
        changes.iter().map(|it| (it.0.to_owned(), it.1.to_owned())).collect::<Vec<_>>()
    };
    assert_eq!(steps(&live_changes), steps(&virtual_changes));
    let apart = live_changes.iter().zip(&virtual_changes).map(|(a, b)| (a.2 - b.2).abs());
    let apart_s = (apart.fold(0.0, f64::max) * 100.0).ceil() / 100.0;
    says(&page(), &format!("at most {} earlier or later than in virtual time", s(apart_s)));
    let at = |node: &str, shown: &str| {
        let found = live_changes.iter().find(|it| it.0 == node && it.1 == shown);
        s(found.expect("the figure shows it").2)
    };
    assert_eq!(at("localization", "ERROR"), at("perception", "IGNORE"));
    assert_eq!(at("localization", "IGNORE"), at("sensors", "ERROR"));
    says(&page(), &format!("Localization is in ERROR from {} on", at("localization", "ERROR")));
    says(&page(), &format!("at {} Sensors shows ERROR", at("sensors", "ERROR")));
    let own = |bars: &[Bar]| {
        s(bars.iter().find(|bar| bar.node == "perception" && bar.own_error).expect("it fails too").from_s)
    };
    says(
        &page(),
        &format!(
            "Perception itself reports ERROR from {} on, in virtual time from {}",
            own(&live),
            own(&virtual_time)
        ),
    );
}
