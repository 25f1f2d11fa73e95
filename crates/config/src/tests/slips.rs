//! Tests of common mistakes, and of the suggested corrections.

use super::{check, check_beside_group};
use crate::parse;
use telltale_engine::text::Text;

#[test]
fn a_tab_is_pointed_at() {
    let help = "this is not YAML: a tab indents this line (use spaces: YAML allows no tab in an indentation)";
    check("groups:\n- id: a\n\tmodules: []\n", &[&format!("3:1: {help}")]);
    let module = "groups:\n  - id: a\n    modules:\n\t- { id: m, status: s }\n";
    check(module, &[&format!("4:1: {help}")]);
}

#[test]
fn the_name_of_a_status_wants_quotes() {
    check(
        "groups:\n- id: a\n  modules:\n  - id: m\n    status: imu: status\n",
        &["5:13: this is not YAML: a second `: ` in one value (quote it: `status: 'imu: status'`)"],
    );
    check(
        "groups: [{ id: a, modules: [{ id: m, status: imu: status }] }]\n",
        &["1:46: this is not YAML: a second `: ` in one value (quote it: `status: 'imu: status'`)"],
    );
    check(
        "groups:\n- id: a\n  match:\n  - name: imu: it's up\n",
        &["4:11: this is not YAML: a second `: ` in one value (quote it: `name: 'imu: it''s up'`)"],
    );
}

#[test]
fn a_second_key_on_one_line_wants_braces() {
    let help = "this is not YAML: a second key on one line (write `monitor: { value: ... }`, or `value:` on a line of its own below, further in than `monitor`)";
    let module = "groups:\n- id: a\n  modules:\n  - id: m\n";
    let monitor = "monitor: value: { status: s, key: k, error_above: 1 }";
    check(&format!("{module}    {monitor}\n"), &[&format!("5:14: {help}")]);
    check(
        &format!("{module}    monitor: value:\n      status: s\n      key: k\n      error_above: 1\n"),
        &[&format!("5:14: {help}")],
    );
}

#[test]
fn a_pattern_of_file_names_is_no_filter() {
    let of = |filter: &str, expected: &[&str]| {
        check(&format!("groups:\n- id: a\n  match: [{{ {filter} }}]\n"), expected);
    };
    for sound in
        ["name: 'A* planner'", "regex: 'imu: *status'", "regex: 'door_*left'", "regex: 'lidar-*front'"]
    {
        of(sound, &[]);
    }
    of(
        "regex: 'imu*'",
        &[
            "3:24: in a regular expression `u*` is any number of `u` (write `contains: imu` or `regex: 'imu.*'`; if it is meant so, `(?:u)*`)",
        ],
    );
    of(
        "regex: '*imu*'",
        &[
            "3:21: this is no regular expression: repetition operator missing expression (it looks like a pattern of file names: write `contains: imu` or `regex: '.*imu.*'`)",
        ],
    );
    of(
        "regex: '?imu'",
        &[
            "3:21: this is no regular expression: repetition operator missing expression (it looks like a pattern of file names: write `contains: imu` or `regex: '.imu'`)",
        ],
    );
    for fine in [
        "regex: 'imu.*'",
        "regex: 'imu?'",
        "regex: '(ab)*'",
        "regex: '[a-z]*'",
        "regex: 'im(?:u)*'",
        "regex: 'a\\*b'",
        "name: imu",
    ] {
        of(fine, &[]);
    }
    of(
        "startswith: /amcl",
        &[
            "3:13: there is no filter `startswith` (write `namespace: /amcl` for names that begin with it up to a `/` or `:`, or `regex: '/amcl.*'` for any)",
        ],
    );
}

#[test]
fn a_filter_that_there_is_not_is_said_once_with_what_to_write() {
    for (filter, help) in [
        (
            "prefix: /amcl",
            "write `namespace: /amcl` for names that begin with it up to a `/` or `:`, or `regex: '/amcl.*'` for any",
        ),
        ("ends_with: x.y", "write `regex: '.*x\\.y'`"),
        ("glob: '/amcl*'", "write `contains: /amcl` or `regex: '/amcl.*'`"),
        ("glob: '/amcl[!x]?'", "write `contains: /amcl` or `regex: '/amcl[^x].'`"),
        ("like: amcl", "write `contains: amcl`"),
        ("pattern: amcl.+", "write `regex: 'amcl.+'`"),
        ("equals: amcl", "write `name: amcl`"),
        ("namspace: amcl", "did you mean `namespace`?"),
    ] {
        let key = filter.split(':').next().unwrap_or_default();
        let text = format!("groups:\n- id: a\n  match: [{{ {filter}, timeout: 1s }}]\n");
        check(&text, &[&format!("3:13: there is no filter `{key}` ({help})")]);
    }
}

#[test]
fn a_key_that_stands_too_far_out_is_answered_with_its_place() {
    check_beside_group(
        "stages: none\n",
        &[
            "2:1: unknown key `stages` in a configuration (`stages` belongs to the vehicle: indent it below `vehicle:`)",
        ],
    );
    check_beside_group(
        "timeout: 1s\n",
        &[
            "2:1: unknown key `timeout` in a configuration (`timeout` belongs to `defaults`, for all modules: indent it below `defaults:`)",
        ],
    );
    check(
        "groups:\n- id: a\n  match: [{ name: s }]\n  stale: error\n",
        &[
            "4:3: unknown key `stale` in a group (`stale` belongs to a module: indent it as the `id` of one in `modules`)",
        ],
    );
}

fn is_no_number(limit: &str, written: &str, help: &str) {
    let monitor = format!("{{ value: {{ status: s, key: k, {limit}: {written} }} }}");
    check(
        &format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {monitor} }}] }}]\n"),
        &[&format!("1:90: expected a number, found `{written}` (write the number {help})")],
    );
}

#[test]
fn a_word_in_the_place_of_a_number_is_given_none_by_chance() {
    let help = "that is meant: the definition of a message has those of its names";
    is_no_number("error_above", "CHARGING", help);
}

#[test]
fn a_percentage_is_no_number() {
    is_no_number("error_below", "25.60 V", "alone, in the unit of the value: `25.60`");
    let help = "alone, in the unit of the value: `20`, or `0.2` where it goes from 0 to 1";
    is_no_number("error_below", "20%", help);
}

#[test]
fn a_text_in_one_language_is_read_by_everybody() {
    for (written, expected) in [("{ en: Van }", "Van"), ("{ de: Bus }", "Bus"), ("Van", "Van")] {
        let text = format!("{}vehicle: {{ name: {written} }}\n", super::GROUP);
        let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(loaded.model.vehicle_name, Text::plain(expected));
    }
    check_beside_group(
        "vehicle: { name: { en: A, fr: B } }\n",
        &["2:27: unknown key `fr` in a text in two languages (known here: en, de)"],
    );
}
