//! Takes the place of the DDS bridge in a replay by another configuration, and in one of a bag: decodes the messages,
//! and tells the engine of their publishers.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::recording::ReplayError;
use super::steps::Notes;
use super::unheard::Unheard;
use telltale_engine::input::{Input, ReceptionTrouble, TroubleKind};
use telltale_engine::model::monitors::{StampClock, TopicSpec, Watched};
use telltale_engine::model::sample::PublisherReport;
use telltale_engine::model::{FieldSource, Limits, Model};
use telltale_msg::fields::Definitions;
use telltale_msg::ros_clock::{self, RosClock};
use telltale_msg::subscription::{Plan, Received, Subscription};
use telltale_record::file::Channel;

/// Topics that are remembered to be read the same way, or not.
const SAME_MAX: usize = 10_000;

pub(super) struct Bridge {
    /// By topic.
    topics: BTreeMap<Arc<str>, Topic>,
    watched: BTreeMap<Box<str>, Arc<TopicSpec>>,
    clock: RosClock,
    /// The journal has the troubles of the reception and what discovery found.
    has_journal: bool,
    model: Arc<Model>,
    /// The configuration whose inputs the journal has; `None`: it is not known, or another one by now.
    recorded: Option<Arc<Model>>,
    /// Topics that both read the same way, as far as they were asked for.
    same: BTreeMap<Box<str>, bool>,
}

/// How a configuration reads a topic: what decides which inputs a message means.
#[derive(PartialEq)]
struct Reading<'m> {
    /// The name of each signal, where it stands, and whether a message can be an event.
    signals: Vec<(&'m str, &'m FieldSource, bool)>,
    watched: Vec<&'m TopicSpec>,
    /// The prefix of its statuses, and their bounds.
    diagnostics: Option<(&'m str, &'m Limits)>,
    stamps: StampClock,
}

impl Reading<'_> {
    fn of<'m>(model: &'m Model, topic: &str) -> Reading<'m> {
        let is_it = |named: &str| name(named) == name(topic);
        let fields = model.signals.iter().filter_map(|spec| Some((spec, spec.source.field()?)));
        let signals = fields.filter(|(_, source)| is_it(&source.topic));
        let Watched { topics, stamps, .. } = &model.watched;
        let named = model.watched.diagnostics_topics().find(|(it, _)| is_it(it));
        Reading {
            signals: signals
                .map(|(spec, source)| (&*spec.name, source, spec.present_for.is_some()))
                .collect(),
            watched: topics.iter().filter(|spec| is_it(&spec.topic)).map(|spec| &**spec).collect(),
            diagnostics: named.map(|(_, prefix)| (prefix, &model.limits)),
            stamps: *stamps,
        }
    }
}

#[derive(Clone)]
struct Topic {
    subscription: Arc<Subscription>,
    /// The engine knows that it has a publisher.
    is_found: bool,
    is_heard: bool,
    /// A message of it could not be read, which is said.
    is_malformed: bool,
}

/// A bridge that goes on from here by itself: clones of the clock are one clock.
impl Clone for Bridge {
    fn clone(&self) -> Bridge {
        let Bridge { topics, watched, clock, has_journal, model, recorded, same } = self;
        Bridge {
            topics: topics.clone(),
            watched: watched.clone(),
            clock: clock.copy(),
            has_journal: *has_journal,
            model: model.clone(),
            recorded: recorded.clone(),
            same: same.clone(),
        }
    }
}

impl Bridge {
    /// # Errors
    /// A field that no message of its type can provide.
    pub fn new(
        model: &Arc<Model>,
        definitions: &Definitions,
        has_journal: bool,
    ) -> Result<Bridge, ReplayError> {
        let plan =
            Plan::of(model, definitions).map_err(|error| ReplayError::Definitions(error.to_string()))?;
        let topic = |subscription: Arc<Subscription>| {
            (
                subscription.topic.clone(),
                Topic { subscription, is_found: false, is_heard: false, is_malformed: false },
            )
        };
        let watched = plan.watched.topics.iter();
        let watched = watched.map(|spec| (name(&spec.topic).into(), spec.clone())).collect();
        let topics = plan.subscriptions.into_iter().map(topic).collect();
        let (model, clock) = (model.clone(), RosClock::default());
        Ok(Bridge { topics, watched, clock, has_journal, model, recorded: None, same: BTreeMap::new() })
    }

    /// The journal has what messages meant to this configuration; `None`: to another one, which is not known.
    pub fn set_recorded(&mut self, recorded: Option<Arc<Model>>) {
        (self.recorded, self.same) = (recorded, BTreeMap::new());
    }

    /// Whether the recorded configuration read this topic as this one does: then what its messages meant is in the
    /// journal, with all that no message says of itself, such as whether it came late.
    pub fn reads_the_same(&mut self, topic: &str) -> bool {
        let Some(recorded) = self.recorded.as_ref().filter(|_| name(topic) != ros_clock::TOPIC) else {
            return false;
        };
        let is_same = match self.same.get(topic) {
            Some(is_same) => *is_same,
            None => {
                let is_same = Reading::of(recorded, topic) == Reading::of(&self.model, topic);
                if self.same.len() < SAME_MAX {
                    self.same.insert(topic.into(), is_same);
                }
                is_same
            }
        };
        if let Some(topic) = self.topics.get_mut(&*name(topic)).filter(|_| is_same) {
            (topic.is_heard, topic.is_found) = (true, true);
        }
        is_same
    }

    /// The meaning of a message.
    pub fn take(&mut self, channel: &Channel, received: Received<'_>, notes: &mut Notes) -> Vec<Input> {
        let Some(topic) = self.topics.get_mut(&*name(&channel.topic)) else { return Vec::new() };
        topic.is_heard = true;
        let mut inputs = Vec::new();
        if topic.subscription.is_untyped() {
            match topic.subscription.learn(&channel.type_name) {
                Ok(learned) => {
                    learned.missing.into_iter().for_each(|sentence| notes.say(sentence));
                    topic.subscription = Arc::new(learned.subscription);
                }
                Err(error) => notes.say(error.to_string()),
            }
        }
        let is_its_type = channel.type_name == topic.subscription.type_name;
        if !std::mem::replace(&mut topic.is_found, true) {
            if !is_its_type {
                notes.say(format!(
                    "the messages of {} are {}, not {}",
                    channel.topic, channel.type_name, topic.subscription.type_name
                ));
            }
            inputs.extend(topic.subscription.watched().map(|spec| {
                Input::Topic(PublisherReport {
                    source: spec.clone(),
                    publishers: u32::from(is_its_type),
                    other_type: (!is_its_type).then(|| (*channel.type_name).into()),
                    transient_local: false,
                    best_effort: false,
                    anew: false,
                })
            }));
        }
        if !is_its_type {
            return inputs;
        }
        let (meant, wrong) = topic.subscription.decode_by(received, &self.clock);
        inputs.extend(meant);
        if let Some(wrong) = wrong {
            notes.malformed += 1;
            if !std::mem::replace(&mut topic.is_malformed, true) {
                notes.say(format!("a message of {} cannot be read: {wrong}", channel.topic));
            }
            // The journal says it already.
            inputs.extend((!self.has_journal).then(|| {
                Input::Reception(ReceptionTrouble {
                    topic: (*channel.topic).into(),
                    kind: TroubleKind::Malformed,
                    count: 1,
                    text: wrong.to_string().into(),
                })
            }));
        }
        inputs
    }

    /// An input of the journal that no message made, for this configuration; `None` if it concerns the other one.
    pub fn fit(&self, input: Input) -> Option<Input> {
        match input {
            Input::Topic(report) => {
                let source = self.watched.get(&*name(&report.source.topic))?.clone();
                Some(Input::Topic(PublisherReport { source, ..report }))
            }
            input => Some(input),
        }
    }

    /// Topics without any message.
    pub fn unheard(&self) -> BTreeSet<Unheard> {
        let unheard = self.topics.values().filter(|topic| !topic.is_heard).map(|topic| &topic.subscription);
        let of = |it: &Arc<Subscription>| Unheard {
            topic: it.topic.to_string(),
            type_name: if it.is_untyped() { String::new() } else { it.type_name.to_string() },
        };
        unheard.map(of).collect()
    }

    /// Whether messages of this topic mean anything.
    pub fn reads(&self, topic: &str) -> bool {
        self.topics.contains_key(&*name(topic))
    }
}

/// The name of a topic with its slash.
fn name(topic: &str) -> String {
    format!("/{}", topic.trim_start_matches('/'))
}
