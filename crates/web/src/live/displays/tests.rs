//! The rule for a live display, and places for sockets.

use super::*;
use telltale_clock::Clock;
use telltale_store::{DemoSecrets, Store};

#[tokio::test]
async fn a_display_lives_by_what_it_confirms() {
    let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
    store.add_demo_users().await.unwrap();
    let user = store.authenticate("operator", "246810").await.unwrap().unwrap();
    let (_, session) = store.open_session(&user).await.unwrap();
    let displays = Displays::default();
    let (at, seq) = (Timestamp::from_millis, Version::from);
    assert!(!displays.is_live_for(&session, at(0)) && !displays.is_late("operator", at(9_000)));
    let place = displays.enter(&session).unwrap();
    place.sent(seq(1), at(1_000));
    assert!(!displays.is_live_for(&session, at(1_000)), "nothing is confirmed");
    place.confirm(seq(1), Timestamp::ZERO);
    assert!(displays.is_live_for(&session, at(2_999)) && !displays.is_live_for(&session, at(3_000)));
    for ms in (2_000..9_000).step_by(100) {
        place.sent(seq(ms), at(ms));
    }
    // It goes on to answer, but shows what is old.
    place.confirm(seq(2_000), Timestamp::ZERO);
    assert!(!displays.is_live_for(&session, at(4_000)) && displays.is_late("operator", at(4_100)));
    place.confirm(seq(8_900), Timestamp::ZERO);
    assert_eq!(displays.shows_as_of(&session).map(|shown| shown > at(5_000)), Some(true));
    place.sent(seq(9_000), at(9_000));
    place.confirm(seq(9_000), Timestamp::ZERO);
    assert!(displays.is_live_for(&session, at(9_500)) && !displays.is_late("operator", at(10_900)));
    // A step back in time: what was confirmed before it says nothing about what was sent after it.
    place.sent(Version { rewinds: 1, number: 5 }, at(11_000));
    place.confirm(seq(9_000), Timestamp::ZERO);
    assert!(!displays.is_live_for(&session, at(11_500)));
    place.confirm(Version { rewinds: 1, number: 5 }, Timestamp::ZERO);
    assert!(displays.is_live_for(&session, at(11_500)));
    drop(place);
    assert!(!displays.is_live_for(&session, at(9_500)) && !displays.is_late("operator", at(20_000)));
}
#[tokio::test]
async fn a_constant_delay_is_late_for_as_long_as_it_lasts() {
    const DELAY_MS: u64 = 3_300;
    let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
    store.add_demo_users().await.unwrap();
    let user = store.authenticate("operator", "246810").await.unwrap().unwrap();
    let (_, session) = store.open_session(&user).await.unwrap();
    for says_beats in [false, true] {
        let displays = Displays::default();
        let place = displays.enter(&session).unwrap();
        let (mut lateness, mut told, mut late) = (Lateness::default(), Vec::new(), 0);
        let (mut seq, mut on_the_way) = (Version::from(1), VecDeque::new());
        for ms in (0..90_000_u64).step_by(50) {
            let now = Timestamp::from_millis(10_000 + ms);
            let delay_ms = if (10_000..60_000).contains(&ms) { DELAY_MS } else { 100 };
            if ms % 250 == 0 {
                // The state stands still for seconds on end.
                seq.number += u64::from(ms % 4_000 == 0);
                place.beat(ms / 250, seq, now);
                on_the_way.push_back((ms + delay_ms, ms / 250, seq));
            }
            while let Some((_, beat, seq)) = on_the_way.pop_front_if(|(due_ms, ..)| *due_ms <= ms) {
                match says_beats {
                    true => place.confirm_beat(beat, Some(seq), now),
                    false => place.confirm(seq, now),
                }
            }
            let is_late = displays.is_late("operator", now);
            late += u32::from(is_late && (15_000..60_000).contains(&ms));
            if lateness.judge(is_late.then_some("operator"), now) {
                told.push((ms / 1000, lateness.of.is_some()));
            }
        }
        let [(from_s, true), (till_s, false)] = told[..] else { panic!("{says_beats}: {told:?}") };
        assert!((11..=16).contains(&from_s) && (60..=70).contains(&till_s), "{says_beats}: {told:?}");
        // By its beats it is seen as late at every look.
        assert!(!says_beats || late == 45_000 / 50, "{late}");
    }
}

#[tokio::test]
async fn nobody_takes_the_places_of_others_and_two_hundred_browsers_have_one() {
    let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
    store.add_demo_users().await.unwrap();
    let logins = async |name: &str, secret: &str| {
        let mut sessions = Vec::new();
        for _ in 0..5 {
            let user = store.authenticate(name, secret).await.unwrap().unwrap();
            sessions.push(store.open_session(&user).await.unwrap().1);
        }
        sessions
    };
    let displays = Displays::default();
    let fill = |sessions: &[Session], is_stream: bool| -> Vec<Place> {
        let tries = sessions.iter().cycle().take(500);
        tries.filter_map(|session| displays.enter_as(session, is_stream)).collect()
    };
    let mut held = Vec::new();
    for name in ["authority", "bert", "carl", "dora", "emil"] {
        let secret = if name == "authority" { "demo-authority" } else { "a long password" };
        if name != "authority" {
            store.add_user(name, Role::Authority, secret).await.unwrap();
        }
        let sessions = logins(name, secret).await;
        let (one, all) = (fill(&sessions[..1], false), fill(&sessions, false));
        let streams = fill(&sessions, true);
        held.push((one.len() + all.len(), streams.len()));
        std::mem::forget((one, all, streams));
    }
    let expected = [(80, 32), (80, 32), (80, 32), (16, 0), (0, 0)];
    assert_eq!(held, expected, "pages and streams of each, of five logins");
    let operator = logins("operator", "246810").await;
    let streams = fill(&operator, true);
    assert_eq!((streams.len(), fill(&operator[..1], false).len()), (32, 16));
    assert_eq!(fill(&operator, false).len(), 64, "the places of pages that went are free");
}
