//! The parts of the JSON that programs read, as borrowed structs: a field of the wire stands here once.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use super::wire::{Signals, Values, Wall};
use crate::schema::words;
use telltale_clock::wall_at;
use telltale_engine::input::TroubleKind;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::{self, Reason, Snapshot};
use telltale_engine::time::{Since, Timestamp};
use telltale_record::why::Why;

/// The rest of a message where words are left out.
const MESSAGE_BYTES: usize = 200;

/// The cuts of an answer that would be too large; each contains those before it.
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
    pub(super) const fn as_str(self) -> Option<&'static str> {
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

/// The members before the groups.
#[derive(Serialize, JsonSchema)]
pub(super) struct Head<'a> {
    /// The number of the state. Operators' actions name the one that they were shown.
    seq: u64,
    /// In a message that says only what changed: the `seq` of the state to which the changes apply.
    #[serde(skip_serializing_if = "Option::is_none")]
    base: Option<u64>,
    #[schemars(schema_with = "words::time")]
    at: Wall,
    #[schemars(schema_with = "words::stage")]
    stage: &'static str,
    /// The operator in charge.
    operator: Option<&'a str>,
    #[schemars(schema_with = "words::state")]
    overall: &'static str,
    motion: Motion<'a>,
    /// An incident is being recorded.
    recording: bool,
}

#[derive(Serialize, JsonSchema)]
struct Motion<'a> {
    #[schemars(schema_with = "words::moving")]
    moving: &'static str,
    /// Of the whole km/h that the page shows, to the tenth.
    speed_mps: Option<f64>,
    destination: Option<&'a str>,
}

/// The members after the groups. In a message that says only what changed, a list that did not is not there.
#[derive(Serialize, JsonSchema)]
pub(super) struct Tail<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    roots: Option<Vec<Root<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alarms: Option<Vec<Alarm<'a>>>,
    /// Modules whose faults raise no alarm for now, because a developer has shelved them for maintenance.
    #[serde(skip_serializing_if = "Option::is_none")]
    shelved: Option<Vec<Shelved<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    countermeasures: Option<Vec<Countermeasure<'a>>>,
    /// The signals of the configuration by their names; `null` is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<BTreeMap<String, Option<bool>>>")]
    signals: Option<Signals<'a>>,
    counters: Counters,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "left_out_words")]
    left_out: Option<&'static str>,
}

/// Something of each list that follows the groups.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lists<T> {
    pub roots: T,
    pub alarms: T,
    pub shelved: T,
    pub countermeasures: T,
    pub signals: T,
}

/// A group of modules; a tile of the operator's page.
#[derive(Serialize, JsonSchema)]
pub(super) struct Group<'a> {
    id: &'a str,
    name: &'a str,
    /// The shown state: `ignore` where something else explains it, or where it does not matter now.
    #[schemars(schema_with = "words::state")]
    state: &'static str,
    /// The state without any mask.
    #[schemars(schema_with = "words::state")]
    own: &'static str,
    #[schemars(schema_with = "words::time")]
    since: Wall,
    /// Modules that are OK, of those that count.
    ok: u32,
    counted: u32,
    reason: Option<Why<'a>>,
    /// From this group to the root causes that explain it.
    paths: Vec<Vec<&'a str>>,
}

/// A module up to its `age_ms`, which alone changes with time.
#[derive(Serialize, JsonSchema)]
pub(super) struct ModuleHead<'a> {
    id: &'a str,
    /// The shown state: `ignore` where something else explains it, or where it does not matter now.
    #[schemars(schema_with = "words::state")]
    state: &'static str,
    /// The state without any mask.
    #[schemars(schema_with = "words::state")]
    own: &'static str,
    #[schemars(schema_with = "words::time")]
    since: Wall,
    message: Cow<'a, str>,
}

/// A module after its `age_ms`.
#[derive(Serialize, JsonSchema)]
pub(super) struct ModuleTail<'a> {
    /// When its present fault began, if it is estimated to have begun before its notice.
    #[schemars(with = "Option<String>")]
    #[serde(skip_serializing_if = "Option::is_none")]
    began: Option<Wall>,
    /// To the tenth of a second; `age_ms` is finer.
    #[serde(skip_serializing_if = "Option::is_none")]
    silent_s: Option<f64>,
    reason: Option<Why<'a>>,
    class: Class,
    /// Of the device that the status names; empty if it names none.
    hardware_id: Cow<'a, str>,
    /// The KeyValues of the status.
    #[schemars(with = "BTreeMap<String, String>")]
    values: Values<'a>,
    /// Bytes of the report that had no room in the memory for reports.
    #[serde(skip_serializing_if = "Option::is_none")]
    cut: Option<usize>,
}

/// A module.
#[derive(Serialize, JsonSchema)]
pub struct Module<'a> {
    #[serde(flatten)]
    head: ModuleHead<'a>,
    /// Since its last status; `null` if there was none.
    age_ms: Option<u64>,
    #[serde(flatten)]
    tail: ModuleTail<'a>,
}

/// The class of a monitor, after the paper.
#[derive(Serialize, JsonSchema)]
struct Class {
    #[schemars(schema_with = "words::location")]
    location: &'static str,
    #[schemars(schema_with = "words::information")]
    information: &'static str,
    #[schemars(schema_with = "words::flow")]
    flow: Option<&'static str>,
}

#[derive(Serialize, JsonSchema)]
struct Root<'a> {
    node: &'a str,
    /// Nodes that it explains.
    masks: u32,
    #[schemars(schema_with = "words::time")]
    since: Wall,
    /// It waits for a failing dependency too, which does not explain it: a fault of its own.
    second: bool,
}

#[derive(Serialize, JsonSchema)]
struct Alarm<'a> {
    id: u64,
    node: &'a str,
    #[schemars(schema_with = "words::time")]
    raised: Wall,
    acknowledged: bool,
    active: bool,
    repeats: u32,
}

#[derive(Serialize, JsonSchema)]
struct Shelved<'a> {
    node: &'a str,
    #[schemars(schema_with = "words::time")]
    until: Wall,
    /// The user.
    by: &'a str,
}

#[derive(Serialize, JsonSchema)]
struct Countermeasure<'a> {
    #[schemars(schema_with = "words::request")]
    request: &'static str,
    mps2: Option<f64>,
    /// The one that the page names; a stop may be the operator's alone.
    cause: &'a str,
    #[schemars(schema_with = "words::countermeasure_state")]
    state: &'static str,
    by_operator: bool,
    #[schemars(schema_with = "words::time")]
    since: Wall,
    causes: Vec<&'a str>,
    held: bool,
}

/// The messages received since the start, and those lost or unreadable.
#[derive(Serialize, JsonSchema)]
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
            shelved: lists.shelved.then(|| self.shelved()),
            countermeasures: lists.countermeasures.then(|| self.countermeasures()),
            signals: lists.signals.then(|| self.signals()),
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
        let message = self.words(view.says(now));
        let head = ModuleHead {
            id: &info.id,
            state: view.state.as_str(),
            own: view.own.as_str(),
            since: self.wall(view.since),
            message,
        };
        let tail = ModuleTail {
            began: view.began.map(|began| self.wall(began)),
            silent_s: view.silent_for(now).map(|silent| (silent.as_millis() / 100) as f64 / 10.0),
            reason: view.reason.as_ref().map(|reason| self.why(reason)),
            class: Class {
                location: info.class.location,
                information: info.class.information,
                flow: info.class.flow,
            },
            hardware_id: self.words(Cow::Borrowed(&view.report.hardware_id)),
            values: Values(if self.lacks(LeftOut::Values) { &[] } else { &view.report.values }),
            cut: (view.report.cut > 0).then_some(view.report.cut),
        };
        (head, tail)
    }

    /// The module in one piece.
    pub(super) fn whole_module(&self, id: ModuleId) -> Module<'a> {
        let (head, tail) = self.module(id);
        let received = self.snapshot.module(id).1.received;
        Module { head, age_ms: received.map(|it| self.snapshot.now.since(it).as_millis()), tail }
    }

    fn roots(&self) -> Vec<Root<'a>> {
        let root = |it: &snapshot::RootCause| Root {
            node: self.name(it.node),
            masks: it.masks,
            since: self.wall(it.since),
            second: it.second,
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

    fn shelved(&self) -> Vec<Shelved<'a>> {
        let shelved = |it: &'a snapshot::Shelved| Shelved {
            node: self.name(NodeId::Module(it.module)),
            until: self.wall(it.until),
            by: &it.by,
        };
        self.snapshot.shelved.iter().map(shelved).collect()
    }

    fn countermeasures(&self) -> Vec<Countermeasure<'a>> {
        let countermeasure = |it: &snapshot::Countermeasure| Countermeasure {
            request: it.request.as_str(),
            mps2: it.request.mps2(),
            cause: it.causes.first().map_or("operator", |cause| self.name(cause.node)),
            state: it.state.as_str(),
            by_operator: it.by_operator.is_some(),
            since: self.since(it.since),
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

    fn signals(&self) -> Signals<'a> {
        Signals(&self.snapshot.signals)
    }

    /// A text of a report, or the beginning of it.
    fn words(&self, mut text: Cow<'a, str>) -> Cow<'a, str> {
        if self.lacks(LeftOut::Words) && text.len() > MESSAGE_BYTES {
            let end = text.floor_char_boundary(MESSAGE_BYTES);
            text.to_mut().truncate(end);
        }
        text
    }

    fn why(&self, reason: &Reason) -> Why<'a> {
        Why::of(reason, self.snapshot, if self.lacks(LeftOut::Words) { 1 } else { usize::MAX })
    }

    fn wall(&self, then: Timestamp) -> Wall {
        Wall(wall_at(self.at, self.snapshot.now, then))
    }

    fn since(&self, since: Since) -> Wall {
        let Wall(at) = self.wall(since.at);
        Wall(at.checked_sub(Duration::from(since.before)).unwrap_or(at))
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

/// The parts that an answer may lack.
fn left_out_words(_: &mut SchemaGenerator) -> Schema {
    words::of(LeftOut::ALL.into_iter().filter_map(LeftOut::as_str))
}
