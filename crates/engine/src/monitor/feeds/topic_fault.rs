//! Topics without publisher or with a wrong type, and their effect on a judgement.

use super::{Publishers, TopicId, Watch, Watching};
use crate::model::Policy;
use crate::model::monitors::TopicSpec;
use crate::monitor::{Monitor, Words};
use crate::state::State;
use crate::text::say;
use crate::time::Timestamp;

/// The reason why a topic cannot be judged as usual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TopicFault {
    WrongType(TopicId),
    NoPublisher(TopicId),
    /// It has a publisher again, which has sent nothing yet: earlier messages are from another publisher.
    NoMessageYet(TopicId),
}

/// A judgement, and the reason why it cannot be made as usual.
pub(super) struct Judged {
    pub(super) judged: Option<State>,
    pub(super) topic_fault: Option<TopicFault>,
    /// The state that follows.
    pub(super) state: Option<State>,
}

impl Watching {
    /// The judgement of a monitor, combined with the faults of its topics. The worse of both counts: an ERROR does not
    /// end because its publisher is gone.
    pub(super) fn look(&mut self, index: u32, policy: &Policy, now: Timestamp) -> Judged {
        let topic_fault = self.topic_fault(index);
        let watch = &mut self.watches[index as usize];
        let judged = watch.monitor.judge(now);
        let of_fault = topic_fault.map(|topic_fault| match topic_fault {
            TopicFault::WrongType(_) | TopicFault::NoMessageYet(_) => State::Unknown,
            TopicFault::NoPublisher(_) => policy.no_publisher,
        });
        let is_frequency = matches!(watch.monitor, Monitor::Frequency(_));
        let state = match topic_fault {
            // No publisher is 0 Hz, which the bands judge; if they find that OK, the `no_publisher` state
            // counts.
            Some(TopicFault::NoPublisher(_)) if is_frequency => {
                judged.map(|state| if state == State::Ok { policy.no_publisher } else { state })
            }
            // Its type is to be learned from a publisher and cannot be: nothing was counted, so the rate is
            // unknown.
            Some(TopicFault::WrongType(id)) if self.topics[id.0 as usize].spec.type_name.is_empty() => {
                judged.map(|_| State::Unknown).or(of_fault.filter(|_| !watch.by_the_clock))
            }
            Some(TopicFault::NoMessageYet(_)) => judged.max(of_fault.filter(|_| judged.is_some())),
            Some(TopicFault::NoPublisher(_) | TopicFault::WrongType(_)) | None if watch.by_the_clock => {
                judged.map(|state| state.max(of_fault.unwrap_or(State::Ok)))
            }
            Some(TopicFault::NoPublisher(_) | TopicFault::WrongType(_)) | None => judged.max(of_fault),
        };
        Judged { judged, topic_fault, state }
    }

    /// A wrong type is a better explanation than a missing publisher, and that than a silence.
    fn topic_fault(&self, index: u32) -> Option<TopicFault> {
        let Watch { topics, by_the_clock, monitor, .. } = &self.watches[index as usize];
        let of = |&id: &TopicId| {
            let topic = &self.topics[id.0 as usize];
            match &topic.news {
                // A monitor that judges by the clock does not wait for discovery: until a publisher is found
                // there is none.
                None => (*by_the_clock && !topic.heard).then_some(TopicFault::NoPublisher(id)),
                Some(Publishers { publishers: 0, other_type: Some(_), .. }) => {
                    Some(TopicFault::WrongType(id))
                }
                Some(Publishers { publishers: 0, .. }) => Some(TopicFault::NoPublisher(id)),
                Some(_) => (topic.left && !by_the_clock).then_some(TopicFault::NoMessageYet(id)),
            }
        };
        let weight = |topic_fault: &TopicFault| match topic_fault {
            TopicFault::NoMessageYet(_) => 0,
            TopicFault::NoPublisher(_) => 1,
            TopicFault::WrongType(_) => 2,
        };
        let needed = topics.iter().enumerate().filter(|(slot, _)| monitor.needs_publisher(*slot));
        needed.map(|(_, topic)| topic).rev().filter_map(of).max_by_key(weight)
    }

    /// Combines the reason with the measured values, if those are judged beside it.
    pub(super) fn say(&self, topic_fault: Option<TopicFault>, beside: bool, words: Words) -> Words {
        let Some(topic_fault) = topic_fault else { return words };
        let message = match topic_fault {
            TopicFault::NoPublisher(id) => say!(
                "nobody publishes {topic}",
                "niemand veröffentlicht {topic}",
                topic = &*self.topics[id.0 as usize].spec.topic
            ),
            TopicFault::NoMessageYet(id) => say!(
                "nothing came since {topic} is published again",
                "nichts empfangen, seit {topic} wieder veröffentlicht wird",
                topic = &*self.topics[id.0 as usize].spec.topic
            ),
            TopicFault::WrongType(id) => {
                let topic = &self.topics[id.0 as usize];
                let other = topic.news.as_ref().and_then(|news| news.other_type.as_deref()).unwrap_or("?");
                let TopicSpec { topic, type_name, .. } = &*topic.spec;
                if type_name.is_empty() {
                    let said = if other.contains(", ") {
                        say!(
                            "{topic} is published as {other}: name one of them with `type`",
                            "{topic} wird als {other} veröffentlicht: einen davon mit `type` angeben",
                            topic = &**topic,
                            other
                        )
                    } else {
                        say!(
                            "{topic} is published as {other}, which cannot be read: name its `type`, or where its definition is",
                            "{topic} wird als {other} veröffentlicht und ist so nicht lesbar: `type` angeben, oder wo die Definition liegt",
                            topic = &**topic,
                            other
                        )
                    };
                    return Words { message: said, values: Vec::new() };
                }
                say!(
                    "{topic} has type {other}, configuration says {wanted}",
                    "{topic} hat den Typ {other}, laut Konfiguration {wanted}",
                    topic = &**topic,
                    other,
                    wanted = &**type_name
                )
            }
        };
        if beside {
            let message = say!("{said}; {message}", "{said}; {message}", said = words.message, message);
            Words { message, values: words.values }
        } else {
            Words { message, values: Vec::new() }
        }
    }
}
