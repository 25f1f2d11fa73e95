//! The strips of the timeline: the stage, nodes and signals, with their states at the selected moment.

use crate::texts::{DevWords, IncidentWords, Lang, MESSAGE, NAME, clean};
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_picture::bars::{Bar, word};
use telltale_picture::strips::{Axis, Look, Segment, class, recorded, stamp};
use telltale_store::{NodePast, Past, Period};

use super::super::{PageQuery, why_address};
use super::{Window, clock, percent};
use crate::developer::page_query::address;

/// The width of a letter, in hundredths of a strip: of the narrowest strip on a laptop, and of one on a phone.
const LETTER: f64 = 1.2;
const LETTER_OF_PHONE: f64 = 3.4;
/// A transition too short to be drawn is drawn this wide.
const WIDTH_MIN: f64 = 0.15;
const BAR_Y: f64 = 1.0;
const WORD_Y: f64 = 16.0;

pub struct StripHtml {
    pub name: String,
    pub kind: StripKind,
    /// SVG, as wide as the page has room for.
    pub bars: String,
    /// Its state at the selected moment.
    pub state: &'static str,
    pub word: &'static str,
    pub because: String,
}

/// The content of a strip.
pub enum StripKind {
    Stage,
    Signal,
    Node {
        why: String,
        /// The address of the page without this strip.
        remove: String,
    },
}

/// The parameters of the strips of a page.
pub struct TimelineStrips<'a> {
    pub lang: Lang,
    pub words: &'static DevWords,
    pub window: &'a Window,
    pub query: &'a PageQuery,
}

impl TimelineStrips<'_> {
    /// The stage above the nodes, if the machine has stages; the signals below them.
    pub fn strips(&self, past: &Past, has_stages: bool) -> Vec<StripHtml> {
        let stage = (has_stages && !past.stage.is_empty()).then(|| self.stage(&past.stage));
        let nodes = past.nodes.iter().map(|node| self.node(node));
        let signals = past.signals.iter().map(|(name, held)| self.signal(name, held));
        stage.into_iter().chain(nodes).chain(signals).collect()
    }

    pub fn node(&self, past: &NodePast) -> StripHtml {
        let segments = recorded(&past.stretches);
        let (state, word, because) = match self.at_moment(&segments, |it| (it.from, it.to)) {
            Some(segment) => {
                let because = match &segment.cause {
                    Some(cause) => clean(cause, 2 * NAME),
                    None if segment.look == Look::Ok => String::new(),
                    None => self.painter().message(segment),
                };
                (state_of(segment.look), look_word(self.lang, segment.look), because)
            }
            None => ("none", self.nothing(), String::new()),
        };
        let others = self.window.query.nodes.iter().filter(|name| **name != past.name);
        let other_fields = ["span", "until", "at"].into_iter().map(|name| (name, self.query.get(name)));
        let remove = address(other_fields.chain(others.map(|name| ("node", &**name))));
        StripHtml {
            name: clean(&past.name, 2 * NAME),
            kind: StripKind::Node { why: why_address(&past.name), remove },
            bars: segments.iter().map(|segment| self.painter().segment(segment)).collect(),
            state,
            word,
            because,
        }
    }

    fn stage(&self, held: &[Period<Stage>]) -> StripHtml {
        let word = |stage| self.lang.stage(stage, true);
        let class = |stage| if stage == Stage::Active { "stage bar-driving" } else { "stage" };
        self.level(self.words.stage.to_owned(), StripKind::Stage, held, |stage| {
            (class(stage), None, word(stage))
        })
    }

    fn signal(&self, name: &str, held: &[Period<Option<bool>>]) -> StripHtml {
        self.level(clean(name, 2 * NAME), StripKind::Signal, held, |value| signal_look(self.lang, value))
    }

    /// A strip of values without a cause: `look` gives class, pattern and word of a value.
    fn level<T: Copy>(
        &self,
        name: String,
        kind: StripKind,
        held: &[Period<T>],
        look: impl Fn(T) -> (&'static str, Option<&'static str>, &'static str),
    ) -> StripHtml {
        let there = self.at_moment(held, |it| (stamp(it.from_ms), stamp(it.to_ms)));
        let bar = |it: &Period<T>| {
            let (class, pattern, word) = look(it.value);
            let (from, to) = (stamp(it.from_ms), stamp(it.to_ms));
            let title = format!("{word}, {} \u{2013} {}", clock(from), clock(to));
            self.painter().bar((from, to), word, Bar { class, pattern, title: &title, ..EMPTY })
        };
        StripHtml {
            name,
            kind,
            bars: held.iter().map(bar).collect(),
            state: if there.is_some() { "level" } else { "none" },
            word: there.map_or(self.nothing(), |it| look(it.value).2),
            because: String::new(),
        }
    }

    /// The stretch at the selected moment: of two that meet there, the later.
    fn at_moment<'s, T>(&self, all: &'s [T], span: impl Fn(&T) -> (Timestamp, Timestamp)) -> Option<&'s T> {
        let moment = stamp(self.window.moment_ms());
        all.iter().rev().find(|it| {
            let (from, to) = span(it);
            from <= moment && moment <= to
        })
    }

    /// Why a strip has no state at the moment.
    fn nothing(&self) -> &'static str {
        match self.window.shows(self.window.moment_ms()) {
            true => self.words.no_record,
            false => self.words.outside,
        }
    }

    fn painter(&self) -> Painter {
        Painter { lang: self.lang, words: self.words, axis: self.window.axis() }
    }
}

/// Draws the bars of strips over one span of time.
pub struct Painter {
    pub lang: Lang,
    pub words: &'static DevWords,
    pub axis: Axis,
}

impl Painter {
    /// The state of a node, with its words as a tooltip.
    pub fn segment(&self, segment: &Segment) -> String {
        let word = look_word(self.lang, segment.look);
        let own = segment.own_fault();
        let mut title = format!("{word}, {} \u{2013} {}", clock(segment.from), clock(segment.to));
        if segment.look == Look::Attributed {
            title += &format!(", {}", self.words.attributed);
        }
        if let Some(cause) = &segment.cause {
            title += &format!(", {}: {}", self.words.cause, clean(cause, 2 * NAME));
        }
        if let Some(own) = own {
            title += &format!(", {}: {}", self.words.own_report, self.lang.state(own));
        }
        let message = self.message(segment);
        if !message.is_empty() {
            title += &format!(", \u{201c}{message}\u{201d}");
        }
        let bar =
            Bar { class: class(segment.look), pattern: pattern(segment.look), own, title: &title, ..EMPTY };
        self.bar((segment.from, segment.to), word, bar)
    }

    /// The module's message when the segment began.
    pub fn message(&self, segment: &Segment) -> String {
        let Some(said) = &segment.said else { return String::new() };
        self.lang.with_silence(clean(&said.message, MESSAGE), said.silent)
    }

    /// A bar from one instant to another, with its word if that fits.
    pub fn bar(&self, (from, to): (Timestamp, Timestamp), text: &str, bar: Bar<'_>) -> String {
        let (left, right) = (self.axis.x(from), self.axis.x(to));
        let fits = |letter: f64| text.chars().count() as f64 * letter + 0.6 <= right - left;
        let middle = percent(left.midpoint(right));
        let word = match (fits(LETTER), fits(LETTER_OF_PHONE)) {
            (false, _) => String::new(),
            (true, true) => word(bar.class, &middle, WORD_Y, text),
            // Not shown in a small window.
            (true, false) => word(&format!("{} word-tight", bar.class), &middle, WORD_Y, text),
        };
        let (x, width) = (percent(left), percent((right - left).max(WIDTH_MIN)));
        let mut out = String::new();
        Bar { x: &x, width: &width, ..bar }.draw(&mut out, &word);
        out
    }

    /// The value of a signal.
    pub fn signal(&self, from: Timestamp, to: Timestamp, value: Option<bool>) -> String {
        let (class, pattern, word) = signal_look(self.lang, value);
        let title = format!("{word}, {} \u{2013} {}", clock(from), clock(to));
        self.bar((from, to), word, Bar { class, pattern, title: &title, ..EMPTY })
    }

    /// The stage. Only driving has a colour.
    pub fn stage(&self, from: Timestamp, to: Timestamp, stage: Stage) -> String {
        let word = self.lang.stage(stage, true);
        let class = if stage == Stage::Active { "stage bar-driving" } else { "stage" };
        let title = format!("{word}, {} \u{2013} {}", clock(from), clock(to));
        self.bar((from, to), word, Bar { class, title: &title, ..EMPTY })
    }
}

const EMPTY: Bar<'static> =
    Bar { x: "", width: "", y: BAR_Y, class: "", pattern: None, title: "", own: None };

/// The class, pattern and word of a signal's value.
fn signal_look(lang: Lang, value: Option<bool>) -> (&'static str, Option<&'static str>, &'static str) {
    match value {
        Some(true) => ("true", None, "true"),
        Some(false) => ("false", None, "false"),
        None => ("unknown", Some("p-unknown"), lang.state(State::Unknown)),
    }
}

/// The pattern that fills a bar; colours alone are in the stylesheet.
pub fn pattern(look: Look) -> Option<&'static str> {
    match look {
        Look::Warning => Some("p-warning"),
        Look::Masked => Some("p-masked"),
        Look::NotRelevant => Some("p-not-relevant"),
        Look::Unknown => Some("p-unknown"),
        _ => None,
    }
}

pub fn look_word(lang: Lang, look: Look) -> &'static str {
    lang.state(match look {
        Look::Ok | Look::True | Look::False => State::Ok,
        Look::Warning => State::Warning,
        Look::Error | Look::Attributed => State::Error,
        Look::Masked | Look::NotRelevant => State::Ignore,
        Look::Unknown | Look::NotKnown => State::Unknown,
    })
}

/// A look of a bar in words.
pub struct Explained {
    pub class: &'static str,
    pub pattern: Option<&'static str>,
    /// With a line at its foot.
    pub is_own: bool,
    pub word: &'static str,
}

/// The legend: how the bars of nodes look, and the meaning of each.
pub fn legend(lang: Lang) -> Vec<Explained> {
    let it = IncidentWords::of(lang);
    let looks = [Look::Ok, Look::Warning, Look::Error, Look::Unknown];
    let plain = looks.map(|look| (look, false, look_word(lang, look)));
    let rest = [
        (Look::Attributed, false, it.look_attributed),
        (Look::Masked, false, it.look_masked),
        (Look::NotRelevant, false, it.look_not_relevant),
        (Look::Masked, true, it.look_own),
    ];
    let explained =
        |(look, is_own, word)| Explained { class: class(look), pattern: pattern(look), is_own, word };
    plain.into_iter().chain(rest).map(explained).collect()
}

pub fn state_of(look: Look) -> &'static str {
    match look {
        Look::Warning => "warning",
        Look::Error | Look::Attributed => "error",
        Look::Masked | Look::NotRelevant => "ignore",
        Look::Unknown | Look::NotKnown => "unknown",
        Look::Ok | Look::True | Look::False => "ok",
    }
}
