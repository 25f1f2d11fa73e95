use std::collections::HashMap;

use super::*;
use crate::config::parse;

fn drawn(text: &str) -> String {
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    svg(&loaded.model)
}

/// Left edges of the boxes of the groups at the top, by their names.
fn columns(drawing: &str) -> HashMap<String, i64> {
    let boxes = drawing.split("<g class=\"box depth-0\" transform=\"translate(").skip(1);
    let column = |part: &str| {
        let x = part.split(' ').next().unwrap();
        let name = part.split("<title>").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
        (name.to_owned(), x.parse::<f64>().unwrap() as i64)
    };
    boxes.map(column).collect()
}

#[test]
fn what_is_depended_on_stands_left_and_every_dependency_has_an_arrow() {
    let drawing = drawn(include_str!("../../../../config/shuttle.yaml"));
    let columns = columns(&drawing);
    for way in [
        ["sensors", "localization"],
        ["localization", "perception"],
        ["prediction", "planning"],
        ["planning", "execution"],
    ] {
        assert!(columns[way[0]] < columns[way[1]], "{way:?} {columns:?}");
    }
    assert_eq!(columns["sensors"], columns["mission"]);
    let arrows = drawing.matches(" depends on ").count();
    let model = parse("c", include_str!("../../../../config/shuttle.yaml")).unwrap().model;
    let of_groups = model.groups.iter().flat_map(|group| &group.depends_on);
    let of_modules = model.modules.iter().flat_map(|module| &module.depends_on);
    let named: usize = of_groups.chain(of_modules).map(|it| it.on.nodes().len()).sum();
    assert_eq!(arrows, named);
}

#[test]
fn tiles_that_need_each_other_crosswise_are_drawn_all_the_same() {
    let drawing = drawn(
        "groups:
  - { id: a, modules: [{ id: m, status: a, depends_on: [b/n] }, { id: n, status: b }] }
  - { id: b, modules: [{ id: m, status: c, depends_on: [a/n] }, { id: n, status: d }] }
  - { id: c, name: 'a <b> & c', depends_on: [{ on: a, masks_when: [error, unknown] }, { any_of: [b/m] }], match: [{ name: x }] }
",
    );
    assert_eq!(columns(&drawing).len(), 3);
    assert_eq!(drawing.matches(" depends on ").count(), 4);
    assert!(drawing.contains("a &lt;b&gt; &amp; c") && !drawing.contains("NaN"));
}

#[test]
fn one_group_is_a_graph() {
    assert!(drawn("groups: [{ id: a, modules: [{ id: m, status: s }] }]\n").ends_with("</svg>\n"));
}
