//! What all nodes of a vehicle show, put together from keyframes and changes, and its open alarms.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use serde::Serialize;
use telltale_engine::model::Stage;
use telltale_engine::module::system::OTHER_GROUP;
use telltale_engine::state::State;
use telltale_fleet::message::{Alarm, Content, Mark, Message, NodeStates};
use telltale_web::texts::{ID, MESSAGE, clean};

/// Nodes and alarms of one vehicle; further ones are left out.
const NODES_MAX: usize = 5000;
const ALARMS_MAX: usize = 1000;

#[derive(Debug, Default)]
pub struct Picture {
    pub nodes: BTreeMap<String, Shown>,
    pub alarms: BTreeMap<u64, Alarm>,
    pub stage: Option<Stage>,
    /// The last message that is in it.
    pub end: Option<Mark>,
    /// When that was made, by the vehicle's clock, in milliseconds since 1970.
    pub at_ms: Option<i64>,
    /// The last message that people read of in the log: of an alarm, a gap, a goodbye, or another stage.
    pub noted: Option<Mark>,
    /// Nothing is missing in it since a keyframe.
    pub is_whole: bool,
}

/// What a node shows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Shown {
    pub state: State,
    pub own: State,
    /// The root cause that masks it.
    pub cause: Option<String>,
    pub words: String,
}

/// The state of a group, and its modules by their whole names: the name of a module begins with that of its group.
type Group<'a> = (Option<&'a Shown>, Vec<(&'a str, &'a Shown)>);

impl Picture {
    /// The place of the last message that people read of in the log; empty if there is none.
    pub fn noted_place(&self) -> String {
        self.noted.map(|mark| format!("{}-{}", mark.epoch, mark.n)).unwrap_or_default()
    }

    /// The worst of its components; UNKNOWN if there are none.
    pub fn overall(&self) -> State {
        // The group for other statuses is empty.
        let is_empty = |group: &str| {
            let is_of = |name: &String| name.split_once('/').is_some_and(|(of, _)| of == group);
            group == OTHER_GROUP && !self.nodes.keys().any(is_of)
        };
        let groups = self.nodes.iter().filter(|(name, _)| !name.contains('/') && !is_empty(name));
        groups.map(|(_, node)| node.state).max().unwrap_or(State::Unknown)
    }

    pub fn groups(&self) -> BTreeMap<&str, Group<'_>> {
        let mut groups: BTreeMap<&str, Group<'_>> = BTreeMap::new();
        for (name, node) in &self.nodes {
            match name.split_once('/') {
                None => groups.entry(name).or_default().0 = Some(node),
                Some((group, _)) => groups.entry(group).or_default().1.push((name, node)),
            }
        }
        groups
    }

    /// The nodes that wait for each cause.
    pub fn waiting(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut waiting: BTreeMap<_, Vec<&str>> = BTreeMap::new();
        for (name, node) in &self.nodes {
            if let Some(cause) = node.cause.as_deref() {
                waiting.entry(cause).or_default().push(name);
            }
        }
        waiting
    }

    /// Takes the next message of the log. One that is not newer is passed over.
    pub fn take(&mut self, message: &Message) {
        let mark = message.mark();
        if self.end.is_some_and(|end| mark <= end) {
            return;
        }
        let follows = self.end.is_some_and(|end| end.epoch == mark.epoch && end.n + 1 == mark.n);
        if self.end.is_some_and(|end| end.epoch != mark.epoch) {
            // Another run of the program tells all open alarms again.
            self.alarms.clear();
        }
        self.is_whole &= follows;
        self.end = Some(message.end());
        self.at_ms = Some(message.at);
        let is_noted = match &message.content {
            Content::Keyframe(all) | Content::Delta(all) => self.stage != Some(all.stage),
            content => matches!(content, Content::Alarm(_) | Content::Gap(_) | Content::Goodbye),
        };
        if is_noted {
            self.noted = Some(mark);
        }
        match &message.content {
            Content::Keyframe(all) => {
                self.nodes.clear();
                self.is_whole = true;
                self.show(all);
            }
            Content::Delta(changed) => self.show(changed),
            Content::Alarm(alarm) => self.note(alarm),
            Content::Gap(_) => self.is_whole = false,
            Content::Head(_)
            | Content::AuditHead(_)
            | Content::Incident(_)
            | Content::Recording(_)
            | Content::Goodbye
            | Content::Unknown => {}
        }
    }

    fn show(&mut self, changed: &NodeStates) {
        self.stage = Some(changed.stage);
        for node in &changed.nodes {
            let name = shown_name(&node.node);
            if node.gone {
                self.nodes.remove(&name);
                continue;
            }
            if self.nodes.len() >= NODES_MAX && !self.nodes.contains_key(&name) {
                self.is_whole = false;
                continue;
            }
            let cause = node.cause.as_deref().map(shown_name);
            let words = clean(&node.words, MESSAGE);
            self.nodes.insert(name, Shown { state: node.state, own: node.own, cause, words });
        }
    }

    fn note(&mut self, alarm: &Alarm) {
        if !alarm.active && alarm.acknowledged {
            self.alarms.remove(&alarm.number);
        } else if self.alarms.len() < ALARMS_MAX || self.alarms.contains_key(&alarm.number) {
            let (node, words) = (clean(&alarm.node, ID), clean(&alarm.words, MESSAGE));
            self.alarms.insert(alarm.number, Alarm { node, words, ..alarm.clone() });
        }
    }
}

/// The name of a node on the page. Names that differ only in letters that are not drawn stay apart.
fn shown_name(name: &str) -> String {
    let shown = clean(name, ID);
    if shown == name {
        return shown;
    }
    let mut hasher = DefaultHasher::new();
    name.hash(&mut hasher);
    format!("{shown} #{:08x}", hasher.finish() as u32)
}
