//! Tests of the timeline's page.

use super::*;
use crate::developer::tests::{english, holds, query};
use crate::texts::Lang;
use crate::view::Palette;
use crate::view::tests::context;
use crate::view::tests::sample::Sample;
use telltale_engine::event::Said;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_store::{NodePast, Period, Stretch};

#[test]
fn the_timeline_draws_what_was_recorded_and_says_what_was_not() {
    let published = Sample::shuttle(true).published();
    let live = Window::of(&published, &query(&[("span", "100")]));
    assert_eq!(live.query.to_ms - live.query.from_ms, 100_000);
    assert_eq!(live.query.nodes.len(), 8, "{:?}", live.query.nodes);
    let asks = [("node", "a/b"), ("span", "100"), ("until", "1000000"), ("at", "950000")];
    let window = Window::of(&published, &query(&asks));
    assert_eq!((window.query.from_ms, window.query.to_ms), (900_000, 1_000_000));
    let stretch = |from_ms, to_ms, state, cause: Option<&str>| Stretch {
        from_ms,
        to_ms,
        state,
        own: State::Error,
        cause: cause.map(Into::into),
        said: None,
    };
    let stretches = vec![
        stretch(900_000, 920_000, State::Error, None),
        stretch(920_000, 960_000, State::Ignore, Some("a/root")),
    ];
    let nodes = vec![NodePast { name: "a/b".to_owned(), stretches }];
    let held = |from_ms, to_ms, value| Period { from_ms, to_ms, value };
    let active = vec![held(900_000, 940_000, None), held(940_000, 1_000_000, Some(true))];
    let past = Past {
        nodes,
        stage: vec![Period { from_ms: 900_000, to_ms: 1_000_000, value: Stage::Active }],
        signals: vec![("active".to_owned(), active)],
        ..Past::default()
    };
    let html = page(&published, &english(), &query(&asks), (&window, String::new()), Some(&past));
    // The ERROR before the cause showed itself is owed to it; the moment in the middle is masked.
    holds(
        &html,
        &[
            "bar-attributed",
            "x=\"0.00%\" y=\"1.0\" width=\"20.00%\"",
            "url(#p-masked)",
            "From history",
            "data-static",
        ],
    );
    holds(
        &html,
        &["bar-stage bar-driving", "data-signal=\"active\"", "bar-true", "data-state=\"level\">true<"],
    );
    holds(&html, &["data-state=\"ignore\">Ignored</span> <small>a/root", "1970-01-01T00:15:50.000Z"]);
    assert!(!html.contains("silent"), "nothing was said");
    let after = query(&[asks[0], asks[1], asks[2], ("unrecorded", "1")]);
    let window = Window::of(&published, &after);
    let html = page(&published, &english(), &after, (&window, String::new()), Some(&past));
    holds(&html, &["data-state=\"none\">no record<", "No recording has this moment. The history knows"]);
    // A chosen moment stays where it is, also outside of the span.
    let outside = query(&[asks[0], asks[1], asks[2], ("at", "800000")]);
    let window = Window::of(&published, &outside);
    let html = page(&published, &english(), &outside, (&window, String::new()), Some(&past));
    holds(&html, &["data-state=\"none\">not shown<", "data-chosen=\"800000\"", "1970-01-01T00:13:20.000Z"]);
    holds(&html, &["id=\"to-moment\" href=\"?node=a%2Fb&#38;span=100&#38;at=800000&#38;until=850000\""]);
    assert!(!html.contains("class=\"moment\""));
}

#[test]
fn the_timeline_tells_a_silence_from_an_error_that_was_reported() {
    let published = Sample::shuttle(true).published();
    let asks = [("node", "a/b"), ("span", "100"), ("until", "1000000")];
    let stretch =
        |from_ms, to_ms, state, said| Stretch { from_ms, to_ms, state, own: state, cause: None, said };
    let silent = Said::of("Images <arrive>", Some(Span::from_secs(2)));
    let stretches = vec![
        stretch(900_000, 920_000, State::Ok, Said::of("Images arrive", None)),
        stretch(920_000, 940_000, State::Error, silent),
        stretch(940_000, 960_000, State::Ok, None),
        stretch(960_000, 980_000, State::Error, Said::of("no picture", None)),
    ];
    let past = Past { nodes: vec![NodePast { name: "a/b".to_owned(), stretches }], ..Past::default() };
    let shown = |lang, at| {
        let query = query(&[asks[0], asks[1], asks[2], ("at", at)]);
        let window = Window::of(&published, &query);
        page(&published, &context(lang, Palette::Day), &query, (&window, String::new()), Some(&past))
    };
    let english = shown(Lang::En, "930000");
    holds(&english, &[", \u{201c}silent for 2 s; last: Images &lt;arrive&gt;\u{201d}</title>"]);
    holds(&english, &["data-state=\"error\">Error</span> <small>silent for 2 s; last: Images &#60;arrive"]);
    holds(&english, &[", \u{201c}no picture\u{201d}</title>"]);
    let german = shown(Lang::De, "970000");
    holds(
        &german,
        &["seit 2 s still; zuletzt: Images", "data-state=\"error\">Fehler</span> <small>no picture<"],
    );
    // Where all is well the words stay behind the strip.
    holds(&shown(Lang::En, "910000"), &["data-state=\"ok\">OK</span> <small></small>"]);
}
