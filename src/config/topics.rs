//! The topics that are read: each has one name, one type and one place in the model.

use std::collections::HashMap;
use std::sync::Arc;

use super::places::TopicPlace;
use super::raw_source::Topic;
use crate::engine::monitor::spec::{
    FieldKind, FieldSpec, TopicId, TopicSpec, WatchdogId, WatchdogSpec, Watched,
};
use crate::yaml::{Log, Problem, Span, Spanned};

/// What is read without being named.
const DIAGNOSTICS: (&str, &str) = ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray");
/// A longer path names no field of a message.
const PATH_BYTES_MAX: usize = 512;

/// All topics of a configuration, collected while what reads them is resolved.
#[derive(Default)]
pub(super) struct Topics {
    /// The type of each topic, and where its name and its type are first said.
    types: HashMap<String, (String, Option<(Span, Span)>)>,
    watched: Vec<TopicSpec>,
    places: Vec<TopicPlace>,
    by_name: HashMap<String, usize>,
    fields: HashMap<(usize, FieldSpec), u32>,
    watchdogs: Vec<Arc<WatchdogSpec>>,
}

impl Topics {
    pub fn new() -> Topics {
        let (topic, type_name) = DIAGNOSTICS;
        let types = HashMap::from([(topic.to_owned(), (type_name.to_owned(), None))]);
        Topics { types, ..Topics::default() }
    }

    /// Checks the name and the type of a topic that something reads, and that everything else which
    /// reads it says the same type.
    pub fn read(&mut self, name: &Spanned<String>, type_name: &Spanned<String>, log: &mut Log) {
        check_topic(name, log);
        check_type(type_name, log);
        match self.types.get(&name.value) {
            None => {
                self.types
                    .insert(name.value.clone(), (type_name.value.clone(), Some((name.span, type_name.span))));
            }
            Some((known, _)) if *known == type_name.value => {}
            Some((known, first)) => {
                let text = format!("{} is read as {known} already", name.value);
                let problem = Problem::at(type_name.span, text);
                let problem = match first {
                    Some((_, first)) => problem.also(*first, "here"),
                    None => problem,
                };
                log.push(problem.help("a topic has one type; correct the type, or name another topic"));
            }
        }
    }

    /// Whether something reads this topic.
    pub fn reads(&self, name: &str) -> bool {
        self.types.contains_key(name)
    }

    /// Where this topic is first named.
    pub fn place(&self, name: &str) -> Option<Span> {
        self.types.get(name).and_then(|(_, first)| first.map(|(name, _)| name))
    }

    /// The place of a topic that a monitor watches.
    pub fn watch(&mut self, topic: &Topic, stamp: bool, log: &mut Log) -> TopicId {
        self.read(&topic.name, &topic.type_name, log);
        let index = *self.by_name.entry(topic.name.value.clone()).or_insert_with(|| {
            self.watched.push(TopicSpec {
                topic: topic.name.value.as_str().into(),
                type_name: topic.type_name.value.as_str().into(),
                stamp: false,
                fields: Vec::new(),
            });
            let (name, type_name) = (topic.name.span, topic.type_name.span);
            self.places.push(TopicPlace { name, type_name, stamp: None, fields: Vec::new() });
            self.watched.len() - 1
        });
        if stamp {
            self.watched[index].stamp = true;
            self.places[index].stamp.get_or_insert(topic.type_name.span);
        }
        TopicId(index as u32)
    }

    /// A topic that a monitor watches, and the position of the field in it.
    pub fn field(
        &mut self,
        topic: &Topic,
        path: &Spanned<String>,
        kind: FieldKind,
        log: &mut Log,
    ) -> (TopicId, u32) {
        let id = self.watch(topic, false, log);
        check_path(path, log);
        let index = id.0 as usize;
        let field = FieldSpec { path: path.value.as_str().into(), kind };
        let position = *self.fields.entry((index, field.clone())).or_insert_with(|| {
            self.watched[index].fields.push(field);
            self.places[index].fields.push(path.span);
            (self.watched[index].fields.len() - 1) as u32
        });
        (id, position)
    }

    pub fn watchdog(&mut self, spec: WatchdogSpec) -> WatchdogId {
        let found = self.watchdogs.iter().position(|known| **known == spec);
        let index = found.unwrap_or_else(|| {
            self.watchdogs.push(Arc::new(spec));
            self.watchdogs.len() - 1
        });
        WatchdogId(index as u32)
    }

    pub fn finish(self) -> (Watched, Vec<TopicPlace>) {
        let topics = self.watched.into_iter().map(Arc::new).collect();
        (Watched { topics, watchdogs: self.watchdogs }, self.places)
    }
}

/// A name with its namespace, as ROS writes it: `/mission/active`.
pub(super) fn is_full_name(name: &str) -> bool {
    let word = |part: &str| {
        !part.is_empty()
            && !part.starts_with(|c: char| c.is_ascii_digit())
            && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(word))
}

pub(super) fn check_topic(topic: &Spanned<String>, log: &mut Log) {
    if !is_full_name(&topic.value) {
        let problem = Problem::at(topic.span, format!("`{}` is no full topic name", topic.value));
        log.push(problem.help("begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`"));
    }
}

fn check_type(name: &Spanned<String>, log: &mut Log) {
    let parts: Vec<&str> = name.value.split('/').collect();
    let word = |part: &&str| {
        !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    if parts.len() == 3 && parts[1] == "msg" && parts.iter().all(word) {
        return;
    }
    let problem = Problem::at(name.span, format!("`{}` is no message type", name.value));
    log.push(problem.help(match parts[..] {
        [package, message] if word(&package) && word(&message) => {
            format!("did you mean `{package}/msg/{message}`?")
        }
        _ => "write `package/msg/Name`, for example `std_msgs/msg/Bool`".into(),
    }));
}

/// Whether it can be the path of a field at all: `poses[0].position.x`, `transforms[child_frame_id=base].transform`.
pub(super) fn check_path(path: &Spanned<String>, log: &mut Log) {
    if path.value.len() > PATH_BYTES_MAX || !is_path(&path.value) {
        let problem = Problem::at(path.span, format!("`{}` is no path of a field", path.value));
        log.push(problem.help(
            "write names with dots, elements in brackets: `twist.linear.x`, `poses[0].position.x`, `transforms[child_frame_id=base_link].transform`",
        ));
    }
}

/// Splits at the dots outside of brackets and looks at each part.
fn is_path(path: &str) -> bool {
    let mut rest = path;
    loop {
        let name = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
        if name == 0 || rest.starts_with(|c: char| c.is_ascii_digit()) {
            return false;
        }
        rest = &rest[name..];
        while let Some(inside) = rest.strip_prefix('[') {
            let Some((index, after)) = inside.split_once(']') else { return false };
            let number = !index.is_empty() && index.bytes().all(|byte| byte.is_ascii_digit());
            let chosen = index.split_once('=').is_some_and(|(field, _)| is_path(field));
            if !number && !chosen {
                return false;
            }
            rest = after;
        }
        match rest.strip_prefix('.') {
            Some(after) => rest = after,
            None => return rest.is_empty(),
        }
    }
}
