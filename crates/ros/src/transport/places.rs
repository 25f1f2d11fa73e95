//! Which of the discovered endpoints are followed when there are more than the program takes. What matters here comes
//! first, and then each participant in turn: so one with thousands pushes out its own alone.

use std::collections::{BTreeMap, BTreeSet};

use super::{ENDPOINTS_MAX, Found};
use crate::transport::ids::{self, Prefix};
use telltale_msg::sample_bytes::Guid;

/// Endpoints on topics of ours that any participant may have, however many others there are.
const SHARE: usize = 256;
/// With more than these the looks at them take all the time.
const DISCOVERED_MAX: usize = 65_536;

/// Those that are followed, and how many others there are.
pub struct Places {
    pub followed: BTreeMap<Guid, Found>,
    /// On topics of ours: more of one participant than its share.
    pub cut_of_ours: u32,
    pub cut: u32,
}

/// Chooses among all. Those that are `told` keep their places before others of their participant, and those of `ours`,
/// the topics that are read, written or watched here, come before all others.
///
/// # Errors
/// There are more than can be looked at: the process is of no use any more.
pub fn choose(
    all: BTreeMap<Guid, Found>,
    told: &BTreeMap<Guid, Found>,
    ours: &BTreeSet<String>,
) -> Result<Places, String> {
    if all.len() <= ENDPOINTS_MAX {
        return Ok(Places { followed: all, cut_of_ours: 0, cut: 0 });
    }
    if all.len() > DISCOVERED_MAX {
        return Err(format!("{} readers and writers were announced, more than it can look at", all.len()));
    }
    let rank = |guid: &Guid, found: &Found| (!ours.contains(&found.topic), !told.contains_key(guid));
    let mut ranked: Vec<(Prefix, (bool, bool), Guid)> =
        all.iter().map(|(guid, found)| (ids::prefix(guid), rank(guid, found), *guid)).collect();
    ranked.sort_unstable();
    // The number of each among those of its participant, on topics of ours or on others.
    let mut turns = Vec::with_capacity(ranked.len());
    let (mut before, mut turn) = (None, 0);
    for (participant, (is_other, is_new), guid) in ranked {
        turn = if before.replace((participant, is_other)) == Some((participant, is_other)) {
            turn + 1
        } else {
            0
        };
        turns.push((is_other, turn, is_new, guid));
    }
    turns.sort_unstable();
    let cut = turns.split_off(ENDPOINTS_MAX);
    let cut_of_ours = cut.iter().filter(|(is_other, ..)| !is_other);
    if cut_of_ours.clone().any(|(_, turn, ..)| *turn < SHARE) {
        return Err("more readers and writers of its topics were announced than it can look at".to_owned());
    }
    let cut_of_ours = u32::try_from(cut_of_ours.count()).unwrap_or(u32::MAX);
    let mut followed = all;
    for (.., guid) in &cut {
        followed.remove(guid);
    }
    Ok(Places { followed, cut_of_ours, cut: u32::try_from(cut.len()).unwrap_or(u32::MAX) })
}

/// Sorts what participants announce so that each participant's first comes before any one's second, and otherwise
/// leaves the order: one with thousands is before nobody else. What several announce has the best of their turns.
pub fn in_turn<T>(announced: impl IntoIterator<Item = (T, BTreeSet<Prefix>)>) -> Vec<T> {
    let mut turns: BTreeMap<Prefix, usize> = BTreeMap::new();
    let mut turn = |prefix: Prefix| {
        let next = turns.entry(prefix).or_default();
        *next += 1;
        *next
    };
    let mut ranked: Vec<(usize, T)> = announced
        .into_iter()
        .map(|(it, by)| (by.into_iter().map(&mut turn).min().unwrap_or_default(), it))
        .collect();
    ranked.sort_by_key(|(turn, _)| *turn);
    ranked.into_iter().map(|(_, it)| it).collect()
}

#[cfg(test)]
mod tests {
    use super::super::seen::tests::found;
    use super::*;

    fn guid(participant: u16, entity: usize) -> Guid {
        let mut guid = [0; 16];
        guid[..2].copy_from_slice(&participant.to_be_bytes());
        guid[12..].copy_from_slice(&(entity as u32).to_be_bytes());
        guid
    }

    /// So many of one participant on a topic.
    fn some(
        participant: u16,
        first: usize,
        count: usize,
        topic: &str,
    ) -> impl Iterator<Item = (Guid, Found)> {
        let found = found(0, topic);
        (first..first + count).map(move |entity| {
            let guid = guid(participant, entity);
            (guid, Found { guid, ..found.clone() })
        })
    }

    fn ours() -> BTreeSet<String> {
        BTreeSet::from(["rt/stop".to_owned(), "rt/diagnostics".to_owned()])
    }

    fn count(places: &Places, participant: u16, topic: &str) -> usize {
        let of =
            |(guid, found): &(&Guid, &Found)| guid[..2] == participant.to_be_bytes() && found.topic == topic;
        places.followed.iter().filter(of).count()
    }

    #[test]
    fn a_stranger_with_thousands_pushes_out_its_own_alone() {
        // The stranger sorts before the vehicle, was there first, and speaks on topics of ours, too.
        for topic in ["rt/a", "rt/stop"] {
            let stranger: BTreeMap<Guid, Found> = some(1, 0, ENDPOINTS_MAX, topic).collect();
            let reader =
                some(9, 0, 1, "rt/stop").map(|(guid, found)| (guid, Found { writes: false, ..found }));
            let vehicle =
                reader.chain(some(9, 1, 100, "rt/diagnostics")).chain(some(9, 500, 1000, "rt/lidar"));
            let all = stranger.clone().into_iter().chain(vehicle).chain(some(1, 60_000, 1, "rt/diagnostics"));
            let places = choose(all.collect(), &stranger, &ours()).unwrap();
            assert_eq!(places.followed.len(), ENDPOINTS_MAX);
            assert_eq!(
                [count(&places, 9, "rt/stop"), count(&places, 9, "rt/diagnostics")],
                [1, 100],
                "{topic}"
            );
            assert_eq!(count(&places, 1, "rt/diagnostics"), usize::from(topic == "rt/a"), "{topic}");
            assert_eq!(places.cut, 1102);
            match topic {
                "rt/a" => assert_eq!((count(&places, 9, "rt/lidar"), places.cut_of_ours), (1000, 0)),
                _ => assert!(places.cut_of_ours > 0, "that is no reason to lose the vehicle"),
            }
        }
    }

    #[test]
    fn what_has_a_place_keeps_it() {
        let first: BTreeMap<Guid, Found> = some(1, 10_000, ENDPOINTS_MAX, "rt/a").collect();
        let more = first.clone().into_iter().chain(some(1, 0, 10_000, "rt/b"));
        let places = choose(more.collect(), &first, &ours()).unwrap();
        assert!(places.followed == first && places.cut == 10_000);
    }

    #[test]
    fn a_process_is_of_no_use_where_a_participant_has_less_than_its_share_or_the_looks_have_no_end() {
        let none = BTreeMap::new();
        let crowd =
            |participants: u16, each| (0..participants).flat_map(move |it| some(it, 0, each, "rt/stop"));
        assert!(choose(crowd(64, SHARE).collect(), &none, &ours()).is_ok());
        assert!(
            choose(crowd(64, SHARE + 9).collect(), &none, &ours()).is_ok_and(|it| it.cut_of_ours == 64 * 9)
        );
        assert!(choose(crowd(65, SHARE).collect(), &none, &ours()).is_err());
        assert!(choose(some(1, 0, DISCOVERED_MAX, "rt/a").collect(), &none, &ours()).is_ok());
        assert!(choose(some(1, 0, DISCOVERED_MAX + 1, "rt/a").collect(), &none, &ours()).is_err());
    }

    #[test]
    fn each_participant_is_first_once() {
        let by = |numbers: &[u8]| numbers.iter().map(|&number| [number; 12]).collect::<BTreeSet<Prefix>>();
        let announced =
            [("a", by(&[1])), ("b", by(&[1])), ("c", by(&[1])), ("both", by(&[1, 2])), ("last", by(&[3]))];
        assert_eq!(in_turn(announced), ["a", "both", "last", "b", "c"]);
    }
}
