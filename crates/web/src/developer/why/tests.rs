//! Tests of a node's page.

use super::*;
use crate::developer::tests::{english, holds, query};
use crate::texts::Lang;
use crate::view::tests::jump;

#[test]
fn a_why_page_leads_to_what_it_names() {
    let published = jump().pass(4).published();
    let NodeId::Group(_) = published.snapshot.node("perception").expect("it is there") else { panic!() };
    let node = published.snapshot.node("perception").expect("it is there");
    let query = query(&[("node", "perception")]);
    let window = Window::over(&published, &query, 300);
    let (trends, read) = (Trends::default(), NodeRead::default());
    let page = page((&published, &trends), node, &english(), (&query, &window), &read);
    holds(&page, &["/developer/why?node=localization%2Ftf_quality", "perception/costmap_delay"]);
}

#[test]
fn the_neighbours_of_a_node_are_what_it_needs_and_what_needs_it() {
    let published = jump().pass(4).published();
    let view = &View::new(&published, Lang::En, false);
    let around = |name: &str| {
        let node = published.snapshot.node(name).expect("it is there");
        graph::neighbourhood(view, node).map(|(drawing, more)| (drawing.svg, more))
    };
    let (svg, more) = around("localization").expect("it has neighbours");
    holds(&svg, &["data-here", "sensors", "perception", "data-hot"]);
    assert_eq!((more, svg.matches("data-here").count()), (0, 1));
    assert!(!svg.contains("toggle"), "the page of a node has nothing to open: {svg}");
    // A member has the dependencies of its group, and is shown in it without the others.
    let (svg, _) = around("localization/tf_quality").expect("its group has neighbours");
    holds(&svg, &["sensors", "tf_quality"]);
    assert!(!svg.contains("localization%2Fodometry"), "{svg}");
}
