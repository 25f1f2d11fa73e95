//! The writers of diagnostics that discovery knows, with their nodes. None of it is proven: without DDS
//! Security, the announcements of participants are believed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use super::nodes::Nodes;
use super::repeated::Repeated;
use crate::engine_queue::stopped;
use crate::every;
use crate::transport::Participant;
use crate::transport::ids::PREFIX;
use telltale_clock::Clock;
use telltale_engine::input::{Input, NodeOf, WriterId, WriterList};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages::{self, DIAGNOSTIC_ARRAY};
use telltale_msg::received::Stamped;
use telltale_msg::sample_bytes::Guid;

const LOOK: Duration = Duration::from_secs(1);
/// An unchanged list is sent again after so many looks, so that statuses of a writer that arrived after its
/// end are removed, too.
const REPEAT_LOOKS: u32 = 5;
/// Writers that are distinguished; no vehicle has more.
const WRITERS_MAX: usize = 1024;
/// The time that discovery has to find everybody.
const DISCOVERY: Span = Span::from_secs(5);
/// A participant announces its nodes within this time of being found, or is not a ROS 2 participant. One that announces
/// some that are not known may be anybody's for longer.
const ANNOUNCED: Span = Span::from_secs(10);

/// Follows discovery from one look to the next.
#[derive(Debug)]
struct StatusWriters {
    since: Timestamp,
    found: BTreeMap<Guid, Timestamp>,
    said: Option<WriterList>,
    looks: u32,
}

impl StatusWriters {
    fn new(since: Timestamp) -> StatusWriters {
        StatusWriters { since, found: BTreeMap::new(), said: None, looks: 0 }
    }

    /// Takes the present writers; returns the input for the engine. `node_of` knows the nodes that are announced, and
    /// whose announcement is not known yet; `is_named` the writers of nodes that the configuration names.
    fn look(
        &mut self,
        writers: &BTreeSet<Guid>,
        (node_of, is_named): (impl Fn(&Guid) -> Option<NodeOf>, impl Fn(&Guid) -> bool),
        (now, is_searching): (Timestamp, bool),
    ) -> Option<WriterList> {
        let known = chosen(writers, is_named);
        self.found.retain(|guid, _| known.contains(guid));
        for guid in known {
            self.found.entry(guid).or_insert(now);
        }
        let node = |(guid, found): (&Guid, &Timestamp)| {
            let is_new = now.since(*found) < ANNOUNCED;
            let unknown = if is_new { NodeOf::Pending } else { NodeOf::Unannounced };
            (WriterId(*guid), node_of(guid).unwrap_or(unknown))
        };
        let known = self.found.iter().map(node).collect();
        // If there are more writers than can be distinguished, none is known to have left.
        let complete = now.since(self.since) >= DISCOVERY && !is_searching && writers.len() <= WRITERS_MAX;
        let list = WriterList { as_of: now, complete, writers: known };
        self.looks += 1;
        let same = |said: &WriterList| said.complete == list.complete && said.writers == list.writers;
        if self.said.as_ref().is_some_and(same) && self.looks < REPEAT_LOOKS {
            return None;
        }
        self.looks = 0;
        self.said = Some(list.clone());
        Some(list)
    }
}

/// The writers for which there is room: those of named nodes, then of each participant in turn, so that neither many
/// participants nor one with many writers take the places of others.
fn chosen(writers: &BTreeSet<Guid>, is_named: impl Fn(&Guid) -> bool) -> BTreeSet<Guid> {
    if writers.len() <= WRITERS_MAX {
        return writers.clone();
    }
    let mut last = None;
    let mut rank = 0;
    let ranked = writers.iter().map(|guid| {
        rank = if last == Some(&guid[..PREFIX]) { rank + 1 } else { 0 };
        last = Some(&guid[..PREFIX]);
        (!is_named(guid), rank, *guid)
    });
    let mut ranked: Vec<(bool, usize, Guid)> = ranked.collect();
    ranked.sort_unstable();
    ranked.into_iter().take(WRITERS_MAX).map(|(.., guid)| guid).collect()
}

/// Runs until it is stopped, or nobody takes the inputs any more.
pub async fn run(
    participant: Participant,
    nodes: watch::Receiver<Nodes>,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
    mut stop: watch::Receiver<bool>,
) {
    let mut looks = every(LOOK);
    let mut speakers = StatusWriters::new(clock.now());
    let mut repeated = Repeated::default();
    loop {
        tokio::select! {
            () = stopped(&mut stop) => return,
            _ = looks.tick() => {}
        }
        // Taken before discovery is asked: messages that come meanwhile are newer than its answer.
        let now = clock.now();
        let is_searching = participant.is_searching() || participant.sees_not_all();
        let writers = writers(&participant);
        let is_searching = is_searching || participant.sees_not_all();
        let (list, names) = {
            let nodes = nodes.borrow();
            let node_of = |guid: &Guid| match nodes.node_of(guid) {
                Some(name) => Some(NodeOf::Named(name.into())),
                None => nodes.is_unheard(guid).then_some(NodeOf::Pending),
            };
            let is_named = |guid: &Guid| nodes.is_of_named(guid);
            let list = speakers.look(&writers, (node_of, is_named), (now, is_searching));
            (list, repeated.look(&nodes.repeated(), now))
        };
        let list = list.map(|list| Input::Writers(Arc::new(list)));
        let names = names.map(|repeated| Input::Nodes { repeated });
        for input in [list, names].into_iter().flatten() {
            tokio::select! {
                () = stopped(&mut stop) => return,
                sent = inputs.send(Stamped::new(input, now)) => if sent.is_err() { return },
            }
        }
    }
}

fn writers(participant: &Participant) -> BTreeSet<Guid> {
    let seen = participant.seen();
    let speak = seen.writers().filter(|found| messages::ros_type_name(&found.type_name) == DIAGNOSTIC_ARRAY);
    speak.map(|found| found.guid).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Guid = [1; 16];
    const B: Guid = [2; 16];

    /// Every announcement is known, and one has a node.
    fn named(writer: Guid, name: &'static str) -> impl Fn(&Guid) -> Option<NodeOf> {
        move |guid| (*guid == writer).then(|| NodeOf::Named(name.into()))
    }

    /// The configuration names no node.
    fn nobody(_: &Guid) -> bool {
        false
    }

    fn node(list: &WriterList, guid: Guid) -> Option<&NodeOf> {
        list.writers.get(&WriterId(guid))
    }

    #[test]
    fn a_writer_without_a_node_has_time_to_be_announced() {
        let at = Timestamp::from_millis;
        let mut speakers = StatusWriters::new(at(0));
        let named = named(A, "/lidar");
        let list = speakers.look(&[A, B].into(), (&named, nobody), (at(1000), false)).unwrap();
        assert!(!list.complete, "others may be found still");
        assert_eq!(node(&list, A), Some(&NodeOf::Named("/lidar".into())));
        assert_eq!(node(&list, B), Some(&NodeOf::Pending));
        assert_eq!(
            speakers.look(&[A, B].into(), (&named, nobody), (at(2000), false)),
            None,
            "nothing is new"
        );
        assert!(speakers.look(&[A, B].into(), (&named, nobody), (at(5000), false)).unwrap().complete);
        let list = speakers.look(&[A, B].into(), (&named, nobody), (at(11_000), false)).unwrap();
        assert_eq!(node(&list, B), Some(&NodeOf::Unannounced));
        let list = speakers.look(&[B].into(), (&named, nobody), (at(12_000), false)).unwrap();
        assert_eq!((node(&list, A), list.as_of), (None, at(12_000)));
    }

    /// Refused, it could not say that something is wrong.
    #[test]
    fn a_writer_whose_announcement_found_no_place_is_not_taken_for_one_without_a_node() {
        let at = Timestamp::from_millis;
        let mut speakers = StatusWriters::new(at(0));
        let unheard = |guid: &Guid| (*guid == A).then_some(NodeOf::Pending);
        speakers.look(&[A, B].into(), (unheard, nobody), (at(0), false));
        let list = speakers.look(&[A, B].into(), (unheard, nobody), (at(60_000), false)).unwrap();
        assert_eq!([A, B].map(|it| node(&list, it).unwrap()), [&NodeOf::Pending, &NodeOf::Unannounced]);
    }

    #[test]
    fn a_participant_with_many_writers_takes_no_place_of_another() {
        let mut speakers = StatusWriters::new(Timestamp::ZERO);
        let own = |it: u32| std::array::from_fn(|n| if n < 12 { 1 } else { it.to_be_bytes()[n - 12] });
        let many: BTreeSet<Guid> = (0..2000).map(own).collect();
        let at = |second: u64| (Timestamp::from_millis(1000 * second), false);
        speakers.look(&many, (|_: &Guid| None, nobody), at(0));
        let with_another: BTreeSet<Guid> = many.iter().copied().chain([B]).collect();
        let list = speakers.look(&with_another, (named(B, "/b"), nobody), at(1)).unwrap();
        assert_eq!(node(&list, B), Some(&NodeOf::Named("/b".into())));
        assert_eq!((list.writers.len(), list.complete), (WRITERS_MAX, false));
    }

    #[test]
    fn a_writer_of_a_named_node_has_a_place_beside_those_of_many_participants() {
        let mut speakers = StatusWriters::new(Timestamp::ZERO);
        let strangers = (0..1500_u16).map(|it| {
            let mut guid = [0; 16];
            guid[..2].copy_from_slice(&it.to_be_bytes());
            guid
        });
        let late = [0xff; 16];
        let all: BTreeSet<Guid> = strangers.chain([late]).collect();
        let at = (Timestamp::from_millis(1000), false);
        let list = speakers.look(&all, (named(late, "/camera"), |guid: &Guid| *guid == late), at).unwrap();
        assert_eq!(node(&list, late), Some(&NodeOf::Named("/camera".into())));
        assert_eq!(list.writers.len(), WRITERS_MAX);
    }

    #[test]
    fn what_did_not_change_is_said_again_and_the_list_is_bounded() {
        let mut speakers = StatusWriters::new(Timestamp::ZERO);
        let at = |look: u64| Timestamp::from_millis(60_000 + 1000 * look);
        let named = named(A, "/a");
        let said: Vec<u64> = (0..11)
            .filter(|&look| speakers.look(&[A].into(), (&named, nobody), (at(look), false)).is_some())
            .collect();
        assert_eq!(said, [0, 5, 10]);
        let many: BTreeSet<Guid> =
            (0..2000_u32).map(|it| std::array::from_fn(|n| it.to_le_bytes()[n % 4])).collect();
        let list = speakers.look(&many, (|_: &Guid| None, nobody), (at(20), false)).unwrap();
        assert_eq!((list.writers.len(), list.complete), (WRITERS_MAX, false));
    }
}
