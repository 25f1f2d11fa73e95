//! A node's states over a span of time: its strip, and its transitions.

use crate::developer::PageQuery;
use crate::developer::timeline::strips::{Painter, StripHtml, TimelineStrips, look_word, state_of};
use crate::developer::timeline::{Tick, Window, ticks};
use crate::developer::why_address;
use crate::incidents::wall_time;
use crate::texts::{DevWords, Lang, NAME, clean};
use telltale_picture::strips::{Segment, recorded, stamp};
use telltale_store::{NodePast, Past};

/// Transitions that are listed: the newest.
const LISTED: usize = 50;

pub struct Transition {
    pub at: String,
    pub at_ms: i64,
    pub state: &'static str,
    pub word: &'static str,
    /// The state that it reported behind this one; empty if that is no fault.
    pub own: &'static str,
    pub cause: Option<(String, String)>,
    pub message: String,
    /// Empty for the last one, which may go on.
    pub lasted: String,
}

pub struct NodeStates {
    pub strip: Option<StripHtml>,
    pub ticks: Vec<Tick>,
    /// The newest first.
    pub transitions: Vec<Transition>,
    pub more: usize,
}

pub fn states(lang: Lang, query: &PageQuery, window: &Window, past: &Past) -> NodeStates {
    let words = DevWords::of(lang);
    let strips = TimelineStrips { lang, words, window, query };
    let node = past.nodes.first();
    let segments = node.map(|node| recorded(&node.stretches)).unwrap_or_default();
    let painter = Painter { lang, words, axis: window.axis() };
    let end = stamp(window.query.to_ms);
    let newest = segments.iter().rev().take(LISTED);
    NodeStates {
        strip: node.map(|node: &NodePast| strips.node(node)),
        ticks: ticks(window.axis()),
        transitions: newest.map(|it| transition(lang, &painter, it, it.to >= end)).collect(),
        more: segments.len().saturating_sub(LISTED),
    }
}

fn transition(lang: Lang, painter: &Painter, segment: &Segment, is_last: bool) -> Transition {
    let ms = segment.to.since(segment.from).as_millis();
    let at_ms = i64::try_from(segment.from.as_nanos() / 1_000_000).unwrap_or(i64::MAX);
    let cause = segment.cause.as_ref().map(|cause| (clean(cause, 2 * NAME), why_address(cause)));
    Transition {
        at: wall_time(at_ms),
        at_ms,
        state: state_of(segment.look),
        word: look_word(lang, segment.look),
        own: segment.own_fault().map_or("", |own| lang.state(own)),
        cause,
        message: painter.message(segment),
        lasted: if is_last { String::new() } else { lang.decimals(&lasting(ms)) },
    }
}

/// Milliseconds while they can be read at a glance.
fn lasting(ms: u64) -> String {
    match ms {
        0..10_000 => format!("{ms} ms"),
        10_000..600_000 => format!("{}.{} s", ms / 1000, ms % 1000 / 100),
        _ => format!("{} min", ms / 60_000),
    }
}
