//! Configurations of other diagnostics as ours: each file of `tests/import` gives a configuration and findings that
//! stand beside it. With TELLTALE_BLESS=1 they are written anew, for a person to read.

use std::path::{Path, PathBuf};

use telltale::config;
use telltale::onboarding::import::{Imported, Lookup, import};
use telltale::yaml::Sources;

use crate::folder::TestFolder;
use crate::program::telltale;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/import")
}

/// The files by names that are the same on every machine.
fn sources() -> Sources {
    let read = |name: &str| (name.to_owned(), std::fs::read_to_string(folder().join(name)).unwrap());
    let planning = std::fs::read_to_string(folder().join("graph_parts/planning.yaml")).unwrap();
    Sources::kept([
        read("arm.yaml"),
        read("nested_names.yaml"),
        read("ros1.yaml"),
        read("graph.yaml"),
        read("graph_parts/sensing.yaml"),
        ("/opt/my_graphs/planning.yaml".to_owned(), planning),
    ])
}

/// The findings, one in a line.
fn said(imported: &Imported) -> Vec<String> {
    let Some(findings) = &imported.findings else { return Vec::new() };
    let lines = findings.list().iter().zip(findings.lines());
    lines.map(|(found, line)| format!("{}{line}\n", if found.warning { "warning: " } else { "" })).collect()
}

#[track_caller]
fn check(name: &str, lost: usize) {
    let mut sources = sources();
    let file = sources.read(Path::new(&format!("{name}.yaml"))).unwrap();
    let lookup =
        Lookup { packages: vec![("my_graphs".into(), "/opt/my_graphs".into())], ..Lookup::default() };
    let imported = import(sources, &[file], &lookup).unwrap_or_else(|problems| panic!("{problems}"));
    let findings = said(&imported).join("");
    for (kind, found) in [("imported.yaml", &imported.text), ("findings.txt", &findings)] {
        let path = folder().join(format!("{name}.{kind}"));
        if std::env::var_os("TELLTALE_BLESS").is_some() {
            std::fs::write(&path, found).unwrap();
        }
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(*found, expected, "{}", path.display());
    }
    assert_eq!(imported.lost, lost);
    let loaded = config::parse("the result", &imported.text).unwrap_or_else(|problems| panic!("{problems}"));
    if let (_, Some(warnings)) = loaded.soundness() {
        panic!("{warnings}");
    }
}

#[test]
fn analyzers_become_groups() {
    check("arm", 3);
}

#[test]
fn parameters_may_have_dots_and_a_namespace() {
    check("nested_names", 0);
}

#[test]
fn the_form_of_ros_1_is_understood() {
    check("ros1", 1);
}

#[test]
fn a_graph_becomes_a_tree_with_its_loops_and_gaps_named() {
    check("graph", 5);
}

/// Imports a text that is wrong: nothing is made of it.
#[track_caller]
fn refused(text: &str, expected: &str) {
    let mut sources = Sources::default();
    let file = sources.add("f.yaml", text);
    let problems = import(sources, &[file], &Lookup::default()).map(|it| it.text).unwrap_err();
    assert_eq!(problems.lines().join("\n"), expected);
}

#[test]
fn what_is_neither_is_refused_with_what_would_be_read() {
    let help = "give it the parameters of diagnostic_aggregator (`ros__parameters:` with analyzers in it), or a diagnostic graph of Autoware (`units:`, `files:`)";
    refused(
        "robot: { speed: 3 }\n",
        &format!("f.yaml:1:1: these are neither analyzers nor a diagnostic graph ({help})"),
    );
    refused("- a\n", &format!("f.yaml:1:1: expected a map of keys, found a list ({help})"));
    refused(
        "vehicle: { id: v }\ngroups: [{ id: a }]\n",
        "f.yaml:2:1: this is a configuration of Telltale already (try `telltale check` with it)",
    );
    refused(
        "a:\n  ros__parameters: { path: X }\n",
        "f.yaml:2:3: there are no analyzers in this file (an analyzer is a map with `type: diagnostic_aggregator/GenericAnalyzer` and `path: NAME`)",
    );
    refused(
        "units: []\n",
        "f.yaml:1:1: there are no units in this graph (a unit is `{ path: /autoware/..., type: and, list: [...] }` below `units`)",
    );
}

/// What is found in a graph of one file.
#[track_caller]
fn found(text: &str, expected: &[&str]) {
    let mut sources = Sources::default();
    let file = sources.add("g.yaml", text);
    let imported =
        import(sources, &[file], &Lookup::default()).unwrap_or_else(|problems| panic!("{problems}"));
    let findings = said(&imported);
    assert_eq!(findings.iter().map(|line| line.trim_end()).collect::<Vec<_>>(), expected);
    config::parse("the result", &imported.text)
        .unwrap_or_else(|problems| panic!("{problems}\n{}", imported.text));
}

#[test]
fn what_is_wrong_in_a_graph_is_said_and_the_rest_is_kept() {
    let diag = "{ path: /d, type: diag, node: n, name: d }";
    found(&format!("units: [{diag}]\n"), &[]);
    found(
        &format!("units: [{diag}, {{ path: /d, type: ok }}, {{ path: /x }}, 3]\n"),
        &[
            "g.yaml:1:61: two units have the path `/d` (links lead to the first; give the other a path of its own)",
            "g.yaml:1:77: this unit has no `type` (add one of: and, or, short-circuit-and, warn-to-ok, warn-to-error, diag, link, ok, warn, error, stale)",
            "g.yaml:1:91: expected a unit, found `3` (write `{ path: /autoware/..., type: and, list: [...] }`)",
        ],
    );
    found(
        "files:\n  - { path: $(var x)/a.yaml }\n  - { path: $(find-pkg-share p)/a.yaml }\n  - { path: $(env X)/a.yaml }\nunits: [{ type: ok, path: /a }]\n",
        &[
            "g.yaml:2:13: the variable `x` has no value (give it one: `telltale import --var x=VALUE`)",
            "g.yaml:3:13: where the package `p` is installed is not known (source the workspace, or name its folder: `telltale import --package p=DIR`)",
            "g.yaml:4:13: there is no substitution `$(env X)` (known: `$(dirname)`, `$(find-pkg-share PACKAGE)`, `$(var NAME)`)",
        ],
    );
    // Each depends on the other: that has no order here.
    let both = "{ path: /a, type: and, dependent: /b, list: [{ type: ok }] }, { path: /b, type: and, dependent: /a, list: [{ type: ok }] }";
    let help = "(with the dependencies of this graph some unit would depend on itself: add those that matter as `depends_on`)";
    found(
        &format!("units: [{both}]\n"),
        &[
            "warning: g.yaml:1:43: here a unit is ignored while what it depends on is in ERROR or UNKNOWN, and names the cause (in Autoware it keeps its level and is marked; see docs/how-to/move-from-autoware.md)",
            &format!("g.yaml:1:43: the dependency on `/b` is left out {help}"),
            &format!("g.yaml:1:105: the dependency on `/a` is left out {help}"),
        ],
    );
}

#[test]
fn a_file_under_two_names_is_read_once_and_a_pipe_is_not_waited_for() {
    let folder = TestFolder::new("imported-files");
    std::fs::create_dir_all(&*folder).unwrap();
    let path = |name: &str| folder.join(name);
    std::fs::write(path("part.yaml"), "units: [{ path: /d, type: diag, node: n, name: d }]\n").unwrap();
    std::os::unix::fs::symlink(path("part.yaml"), path("alias.yaml")).unwrap();
    let made = std::process::Command::new("mkfifo").arg(path("pipe.yaml")).status().unwrap();
    assert!(made.success());
    let names = ["part", "alias", "pipe"].map(|name| format!("{{ path: $(dirname)/{name}.yaml }}"));
    std::fs::write(path("main.yaml"), format!("files: [{}]\nunits: []\n", names.join(", "))).unwrap();
    let mut sources = Sources::default();
    let file = sources.read(&path("main.yaml")).unwrap();
    let imported =
        import(sources, &[file], &Lookup::default()).unwrap_or_else(|problems| panic!("{problems}"));
    let found = said(&imported).join("\n");
    for part in ["alias.yaml` is in the graph already", "pipe.yaml` is no file"] {
        assert!(found.contains(part), "{found}");
    }
    assert_eq!((imported.text.matches("status:").count(), imported.lost), (1, 2), "{}", imported.text);
}

#[test]
fn a_value_of_the_wrong_kind_is_said_and_makes_nothing_ok() {
    let wrong = "units: [{ path: /m, type: and, list: { type: link, link: /a } }]\n";
    let mut sources = Sources::default();
    let file = sources.add("g.yaml", wrong);
    let imported =
        import(sources, &[file], &Lookup::default()).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(imported.lost, 1);
    assert!(said(&imported)[0].contains("`list` is a list of units, found"), "{:?}", said(&imported));
    assert!(!imported.text.contains("empty: ok"), "{}", imported.text);
}

#[test]
fn a_long_chain_of_units_ends_where_a_configuration_could_not_be_read() {
    let unit = |at: u32| {
        format!("  - {{ path: /u{at}, type: and, list: [{{ type: link, link: /u{} }}] }}\n", at + 1)
    };
    let units: String = (0..3000).map(unit).collect();
    let mut sources = Sources::default();
    let text = format!("units:\n{units}  - {{ path: /u3000, type: diag, node: n, name: d }}\n");
    let file = sources.add("g.yaml", &text);
    let imported =
        import(sources, &[file], &Lookup::default()).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(imported.lost, 1);
    config::parse("the result", &imported.text).unwrap_or_else(|problems| panic!("{problems}"));
}

#[test]
fn the_command_says_with_its_exit_code_whether_all_was_carried_over() {
    let run = |arguments: &[&str]| {
        let output = telltale(arguments).current_dir(folder()).output();
        let output = output.unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (code, text, said) = run(&["import", "nested_names.yaml"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(text.contains("groups:\n") && said.contains("everything was carried over"), "{text}{said}");
    let out = TestFolder::new("imports");
    std::fs::create_dir_all(&*out).unwrap();
    let written = out.join("graph.yaml");
    let written = written.to_str().unwrap();
    let (code, text, said) =
        run(&["import", "graph.yaml", "--package", "my_graphs=graph_parts", "-o", written]);
    assert_eq!((code, &*text), (Some(1), ""), "{said}");
    assert!(said.contains("5 things could not be carried over"), "{said}");
    assert_eq!(run(&["check", "-q", written]).0, Some(0));
    let (code, _, said) = run(&["import", "nothing.yaml"]);
    assert_eq!(code, Some(2));
    assert!(said.contains("`nothing.yaml` does not exist"), "{said}");
}
