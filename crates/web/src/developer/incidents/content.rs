//! The parts that the page of an incident and its report share.

use super::list::{flags, length};
use super::plots::{Plot, plots};
use super::sentences::{sentence, stage_word, state_word};
use crate::developer::timeline::strips::{Explained, Painter, legend};
use crate::developer::timeline::{Tick, ticks};
use crate::developer::why_address;
use crate::incidents::{Read, wall_time};
use crate::texts::{DevWords, IncidentWords, Lang, MESSAGE, NAME, VALUE, clean, clean_lines};
use telltale_engine::event::Said;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::view::record::Stretch;
use telltale_picture::bars::patterns;
use telltale_picture::strips::{Axis, recorded, stamp};
use telltale_picture::svg::escaped;
use telltale_record::proof::Proof;
use telltale_record::story::{Happened, Moment, NodeStrip, Period, Story, ToldTopic, known};
use telltale_record::summary::{FrozenNode, Recording, Summary};
use telltale_store::Incident;

/// Parts of a damaged file that are named.
const LEFT_OUT: usize = 5;
/// Causes that are named.
const CAUSES: usize = 24;

/// Where the content stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Medium<'a> {
    /// Names lead to the pages of their nodes.
    Page,
    /// The page of a replay with this address: names lead to their nodes as they were.
    Replay(&'a str),
    /// A document by itself.
    Report,
}

pub(crate) struct MomentRow {
    pub at: String,
    pub clock: String,
    /// Seconds after the first trigger.
    pub after: String,
    pub state: String,
    pub text: String,
}

pub(crate) struct Lane {
    pub name: String,
    /// The name as HTML, with places where its line may break.
    pub broken: String,
    pub why: Option<String>,
    pub bars: String,
}

pub(crate) struct FrozenRow {
    /// The name as HTML, with places where its line may break.
    pub broken: String,
    pub why: Option<String>,
    pub state: String,
    pub word: &'static str,
    pub message: String,
    pub values: Vec<(String, String)>,
    /// Seconds after the first trigger; empty at that.
    pub after: String,
}

pub(crate) struct TopicRow {
    pub topic: String,
    /// The name as HTML, with places where its line may break.
    pub broken: String,
    /// The same of its type.
    pub type_name: String,
    pub seconds: String,
    pub messages: u64,
    pub size: String,
    /// Messages that the file has by their times and sizes alone, and their bytes.
    pub left_out: Option<(u64, String)>,
}

/// Everything that is known of an incident, in words of one language.
pub(crate) struct Content {
    pub it: &'static IncidentWords,
    pub words: &'static DevWords,
    pub id: u64,
    pub vehicle: String,
    pub causes: Vec<(String, Option<String>)>,
    pub more_causes: Option<String>,
    pub since: String,
    /// Date and time for people.
    pub began: String,
    /// Empty while it lasts.
    pub length: String,
    pub stage: &'static str,
    pub kinds: String,
    pub flags: Vec<&'static str>,
    pub note: String,
    pub note_by: String,
    pub troubles: Vec<String>,
    pub moments: Vec<MomentRow>,
    pub more_moments: u64,
    pub patterns: String,
    /// A line over each strip.
    pub first_trigger: String,
    pub stage_bars: String,
    pub signals: Vec<Lane>,
    pub lanes: Vec<Lane>,
    pub plots: Vec<Plot>,
    pub more_periods: u64,
    pub legend: Vec<Explained>,
    pub ticks: Vec<Tick>,
    /// The ends of the strips.
    pub from_ms: i64,
    pub to_ms: i64,
    pub frozen: Vec<FrozenRow>,
    pub size: String,
    pub pre_roll_s: String,
    pub messages: u64,
    pub missing: u64,
    pub sha256: String,
    pub version: String,
    pub configuration: String,
    pub topics: Vec<TopicRow>,
    /// The recording was read.
    pub is_read: bool,
}

impl Content {
    pub fn of(
        lang: Lang,
        incident: &Incident,
        (read, proof): (&Read, &Proof),
        medium: Medium<'_>,
    ) -> Content {
        let (it, words) = (IncidentWords::of(lang), DevWords::of(lang));
        let summary = &incident.summary;
        let recording = &summary.recording;
        let only_known;
        let story = match read {
            Read::Told(story) => story,
            _ => {
                only_known = known(summary);
                &only_known
            }
        };
        let why = |name: &str| match medium {
            Medium::Page => Some(why_address(name)),
            Medium::Replay(id) => Some(format!("/replay/{id}/screen{}", why_address(name))),
            Medium::Report => None,
        };
        let causes = summary.causes();
        let more_causes = causes.len().saturating_sub(CAUSES);
        let axis = Axis { from: stamp(story.from_ms), to: stamp(story.to_ms), left: 0.0, width: 100.0 };
        let painter = Painter { lang, words, axis };
        let lane = |strip: &NodeStrip| Lane {
            name: clean(&strip.node, 2 * NAME),
            broken: broken(&strip.node),
            why: why(&strip.node),
            bars: node_bars(&painter, strip),
        };
        let frozen = |frozen: &FrozenNode| FrozenRow {
            broken: broken(&frozen.node),
            why: why(&frozen.node),
            state: clean(&frozen.state, NAME),
            word: state_word(lang, &frozen.state),
            after: frozen.at_ms.map(|at_ms| after(at_ms, summary.since_ms)).unwrap_or_default(),
            message: clean(&frozen.message, MESSAGE),
            values: frozen
                .values
                .iter()
                .map(|(key, value)| (clean(key, VALUE), clean(value, VALUE)))
                .collect(),
        };
        let note = incident.note.as_ref();
        let since = wall_time(summary.since_ms);
        Content {
            id: summary.id,
            vehicle: clean(&summary.vehicle, NAME),
            causes: causes.iter().take(CAUSES).map(|name| (clean(name, 2 * NAME), why(name))).collect(),
            more_causes: (more_causes > 0).then(|| lang.and_more(more_causes)),
            began: format!("{} {} UTC", &since[..10], &since[11..19]),
            since,
            length: length(incident),
            stage: stage_word(lang, &summary.stage),
            kinds: kinds(lang, summary),
            flags: flags(it, incident),
            note: note.map(|note| clean_lines(&note.text)).unwrap_or_default(),
            note_by: note.map(|note| clean(&note.by, NAME)).unwrap_or_default(),
            troubles: of_proof(it, proof)
                .into_iter()
                .chain(troubles(it, read, medium, summary.since_ms))
                .chain(no_room(lang, recording))
                .collect(),
            moments: story.moments.iter().map(|moment| row(lang, moment, summary.since_ms)).collect(),
            more_moments: story.more_moments,
            patterns: patterns("p-", |paint| format!("class=\"p-{paint}\"")),
            first_trigger: if summary.triggers.is_empty() {
                String::new()
            } else {
                let x = axis.x(stamp(summary.since_ms));
                format!("<line class=\"moment\" x1=\"{x:.2}%\" x2=\"{x:.2}%\" y1=\"0\" y2=\"24\"/>")
            },
            stage_bars: story.stages.iter().filter_map(|period| stage_bar(&painter, period)).collect(),
            signals: story.signals.iter().map(|strip| signal_lane(&painter, strip)).collect(),
            lanes: story.strips.iter().map(lane).collect(),
            plots: plots(it, story),
            more_periods: story.more_periods,
            legend: legend(lang),
            from_ms: story.from_ms,
            to_ms: story.to_ms,
            ticks: if story.strips.is_empty() { Vec::new() } else { ticks(axis) },
            frozen: summary.freeze.iter().map(frozen).collect(),
            size: lang.size(recording.bytes),
            pre_roll_s: lang.decimals(&format!("{:.1} s", recording.pre_roll_s)),
            messages: recording.messages,
            missing: recording.missing.max(story.lost),
            sha256: clean(recording.sha256.as_deref().unwrap_or_default(), MESSAGE),
            version: clean(&summary.version, NAME),
            configuration: clean(&summary.configuration, MESSAGE),
            topics: story.topics.iter().map(|it| topic(lang, it)).collect(),
            is_read: matches!(read, Read::Told(_)),
            it,
            words,
        }
    }
}

/// A name that may break between its parts.
pub(crate) fn broken(name: &str) -> String {
    escaped(&clean(name, 2 * NAME)).replace('/', "/<wbr>").replace('_', "_<wbr>")
}

fn kinds(lang: Lang, summary: &Summary) -> String {
    let mut kinds: Vec<&str> =
        summary.triggers.iter().map(|trigger| lang.trigger(&trigger.kind).unwrap_or(&trigger.kind)).collect();
    kinds.sort_unstable();
    kinds.dedup();
    clean(&kinds.join(", "), MESSAGE)
}

fn of_proof(it: &IncidentWords, proof: &Proof) -> Option<String> {
    match proof {
        Proof::Other(hash) => Some(format!("{} {}.", it.is_other, clean(hash, MESSAGE))),
        Proof::OtherRow => Some(it.is_other_row.to_owned()),
        Proof::TooLarge => Some(it.not_compared.to_owned()),
        Proof::Same | Proof::None => None,
    }
}

/// The messages that the recording lacks because it had reached its size.
fn no_room(lang: Lang, recording: &Recording) -> Option<String> {
    let &Recording { left_out: count, left_out_bytes: bytes, .. } = recording;
    let bytes = lang.size(bytes);
    (count > 0).then(|| lang.no_room(count, &bytes))
}

fn troubles(it: &IncidentWords, read: &Read, medium: Medium<'_>, since_ms: i64) -> Vec<String> {
    let story: &Story = match read {
        Read::Told(story) => story,
        Read::Missing => return vec![it.no_file.to_owned()],
        Read::Busy => return vec![it.busy.to_owned()],
        Read::Bad(why) => {
            return vec![format!("{}: {}. {}", it.bad_file, clean(why, MESSAGE), it.only_known)];
        }
    };
    let mut troubles = Vec::new();
    if let Some(end_ms) = story.interrupted_ms {
        let lacks = if end_ms < since_ms { it.ends_before } else { it.ends_after };
        troubles.push(format!("{}: {}. {lacks}", it.interrupted_at, after(end_ms, since_ms)));
    }
    if !story.complete {
        troubles.push(it.incomplete.to_owned());
    }
    if story.cut {
        troubles.push(it.cut.to_owned());
    }
    if !story.left_out.is_empty() && story.complete {
        let parts: Vec<String> =
            story.left_out.iter().take(LEFT_OUT).map(|part| clean(part, MESSAGE)).collect();
        troubles.push(format!("{}: {}", it.left_out, parts.join("; ")));
    }
    // The page asks again by itself; a report stays as it is.
    if story.series_pending && medium == Medium::Report {
        troubles.push(it.numbers_pending.to_owned());
    }
    troubles
}

fn row(lang: Lang, moment: &Moment, since_ms: i64) -> MomentRow {
    let state = match &moment.what {
        Happened::Fails { state, .. } => state.clone(),
        Happened::Masks { .. } => "ignore".to_owned(),
        Happened::Recovers { .. } => "ok".to_owned(),
        _ => String::new(),
    };
    let began_ms = moment.began_ms();
    let at = wall_time(began_ms);
    let late = tenths(moment.at_ms, began_ms);
    let text = sentence(lang, &moment.what);
    MomentRow {
        clock: at[11..21].to_owned(),
        at,
        after: after(began_ms, since_ms),
        state: clean(&state, NAME),
        text: if late > 0 {
            lang.noticed_later(&text, &lang.quantity(&format!("{:.1}", late as f64 / 10.0), 1.0, "s"))
        } else {
            text
        },
    }
}

/// Seconds after the first trigger.
fn after(at_ms: i64, since_ms: i64) -> String {
    format!("{:+.1} s", tenths(at_ms, since_ms) as f64 / 10.0)
}

/// Whole tenths of a second, so that nothing is "-0.0".
fn tenths(at_ms: i64, since_ms: i64) -> i64 {
    (at_ms.saturating_sub(since_ms) as f64 / 100.0).round() as i64
}

fn stage_bar(painter: &Painter, period: &Period) -> Option<String> {
    let stage = Stage::from_word(&period.state)?;
    Some(painter.stage(stamp(period.from_ms), stamp(period.to_ms), stage))
}

fn signal_lane(painter: &Painter, strip: &NodeStrip) -> Lane {
    let bar = |period: &Period| {
        let value = period.state.parse().ok();
        painter.signal(stamp(period.from_ms), stamp(period.to_ms), value)
    };
    let bars = strip.periods.iter().map(bar).collect();
    Lane { name: clean(&strip.node, 2 * NAME), broken: broken(&strip.node), why: None, bars }
}

fn node_bars(painter: &Painter, strip: &NodeStrip) -> String {
    let stretch = |period: &Period| {
        Some(Stretch {
            from_ms: period.from_ms,
            to_ms: period.to_ms,
            state: State::from_word(&period.state)?,
            own: State::from_word(&period.own)?,
            cause: period.masked_by.as_deref().map(Into::into),
            said: Said::of(&period.message, None),
        })
    };
    let stretches: Vec<Stretch> = strip.periods.iter().filter_map(stretch).collect();
    recorded(&stretches).iter().map(|segment| painter.segment(segment)).collect()
}

fn topic(lang: Lang, topic: &ToldTopic) -> TopicRow {
    TopicRow {
        topic: clean(&topic.topic, 2 * NAME),
        broken: broken(&topic.topic),
        type_name: broken(&topic.type_name),
        seconds: lang
            .decimals(&format!("{:.1}", topic.last_ms.saturating_sub(topic.first_ms) as f64 / 1000.0)),
        messages: topic.messages,
        size: lang.size(topic.bytes),
        left_out: (topic.left_out > 0).then(|| (topic.left_out, lang.size(topic.left_out_bytes))),
    }
}
