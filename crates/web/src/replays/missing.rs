//! The gaps of a replay's recording, in time and in topics: as notices on its pages, and as marks over its strips.

use std::sync::Arc;

use crate::incidents::wall_time;
use crate::source::{GapThen, gap_marks};
use crate::texts::{IncidentWords, Lang, NAME, clean};
use telltale_clock::unix_ms;
use telltale_engine::time::Timestamp;
use telltale_replay::Playback;

/// Gaps that a notice names.
const NAMED_MAX: usize = 3;
/// Topics that a notice names.
const TOPICS_MAX: usize = 10;

/// The gaps of a recording. Times are milliseconds since 1970.
#[derive(Debug, Clone, Default)]
pub(super) struct Missing {
    pub gaps: Arc<[GapThen]>,
    more: u64,
    is_damage: bool,
    /// Topics that the configuration reads and the recording has no message of.
    unheard: Arc<[String]>,
}

/// The same in words, for a page.
pub(super) struct MissingTold {
    pub title: &'static str,
    pub spans: Vec<SpanTold>,
    /// Further ones.
    pub more: Option<String>,
    /// Up to when it may differ, behind a single gap; `None` if that is the end, or there are several.
    pub until: Option<At>,
}

/// An instant in UTC. The page of a replay shows it by its own clock.
pub(super) struct At(pub String);

impl At {
    fn of(ms: i64) -> At {
        At(wall_time(ms))
    }

    /// The time of the day, with milliseconds.
    pub fn clock(&self) -> &str {
        &self.0[11..23]
    }
}

pub(super) struct SpanTold {
    pub from: At,
    pub to: Option<At>,
    /// In seconds; empty if nothing follows.
    pub length: String,
}

impl Missing {
    pub fn of(playback: &Playback) -> Missing {
        let gaps = playback.gaps();
        let ms = |at: Timestamp| unix_ms(playback.facts().wall(at));
        let gap = |gap: &telltale_replay::Gap| GapThen {
            from_ms: ms(gap.from),
            to_ms: gap.to.map(ms),
            exact_ms: gap.exact_from.map(ms),
        };
        Missing {
            gaps: gaps.list().iter().map(gap).collect(),
            more: gaps.more(),
            is_damage: gaps.is_damage(),
            unheard: playback.unheard().into(),
        }
    }

    /// The topics without a message, for a page; empty if there is none.
    pub fn unheard(&self, lang: Lang) -> String {
        let mut named: Vec<String> = self.unheard.iter().take(TOPICS_MAX).map(|it| clean(it, NAME)).collect();
        let more = self.unheard.len().saturating_sub(TOPICS_MAX);
        named.extend((more > 0).then(|| lang.and_more(more)));
        named.join(", ")
    }

    fn title(&self, it: &'static IncidentWords) -> &'static str {
        if self.is_damage { it.damaged } else { it.has_gaps }
    }

    /// The notice; `None` if nothing is missing.
    pub fn told(&self, lang: Lang, it: &'static IncidentWords) -> Option<MissingTold> {
        let more = self.gaps.len().saturating_sub(NAMED_MAX) + self.more as usize;
        let span = |gap: &GapThen| SpanTold {
            from: At::of(gap.from_ms),
            to: gap.to_ms.map(At::of),
            length: gap.to_ms.map(|to_ms| lang.decimals(&seconds(to_ms - gap.from_ms))).unwrap_or_default(),
        };
        (!self.gaps.is_empty()).then(|| MissingTold {
            title: self.title(it),
            spans: self.gaps.iter().take(NAMED_MAX).map(span).collect(),
            more: (more > 0).then(|| lang.and_more(more)),
            until: match self.gaps[..] {
                [GapThen { exact_ms: Some(exact_ms), .. }] => Some(At::of(exact_ms)),
                _ => None,
            },
        })
    }

    /// The sign of each screen of the replay, which may be looked at by itself; empty if nothing is missing.
    pub fn sign(&self, lang: Lang, it: &'static IncidentWords) -> String {
        let Some(told) = self.told(lang, it) else { return String::new() };
        let span = |span: &SpanTold| match &span.to {
            Some(to) => format!("{} \u{2013} {}", span.from.clock(), to.clock()),
            None => format!("{} \u{2013} {}", span.from.clock(), it.to_the_end),
        };
        let mut spans: Vec<String> = told.spans.iter().map(span).collect();
        spans.extend(told.more);
        let until = told.until.map(|until| format!(" {} {}", it.up_to, until.clock())).unwrap_or_default();
        format!("{}: {} {} UTC; {}{until}", told.title, it.missing_are, spans.join(", "), it.may_differ)
    }

    /// Marks over a strip with these ends.
    pub fn marks(&self, from_ms: i64, to_ms: i64) -> String {
        gap_marks(&self.gaps, from_ms, to_ms)
    }
}

fn seconds(ms: i64) -> String {
    format!("{:.3} s", ms as f64 / 1000.0)
}
