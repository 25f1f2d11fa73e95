//! Tests of the tree with imported analyzers against the rules of ROS 2's diagnostic_aggregator.

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use crate::publish::outputs::aggregate::{top, tree};
    use telltale_engine::Engine;
    use telltale_engine::input::{Input, StatusArray};
    use telltale_engine::model::output::{Like, TreeForm};
    use telltale_engine::snapshot::Snapshot;
    use telltale_engine::time::Timestamp;
    use telltale_onboarding::import::{Lookup, import};
    use telltale_yaml::Sources;

    const OK: u8 = 0;
    const WARN: u8 = 1;
    const ERROR: u8 = 2;
    const STALE: u8 = 3;

    /// The snapshot and the form of the tree at `end_s`, with statuses of these levels published each second until the
    /// given one.
    fn run(analyzers: &str, published: &[(&str, u8, u64)], end_s: u64) -> (Arc<Snapshot>, TreeForm) {
        let mut sources = Sources::default();
        let file = sources.add("analyzers.yaml", analyzers);
        let imported =
            import(sources, &[file], &Lookup::default()).unwrap_or_else(|problems| panic!("{problems}"));
        let loaded = telltale_config::parse("imported", &imported.text)
            .unwrap_or_else(|problems| panic!("{problems}"));
        let mut engine = Engine::new(loaded.model, Timestamp::ZERO);
        for second in 0..end_s {
            let mut array = StatusArray::default();
            for (name, level, until_s) in published {
                if second < *until_s {
                    array.push_status(*level, name, "said so", "unit");
                    array.push_value("k", "v");
                }
            }
            engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(second * 1000 + 10));
        }
        engine.handle(&Input::Tick, Timestamp::from_millis(end_s * 1000));
        (engine.snapshot(), loaded.publishing.tree)
    }

    /// Levels by path, without the statuses of Telltale itself.
    fn levels_in(snapshot: &Snapshot, form: &TreeForm) -> BTreeMap<String, u8> {
        let statuses = tree(snapshot, form);
        let told = statuses.iter().map(|status| (status.name().to_owned(), status.level()));
        let own = |path: &str| path.split('/').any(|part| part == "Telltale");
        told.filter(|(path, _)| !own(path)).collect()
    }

    fn levels(analyzers: &str, published: &[(&str, u8, u64)], end_s: u64) -> BTreeMap<String, u8> {
        let (snapshot, form) = run(analyzers, published, end_s);
        levels_in(&snapshot, &form)
    }

    #[track_caller]
    fn check(analyzers: &str, published: &[(&str, u8, u64)], end_s: u64, expected: &[(&str, u8)]) {
        let expected: BTreeMap<String, u8> =
            expected.iter().map(|&(path, level)| (path.to_owned(), level)).collect();
        assert_eq!(levels(analyzers, published, end_s), expected);
    }

    const ALWAYS: u64 = u64::MAX;

    fn robot(analyzers: &str) -> String {
        format!("analyzers:\n  ros__parameters:\n    path: Robot\n{analyzers}")
    }

    fn generic(name: &str, keys: &str) -> String {
        format!("    {name}: {{ type: diagnostic_aggregator/GenericAnalyzer, path: {name}, {keys} }}\n")
    }

    #[test]
    fn a_status_stands_in_each_analyzer_that_matches_it_and_keeps_its_spaces() {
        let text =
            robot(&(generic("Arms", "startswith: ['/arms']") + &generic("Left", "contains: ['/left']")));
        check(
            &text,
            &[("/arms/left/motor", OK, ALWAYS), ("/legs/left/motor", WARN, ALWAYS), ("cpu", ERROR, ALWAYS)],
            3,
            &[
                // A status that nobody takes does not count for the whole.
                ("/Robot", WARN),
                ("/Robot/Arms", OK),
                ("/Robot/Arms/ arms left motor", OK),
                ("/Robot/Left", WARN),
                ("/Robot/Left/ arms left motor", OK),
                ("/Robot/Left/ legs left motor", WARN),
                ("/Robot/Other", ERROR),
                ("/Robot/Other/cpu", ERROR),
            ],
        );
    }

    #[test]
    fn without_a_path_there_is_no_status_of_the_whole() {
        let text = "a:\n  ros__parameters:\n    g:\n      type: AnalyzerGroup\n      path: A/B\n      x: { type: GenericAnalyzer, path: X, name: [x] }\n";
        check(text, &[("x", OK, ALWAYS)], 2, &[("/A/B", OK), ("/A/B/X", OK), ("/A/B/X/x", OK)]);
    }

    #[test]
    fn a_header_is_stale_only_if_all_below_it_is() {
        let text = robot(&generic("A", "startswith: [a], timeout: 3.0"));
        let both = |a_until, b_until| [("a1", WARN, a_until), ("a2", OK, b_until)];
        let expected =
            |robot, a, a1, a2| [("/Robot", robot), ("/Robot/A", a), ("/Robot/A/a1", a1), ("/Robot/A/a2", a2)];
        check(&text, &both(9, 9), 9, &expected(WARN, WARN, WARN, OK));
        // Received last at 5.01 s, silent for less than 3 s, and for more.
        check(&text, &both(6, 9), 8, &expected(WARN, WARN, WARN, OK));
        check(&text, &both(6, 20), 9, &expected(ERROR, ERROR, STALE, OK));
        check(&text, &both(6, 6), 20, &expected(STALE, STALE, STALE, STALE));
        // Nothing ever matched.
        check(&text, &[], 1, &[("/Robot", STALE), ("/Robot/A", STALE)]);
        check(&text, &[], 20, &[("/Robot", STALE), ("/Robot/A", STALE)]);
        // An error is stale as well once it is silent.
        check(&text, &[("a1", ERROR, 6), ("a2", OK, 20)], 8, &expected(ERROR, ERROR, ERROR, OK));
        check(&text, &[("a1", ERROR, 6), ("a2", OK, 20)], 9, &expected(ERROR, ERROR, STALE, OK));
        check(&text, &[("a1", ERROR, 6), ("a2", ERROR, 6)], 20, &expected(STALE, STALE, STALE, STALE));
        // A reported STALE is as bad as silence.
        check(&text, &[("a1", STALE, ALWAYS), ("a2", OK, ALWAYS)], 3, &expected(ERROR, ERROR, STALE, OK));
    }

    #[test]
    fn what_is_stale_is_discarded_where_that_is_wanted() {
        let part = |foo: bool, bar: bool| {
            let one = |name: &str, discard: bool| {
                format!(
                    "          {name}: {{ type: diagnostic_aggregator/GenericAnalyzer, path: {name}, find_and_remove_prefix: ['/{name}'], discard_stale: {discard} }}\n"
                )
            };
            let group = "    part:\n      type: diagnostic_aggregator/AnalyzerGroup\n      path: agg\n      analyzers:\n";
            robot(&format!("{group}{}{}", one("foo", foo), one("bar", bar))).replace("Robot", "robot")
        };
        // Whether each discards, the level of each (if it is published), and that of the group before and since the
        // releases that changed it.
        for (foo, foo_level, bar, bar_level, before, expected) in [
            (true, None, true, None, OK, OK),
            (true, Some(STALE), true, Some(STALE), OK, OK),
            (true, None, true, Some(STALE), OK, OK),
            (false, None, false, None, STALE, STALE),
            (false, Some(STALE), false, Some(STALE), STALE, STALE),
            (false, None, false, Some(STALE), STALE, STALE),
            (true, None, false, None, ERROR, STALE),
            (true, Some(OK), false, None, ERROR, STALE),
            (true, Some(WARN), false, None, ERROR, WARN),
            (true, None, false, Some(OK), OK, OK),
            (true, Some(OK), false, Some(OK), OK, OK),
        ] {
            let levels_of = [("/foo", foo_level), ("/bar", bar_level)];
            let published: Vec<(&str, u8, u64)> =
                levels_of.iter().filter_map(|&(name, level)| Some((name, level?, ALWAYS))).collect();
            let (snapshot, form) = run(&part(foo, bar), &published, 7);
            let found = levels_in(&snapshot, &form);
            let older = levels_in(&snapshot, &TreeForm { like: Like::Before, ..form });
            assert_eq!((older["/robot/agg"], older["/robot"]), (before, before), "{foo} {bar}");
            let case = format!("{foo} {foo_level:?} {bar} {bar_level:?}: {found:?}");
            assert_eq!(found["/robot/agg"], expected, "{case}");
            // The prefix is the whole name: nothing of it is left.
            assert_eq!(found.get("/robot/agg/foo/"), foo_level.as_ref(), "{case}");
        }
        // At its timeout a discarded status is gone, and was never stale.
        let text = robot(&generic("A", "startswith: [a], timeout: 3.0, discard_stale: true"));
        check(
            &text,
            &[("a1", ERROR, 6)],
            8,
            &[("/Robot", ERROR), ("/Robot/A", ERROR), ("/Robot/A/a1", ERROR)],
        );
        check(&text, &[("a1", ERROR, 6)], 9, &[("/Robot", OK), ("/Robot/A", OK)]);
    }

    #[test]
    fn what_is_expected_is_missed_and_is_taken_by_others_too() {
        let one = "expected: ['prefix1: a', 'prefix1: b'], remove_prefix: [prefix1]";
        let text = robot(&(generic("First", one) + &generic("Second", "contains: [a]")));
        let first = |robot, first, a, b| {
            [("/Robot", robot), ("/Robot/First", first), ("/Robot/First/a", a), ("/Robot/First/b", b)]
        };
        let nothing = [&first(STALE, STALE, STALE, STALE)[..], &[("/Robot/Second", STALE)]].concat();
        check(&text, &[], 1, &nothing);
        check(&text, &[], 30, &nothing);
        let second = [("/Robot/Second", OK), ("/Robot/Second/prefix1: a", OK)];
        let half = [&first(ERROR, ERROR, OK, STALE)[..], &second].concat();
        check(&text, &[("prefix1: a", OK, ALWAYS)], 3, &half);
        let whole = [&first(OK, OK, OK, OK)[..], &second].concat();
        check(&text, &[("prefix1: a", OK, ALWAYS), ("prefix1: b", OK, ALWAYS)], 3, &whole);
    }

    #[test]
    fn the_number_of_items_is_counted() {
        let text = robot(&generic("A", "startswith: [a], num_items: 2"));
        let a1 = ("a1", OK, ALWAYS);
        check(&text, &[], 20, &[("/Robot", STALE), ("/Robot/A", STALE)]);
        check(&text, &[a1], 20, &[("/Robot", ERROR), ("/Robot/A", ERROR), ("/Robot/A/a1", OK)]);
        let two = [("/Robot", OK), ("/Robot/A", OK), ("/Robot/A/a1", OK), ("/Robot/A/a2", OK)];
        check(&text, &[a1, ("a2", OK, ALWAYS)], 20, &two);
        check(&text, &[("a1", OK, 1)], 20, &[("/Robot", STALE), ("/Robot/A", STALE), ("/Robot/A/a1", STALE)]);
        let none = robot(&generic("A", "startswith: [a], num_items: 0"));
        check(&none, &[], 20, &[("/Robot", OK), ("/Robot/A", OK)]);
    }

    #[test]
    fn what_nobody_takes_is_in_other_for_a_while_unless_it_is_dropped() {
        let drop = "    d: { type: diagnostic_aggregator/DiscardAnalyzer, path: D, contains: [debug] }\n    i: { type: diagnostic_aggregator/IgnoreAnalyzer, path: I, contains: [old] }\n";
        let text = robot(&(generic("A", "startswith: [a]") + drop));
        let published = [("a debug", OK, ALWAYS), ("b debug", ERROR, ALWAYS), ("old", WARN, 3)];
        let a = [("/Robot", OK), ("/Robot/A", OK), ("/Robot/A/a debug", OK)];
        let other = [("/Robot/Other", WARN), ("/Robot/Other/old", WARN)];
        check(&text, &published, 7, &[&a[..], &other].concat());
        check(&text, &published, 8, &a);
        let errors = text.replace("path: Robot\n", "path: Robot\n    other_as_errors: true\n");
        let found = levels(&errors, &published, 7);
        assert_eq!((found["/Robot"], found["/Robot/Other"]), (OK, ERROR));
        assert_eq!(levels(&errors, &published, 8).get("/Robot/Other"), None);
    }
    #[test]
    fn one_silent_status_makes_its_analyzer_an_error_but_a_silent_analyzer_makes_the_whole_stale() {
        let text = robot(&(generic("A", "startswith: [a], timeout: 2.0") + &generic("B", "startswith: [b]")));
        let whole = |published: &[(&str, u8, u64)], like| {
            let (snapshot, form) = run(&text, published, 9);
            let form = TreeForm { like, ..form };
            let found = levels_in(&snapshot, &form);
            (found["/Robot/A"], found["/Robot"], top(&snapshot, &form).get(0).level())
        };
        let one = [("a1", OK, 3), ("a2", OK, ALWAYS), ("b", OK, ALWAYS)];
        assert_eq!(whole(&one, Like::Before), (ERROR, ERROR, ERROR));
        assert_eq!(whole(&one, Like::Since), (ERROR, ERROR, ERROR));
        let all = [("a1", OK, 3), ("b", OK, ALWAYS)];
        assert_eq!(whole(&all, Like::Before), (STALE, ERROR, ERROR));
        assert_eq!(whole(&all, Like::Since), (STALE, STALE, STALE));
        let warned = [("a1", OK, 3), ("b", WARN, ALWAYS)];
        assert_eq!(whole(&warned, Like::Before), (STALE, ERROR, ERROR));
        assert_eq!(whole(&warned, Like::Since), (STALE, WARN, WARN));
        // A status that nobody takes counts there, and nowhere else.
        let other = [("a1", OK, ALWAYS), ("b", OK, ALWAYS), ("c", WARN, ALWAYS)];
        assert_eq!(whole(&other, Like::Since), (OK, OK, WARN));
    }

    #[test]
    fn the_whole_names_its_worst_status() {
        let text = robot(&generic("A", "startswith: [a], timeout: 2.0"));
        let told = |published: &[(&str, u8, u64)], like| {
            let (snapshot, form) = run(&text, published, 5);
            let top = top(&snapshot, &TreeForm { like, ..form });
            let status = top.get(0);
            let has_value = status.values().any(|value| value == ("k", "v"));
            (
                status.name().to_owned(),
                status.message().to_owned(),
                status.hardware_id().to_owned(),
                has_value,
            )
        };
        let of = |message: &str, unit: &str, has_value| {
            ("toplevel_state".to_owned(), message.to_owned(), unit.to_owned(), has_value)
        };
        let failing = [("a1", WARN, ALWAYS), ("a2", ERROR, ALWAYS)];
        assert_eq!(told(&failing, Like::Since), of("/Robot/A/a2: said so", "unit", true));
        assert_eq!(told(&failing, Like::Before), of("Error", "", false));
        assert_eq!(told(&[("a1", OK, ALWAYS)], Like::Since), of("OK", "", false));
    }

    #[test]
    fn a_level_that_nothing_names_is_an_error() {
        let text = robot(&generic("A", "startswith: [a]"));
        for level in [4, 5, 255] {
            let error = [("/Robot", ERROR), ("/Robot/A", ERROR), ("/Robot/A/a", ERROR)];
            check(&text, &[("a", level, ALWAYS)], 3, &error);
        }
    }

    #[test]
    fn a_wrong_number_is_one_from_the_start_whatever_the_timeout() {
        for timeout in ["", ", timeout: 2.0", ", timeout: 30.0"] {
            let text = robot(&generic("A", &format!("startswith: [a], num_items: 1{timeout}")));
            let both = [("a1", OK, ALWAYS), ("a2", OK, ALWAYS)];
            let wrong = [("/Robot", ERROR), ("/Robot/A", ERROR), ("/Robot/A/a1", OK), ("/Robot/A/a2", OK)];
            check(&text, &both, 1, &wrong);
            check(&text, &both, 9, &wrong);
            check(&text, &both[..1], 1, &[("/Robot", OK), ("/Robot/A", OK), ("/Robot/A/a1", OK)]);
        }
    }

    #[test]
    fn slashes_in_paths_stay() {
        let text =
            robot("    a: { type: GenericAnalyzer, path: /A, startswith: [a] }\n").replace("Robot", "/R");
        let all = [("//R", OK), ("//R//A", OK), ("//R//A/a", OK)];
        check(&text, &[("a", OK, ALWAYS)], 1, &all);
    }

    #[test]
    fn a_prefix_that_the_path_has_already_stays_in_the_names() {
        let group = "    imu: { type: AnalyzerGroup, path: imu_node, x: { type: GenericAnalyzer, path: General, find_and_remove_prefix: [imu_node, gyro] } }\n";
        let published = [("imu_node: Model", OK, ALWAYS), ("gyro: Rate", OK, ALWAYS)];
        let levels = levels(&robot(group), &published, 1);
        let names: Vec<&str> = levels.keys().map(String::as_str).collect();
        let inside = ["", "/General", "/General/Rate", "/General/imu_node: Model"];
        let expected: Vec<String> = inside.iter().map(|rest| format!("/Robot/imu_node{rest}")).collect();
        assert_eq!(names[1..], expected);
        // Without another prefix, a colon and spaces at the beginning go all the same.
        let only = group.replace("imu_node, gyro", "imu_node, /imu_node");
        let found = self::levels(&robot(&only), &[("/imu_node/rate", OK, ALWAYS)], 1);
        assert!(found.contains_key("/Robot/imu_node/General/imu_node rate"), "{found:?}");
    }

    #[test]
    fn values_are_left_out_where_that_is_wanted() {
        let text = robot(&generic("A", "startswith: [a]"));
        let values = |text: &str| {
            let (snapshot, form) = run(text, &[("a", OK, ALWAYS)], 1);
            tree(&snapshot, &form).iter().map(|status| status.values().len()).sum::<usize>()
        };
        assert!(values(&text) > 0);
        assert_eq!(values(&text.replace("path: Robot\n", "path: Robot\n    publish_values: false\n")), 0);
    }
}
