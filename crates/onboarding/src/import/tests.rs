//! Which parameters an import takes if they stand in several sections and files.

use super::{Imported, Lookup, import};
use telltale_yaml::Sources;

/// The parameters of all files together, `node` being the aggregator's.
fn of(files: &[(&str, &str)], node: Option<&str>) -> Imported {
    let mut sources = Sources::default();
    let files: Vec<u16> = files.iter().map(|(name, text)| sources.add(name, text)).collect();
    let lookup = Lookup { node: node.map(str::to_owned), ..Lookup::default() };
    let imported = import(sources, &files, &lookup).unwrap_or_else(|problems| panic!("{problems}"));
    if let Err(problems) = telltale_config::parse("the result", &imported.text) {
        panic!("{problems}\n{}", imported.text);
    }
    imported
}

fn lines(imported: &Imported) -> Vec<String> {
    imported.findings.as_ref().map(|findings| findings.lines()).unwrap_or_default()
}

#[track_caller]
fn has(imported: &Imported, parts: &[&str]) {
    for part in parts {
        assert!(imported.text.contains(part), "no `{part}` in\n{}\n{:#?}", imported.text, lines(imported));
    }
}

/// Everything is carried over, and the result has these parts.
#[track_caller]
fn whole(text: &str, parts: &[&str]) {
    let imported = of(&[("a.yaml", text)], None);
    assert_eq!((imported.lost, lines(&imported)), (0, vec![]));
    has(&imported, parts);
}

const BASE: &str = "{ type: diagnostic_aggregator/GenericAnalyzer, path: Base, startswith: [base] }";
const CPU: &str = "{ type: diagnostic_aggregator/GenericAnalyzer, path: CPU, contains: [cpu] }";

#[test]
fn sections_of_a_node_and_of_patterns_are_put_together() {
    whole(
        &format!(
            "/**:\n  ros__parameters: {{ path: Robot, pub_rate: 2.0, other_as_errors: true }}\nanalyzers:\n  ros__parameters: {{ base: {BASE} }}\n"
        ),
        &["path: Robot, rate: 2 Hz", "state: error", "name: Base"],
    );
    whole(
        &format!(
            "/**:\n  ros__parameters: {{ cpu: {CPU} }}\nanalyzers:\n  ros__parameters: {{ path: Robot, base: {BASE} }}\n"
        ),
        &["path: Robot }", "name: CPU", "name: Base"],
    );
    // The later section counts, also where it is that of a pattern.
    whole(
        &format!(
            "/robot/analyzers:\n  ros__parameters: {{ path: First, base: {BASE} }}\n/robot/**:\n  ros__parameters: {{ path: Second }}\n"
        ),
        &["path: Second }", "name: Base"],
    );
}

#[test]
fn a_name_may_be_a_list_and_the_beginning_of_names() {
    whole(
        "analyzers:\n  ros__parameters:\n    analyzers: [lidar, imu]\n    analyzers.lidar.type: GenericAnalyzer\n    analyzers.lidar.path: Lidar\n    analyzers.lidar.contains: [lidar]\n    imu.type: GenericAnalyzer\n    imu.path: IMU\n    imu.contains: [imu]\n",
        &["name: Lidar", "contains: lidar", "name: IMU", "contains: imu"],
    );
}

#[test]
fn what_every_node_has_is_no_analyzer() {
    whole(
        &format!(
            "/analyzers:\n  ros__parameters:\n    base: {BASE}\n    path: Robot\n    qos_overrides: {{ /parameter_events: {{ publisher: {{ depth: 1000 }} }} }}\n    start_type_description_service: true\n    use_sim_time: false\n"
        ),
        &["path: Robot }", "name: Base"],
    );
    let simulated =
        of(&[("a.yaml", &format!("a:\n  ros__parameters: {{ use_sim_time: true, base: {BASE} }}\n"))], None);
    assert!(lines(&simulated)[0].contains("`clock: ros`"), "{:?}", lines(&simulated));
}

#[test]
fn a_file_of_ros_1_may_have_the_name_of_the_node_around_its_parameters() {
    let imported = of(
        &[(
            "a.yaml",
            "diagnostic_aggregator:\n  pub_rate: 1.0\n  base_path: ''\n  analyzers:\n    ekf: { type: GenericAnalyzer, path: EKF, startswith: ekf }\n    safety: { type: GenericAnalyzer, path: Safety, startswith: Safety }\nother_node: { rate: 3 }\nstray: 1\n",
        )],
        None,
    );
    has(&imported, &["name: EKF", "name: Safety"]);
    assert_eq!(
        lines(&imported),
        [
            "a.yaml:7:1: the parameters of `/other_node` are not those of `/diagnostic_aggregator` (they are left out; `--node NAME` names another node)",
            "a.yaml:8:1: `stray` stands outside of the node (it is left out: move it to the parameters of the node)",
        ]
    );
    assert_eq!(imported.lost, 1);
}

#[test]
fn several_files_are_put_together_and_the_later_one_counts() {
    let first = format!("/**:\n  ros__parameters: {{ path: First, critical: true, base: {BASE} }}\n");
    let second = "/**:\n  ros__parameters:\n    path: Second\n    publish_values: false\n    base.path: Chassis\n    base.timeout: 2.0\n";
    let imported = of(&[("a.yaml", &first), ("b.yaml", second)], None);
    assert_eq!((imported.lost, lines(&imported)), (0, vec![]));
    has(
        &imported,
        &["path: Second, values: false, at_once: true", "name: Chassis", "timeout: 2s", "a.yaml, b.yaml"],
    );
    // Of one name in one file the later counts, too, and it is said.
    let twice = format!("a:\n  ros__parameters:\n    path: One\n    base: {BASE}\n    base.path: Two\n");
    let imported = of(&[("a.yaml", &twice)], None);
    has(&imported, &["name: Two"]);
    assert_eq!(lines(&imported), ["a.yaml:5:16: `base.path` is given again (keep one of the two)"]);
}

#[test]
fn of_several_aggregators_one_is_imported_and_the_others_are_named() {
    let text = format!(
        "front:\n  analyzers:\n    ros__parameters: {{ path: Front, base: {BASE} }}\nrear:\n  analyzers:\n    ros__parameters: {{ path: Rear, cpu: {CPU} }}\n/**:\n  ros__parameters: {{ pub_rate: 2.0 }}\ndriver:\n  ros__parameters: {{ rate: 5 }}\nstray: {{ a: 1 }}\n"
    );
    let first = of(&[("a.yaml", &text)], None);
    has(&first, &["path: Front, rate: 2 Hz", "name: Base"]);
    assert_eq!(first.lost, 2, "{:#?}", lines(&first));
    let said = lines(&first).join("\n");
    for part in
        ["`--node /rear/analyzers`", "parameters of `/driver`", "`stray` stands outside of `ros__parameters`"]
    {
        assert!(said.contains(part), "{said}");
    }
    let second = of(&[("a.yaml", &text)], Some("rear/analyzers"));
    has(&second, &["path: Rear, rate: 2 Hz", "name: CPU"]);
    // A caller that asks for one node knows of the others; a part outside all nodes is lost all the same.
    assert_eq!((second.lost, lines(&second).len()), (1, 3));
    let mut sources = Sources::default();
    let file = sources.add("a.yaml", &text.replace("/**", "/x"));
    let lookup = Lookup { node: Some("nobody".into()), ..Lookup::default() };
    let refused = import(sources, &[file], &lookup).map(|it| it.text).unwrap_err().lines().join("\n");
    assert!(refused.contains("no parameters of the node `/nobody`"), "{refused}");
    assert!(refused.contains("`/rear/analyzers`"), "{refused}");
}

#[test]
fn a_graph_is_one_file() {
    let mut sources = Sources::default();
    let files = [sources.add("a.yaml", "units: []\n"), sources.add("b.yaml", "units: []\n")];
    let refused = import(sources, &files, &Lookup::default()).map(|it| it.text).unwrap_err();
    assert!(refused.lines()[0].contains("a graph is one file"), "{refused}");
}

#[test]
fn a_name_with_many_parts_is_said_and_survived() {
    let deep = ["a"; 100].join(".");
    let text = format!("a:\n  ros__parameters:\n    base: {BASE}\n    {deep}.type: GenericAnalyzer\n");
    assert_eq!(of(&[("a.yaml", &text)], None).lost, 1);
}

#[test]
fn slashes_and_prefixes_in_paths_are_carried_over_and_said() {
    let text = "a:\n  ros__parameters:\n    path: /R\n    base: { type: GenericAnalyzer, path: /Base, startswith: [base] }\n    imu: { type: GenericAnalyzer, path: imu, find_and_remove_prefix: [imu] }\n";
    let imported = of(&[("a.yaml", text)], None);
    assert_eq!(imported.lost, 0);
    has(&imported, &["path: '/R'", "name: '/Base'", "{ regex: 'imu.*', prefix: [':'] }"]);
    assert_eq!(
        lines(&imported),
        [
            "a.yaml:3:11: the paths begin with `//R`, as with diagnostic_aggregator (for one `/`, remove that of `path` below `publish`)",
            "a.yaml:5:5: `imu` stays in the names of the statuses: the path `//R/imu` has it already (diagnostic_aggregator does so, and it is imported so; to leave it out, write it under `prefix`)",
            "a.yaml:5:5: diagnostic_aggregator takes `imu` off the path `//R/imu`, too, and then does not count the analyzer for the level above it (here it has its whole path, and counts)",
        ]
    );
}

#[test]
fn what_is_expected_and_may_go_is_said_once() {
    let text = "a:\n  ros__parameters:\n    base: { type: GenericAnalyzer, path: Base, expected: ['one', 'two'], discard_stale: true }\n";
    let imported = of(&[("a.yaml", text)], None);
    has(&imported, &["name: one, forget_after: 5s", "name: two, forget_after: 5s", "empty: ok"]);
    assert_eq!(lines(&imported).len(), 1);
    assert!(
        lines(&imported)[0].starts_with("a.yaml:3:59: `discard_stale` lets go"),
        "{:?}",
        lines(&imported)
    );
}

#[test]
fn the_same_link_that_leads_nowhere_gets_the_same_suggestion() {
    let unit = |path: &str| format!("  - {{ path: {path}, type: ok }}\n");
    let link = "  - { path: /m, type: and, list: [{ type: link, link: /mrm_domain/planning/available }] }\n";
    let (near, far) = (unit("/mrm_comain/planning/available"), unit("/foolproof/available"));
    for text in [format!("units:\n{link}{near}{far}"), format!("units:\n{far}{near}{link}")] {
        let said = lines(&of(&[("g.yaml", &text)], None)).join("\n");
        assert!(said.contains("did you mean `/mrm_comain/planning/available`?"), "{said}");
    }
}
