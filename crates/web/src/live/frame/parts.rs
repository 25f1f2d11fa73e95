//! A snapshot as JSON for programs, kept in parts: a part that did not change is written once, for all
//! snapshots and all programs.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use axum::extract::ws::Utf8Bytes;
use serde::Serialize;
use serde_json::Value;

use super::json::{Context, LeftOut, Lists};
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::{GroupView, ModuleView, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;

/// Where statuses hold more than this, an answer leaves out their KeyValues: it would be too large to be
/// made and sent four times a second.
const VALUES_BYTES_MAX: u64 = 16 << 20;
/// An answer is never larger, but for what the configuration itself makes of it.
const ANSWER_BYTES_MAX: usize = 16 << 20;
/// The bytes of an answer beside the texts of its parts: for each part, and for the rest.
const BESIDE_PART_BYTES: usize = 64;
const BESIDE_BYTES: usize = 1024;
/// A wall clock that is set by more than this is told at once. Less shows when a part changes.
const CLOCK_STEP_MAX: Duration = Duration::from_secs(1);

/// The form in which a program reads snapshots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Form {
    /// Groups without their modules.
    pub groups: bool,
    /// After the first message, only what changed.
    pub deltas: bool,
}

/// The answer that a program has: changes are told against it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent {
    number: u64,
    seq: u64,
}

/// The newest snapshot in parts.
#[derive(Debug)]
pub(super) struct Parts {
    published: Published,
    left_out: LeftOut,
    /// Grows with each snapshot.
    number: u64,
    /// The first one whose parts the present parts can be told against.
    comparable_since: u64,
    /// By their ids.
    groups: Vec<Part>,
    modules: Vec<ModulePart>,
    /// The snapshots in which the lists changed.
    lists: Lists<u64>,
    /// Messages that were made of this snapshot: whole, and what changed since the one before; of groups alone too.
    whole: [Option<Utf8Bytes>; 2],
    step: [Option<(Sent, Utf8Bytes)>; 2],
}

#[derive(Debug, Default)]
struct Part {
    text: String,
    since_ms: Option<u64>,
    changed: u64,
}

#[derive(Debug, Default)]
struct ModulePart {
    part: Part,
    /// Where the age stands in the text.
    age_at: usize,
    received: Option<Timestamp>,
}

impl Parts {
    pub(super) fn new(published: Published) -> Parts {
        let mut parts = Parts {
            left_out: LeftOut::Nothing,
            number: 0,
            comparable_since: 0,
            groups: Vec::new(),
            modules: Vec::new(),
            lists: Lists::default(),
            whole: [None, None],
            step: [None, None],
            published,
        };
        parts.write(None, ANSWER_BYTES_MAX);
        parts
    }

    pub(super) fn published(&self) -> &Published {
        &self.published
    }

    /// Goes on to a later snapshot.
    pub(super) fn follow(&mut self, published: Published) {
        let before = std::mem::replace(&mut self.published, published);
        self.number += 1;
        (self.whole, self.step) = ([None, None], [None, None]);
        self.write(Some(&before), ANSWER_BYTES_MAX);
    }

    /// The message for a program that has `sent`, and what it has then.
    pub(super) fn message(&mut self, form: Form, sent: Option<Sent>) -> (Utf8Bytes, Sent) {
        let has = Sent { number: self.number, seq: self.published.snapshot.seq };
        let message = match sent.filter(|sent| form.deltas && sent.number >= self.comparable_since) {
            Some(sent) => self.delta(form.groups, sent),
            None => self.whole(form.groups),
        };
        (message, has)
    }

    /// The whole snapshot.
    pub(super) fn whole(&mut self, groups_alone: bool) -> Utf8Bytes {
        let made = &self.whole[usize::from(groups_alone)];
        let whole = made.clone().unwrap_or_else(|| self.assemble(groups_alone).into());
        self.whole[usize::from(groups_alone)] = Some(whole.clone());
        whole
    }

    fn delta(&mut self, groups_alone: bool, sent: Sent) -> Utf8Bytes {
        let step = &self.step[usize::from(groups_alone)];
        if let Some((_, message)) = step.as_ref().filter(|(of, _)| *of == sent) {
            return message.clone();
        }
        let message = Utf8Bytes::from(self.changes(groups_alone, sent));
        self.step[usize::from(groups_alone)] = Some((sent, message.clone()));
        message
    }

    fn context(&self) -> Context<'_> {
        Context {
            snapshot: &self.published.snapshot,
            at: self.published.at,
            recording: self.published.recording,
            left_out: self.left_out,
        }
    }

    /// Writes the parts that are not as they were. Leaves out what an answer is the least worse without,
    /// until it is small enough.
    fn write(&mut self, before: Option<&Published>, bytes_max: usize) {
        let snapshot = self.published.snapshot.clone();
        let is_much = snapshot.counters.status_bytes > VALUES_BYTES_MAX;
        let first = if is_much { LeftOut::Values } else { LeftOut::Nothing };
        let mut before = before.filter(|before| is_comparable(before, &self.published));
        for left_out in LeftOut::ALL.into_iter().filter(|&it| it >= first) {
            before = before.filter(|_| left_out == self.left_out);
            self.left_out = left_out;
            if before.is_none() {
                self.comparable_since = self.number;
                self.groups = Vec::new();
                self.modules = Vec::new();
            }
            self.groups.resize_with(snapshot.layout.groups.len(), Part::default);
            self.modules.resize_with(snapshot.layout.modules.len(), ModulePart::default);
            if self.write_parts(&snapshot, before.map(|it| &*it.snapshot), bytes_max) {
                return;
            }
            // The text that was written is no base for anything.
            before = None;
        }
    }

    /// Tells whether the answer is small enough.
    fn write_parts(&mut self, snapshot: &Snapshot, before: Option<&Snapshot>, bytes_max: usize) -> bool {
        let (number, wall, left_out) = (self.number, WallMs::of(&self.published), self.left_out);
        let context =
            Context { snapshot, at: self.published.at, recording: self.published.recording, left_out };
        let is_last = left_out == LeftOut::Modules;
        let (mut texts_bytes, now) = (0, snapshot.now);
        for (id, part) in (0..).map(GroupId).zip(&mut self.groups) {
            let view = &snapshot.groups[id.0 as usize];
            let is_same = before.is_some_and(|before| is_same_group(&before.groups[id.0 as usize], view));
            if part.is_due(is_same, wall.at(view.since), number) {
                part.text = members(&context.group(id));
            }
            texts_bytes += part.text.len();
        }
        for (id, module) in (0..).map(ModuleId).zip(&mut self.modules).take_while(|_| !is_last) {
            let view = &snapshot.modules[id.0 as usize];
            let is_same = before.is_some_and(|before| {
                let (old, silent_s) = (&before.modules[id.0 as usize], |view: &ModuleView, now| {
                    view.silent_for(now).map(|it| it.as_millis() / 1000)
                });
                is_same_module(old, view) && silent_s(old, before.now) == silent_s(view, now)
            });
            module.received = view.received;
            let is_due = module.part.is_due(is_same, wall.at(view.since), number);
            // How long a module is silent stands in its text, to the tenth of a second.
            if is_due || view.silent {
                module.write(&context, id);
            }
            texts_bytes += module.part.text.len();
            if texts_bytes > bytes_max {
                return false;
            }
        }
        let is_same =
            |same: fn(&Snapshot, &Snapshot) -> bool| before.is_some_and(|before| same(before, snapshot));
        if !is_same(|a, b| a.roots == b.roots) {
            self.lists.roots = number;
        }
        if !is_same(|a, b| a.alarms == b.alarms) {
            self.lists.alarms = number;
        }
        if !is_same(|a, b| a.shelved == b.shelved) {
            self.lists.shelved = number;
        }
        if !is_same(|a, b| a.countermeasures == b.countermeasures) {
            self.lists.countermeasures = number;
        }
        if !is_same(|a, b| Arc::ptr_eq(&a.signals, &b.signals) || a.signals == b.signals) {
            self.lists.signals = number;
        }
        let beside_bytes = BESIDE_BYTES + (self.groups.len() + self.modules.len()) * BESIDE_PART_BYTES;
        let at_most = texts_bytes + beside_bytes + listed_bytes_max(snapshot);
        is_last || at_most <= bytes_max || self.whole(false).len() <= bytes_max
    }

    fn assemble(&self, groups_alone: bool) -> String {
        let context = self.context();
        let snapshot = context.snapshot;
        let bytes: usize = self.modules.iter().map(|it| it.part.text.len() + BESIDE_PART_BYTES).sum();
        let mut text = String::with_capacity(if groups_alone { BESIDE_BYTES } else { BESIDE_BYTES + bytes });
        let _ = write!(text, "{{{},\"groups\":[", members(&context.head(None)));
        self.push_groups(&mut text, tops(snapshot), groups_alone);
        let tail = context.tail(Lists {
            roots: true,
            alarms: true,
            shelved: true,
            countermeasures: true,
            signals: true,
        });
        let _ = write!(text, "],{}}}", members(&tail));
        text
    }

    fn push_groups(&self, text: &mut String, ids: impl Iterator<Item = GroupId>, groups_alone: bool) {
        for (index, id) in ids.enumerate() {
            let info = &self.published.snapshot.layout.groups[id.0 as usize];
            let _ = write!(text, "{}{{{}", comma(index), self.groups[id.0 as usize].text);
            if !groups_alone {
                text.push_str(",\"modules\":[");
                for (index, module) in self.modules_of(id).iter().enumerate() {
                    self.push_module(text, index, *module);
                }
                text.push(']');
            }
            text.push_str(",\"groups\":[");
            self.push_groups(text, info.groups.iter().copied(), groups_alone);
            text.push_str("]}");
        }
    }

    /// The modules that are told of a group.
    fn modules_of(&self, id: GroupId) -> &[ModuleId] {
        let modules = &self.published.snapshot.layout.groups[id.0 as usize].modules;
        if self.left_out == LeftOut::Modules { &[] } else { modules }
    }

    fn push_module(&self, text: &mut String, index: usize, id: ModuleId) {
        let module = &self.modules[id.0 as usize];
        let (head, tail) = module.part.text.split_at(module.age_at);
        text.push_str(comma(index));
        text.push_str(head);
        match module.received {
            // Writing to a string cannot fail.
            Some(received) => {
                let _ = write!(text, "{}", self.published.snapshot.now.since(received).as_millis());
            }
            None => text.push_str("null"),
        }
        text.push_str(tail);
    }

    fn changes(&self, groups_alone: bool, sent: Sent) -> String {
        let context = self.context();
        let mut text = format!("{{{},\"groups\":[", members(&context.head(Some(sent.seq))));
        let layout = &context.snapshot.layout;
        let mut shown: Vec<GroupId> = tops(context.snapshot).collect();
        let mut next = 0;
        while let Some(&id) = shown.get(next) {
            shown.extend(&layout.groups[id.0 as usize].groups);
            next += 1;
        }
        let is_new = |part: &Part| part.changed > sent.number;
        let groups = shown.iter().map(|id| &self.groups[id.0 as usize]).filter(|part| is_new(part));
        for (index, part) in groups.enumerate() {
            let _ = write!(text, "{}{{{}}}", comma(index), part.text);
        }
        text.push(']');
        if !groups_alone {
            text.push_str(",\"modules\":[");
            let modules = shown.iter().flat_map(|id| self.modules_of(*id)).copied();
            for (index, id) in modules.filter(|id| is_new(&self.modules[id.0 as usize].part)).enumerate() {
                self.push_module(&mut text, index, id);
            }
            text.push(']');
        }
        let tail = context.tail(Lists {
            roots: self.lists.roots > sent.number,
            alarms: self.lists.alarms > sent.number,
            shelved: self.lists.shelved > sent.number,
            countermeasures: self.lists.countermeasures > sent.number,
            signals: self.lists.signals > sent.number,
        });
        let _ = write!(text, ",{}}}", members(&tail));
        text
    }
}

impl Part {
    /// Notes a change, and tells whether the text has to be written: the wall time of an instant may be
    /// rounded to another millisecond, which is no change.
    fn is_due(&mut self, is_same: bool, since_ms: Option<u64>, number: u64) -> bool {
        if !is_same {
            self.changed = number;
        }
        let is_due = !is_same || since_ms.is_none() || since_ms != self.since_ms;
        self.since_ms = since_ms;
        is_due
    }
}

impl ModulePart {
    fn write(&mut self, context: &Context<'_>, id: ModuleId) {
        let (head, tail) = context.module(id);
        let text = &mut self.part.text;
        text.clear();
        let _ = write!(text, "{{{},\"age_ms\":", members(&head));
        self.age_at = text.len();
        let _ = write!(text, ",{}}}", members(&tail));
    }
}

/// These modules, each as the objects of a snapshot are, and what they lack because there would be too much.
pub fn modules(published: &Published, ids: &[ModuleId]) -> (Vec<Value>, Option<&'static str>) {
    let snapshot = &published.snapshot;
    let context = |left_out| Context { snapshot, at: published.at, recording: published.recording, left_out };
    let levels = [LeftOut::Nothing, LeftOut::Values, LeftOut::Words];
    for left_out in levels {
        let (mut rows, mut bytes) = (Vec::with_capacity(ids.len()), 0);
        for &id in ids {
            let row = serde_json::to_value(context(left_out).whole_module(id));
            let row = row.expect("structs of strings and numbers are JSON");
            bytes += row.to_string().len();
            rows.push(row);
            if bytes > ANSWER_BYTES_MAX && left_out != LeftOut::Words {
                break;
            }
        }
        if rows.len() == ids.len() {
            return (rows, left_out.as_str());
        }
    }
    (Vec::new(), LeftOut::Modules.as_str())
}

/// Whether the parts of one snapshot can stand beside those of the other.
fn is_comparable(before: &Published, now: &Published) -> bool {
    let offset = |it: &Published| WallMs::of(it).offset_ns;
    let (Some(before_ns), Some(now_ns)) = (offset(before), offset(now)) else { return false };
    let step = Duration::from_nanos(before_ns.abs_diff(now_ns));
    before.rewinds == now.rewinds
        && Arc::ptr_eq(&before.snapshot.layout, &now.snapshot.layout)
        && tops(&before.snapshot).eq(tops(&now.snapshot))
        && step < CLOCK_STEP_MAX
}

/// The groups that an answer begins with: the tiles; then the statuses that nothing claims, once there are
/// some, and the diagnosis of the diagnosis, once something is wrong with it.
fn tops(snapshot: &Snapshot) -> impl Iterator<Item = GroupId> {
    let others = (0..snapshot.layout.groups.len() as u32).map(GroupId).filter(|&id| {
        let (info, view) = snapshot.group(id);
        !info.modules.is_empty() && (!info.counted || info.is_system && view.state != State::Ok)
    });
    snapshot.tiles().chain(others)
}

/// The room that the lists after the groups take at most. A character of a name takes up to six bytes.
fn listed_bytes_max(snapshot: &Snapshot) -> usize {
    let roots = snapshot.roots.iter().map(|it| it.node);
    let alarms = snapshot.alarms.iter().map(|it| it.node);
    let causes = snapshot.countermeasures.iter().flat_map(|it| it.causes.iter().map(|it| it.node));
    let shelved = snapshot.shelved.iter().map(|it| NodeId::Module(it.module));
    let nodes = roots
        .chain(alarms)
        .chain(causes)
        .chain(shelved)
        .map(|node| 2 * 6 * snapshot.node_name(node).len() + 256);
    let signals = snapshot.signals.iter().map(|(name, _)| 6 * name.len() + 16);
    nodes.chain(signals).sum()
}

/// All that is told of a group, compared.
fn is_same_group(before: &GroupView, now: &GroupView) -> bool {
    let is_same_paths = Arc::ptr_eq(&before.paths, &now.paths) || before.paths == now.paths;
    before.state == now.state
        && before.own == now.own
        && before.since == now.since
        && (before.ok, before.counted) == (now.ok, now.counted)
        && before.reason == now.reason
        && is_same_paths
}

/// All that is told of a module but its age and its silence, compared.
fn is_same_module(before: &ModuleView, now: &ModuleView) -> bool {
    before.state == now.state
        && before.own == now.own
        && before.since == now.since
        && before.silent == now.silent
        && before.reason == now.reason
        && (Arc::ptr_eq(&before.report, &now.report) || before.report == now.report)
}

/// The milliseconds of instants on the wall clock, by which it is known whether a text is as it was.
#[derive(Clone, Copy)]
struct WallMs {
    /// Nanoseconds since 1970 at the instant zero; `None` if the clock is set to where that says nothing.
    offset_ns: Option<u64>,
}

impl WallMs {
    fn of(published: &Published) -> WallMs {
        let at = published.at.duration_since(UNIX_EPOCH).ok();
        let at_ns = at.and_then(|at| u64::try_from(at.as_nanos()).ok());
        WallMs { offset_ns: at_ns.and_then(|at| at.checked_sub(published.snapshot.now.as_nanos())) }
    }

    fn at(self, then: Timestamp) -> Option<u64> {
        Some(self.offset_ns?.checked_add(then.as_nanos())? / 1_000_000)
    }
}

/// The members of an object, without its braces.
fn members(value: &impl Serialize) -> String {
    let mut text = serde_json::to_string(value).expect("structs of strings and numbers are JSON");
    text.pop();
    text.remove(0);
    text
}

const fn comma(index: usize) -> &'static str {
    if index == 0 { "" } else { "," }
}
