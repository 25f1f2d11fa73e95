//! The topics to read: each has one name, one type and one index in the model.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use crate::decode::Spanned;
use crate::describe::places::TopicPlace;
use crate::file::monitors::sources::{
    DIAGNOSTICS_MAX, PREFIX_BYTES_MAX, RawDiagnostics, RawDiagnosticsTopic, Topic,
};
use crate::file::ros_names::{check_list, check_path, check_topic, check_type};
use telltale_engine::model::monitors::{
    DIAGNOSTIC_ARRAY, DIAGNOSTICS, DiagnosticsTopic, FieldKind, FieldSpec, StampClock, TopicId, TopicSpec,
    WatchdogId, WatchdogSpec, Watched,
};
use telltale_yaml::{Log, Problem, Span};

/// The topic of the time of a simulation.
const CLOCK: (&str, &str) = ("/clock", "rosgraph_msgs/msg/Clock");

/// All topics of a configuration, collected while signals and monitors are resolved.
#[derive(Default)]
pub(crate) struct Topics {
    /// The type of each topic, empty while it is unknown, and the first places of its name and its type.
    types: HashMap<String, (String, Option<(Span, Span)>)>,
    watched: Vec<TopicSpec>,
    places: Vec<TopicPlace>,
    by_name: HashMap<String, usize>,
    fields: HashMap<(usize, FieldSpec), u32>,
    watchdogs: Vec<Arc<WatchdogSpec>>,
    diagnostics: Vec<DiagnosticsTopic>,
    stamps: StampClock,
}

impl Topics {
    /// Starts with the topics of diagnostics and of the clock.
    pub fn new(diagnostics: Option<&RawDiagnostics>, stamps: StampClock, log: &mut Log) -> Topics {
        let mut topics = Topics { stamps, ..Topics::default() };
        if stamps == StampClock::Ros {
            topics.types.insert(CLOCK.0.to_owned(), (CLOCK.1.to_owned(), None));
        }
        let Some(raw) = diagnostics else {
            topics.types.insert(DIAGNOSTICS.to_owned(), (DIAGNOSTIC_ARRAY.to_owned(), None));
            return topics;
        };
        if raw.topics.is_empty() || raw.topics.len() > DIAGNOSTICS_MAX {
            let text =
                format!("{} topics of diagnostics; it can be 1 to {DIAGNOSTICS_MAX}", raw.topics.len());
            log.push(Problem::at(raw.span, text).help("write `diagnostics: { topics: [/diagnostics] }`"));
        }
        for RawDiagnosticsTopic { topic, prefix } in &raw.topics {
            let Some(topic) = topic else { continue };
            check_topic(topic, log);
            let prefix = prefix.as_ref();
            if let Some(prefix) = prefix.filter(|prefix| prefix.value.len() > PREFIX_BYTES_MAX) {
                let text = format!("a prefix has at most {PREFIX_BYTES_MAX} bytes");
                log.push(Problem::at(prefix.span, text).help("write a shorter one"));
            }
            let place = Some((topic.span, topic.span));
            let known = topics.types.insert(topic.value.clone(), (DIAGNOSTIC_ARRAY.to_owned(), place));
            if known.is_some() {
                let problem = Problem::at(topic.span, format!("{} is read already", topic.value));
                log.push(problem.help("name each topic once"));
            }
            topics.diagnostics.push(DiagnosticsTopic {
                topic: topic.value.as_str().into(),
                prefix: prefix.map_or("", |prefix| &prefix.value).into(),
            });
        }
        topics
    }

    /// Checks the name and the type of a read topic, and that no other place names another type.
    pub fn read(&mut self, name: &Spanned<String>, type_name: Option<&Spanned<String>>, log: &mut Log) {
        check_topic(name, log);
        let Some(type_name) = type_name else {
            self.types.entry(name.value.clone()).or_insert((String::new(), Some((name.span, name.span))));
            return;
        };
        check_type(type_name, log);
        match self.types.get_mut(&name.value) {
            None => {
                self.types
                    .insert(name.value.clone(), (type_name.value.clone(), Some((name.span, type_name.span))));
            }
            Some((known, _)) if *known == type_name.value => {}
            Some((known, first)) if known.is_empty() => {
                *known = type_name.value.clone();
                *first = first.map(|(name, _)| (name, type_name.span));
            }
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

    /// Whether this topic is read.
    pub fn reads(&self, name: &str) -> bool {
        self.types.contains_key(name)
    }

    /// The type of a topic, from any place of the file.
    pub fn type_of(&self, name: &str) -> &str {
        self.types.get(name).map_or("", |(type_name, _)| type_name)
    }

    /// The name of a watched topic.
    pub fn name_of(&self, id: TopicId) -> &str {
        &self.watched[id.0 as usize].topic
    }

    /// The first place of this topic's name.
    pub fn place(&self, name: &str) -> Option<Span> {
        self.types.get(name).and_then(|(_, first)| first.map(|(name, _)| name))
    }

    /// The index of a topic that a monitor watches.
    pub fn watch(&mut self, topic: &Topic, stamp: bool, log: &mut Log) -> TopicId {
        self.read(&topic.name, topic.type_name.as_ref(), log);
        let index = *self.by_name.entry(topic.name.value.clone()).or_insert_with(|| {
            self.watched.push(TopicSpec {
                topic: topic.name.value.as_str().into(),
                type_name: "".into(),
                stamp: false,
                fields: Vec::new(),
            });
            let (name, type_name) = (topic.name.span, topic.place());
            self.places.push(TopicPlace { name, type_name, stamp: None, fields: Vec::new() });
            self.watched.len() - 1
        });
        if stamp {
            self.watched[index].stamp = true;
            self.places[index].stamp.get_or_insert(topic.place());
        }
        TopicId(index as u32)
    }

    /// A topic that a monitor watches, and the index of the field in it.
    pub fn field(
        &mut self,
        topic: &Topic,
        path: &Spanned<String>,
        kind: FieldKind,
        log: &mut Log,
    ) -> (TopicId, u32) {
        self.field_with_names(topic, path, kind, BTreeSet::new(), log)
    }

    /// The same, with the names that a condition gives to its numbers.
    pub fn field_with_names(
        &mut self,
        topic: &Topic,
        path: &Spanned<String>,
        kind: FieldKind,
        names: BTreeSet<Box<str>>,
        log: &mut Log,
    ) -> (TopicId, u32) {
        let id = self.watch(topic, false, log);
        match kind {
            FieldKind::Positions | FieldKind::Elements => check_list(path, log),
            // All of the message.
            FieldKind::Content if path.value.is_empty() => {}
            // Made of a frame, whose name was checked.
            FieldKind::Transforms => {}
            FieldKind::Scalar | FieldKind::Named | FieldKind::Pose | FieldKind::Content => {
                check_path(path, log);
            }
        }
        let index = id.0 as usize;
        let field = FieldSpec { path: path.value.as_str().into(), kind, names };
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
        let types = &self.types;
        let typed = |spec: TopicSpec| {
            let type_name = types.get(&*spec.topic).map_or("", |(type_name, _)| type_name).into();
            Arc::new(TopicSpec { type_name, ..spec })
        };
        let topics = self.watched.into_iter().map(typed).collect();
        let Topics { watchdogs, diagnostics, stamps, .. } = self;
        (Watched { topics, watchdogs, diagnostics, stamps, ..Watched::default() }, self.places)
    }
}
