//! The parts of the JSON that programs read, as borrowed structs: a field of the wire stands here once.

use std::borrow::Cow;
use std::collections::HashSet;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use humantime::format_rfc3339_millis;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use crate::clock::wall_at;
use crate::engine::input::TroubleKind;
use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{self, Reason, Snapshot};
use crate::engine::time::Timestamp;
use crate::record::reason::Why;

/// More values than this in one status are searched for double keys by hash.
const VALUES_SCANNED_MAX: usize = 16;
/// What is left of a message where words are left out.
const MESSAGE_BYTES: usize = 200;

/// What an answer lacks because it would be too large; each lacks what those before it lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum LeftOut {
    Nothing,
    /// KeyValues.
    Values,
    /// The ends of messages, and all but the first of the nodes in a reason and of the ways to a cause.
    Words,
    /// The modules of the groups.
    Modules,
}

impl LeftOut {
    pub(super) const ALL: [LeftOut; 4] =
        [LeftOut::Nothing, LeftOut::Values, LeftOut::Words, LeftOut::Modules];

    /// The word on the wire.
    const fn as_str(self) -> Option<&'static str> {
        match self {
            LeftOut::Nothing => None,
            LeftOut::Values => Some("values"),
            LeftOut::Words => Some("words"),
            LeftOut::Modules => Some("modules"),
        }
    }
}

/// A snapshot, its wall time, and what is left out.
#[derive(Debug, Clone, Copy)]
pub(super) struct Context<'a> {
    pub snapshot: &'a Snapshot,
    pub at: SystemTime,
    pub recording: bool,
    pub left_out: LeftOut,
}

/// What stands before the groups.
#[derive(Serialize)]
pub(super) struct Head<'a> {
    seq: u64,
    /// In a message that says only what changed: the `seq` of the state to which the changes apply.
    #[serde(skip_serializing_if = "Option::is_none")]
    base: Option<u64>,
    at: Wall,
    stage: &'static str,
    operator: Option<&'a str>,
    overall: &'static str,
    motion: Motion<'a>,
    recording: bool,
}

#[derive(Serialize)]
struct Motion<'a> {
    moving: &'static str,
    /// Of the whole km/h that the page shows, to the tenth.
    speed_mps: Option<f64>,
    destination: Option<&'a str>,
}

/// What stands after the groups. In a message that says only what changed, a list that did not is not there.
#[derive(Serialize)]
pub(super) struct Tail<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    roots: Option<Vec<Root<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alarms: Option<Vec<Alarm<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    countermeasures: Option<Vec<Countermeasure<'a>>>,
    counters: Counters,
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out: Option<&'static str>,
}

/// Something of each list that follows the groups.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lists<T> {
    pub roots: T,
    pub alarms: T,
    pub countermeasures: T,
}

/// A group; its modules and groups follow.
#[derive(Serialize)]
pub(super) struct Group<'a> {
    id: &'a str,
    name: &'a str,
    state: &'static str,
    own: &'static str,
    since: Wall,
    ok: u32,
    counted: u32,
    reason: Option<Why<'a>>,
    paths: Vec<Vec<&'a str>>,
}

/// A module up to its `age_ms`, which alone changes with time.
#[derive(Serialize)]
pub(super) struct ModuleHead<'a> {
    id: &'a str,
    state: &'static str,
    own: &'static str,
    since: Wall,
    message: Cow<'a, str>,
}

/// A module after its `age_ms`.
#[derive(Serialize)]
pub(super) struct ModuleTail<'a> {
    /// To the tenth: what is finer is in `age_ms`.
    #[serde(skip_serializing_if = "Option::is_none")]
    silent_s: Option<f64>,
    reason: Option<Why<'a>>,
    class: Class,
    values: Values<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cut: Option<usize>,
}

#[derive(Serialize)]
struct Class {
    location: &'static str,
    information: &'static str,
    flow: Option<&'static str>,
}

#[derive(Serialize)]
struct Root<'a> {
    node: &'a str,
    masks: u32,
    since: Wall,
}

#[derive(Serialize)]
struct Alarm<'a> {
    id: u64,
    node: &'a str,
    raised: Wall,
    acknowledged: bool,
    active: bool,
    repeats: u32,
}

#[derive(Serialize)]
struct Countermeasure<'a> {
    request: &'static str,
    mps2: Option<f64>,
    /// The one that the page names; a stop may be the operator's alone.
    cause: &'a str,
    state: &'static str,
    by_operator: bool,
    since: Wall,
    causes: Vec<&'a str>,
    held: bool,
}

/// What was received since the start, and what of it was lost or could not be read.
#[derive(Serialize)]
struct Counters {
    arrays: u64,
    statuses: u64,
    dropped_names: u64,
    merged_alarms: u64,
    dropped_alarms: u64,
    malformed: u64,
    wrong_type: u64,
    lost: u64,
}

impl<'a> Context<'a> {
    pub(super) fn head(&self, base: Option<u64>) -> Head<'a> {
        let snapshot = self.snapshot;
        Head {
            seq: snapshot.seq,
            base,
            at: Wall(self.at),
            stage: snapshot.stage.as_str(),
            operator: snapshot.operator.as_deref(),
            overall: snapshot.overall.as_str(),
            motion: Motion {
                moving: snapshot.motion.moving.as_str(),
                speed_mps: snapshot.motion.speed_kmh.map(|kmh| (f64::from(kmh) / 3.6 * 10.0).round() / 10.0),
                destination: snapshot.destination().map(|stop| &*stop.id),
            },
            recording: self.recording,
        }
    }

    pub(super) fn tail(&self, lists: Lists<bool>) -> Tail<'a> {
        Tail {
            roots: lists.roots.then(|| self.roots()),
            alarms: lists.alarms.then(|| self.alarms()),
            countermeasures: lists.countermeasures.then(|| self.countermeasures()),
            counters: self.counters(),
            left_out: self.left_out.as_str(),
        }
    }

    pub(super) fn group(&self, id: GroupId) -> Group<'a> {
        let (info, view) = self.snapshot.group(id);
        Group {
            id: &info.path,
            name: &info.name.en,
            state: view.state.as_str(),
            own: view.own.as_str(),
            since: self.wall(view.since),
            ok: view.ok,
            counted: view.counted,
            reason: view.reason.as_ref().map(|reason| self.why(reason)),
            paths: self.told(&view.paths).iter().map(|path| self.names(path)).collect(),
        }
    }

    pub(super) fn module(&self, id: ModuleId) -> (ModuleHead<'a>, ModuleTail<'a>) {
        let (info, view) = self.snapshot.module(id);
        let now = self.snapshot.now;
        let mut message = view.says(now);
        if self.lacks(LeftOut::Words) {
            let end = message.floor_char_boundary(MESSAGE_BYTES);
            message.to_mut().truncate(end);
        }
        let head = ModuleHead {
            id: &info.id,
            state: view.state.as_str(),
            own: view.own.as_str(),
            since: self.wall(view.since),
            message,
        };
        let tail = ModuleTail {
            silent_s: view.silent_for(now).map(|silent| (silent.as_millis() / 100) as f64 / 10.0),
            reason: view.reason.as_ref().map(|reason| self.why(reason)),
            class: Class {
                location: info.class.location,
                information: info.class.information,
                flow: info.class.flow,
            },
            values: Values(if self.lacks(LeftOut::Values) { &[] } else { &view.report.values }),
            cut: (view.report.cut > 0).then_some(view.report.cut),
        };
        (head, tail)
    }

    fn roots(&self) -> Vec<Root<'a>> {
        let root = |it: &snapshot::RootCause| Root {
            node: self.name(it.node),
            masks: it.masks,
            since: self.wall(it.since),
        };
        self.snapshot.roots.iter().map(root).collect()
    }

    fn alarms(&self) -> Vec<Alarm<'a>> {
        let alarm = |it: &snapshot::Alarm| Alarm {
            id: it.id,
            node: self.name(it.node),
            raised: self.wall(it.raised),
            acknowledged: it.acknowledged,
            active: it.active,
            repeats: it.repeats,
        };
        self.snapshot.alarms.iter().map(alarm).collect()
    }

    fn countermeasures(&self) -> Vec<Countermeasure<'a>> {
        let countermeasure = |it: &snapshot::Countermeasure| Countermeasure {
            request: it.request.as_str(),
            mps2: it.request.mps2(),
            cause: it.causes.first().map_or("operator", |cause| self.name(cause.node)),
            state: it.state.as_str(),
            by_operator: it.by_operator,
            since: self.wall(it.since),
            causes: it.causes.iter().map(|cause| self.name(cause.node)).collect(),
            held: it.latched,
        };
        self.snapshot.countermeasures.iter().map(countermeasure).collect()
    }

    fn counters(&self) -> Counters {
        let Snapshot { counters, reception, .. } = self.snapshot;
        let trouble =
            |kind: TroubleKind| reception.iter().filter(|it| it.kind == kind).map(|it| it.count).sum();
        Counters {
            arrays: counters.arrays,
            statuses: counters.statuses,
            dropped_names: counters.dropped_names,
            merged_alarms: counters.merged_alarms,
            dropped_alarms: counters.dropped_alarms,
            malformed: trouble(TroubleKind::Malformed),
            wrong_type: trouble(TroubleKind::WrongType),
            lost: trouble(TroubleKind::Lost),
        }
    }

    fn why(&self, reason: &Reason) -> Why<'a> {
        Why::of(reason, self.snapshot, if self.lacks(LeftOut::Words) { 1 } else { usize::MAX })
    }

    fn wall(&self, then: Timestamp) -> Wall {
        Wall(wall_at(self.at, self.snapshot.now, then))
    }

    fn name(&self, node: NodeId) -> &'a str {
        self.snapshot.node_name(node)
    }

    fn names(&self, nodes: &[NodeId]) -> Vec<&'a str> {
        nodes.iter().map(|&node| self.name(node)).collect()
    }

    fn lacks(&self, what: LeftOut) -> bool {
        self.left_out >= what
    }

    /// The nodes or paths that are named: where words are left out, the first one, which counts.
    fn told<'l, T>(&self, all: &'l [T]) -> &'l [T] {
        if self.lacks(LeftOut::Words) { &all[..all.len().min(1)] } else { all }
    }
}

/// The KeyValues of a status as an object. A status may name a key twice, an object must not: the first counts.
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

/// Wall time on the wire: `2026-11-20T12:00:00.123Z`.
struct Wall(SystemTime);

impl Serialize for Wall {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_rfc3339_millis(on_wire(self.0)))
    }
}

/// Wall time on the wire, as text.
pub(super) fn rfc3339(time: SystemTime) -> String {
    format_rfc3339_millis(on_wire(time)).to_string()
}

/// A clock that is set out of the years 1970 to 9999 shows their first or last instant.
fn on_wire(time: SystemTime) -> SystemTime {
    UNIX_EPOCH + time.duration_since(UNIX_EPOCH).unwrap_or_default().min(YEAR_9999_END)
}

const YEAR_9999_END: Duration = Duration::from_millis(253_402_300_799_999);
