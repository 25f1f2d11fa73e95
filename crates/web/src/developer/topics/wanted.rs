//! The topics that the configuration's monitors read, and the rate that they want of each.

use std::collections::HashMap;

use telltale_engine::discovery::TopicSeen;
use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::snapshot::{Reason, Snapshot};
use telltale_engine::state::State;

/// The rate that monitors want of one topic.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wanted {
    /// The modules whose monitors read it.
    pub monitors: Vec<ModuleId>,
    /// The strictest limits of its rate, of those that matter now if any does.
    pub least_hz: Option<f64>,
    pub most_hz: Option<f64>,
    /// One of those that want a rate matters now.
    pub is_now: bool,
    /// One of these has measured for long enough to say something.
    pub is_judged: bool,
}

/// By the ROS names of the topics.
pub fn all_wanted(snapshot: &Snapshot) -> HashMap<&str, Wanted> {
    let mut all: HashMap<&str, Wanted> = HashMap::new();
    for id in snapshot.module_ids() {
        let Some(reads) = &snapshot.module(id).0.reads else { continue };
        for topic in &reads.topics {
            all.entry(topic).or_default().monitors.push(id);
        }
        let (Some(bands), Some(topic)) = (reads.rate, reads.topics.first()) else { continue };
        let is_now = !matches!(snapshot.shown(NodeId::Module(id)).1, Some(Reason::NotRelevant(_)));
        let least = [bands.warning_below, bands.error_below].into_iter().flatten().reduce(f64::max);
        let most = [bands.warning_above, bands.error_above].into_iter().flatten().reduce(f64::min);
        let wanted = all.entry(topic).or_default();
        wanted.want(least, most, is_now);
        wanted.is_judged |= is_now && snapshot.module(id).1.own != State::Unknown;
    }
    all
}

impl Wanted {
    fn want(&mut self, least: Option<f64>, most: Option<f64>, is_now: bool) {
        if is_now && !self.is_now {
            (self.least_hz, self.most_hz, self.is_now) = (None, None, true);
        }
        if is_now == self.is_now {
            self.least_hz = [self.least_hz, least].into_iter().flatten().reduce(f64::max);
            self.most_hz = [self.most_hz, most].into_iter().flatten().reduce(f64::min);
        }
    }

    /// Fewer messages come than a monitor wants now.
    pub fn is_too_slow(&self, topic: &TopicSeen) -> bool {
        self.is_judged
            && self.least_hz.zip(topic.rate_hz).is_some_and(|(least, rate)| f64::from(rate) < least)
    }

    /// More messages come than a monitor wants now.
    pub fn is_too_fast(&self, topic: &TopicSeen) -> bool {
        self.is_judged && self.most_hz.zip(topic.rate_hz).is_some_and(|(most, rate)| f64::from(rate) > most)
    }

    /// `≥ 7 Hz`, `7 to 12 Hz`; `None` if no rate is wanted.
    pub fn in_words(&self) -> Option<String> {
        match (self.least_hz, self.most_hz) {
            (None, None) => None,
            (Some(least), None) => Some(format!("\u{2265} {least} Hz")),
            (None, Some(most)) => Some(format!("\u{2264} {most} Hz")),
            (Some(least), Some(most)) => Some(format!("{least}\u{2013}{most} Hz")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strictest_limit_of_those_that_matter_now_counts() {
        let mut wanted = Wanted::default();
        wanted.want(Some(30.0), None, false);
        let topic = |rate_hz| TopicSeen { rate_hz, ..TopicSeen::default() };
        assert!(!wanted.is_too_slow(&topic(Some(1.0))), "nobody wants it now");
        assert_eq!(wanted.in_words().as_deref(), Some("\u{2265} 30 Hz"));
        wanted.want(Some(7.0), Some(20.0), true);
        wanted.want(Some(0.5), Some(15.5), true);
        wanted.want(Some(40.0), None, false);
        assert!(!wanted.is_too_slow(&topic(Some(6.9))), "the monitors still measure");
        wanted.is_judged = true;
        assert_eq!(wanted.in_words().as_deref(), Some("7\u{2013}15.5 Hz"));
        let is = |rate| (wanted.is_too_slow(&topic(rate)), wanted.is_too_fast(&topic(rate)));
        assert_eq!(
            [Some(6.9), Some(7.0), Some(15.6), None].map(is),
            [(true, false), (false, false), (false, true), (false, false)]
        );
    }
}
