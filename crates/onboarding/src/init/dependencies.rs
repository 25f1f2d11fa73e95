//! Which group probably depends on which: who is subscribed to a topic depends on who publishes it. Circles, which
//! no configuration may have, are opened where the relations that point the other way weigh least.

use std::collections::{BTreeMap, BTreeSet};

/// The weights of relations, by (who depends, on whom).
pub type Edges = BTreeMap<(usize, usize), i64>;

/// The groups in an order in which most of them come behind those on which they depend (Eades, Lin, Smyth: a
/// heuristic for the feedback arc set).
pub fn order(count: usize, edges: &Edges) -> Vec<usize> {
    let mut left: BTreeSet<usize> = (0..count).collect();
    let (mut first, mut last) = (Vec::new(), Vec::new());
    while !left.is_empty() {
        let among = |(user, provider): (usize, usize)| left.contains(&user) && left.contains(&provider);
        let open: Vec<((usize, usize), i64)> =
            edges.iter().map(|(edge, weight)| (*edge, *weight)).filter(|(edge, _)| among(*edge)).collect();
        let needs = |group: usize| -> i64 {
            open.iter().filter(|((user, _), _)| *user == group).map(|(_, weight)| weight).sum()
        };
        let serves = |group: usize| -> i64 {
            open.iter().filter(|((_, provider), _)| *provider == group).map(|(_, weight)| weight).sum()
        };
        let source = left.iter().copied().find(|&group| needs(group) == 0);
        let sink = || left.iter().copied().find(|&group| serves(group) == 0);
        let best = || left.iter().copied().max_by_key(|&it| (serves(it) - needs(it), std::cmp::Reverse(it)));
        let (next, is_sink) = match (source, source.is_none().then(sink).flatten()) {
            (Some(source), _) => (source, false),
            (None, Some(sink)) => (sink, true),
            (None, None) => (best().unwrap_or_default(), false),
        };
        left.remove(&next);
        if is_sink { last.push(next) } else { first.push(next) }
    }
    last.reverse();
    first.extend(last);
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_relations_point_back() {
        let edges = |all: &[(usize, usize)]| all.iter().map(|edge| (*edge, 1)).collect::<Edges>();
        // 0: sensors, 1: base, 2: localization, 3: navigation; the base takes the commands of the navigation.
        let all = edges(&[(2, 0), (2, 1), (3, 2), (3, 1), (1, 3)]);
        assert_eq!(order(4, &all), [0, 1, 2, 3]);
        assert_eq!(order(3, &edges(&[(0, 1), (1, 2)])), [2, 1, 0]);
        assert_eq!(order(2, &edges(&[])), [0, 1]);
        // One circle, opened where the base takes its commands.
        let circle = [((2, 1), 2), ((3, 2), 2), ((1, 3), 1), ((2, 0), 2)];
        assert_eq!(order(4, &circle.into()), [0, 1, 2, 3]);
    }
}
