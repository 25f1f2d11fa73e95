//! The snapshot as JSON for programs, written straight from the engine's types.

use std::collections::HashSet;
use std::io::{self, ErrorKind, Write};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use humantime::format_rfc3339_millis;
use serde::ser::{Serialize, SerializeMap, SerializeStruct, Serializer};

use crate::clock::wall_at;
use crate::engine::input::TroubleKind;
use crate::engine::model::countermeasure::Request;
use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{Alarm, Countermeasure, NotRelevant, Reason, RootCause, Snapshot};
use crate::engine::state::State;
use crate::engine::time::Timestamp;
use crate::runtime::Published;

/// More values than this in one status are searched for double keys by hash.
const VALUES_SCANNED_MAX: usize = 16;
/// Where statuses hold more than this, an answer leaves out their KeyValues: it would be too large to be
/// made and sent four times a second.
const VALUES_BYTES_MAX: u64 = 16 << 20;
/// An answer is never larger, but for what the configuration itself makes of it.
const ANSWER_BYTES_MAX: usize = 16 << 20;
/// What is left of a message where words are left out.
const MESSAGE_BYTES: usize = 200;

pub(super) fn encode(published: &Published) -> String {
    encode_within(published, ANSWER_BYTES_MAX)
}

/// Leaves out what an answer is the least worse without, until it is small enough.
fn encode_within(published: &Published, bytes_max: usize) -> String {
    let Published { snapshot, at } = published;
    let many = snapshot.counters.status_bytes > VALUES_BYTES_MAX;
    let first = if many { LeftOut::Values } else { LeftOut::Nothing };
    for left_out in [LeftOut::Nothing, LeftOut::Values, LeftOut::Words].into_iter().filter(|&it| it >= first)
    {
        let mut answer = Answer { bytes: Vec::new(), bytes_max };
        let context = Context { snapshot, at: *at, left_out };
        if serde_json::to_writer(&mut answer, &Wire(&context)).is_ok() {
            return String::from_utf8(answer.bytes).expect("JSON of strings is a string");
        }
    }
    let context = Context { snapshot, at: *at, left_out: LeftOut::Modules };
    serde_json::to_string(&Wire(&context)).expect("maps have string keys and nothing here fails by itself")
}

/// What an answer lacks because it would be too large; each lacks what those before it lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum LeftOut {
    Nothing,
    /// KeyValues.
    Values,
    /// The ends of messages, and all but the first of the nodes in a reason and of the ways to a cause.
    Words,
    /// The modules of the groups.
    Modules,
}

impl LeftOut {
    const fn as_str(self) -> &'static str {
        match self {
            LeftOut::Nothing => "",
            LeftOut::Values => "values",
            LeftOut::Words => "words",
            LeftOut::Modules => "modules",
        }
    }
}

/// Bytes up to a limit.
struct Answer {
    bytes: Vec<u8>,
    bytes_max: usize,
}

impl Write for Answer {
    fn write(&mut self, part: &[u8]) -> io::Result<usize> {
        if self.bytes.len() + part.len() > self.bytes_max {
            return Err(ErrorKind::FileTooLarge.into());
        }
        self.bytes.extend_from_slice(part);
        Ok(part.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Clone, Copy)]
struct Context<'a> {
    snapshot: &'a Snapshot,
    at: SystemTime,
    left_out: LeftOut,
}

impl Context<'_> {
    fn wall(&self, then: Timestamp) -> String {
        rfc3339(wall_at(self.at, self.snapshot.now, then))
    }

    fn name(&self, node: NodeId) -> &str {
        self.snapshot.node_name(node)
    }

    fn lacks(&self, what: LeftOut) -> bool {
        self.left_out >= what
    }

    /// What is told of a list whose first entry is the one that counts.
    fn told<'l, T>(&self, all: &'l [T]) -> &'l [T] {
        if self.lacks(LeftOut::Words) { &all[..all.len().min(1)] } else { all }
    }
}

/// A list that is written from an iterator.
struct List<F>(F);

impl<F, I> Serialize for List<F>
where
    F: Fn() -> I,
    I: Iterator,
    I::Item: Serialize,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((self.0)())
    }
}

struct Wire<'a>(&'a Context<'a>);

impl Serialize for Wire<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let context = self.0;
        let snapshot = context.snapshot;
        // The tiles; then the statuses that nothing claims, once there are some, and the diagnosis
        // of the diagnosis, once something is wrong with it.
        let tops = || {
            let others = (0..snapshot.layout.groups.len() as u32).map(GroupId).filter(|&id| {
                let (info, view) = snapshot.group(id);
                !info.counted && !info.modules.is_empty() || info.is_system && view.state != State::Ok
            });
            snapshot.tiles().chain(others).map(|id| Group(context, id))
        };
        let mut wire =
            serializer.serialize_struct("snapshot", 11 + usize::from(context.lacks(LeftOut::Values)))?;
        wire.serialize_field("seq", &snapshot.seq)?;
        wire.serialize_field("at", &rfc3339(context.at))?;
        wire.serialize_field("stage", snapshot.stage.as_str())?;
        wire.serialize_field("operator", &snapshot.operator.as_deref())?;
        wire.serialize_field("overall", snapshot.overall.as_str())?;
        wire.serialize_field("recording", &false)?;
        wire.serialize_field("groups", &List(tops))?;
        wire.serialize_field("roots", &List(|| snapshot.roots.iter().map(|root| Root(context, root))))?;
        let alarms = || snapshot.alarms.iter().map(|alarm| AlarmEntry(context, alarm));
        wire.serialize_field("alarms", &List(alarms))?;
        let countermeasures = || snapshot.countermeasures.iter().map(|it| CountermeasureWire(context, it));
        wire.serialize_field("countermeasures", &List(countermeasures))?;
        wire.serialize_field("counters", &Counts(context))?;
        if context.lacks(LeftOut::Values) {
            wire.serialize_field("left_out", context.left_out.as_str())?;
        }
        wire.end()
    }
}

struct CountermeasureWire<'a>(&'a Context<'a>, &'a Countermeasure);

impl Serialize for CountermeasureWire<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let CountermeasureWire(context, it) = *self;
        let mps2 = match it.request {
            Request::Decelerate { mps2 } => Some(mps2),
            Request::Notify | Request::ManeuverStop => None,
        };
        // The first cause is the one that the page names; a stop may be the operator's alone.
        let cause = it.causes.first().map_or("operator", |cause| context.name(cause.node));
        let mut wire = serializer.serialize_struct("countermeasure", 8)?;
        wire.serialize_field("request", it.request.as_str())?;
        wire.serialize_field("mps2", &mps2)?;
        wire.serialize_field("cause", cause)?;
        wire.serialize_field("state", it.state.as_str())?;
        wire.serialize_field("by_operator", &it.by_operator)?;
        wire.serialize_field("since", &context.wall(it.since))?;
        wire.serialize_field("causes", &List(|| it.causes.iter().map(|cause| context.name(cause.node))))?;
        wire.serialize_field("held", &it.latched)?;
        wire.end()
    }
}

/// What was received since the start, and what of it was lost or could not be read.
struct Counts<'a>(&'a Context<'a>);

impl Serialize for Counts<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let snapshot = self.0.snapshot;
        let trouble = |kind: TroubleKind| -> u64 {
            snapshot.reception.iter().filter(|it| it.kind == kind).map(|it| it.count).sum()
        };
        let mut counts = serializer.serialize_struct("counters", 8)?;
        counts.serialize_field("arrays", &snapshot.counters.arrays)?;
        counts.serialize_field("statuses", &snapshot.counters.statuses)?;
        counts.serialize_field("dropped_names", &snapshot.counters.dropped_names)?;
        counts.serialize_field("merged_alarms", &snapshot.counters.merged_alarms)?;
        counts.serialize_field("dropped_alarms", &snapshot.counters.dropped_alarms)?;
        counts.serialize_field("malformed", &trouble(TroubleKind::Malformed))?;
        counts.serialize_field("wrong_type", &trouble(TroubleKind::WrongType))?;
        counts.serialize_field("lost", &trouble(TroubleKind::Lost))?;
        counts.end()
    }
}

struct Group<'a>(&'a Context<'a>, GroupId);

impl Serialize for Group<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Group(context, id) = *self;
        let (info, view) = context.snapshot.group(id);
        let mut group = serializer.serialize_struct("group", 11)?;
        group.serialize_field("id", &*info.path)?;
        group.serialize_field("name", &*info.name.en)?;
        group.serialize_field("state", view.state.as_str())?;
        group.serialize_field("own", view.own.as_str())?;
        group.serialize_field("since", &context.wall(view.since))?;
        group.serialize_field("ok", &view.ok)?;
        group.serialize_field("counted", &view.counted)?;
        group.serialize_field("reason", &view.reason.as_ref().map(|reason| Why(context, reason)))?;
        group.serialize_field(
            "paths",
            &List(|| context.told(&view.paths).iter().map(|path| Nodes(context, path))),
        )?;
        let told = if context.lacks(LeftOut::Modules) { &[][..] } else { &info.modules };
        let modules = || told.iter().map(|&id| Module(context, id));
        group.serialize_field("modules", &List(modules))?;
        group.serialize_field("groups", &List(|| info.groups.iter().map(|&id| Group(context, id))))?;
        group.end()
    }
}

struct Module<'a>(&'a Context<'a>, ModuleId);

impl Serialize for Module<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Module(context, id) = *self;
        let (info, view) = context.snapshot.module(id);
        let age_ms = view.received.map(|received| context.snapshot.now.since(received).as_millis());
        let silent = view.silent_for(context.snapshot.now);
        let mut module = serializer.serialize_struct(
            "module",
            9 + usize::from(silent.is_some()) + usize::from(view.report.cut > 0),
        )?;
        module.serialize_field("id", &*info.id)?;
        module.serialize_field("state", view.state.as_str())?;
        module.serialize_field("own", view.own.as_str())?;
        module.serialize_field("since", &context.wall(view.since))?;
        let message = view.says(context.snapshot.now);
        let end = if context.lacks(LeftOut::Words) { MESSAGE_BYTES } else { message.len() };
        module.serialize_field("message", &message[..message.floor_char_boundary(end)])?;
        module.serialize_field("age_ms", &age_ms)?;
        if let Some(silent) = silent {
            // To the tenth: what is finer is in `age_ms`.
            module.serialize_field("silent_s", &((silent.as_millis() / 100) as f64 / 10.0))?;
        }
        module.serialize_field("reason", &view.reason.as_ref().map(|reason| Why(context, reason)))?;
        module.serialize_field("class", &ClassEntry(info.class))?;
        module.serialize_field(
            "values",
            &Values(if context.lacks(LeftOut::Values) { &[] } else { &view.report.values }),
        )?;
        if view.report.cut > 0 {
            module.serialize_field("cut", &view.report.cut)?;
        }
        module.end()
    }
}

struct ClassEntry(crate::engine::model::monitors::Class);

impl Serialize for ClassEntry {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut class = serializer.serialize_struct("class", 3)?;
        class.serialize_field("location", self.0.location)?;
        class.serialize_field("information", self.0.information)?;
        class.serialize_field("flow", &self.0.flow)?;
        class.end()
    }
}

/// A status may name a key twice; an object must not. The first one counts.
struct Values<'a>(&'a [(Box<str>, Box<str>)]);

impl Serialize for Values<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let values = self.0;
        let mut map = serializer.serialize_map(None)?;
        let mut seen = HashSet::new();
        for (index, (key, value)) in values.iter().enumerate() {
            let is_double = if values.len() <= VALUES_SCANNED_MAX {
                values[..index].iter().any(|(earlier, _)| earlier == key)
            } else {
                !seen.insert(&**key)
            };
            if !is_double {
                map.serialize_entry(&**key, &**value)?;
            }
        }
        map.end()
    }
}

struct Why<'a>(&'a Context<'a>, &'a Reason);

impl Serialize for Why<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut why = serializer.serialize_struct("reason", 2)?;
        match self.1 {
            Reason::Masked { by } => {
                why.serialize_field("kind", "masked")?;
                why.serialize_field("by", &Nodes(self.0, self.0.told(by)))?;
            }
            Reason::NotRelevant(because) => {
                why.serialize_field("kind", "not_relevant")?;
                let because = match because {
                    NotRelevant::Stage(stage) => format!("stage {}", stage.as_str()),
                    NotRelevant::Signal { name, value } => format!("signal {name} {value}"),
                };
                why.serialize_field("because", &because)?;
            }
        }
        why.end()
    }
}

/// Names of nodes, in order.
struct Nodes<'a>(&'a Context<'a>, &'a [NodeId]);

impl Serialize for Nodes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.1.iter().map(|&node| self.0.name(node)))
    }
}

struct Root<'a>(&'a Context<'a>, &'a RootCause);

impl Serialize for Root<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Root(context, cause) = *self;
        let mut root = serializer.serialize_struct("root", 3)?;
        root.serialize_field("node", context.name(cause.node))?;
        root.serialize_field("masks", &cause.masks)?;
        root.serialize_field("since", &context.wall(cause.since))?;
        root.end()
    }
}

struct AlarmEntry<'a>(&'a Context<'a>, &'a Alarm);

impl Serialize for AlarmEntry<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let AlarmEntry(context, alarm) = *self;
        let mut entry = serializer.serialize_struct("alarm", 6)?;
        entry.serialize_field("id", &alarm.id)?;
        entry.serialize_field("node", context.name(alarm.node))?;
        entry.serialize_field("raised", &context.wall(alarm.raised))?;
        entry.serialize_field("acknowledged", &alarm.acknowledged)?;
        entry.serialize_field("active", &alarm.active)?;
        entry.serialize_field("repeats", &alarm.repeats)?;
        entry.end()
    }
}

/// Wall time on the wire: `2026-11-20T12:00:00.123Z`. A clock that is set out of the years 1970 to
/// 9999 shows their first or last instant.
pub(super) fn rfc3339(time: SystemTime) -> String {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default().min(YEAR_9999_END);
    format_rfc3339_millis(UNIX_EPOCH + since).to_string()
}

const YEAR_9999_END: Duration = Duration::from_millis(253_402_300_799_999);
