//! Collects from the engine's events what happens to single modules and may be a reason to record. Snapshots alone
//! would miss a short fault.

use std::collections::HashSet;
use std::sync::Arc;

use telltale_engine::event::{Event, EventKind};
use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{Reason, Snapshot};
use telltale_engine::state::State;

/// A state of a module that may be a trigger.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Noticed {
    /// It shows a WARNING, and was not in ERROR: that is no news.
    Warning(Arc<str>),
    /// It is in ERROR itself while it matters, whatever it shows.
    OwnError(Arc<str>),
}

/// Follows the events of one engine, each with the snapshot after it.
#[derive(Debug, Default)]
pub struct Watch {
    /// The modules that are in ERROR themselves and matter.
    failing: HashSet<Arc<str>>,
}

impl Watch {
    pub fn take(&mut self, event: &Event, snapshot: &Snapshot) -> Vec<Noticed> {
        match &event.what {
            &EventKind::Shown { node: NodeId::Module(id), from, to, own, cause, .. } => {
                let (module, _) = snapshot.module(id);
                if !snapshot.group(module.group).0.counted {
                    return Vec::new();
                }
                let (name, matters) = (&module.id, to != State::Ignore || cause.is_some());
                let mut noticed = Vec::new();
                if own != State::Error || !matters {
                    self.failing.remove(name);
                } else if self.failing.insert(name.clone()) {
                    noticed.push(Noticed::OwnError(name.clone()));
                }
                if to == State::Warning && !matches!(from, State::Warning | State::Error) {
                    noticed.push(Noticed::Warning(name.clone()));
                }
                noticed
            }
            EventKind::Left { node } => {
                self.failing.remove(node);
                Vec::new()
            }
            // No event tells what the new configuration changed.
            EventKind::Reloaded => {
                let now: HashSet<Arc<str>> = failing(snapshot).collect();
                let before = std::mem::replace(&mut self.failing, now);
                self.failing.difference(&before).map(|node| Noticed::OwnError(node.clone())).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// The modules that are in ERROR themselves and matter.
fn failing(snapshot: &Snapshot) -> impl Iterator<Item = Arc<str>> {
    snapshot.module_ids().filter_map(|id| {
        let (module, view) = snapshot.module(id);
        let matters = !matches!(view.reason, Some(Reason::NotRelevant(_)));
        let counts = snapshot.group(module.group).0.counted;
        (view.own == State::Error && matters && counts).then(|| module.id.clone())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::incident::{Change, Margins, Open, Tracker, Trigger};
    use telltale_config as config;
    use telltale_engine::Engine;
    use telltale_engine::input::{Input, StatusArray};
    use telltale_engine::time::Timestamp;

    const TEXT: &str = "
vehicle: { stages: none }
defaults: { timeout: 1h }
signals: { driving: { topic: /driving, type: std_msgs/msg/Bool } }
groups:
  - { id: gnss, modules: [{ id: fix, status: fix }] }
  - { id: base, depends_on: [gnss], modules: [{ id: brake, status: brake }] }
  - { id: arm, depends_on: [gnss], when: { signals: { driving: false } }, modules: [{ id: joint, status: joint }] }
";

    struct Watched {
        engine: Engine,
        watch: Watch,
        tracker: Tracker,
    }

    impl Watched {
        /// The fix has failed long ago, and its incident is over.
        fn new() -> Watched {
            let model = config::parse("v.yaml", TEXT).unwrap_or_else(|problems| panic!("{problems}")).model;
            let mut engine = Engine::begin(model, Timestamp::ZERO);
            engine.keep_events();
            let tracker = Tracker::new(Margins::default(), &engine.snapshot());
            let mut watched = Watched { engine, watch: Watch::default(), tracker };
            watched.take(1, Input::Signal { name: "driving".into(), value: true });
            for name in ["brake", "joint"] {
                watched.say(2, name, 0);
            }
            watched.say(3, "fix", 2);
            watched.say(100, "fix", 2);
            assert_eq!(watched.tracker.open(), None);
            watched
        }

        fn say(&mut self, at_s: u64, name: &str, level: u8) -> Vec<Change> {
            let mut array = StatusArray::default();
            array.push_status(level, name, "", "");
            self.take(at_s, Input::Diagnostics(array))
        }

        fn take(&mut self, at_s: u64, input: Input) -> Vec<Change> {
            self.engine.handle(&input, Timestamp::from_millis(1000 * at_s));
            let (snapshot, events) = (self.engine.snapshot(), self.engine.take_events());
            let noticed: Vec<_> = events.iter().flat_map(|it| self.watch.take(it, &snapshot)).collect();
            self.tracker.follow(&snapshot, &noticed)
        }
    }

    fn own_errors(open: &Open) -> Vec<&str> {
        let of = |(_, it): &'_ (Timestamp, Trigger)| match it {
            Trigger::OwnError { node } => Some(node.clone()),
            _ => None,
        };
        let found = open.triggers.iter().filter_map(of).collect::<Vec<_>>();
        ["base/brake", "arm/joint"].into_iter().filter(|it| found.iter().any(|node| **node == **it)).collect()
    }

    #[test]
    fn an_error_behind_another_fault_opens_an_incident_and_its_repetition_does_not() {
        let mut watched = Watched::new();
        // A fault that is hidden from its first instant on.
        let model = watched.engine.snapshot();
        let brake = model.node("base/brake").unwrap();
        let changes = watched.say(101, "brake", 2);
        let [Change::Opened(open)] = &changes[..] else { panic!("{changes:?}") };
        if watched.engine.snapshot().shown(brake).0 == State::Ignore {
            assert_eq!(own_errors(open), ["base/brake"]);
        }
        assert_eq!(watched.say(102, "brake", 2), [], "it is the same one");
        assert!(matches!(watched.say(120, "brake", 0)[..], [Change::Closed(_)]));
        let again = watched.say(121, "brake", 2);
        assert!(matches!(again[..], [Change::Opened(_)]), "{again:?}");
    }

    #[test]
    fn an_error_that_begins_to_matter_opens_one_and_one_that_does_not_matter_none() {
        let mut watched = Watched::new();
        assert_eq!(watched.say(101, "joint", 2), [], "it does not matter");
        let stands = Input::Signal { name: "driving".into(), value: false };
        let changes = watched.take(102, stands);
        assert!(matches!(changes[..], [Change::Opened(_)]), "{changes:?}");
    }

    #[test]
    fn a_fault_is_a_trigger_once_and_its_symptoms_of_the_same_instant_are_others() {
        let mut watched = Watched::new();
        watched.say(200, "fix", 0);
        let mut array = StatusArray::default();
        for name in ["fix", "brake"] {
            array.push_status(2, name, "", "");
        }
        let changes = watched.take(300, Input::Diagnostics(array));
        let [Change::Opened(_), .., Change::Extended(open)] = &changes[..] else { panic!("{changes:?}") };
        assert_eq!((open.triggers.len(), own_errors(open)), (2, vec!["base/brake"]));
    }
}
