//! Tests of the arrows between tiles.

use super::*;

fn hot(published: &Published) -> Vec<(String, String)> {
    let html = fragment(published, Lang::En, "arrows");
    let arrows = html.split("<g ").filter(|arrow| arrow.contains("data-hot"));
    let attribute = |arrow: &str, name: &str| {
        let rest = arrow.split_once(&format!("{name}=\"")).expect("the attribute").1;
        rest.split('"').next().unwrap_or_default().to_owned()
    };
    let mut hot: Vec<_> =
        arrows.map(|arrow| (attribute(arrow, "data-from"), attribute(arrow, "data-to"))).collect();
    hot.sort();
    hot
}

#[test]
fn every_dependency_is_drawn() {
    let calm = Sample::shuttle(true).published();
    let html = fragment(&calm, Lang::En, "arrows");
    assert_eq!(html.matches("<g ").count(), 10, "{html}");
    for (from, to) in [("sensors", "localization"), ("sensors", "perception"), ("localization", "planning")] {
        assert!(html.contains(&format!("data-from=\"{from}\" data-to=\"{to}\"")), "{html}");
    }
    assert!(hot(&calm).is_empty());
}

#[test]
fn the_shortest_ways_from_the_root_cause_are_drawn_strong() {
    let fault = jump().pass(4).published();
    let expect = [
        ("localization", "perception"),
        ("localization", "planning"),
        ("perception", "prediction"),
        ("planning", "execution"),
    ];
    assert_eq!(hot(&fault), expect.map(|(from, to)| (from.to_owned(), to.to_owned())));
}
