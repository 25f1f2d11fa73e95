//! Tests of configurations: files that are read, files that are refused, and the words of a refusal.

mod countermeasures;
mod diagnostics;
mod difference;
mod fleet;
mod monitors;
mod motion;
mod named;
mod nodes;
mod publishing;
mod recording;
mod schema;
mod services;
mod shuttle;
mod signals;
mod slips;
mod soundness;

use std::path::PathBuf;

use super::*;
use telltale_engine::model::filter::Filter;
use telltale_engine::model::wording::Wording;
use telltale_engine::model::{Combine, DependsOn, GroupId, ModuleId, NodeId, Policy, Stage};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_engine::time;

/// All problems of a text, in order, as `line:column: message (what to do)`.
#[track_caller]
fn check(text: &str, expected: &[&str]) {
    let found = match parse("c", text) {
        Ok(_) => Vec::new(),
        Err(problems) => problems.lines(),
    };
    let found: Vec<&str> = found.iter().map(|line| line.strip_prefix("c:").unwrap_or(line)).collect();
    assert_eq!(found, expected);
}

/// A group with a module, for texts in which something else matters.
const GROUP: &str = "groups: [{ id: a, modules: [{ id: m, status: s }] }]\n";

#[track_caller]
fn check_beside_group(text: &str, expected: &[&str]) {
    check(&format!("{GROUP}{text}"), expected);
}

#[test]
fn a_minimal_configuration_has_defaults() {
    let loaded = parse("c", GROUP).unwrap();
    let model = &loaded.model;
    assert_eq!((&*model.vehicle_id, &*model.vehicle_name.de), ("vehicle", "vehicle"));
    assert_eq!(model.groups[0].name, Text::plain("a"));
    assert_eq!(&*model.modules[0].id, "a/m");
    assert_eq!(model.modules[0].policy, Policy::default());
    assert_eq!(loaded.model.driving.localized_after, time::Span::from_secs(2));
}

#[test]
fn everything_that_is_written_reaches_the_model() {
    let text = r"
vehicle: { id: v, name: { en: Van, de: Bus }, stages: none }
signals:
  active: { topic: /a, type: std_msgs/msg/Bool, timeout: 3s }
  goal: { topic: /g, type: geometry_msgs/msg/PoseStamped, present_for: 1h }
stops: [{ id: depot, name: Depot, x: 1.5, y: -2, yaw_deg: 90 }]
defaults: { timeout: 1s, stale: warning, raise_after: 10ms }
limits: { discovered_modules: 7 }
display: { dpi: 170 }
localized_after: 5s
groups:
  - id: a
    combine: any
    tile: { column: 2, row: 1 }
    match: [{ namespace: /a }, { regex: 'x.*' }, { name: 'n: o' }, { contains: p }]
    modules:
      - { id: m, status: 's: t', stale: error, latch: 500ms, name: M, help: { en: Stop., de: Halt. } }
    groups:
      - { id: in, match: [{ contains: q }], when: { stages: [active], signals: { goal: false } } }
  - id: b
    depends_on: [a/in, { any_of: [a, a/m] }, { on: a/m, masks_when: [error, unknown] }]
    modules: [{ id: n, monitor: { self_state: { status: u } } }]
";
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let model = &loaded.model;
    assert_eq!((&*model.vehicle_name.en, &*model.vehicle_name.de), ("Van", "Bus"));
    assert_eq!(model.display_dpi, 170);
    assert_eq!(model.signals[0].timeout, Some(time::Span::from_secs(3)));
    assert_eq!(model.signals[1].present_for, Some(time::Span::from_secs(3600)));
    let fields = model.signals.iter().map(|signal| &*signal.source.field().unwrap().field);
    assert_eq!(fields.collect::<Vec<_>>(), ["data", ""]);
    assert_eq!(
        (
            loaded.model.driving.stops[0].x_m,
            loaded.model.driving.stops[0].y_m,
            loaded.model.driving.stops[0].yaw_deg
        ),
        (1.5, -2.0, 90.0)
    );
    assert_eq!(model.limits.discovered_modules, 7);

    let group = &model.groups[0];
    assert_eq!((group.combine, group.tile), (Combine::Any, Some((2, 1))));
    assert_eq!(group.filters[0], Filter::Namespace("/a".into()).into());
    assert!(group.filters[1].filter.matches("xyz") && !group.filters[1].filter.matches("axyz"));
    assert_eq!((&*model.groups[1].path, model.groups[1].parent), ("a/in", Some(GroupId(0))));
    let when = model.groups[1].when.as_ref().unwrap();
    assert_eq!((&when.stages[..], &when.signals[..]), (&[Stage::Active][..], &[(1, false)][..]));

    let policy = &model.modules[0].policy;
    assert_eq!((policy.timeout, policy.stale), (time::Span::from_secs(1), State::Error));
    assert_eq!(
        (policy.raise_after, policy.latch),
        (time::Span::from_millis(10), Some(time::Span::from_millis(500)))
    );
    assert_eq!(
        model.modules[0].help,
        Some(Wording::help(Text { en: "Stop.".into(), de: "Halt.".into() }).into())
    );

    let (a, m) = (NodeId::Group(GroupId(0)), NodeId::Module(ModuleId(0)));
    let depends: Vec<_> =
        model.groups[2].depends_on.iter().map(|d| (d.on.clone(), d.masks_unknown)).collect();
    let inner = NodeId::Group(GroupId(1));
    let expected =
        [(DependsOn::Node(inner), false), (DependsOn::AnyOf(vec![a, m]), false), (DependsOn::Node(m), true)];
    assert_eq!(depends, expected);
}

#[test]
fn the_robot_is_valid_and_has_words_for_people_who_stand_beside_it() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robot.yaml");
    let loaded = load(&path).unwrap_or_else(|problems| panic!("{problems}"));
    assert!(loaded.soundness().1.is_none());
    for module in &loaded.model.modules {
        let (name, help) = (module.name.as_ref().unwrap(), module.help.as_ref().unwrap());
        for state in [State::Error, State::Unknown] {
            let (name, help) = (name.of(state, Stage::Active), help.of(state, Stage::Active));
            let (Some(name), Some(help)) = (name, help) else { panic!("{} {state:?}", module.id) };
            for said in [&name.en, &name.de, &help.text.en, &help.text.de] {
                let lower = said.to_lowercase();
                for shuttle in ["take over", "übernehm", "stop", "anhalten", "control room", "leitstelle"] {
                    assert!(!lower.contains(shuttle), "{}: {said}", module.id);
                }
            }
        }
    }
}

#[test]
fn all_problems_come_at_once_in_the_order_of_the_file() {
    check(
        "vehicle: { id: v, stges: none }\ngroups:\n  - id: a\n    depends_on: [b]\n    modules: [{ id: m, status: s, timeout: 2 sek }]\n",
        &[
            "1:19: unknown key `stges` in the vehicle (did you mean `stages`?)",
            "4:18: there is no group or module `b` (write the full name: `group`, `group/module` or `group/group/module`)",
            "5:44: expected a duration, found `2 sek` (write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`)",
        ],
    );
}

#[test]
fn a_problem_shows_its_line_with_a_caret_and_what_to_do() {
    let problems =
        parse("c.yaml", "groups:\n  - id: a\n    dependson: [b]\n    match: [{ name: n }]\n").unwrap_err();
    let expected = "  × unknown key `dependson` in a group
   ╭─[c.yaml:3:5]
 2 │   - id: a
 3 │     dependson: [b]
   ·     ────┬────
   ·         ╰── here
 4 │     match: [{ name: n }]
   ╰────
  help: did you mean `depends_on`?

";
    assert_eq!(problems.render(false), expected);
}

#[test]
fn keys_must_be_known_and_stand_once() {
    check_beside_group(
        "modules: []\n",
        &["2:1: a module stands in no group (move `modules` into one of the `groups`)"],
    );
    check_beside_group(
        "colour: red\n",
        &[
            "2:1: unknown key `colour` in a configuration (known here: include, vehicle, signals, stops, motion, defaults, limits, display, localized_after, other, groups, countermeasures, publish, recording, services, fleet, diagnostics, clock, message_folders)",
        ],
    );
    check_beside_group("groups: []\n", &["2:1: `groups` stands twice (keep one of the two)"]);
    check(
        "groups: [{ id: a, id: b, match: [{ name: n }] }]\n",
        &["1:19: `id` stands twice (keep one of the two)"],
    );
}

#[test]
fn values_must_be_what_the_key_says() {
    check(
        "groups: 7\n",
        &[
            "1:9: expected a list, found `7` (write `[one, two]`, or each item in a line of its own after `- `)",
        ],
    );
    check(
        "[1]\n",
        &["1:1: expected a configuration, found a list (write `key: value` lines, or `{ key: value }`)"],
    );
    check_beside_group(
        "limits: { string_bytes: many }\n",
        &["2:25: expected a whole number, found `many` (write digits only, for example `12`)"],
    );
    check_beside_group(
        "limits: { string_bytes: 1 }\n",
        &["2:25: 1 is not between 16 and 1048576 (the default is 4096)"],
    );
    check_beside_group(
        "display: { dpi: 15 }\n",
        &["2:17: 15 is not between 60 and 400 (the default is 149)"],
    );
    check_beside_group(
        "stops: [{ id: s, x: .inf, y: 0 }]\n",
        &["2:21: expected a number, found `.inf` (write digits with a point, for example `12.5`)"],
    );
    check_beside_group(
        "vehicle: { name: {} }\n",
        &["2:18: a text needs `en` or `de` (write the text alone, or `{ en: ..., de: ... }`)"],
    );
    check_beside_group("vehicle: { id: }\n", &["2:14: expected a text, found nothing (write a value)"]);
    check_beside_group(
        "defaults: { timeout: 5 }\n",
        &[
            "2:22: expected a duration, found `5` (write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`)",
        ],
    );
    check_beside_group(
        "defaults: { timeout: 0s }\n",
        &[
            "2:22: a timeout of nothing would make everything stale at once (write a duration above 0, for example `2s`)",
        ],
    );
    check_beside_group(
        "defaults: { stale: ok }\n",
        &["2:20: unknown stale state `ok` (one of: unknown, warning, error)"],
    );
    check_beside_group(
        "vehicle: { stages: shutle }\n",
        &["2:20: unknown stage model `shutle` (did you mean `shuttle`?)"],
    );
}

#[test]
fn what_is_not_yaml_says_where() {
    check("", &["1:1: the file is empty"]);
    check("# nothing\n", &["1:1: the file is empty"]);
    check(
        "a: b\n---\nc: d\n",
        &["2:1: a second document begins here (keep one document in a file: remove the `---`)"],
    );
    check(
        "vehicle: !x { id: a }\n",
        &[
            "1:13: a value has a tag (`!...`), which means nothing here (quote the whole value if the `!` belongs to it, such as CEL's not: `'!value'`; else remove the tag)",
        ],
    );
    check("? [a]\n: b\n", &["1:3: a key must be one word (write `key: value`)"]);
    let problems = parse("c", "groups: [a\n").unwrap_err();
    assert!(problems.lines()[0].contains("this is not YAML"), "{problems}");
}

#[test]
fn anchors_work_but_do_not_explode() {
    parse("c", "groups:\n  - { id: a, match: &m [{ name: n }] }\n  - { id: b, match: *m }\n").unwrap();
    let mut bomb = String::from("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n");
    for level in 1..9 {
        let list = vec![format!("*a{}", level - 1); 10].join(", ");
        bomb.push_str(&format!("a{level}: &a{level} [{list}]\n"));
    }
    check(
        &bomb,
        &[
            "5:45: the aliases of this file stand for more than 100000 values (write the values out instead of nesting anchors)",
        ],
    );
    check(
        "a: &a [*a]\n",
        &[
            "1:8: this alias lies inside of what it refers to (write the value out, or refer to another anchor)",
        ],
    );
    let deep = "[".repeat(100_000);
    assert!(parse("c", &deep).unwrap_err().lines()[0].contains("this is not YAML"));
}

/// A directory of its own for a test, removed when it ends.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Scratch {
        let path = std::env::temp_dir().join(format!("telltale-config-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Scratch(path)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Problems of a file, with the directory left out.
    fn problems(&self, path: &Path) -> Vec<String> {
        let prefix = format!("{}/", self.0.display());
        let lines = load(path).map_or_else(|problems| problems.lines(), |_| Vec::new());
        lines.iter().map(|line| line.replace(&prefix, "")).collect()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn files_that_cannot_be_read_say_why() {
    let scratch = Scratch::new("unreadable");
    assert_eq!(
        scratch.problems(&scratch.0.join("none.yaml")),
        ["`none.yaml` does not exist (check the path)"]
    );
    let lines = load(&scratch.0).unwrap_err().lines();
    assert!(lines[0].ends_with("is a directory (name a file in it)"), "{lines:?}");
    let latin = scratch.write("latin.yaml", b"a: b\nname: M\xfcll\n");
    let expected =
        "`latin.yaml` is not UTF-8 text: byte 13 in line 2 is wrong (save the file with the encoding UTF-8)";
    assert_eq!(scratch.problems(&latin), [expected]);
}

#[test]
fn included_files_add_to_the_lists() {
    let scratch = Scratch::new("include");
    scratch
        .write("b.yaml", b"include: [c.yaml]\ngroups: [{ id: b, depends_on: [a], match: [{ name: n }] }]\n");
    scratch.write("c.yaml", b"groups: [{ id: c, depends_on: [b], match: [{ name: n }] }]\n");
    let main = format!("include: [b.yaml]\n{GROUP}");
    let main = scratch.write("a.yaml", main.as_bytes());
    let loaded = load(&main).unwrap_or_else(|problems| panic!("{problems}"));
    let paths: Vec<&str> = loaded.model.groups.iter().map(|group| &*group.path).collect();
    assert_eq!(paths, ["a", "b", "c"]);
}

#[test]
fn includes_go_wrong_with_the_line_that_asked_for_them() {
    let scratch = Scratch::new("include-wrong");
    scratch.write("b.yaml", b"include: [a.yaml]\nvehicle: { id: b }\ngroups: [{ id: a, depends_on: [c] }]\n");
    let main = format!("include: [none.yaml, b.yaml]\n{GROUP}");
    let main = scratch.write("a.yaml", main.as_bytes());
    assert_eq!(
        scratch.problems(&main),
        [
            "a.yaml:1:11: `none.yaml` does not exist (check the path)",
            "b.yaml:1:11: `a.yaml` is included twice (include each file once, and no file from itself)",
            "b.yaml:2:1: `vehicle` in a file that is included (move `vehicle` to `a.yaml`)",
            "b.yaml:3:16: group `a` is declared twice (rename or remove one of the two)",
            "b.yaml:3:32: there is no group or module `c` (write the full name: `group`, `group/module` or `group/group/module`)",
        ]
    );
}

#[test]
fn a_file_without_groups_says_whether_the_key_is_there() {
    let help = "(for example `groups: [{ id: sensors, match: [{ namespace: /sensors }] }]`)";
    let missing = format!("1:1: there are no `groups`: nothing would be diagnosed {help}");
    check("vehicle: { id: v }\n", &[&missing]);
    let empty = format!("2:1: `groups` is empty: nothing would be diagnosed {help}");
    check("vehicle: { id: v }\ngroups: []\n", &[&empty]);
    check("vehicle: { id: v }\ngroups:\n", &[&empty]);
}

#[test]
fn what_a_file_holds_does_not_act_on_the_terminal() {
    for text in [
        "groups: [{ id: g\u{1b}[31m }]\n",
        "groups: [{ id: g, depends_on: [\"z\\e[2J\\u202ez\"] }]\n# \u{202e}\n",
        "groups: [{ id: g, \"w\\e]0;\": 1 }] # \u{2066}\u{9b}2J\n",
    ] {
        let problems = parse("c\u{1b}[1m", text).unwrap_err();
        let shown = problems.render(false) + &problems.lines().concat();
        let acts = |letter: &char| {
            letter.is_control() && *letter != '\n'
                || matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        };
        assert_eq!(shown.chars().find(acts), None, "{shown:?}");
    }
}
