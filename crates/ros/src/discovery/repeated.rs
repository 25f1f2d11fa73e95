//! Finds node names that two nodes have had for longer than a restart takes.

use std::collections::{BTreeMap, BTreeSet};

use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

/// A node that crashed counts on until its participant's leases end: three of 10 s, or of 20 s with Fast DDS.
const LASTING: Span = Span::from_secs(90);
/// Nodes with a name of others that are followed.
const NODES_MAX: usize = 1024;
/// Names that are listed.
const LISTED: usize = 5;

/// Follows the graph from one look to the next.
#[derive(Debug, Default)]
pub struct Repeated {
    since: BTreeMap<(Box<str>, Guid, u8), Timestamp>,
    began: Option<Timestamp>,
    said: Option<Option<Box<str>>>,
}

impl Repeated {
    /// Takes the nodes whose name another one has too; returns the names to report, if they changed. The nodes of a
    /// restart come and go; where two of them stay, the name is taken twice.
    pub fn look(&mut self, nodes: &BTreeSet<(&str, Guid, u8)>, now: Timestamp) -> Option<Option<Box<str>>> {
        self.since.retain(|(name, writer, number), _| nodes.contains(&(&**name, *writer, *number)));
        for (name, writer, number) in nodes {
            if self.since.len() < NODES_MAX {
                self.since.entry(((*name).into(), *writer, *number)).or_insert(now);
            }
        }
        let mut staying: BTreeMap<&str, usize> = BTreeMap::new();
        for ((name, ..), since) in &self.since {
            *staying.entry(&**name).or_default() += usize::from(now.since(*since) >= LASTING);
        }
        let names: Vec<&str> =
            staying.into_iter().filter(|(_, nodes)| *nodes > 1).map(|(name, _)| name).collect();
        let listed = names.iter().take(LISTED).copied().collect::<Vec<_>>().join(", ");
        let text = match names.len() {
            0 => None,
            1..=LISTED => Some(listed.into()),
            all => Some(format!("{listed} and {} more", all - LISTED).into()),
        };
        // After a shorter look a second node of the name may still be unseen.
        let knows = now.since(*self.began.get_or_insert(now)) >= LASTING;
        if self.said.as_ref() == Some(&text) || text.is_none() && !knows {
            return None;
        }
        self.said = Some(text.clone());
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Guid = [1; 16];
    const B: Guid = [2; 16];
    const C: Guid = [3; 16];

    fn at(seconds: u64) -> Timestamp {
        Timestamp::ZERO + Span::from_secs(seconds)
    }

    #[test]
    fn two_that_stay_are_reported_until_one_leaves() {
        let mut repeated = Repeated::default();
        let two = BTreeSet::from([("/planner", A, 0), ("/planner", B, 0)]);
        assert_eq!(repeated.look(&two, at(0)), None, "nothing is known yet");
        assert_eq!(repeated.look(&two, at(89)), None);
        assert_eq!(repeated.look(&two, at(90)), Some(Some("/planner".into())));
        assert_eq!(repeated.look(&two, at(91)), None, "nothing is new");
        assert_eq!(repeated.look(&BTreeSet::new(), at(92)), Some(None));
    }

    #[test]
    fn restarts_are_not_however_many_there_are() {
        let mut repeated = Repeated::default();
        // The node that crashed is known for a minute beside the one that was started instead.
        for (from, nodes) in [(0, [A, B]), (60, [B, C]), (120, [C, A]), (180, [A, B])] {
            let nodes = nodes.into_iter().map(|writer| ("/planner", writer, 0)).collect();
            for now in [from, from + 59] {
                assert!(!matches!(repeated.look(&nodes, at(now)), Some(Some(_))), "{now} s");
            }
        }
    }

    #[test]
    fn one_process_can_have_both_and_long_lists_are_cut() {
        let mut repeated = Repeated::default();
        let names: Vec<String> = (0..7).map(|number| format!("/n{number}")).collect();
        let nodes = names.iter().flat_map(|name| [(&**name, A, 0), (&**name, A, 1)]).collect();
        assert_eq!(repeated.look(&nodes, at(0)), None);
        assert_eq!(repeated.look(&nodes, at(90)), Some(Some("/n0, /n1, /n2, /n3, /n4 and 2 more".into())));
    }
}
