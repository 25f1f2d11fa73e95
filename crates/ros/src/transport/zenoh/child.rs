//! The Zenoh library in its process.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};

use bytes::Bytes;
use tokio::sync::oneshot;

use super::follower::{self, Follow};
use super::heard::{Heard, State};
use super::names::{Channel, Part};
use super::session::{self, Work};
use crate::every;
use crate::transport::ids::Prefix;
use crate::transport::parent::{Orders, ToParent, next};
use crate::transport::told::Told;
use crate::transport::wire::{FromChild, Order};
use crate::transport::{BEAT, NODES_TOPIC, ORDERS_MAX, RawSample};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::cdr::Endian;

/// The shortest time between two looks at the graph.
const LOOK_MIN: Span = Span::from_millis(5);
/// With more tokens the graph is not followed for a while: the library takes 4 KB for each, and ever longer.
const TOKENS_MAX: usize = 65_536;
/// A router that tells of so many again does nothing else for seconds.
const PAUSE: Span = Span::from_secs(600);
/// For so long after a question for all tokens the router may answer late, as long as it tells of tokens: with a longer
/// pause between two of them it hangs.
const PATIENCE: Span = Span::from_secs(10);
const BETWEEN_TOKENS: Span = Span::from_millis(500);
/// After a pause of this length, or so many beats without an answer of the router, messages may be lost: a full line drops them.
const STOOD_STILL: Span = Span::from_secs(1);
const UNANSWERED: u64 = 4;
/// That messages are missing is told at most this often.
const MISSED_EVERY: Span = Span::from_millis(250);
const STUCK: &str = "the Zenoh library takes no orders any more";

/// Opens a session of a domain at this router, or at the one that the environment names, and executes orders until the program ends it.
///
/// # Errors
/// There is no router any more, or the library can no longer be used.
pub async fn run(
    domain: u16,
    router: Option<String>,
    first: Vec<Order>,
    orders: &mut Orders,
    out: &mut ToParent,
) -> Result<(), String> {
    let heard = Arc::new(Heard::default());
    let (work, to_do) = sync_channel(ORDERS_MAX);
    let (follow, to_follow) = sync_channel(ORDERS_MAX);
    let (opened, opening) = oneshot::channel();
    let named = |name: &str| std::thread::Builder::new().name(name.to_owned());
    let (shared, at) = (heard.clone(), router.clone());
    let thread =
        named("zenoh-session").spawn(move || session::run(domain, at.as_deref(), &shared, &to_do, opened));
    let thread = thread.map_err(|error| error.to_string())?;
    let guid = opening.await.map_err(|_| "the Zenoh library failed".to_owned())??;
    let shared = heard.clone();
    // It ends with the last order; nobody waits for it.
    let following =
        named("zenoh-graph").spawn(move || follower::run(domain, router.as_deref(), &shared, &to_follow));
    following.map_err(|error| error.to_string())?;
    out.frame.news(&FromChild::Ready { guid, participant: 0 });
    out.send().await?;
    let mut child = Child::new(heard, work, follow);
    let ended = child.run(first, orders, out).await;
    // Ends the thread, and with it the session.
    drop(child);
    let _ = tokio::task::spawn_blocking(move || thread.join()).await;
    ended
}

struct Child {
    heard: Arc<Heard>,
    work: SyncSender<Work>,
    follow: SyncSender<Follow>,
    told: Told,
    clock: Clock,
    /// The number of the last beat.
    said: u64,
    /// The number of the last question whether tokens are gone, or the router, and whether its answer is to come.
    asked: u64,
    is_asking: bool,
    /// When the graph is followed again from its beginning, and until when the router may be late for that reason.
    follow_at: Option<Timestamp>,
    late_until: Timestamp,
    /// The number of tokens at the last beat that told of some, and its time; and the time of the last beat.
    tokens: (usize, Timestamp),
    beat_at: Timestamp,
    /// From when it may be told again that messages are missing.
    missed_from: Timestamp,
    /// The earliest time of the next look at the graph, and whether one is to come.
    look_at: Timestamp,
    waits: bool,
    /// Of announcements of nodes.
    numbers: i64,
}

impl Child {
    fn new(heard: Arc<Heard>, work: SyncSender<Work>, follow: SyncSender<Follow>) -> Child {
        let clock = Clock::start();
        Child {
            heard,
            work,
            follow,
            told: Told::default(),
            clock,
            said: 0,
            asked: 0,
            is_asking: false,
            follow_at: Some(clock.now()),
            late_until: clock.now(),
            tokens: (0, clock.now()),
            beat_at: clock.now(),
            missed_from: clock.now(),
            look_at: clock.now(),
            waits: false,
            numbers: 0,
        }
    }

    async fn run(
        &mut self,
        first: Vec<Order>,
        orders: &mut Orders,
        out: &mut ToParent,
    ) -> Result<(), String> {
        let heard = self.heard.clone();
        self.obey(first)?;
        let mut beats = every(BEAT);
        loop {
            tokio::select! {
                orders = next(orders) => match orders {
                    Some(orders) if !orders.contains(&Order::Close) => self.obey(orders)?,
                    _ => return Ok(()),
                },
                () = heard.wake.notified() => {}
                () = tokio::time::sleep_until(self.clock.instant(self.look_at).into()), if self.waits => {}
                _ = beats.tick() => {
                    let echo = self.beat(&mut heard.state())?;
                    out.frame.news(&FromChild::Beat { heard: echo });
                }
            }
            self.pass_up(&mut heard.state(), out)?;
            out.send().await?;
        }
    }

    fn obey(&mut self, orders: Vec<Order>) -> Result<(), String> {
        for order in orders {
            match order {
                Order::Taken { id, bytes } => self.heard.state().taken(id, bytes as usize),
                Order::FollowFirst { topic } => drop(self.told.ours.insert(topic)),
                Order::Forget { .. } => {}
                order => {
                    if let Order::Reader { topic, .. } | Order::Writer { topic, .. } = &order {
                        self.told.ours.insert(topic.clone());
                    }
                    self.give(Work::Order(order))?;
                }
            }
        }
        Ok(())
    }

    fn give(&self, work: Work) -> Result<(), String> {
        self.work.try_send(work).map_err(|_| STUCK.to_owned())
    }

    /// Asks the router whether it is there. Returns the newest beat that it has answered, or may still answer.
    fn beat(&mut self, state: &mut State) -> Result<u64, String> {
        let now = self.clock.now();
        self.said += 1;
        self.give(Work::Beat(self.said))?;
        if state.there != self.tokens.0 {
            self.tokens = (state.there, now);
        }
        let tells = now.since(self.tokens.1) < BETWEEN_TOKENS;
        let echo = if tells && now < self.late_until { self.said } else { state.echo };
        state.dropped |= now.since(self.beat_at) >= STOOD_STILL || self.said - echo > UNANSWERED;
        self.beat_at = now;
        Ok(echo)
    }

    /// Passes up the graph and then the messages.
    fn pass_up(&mut self, state: &mut State, out: &mut ToParent) -> Result<(), String> {
        if let Some(reason) = state.broken.take() {
            return Err(reason);
        }
        for news in state.news.drain(..) {
            out.frame.news(&news);
        }
        let now = self.clock.now();
        if state.dropped && now >= self.missed_from {
            (state.dropped, self.missed_from) = (false, now + MISSED_EVERY);
            for reader in state.queues.keys() {
                out.frame.news(&FromChild::Missed { reader: *reader });
            }
        }
        self.look_after_tokens(state, now)?;
        self.waits = !state.graph.changed.is_empty();
        if self.waits && now >= self.look_at {
            self.tell_of_graph(state, out)?;
            // A large graph is looked at less often than it changes.
            self.look_at = now + LOOK_MIN + Span::from_nanos(4 * self.clock.now().since(now).as_nanos());
            self.waits = false;
        }
        state.take(&mut out.samples);
        Ok(())
    }

    /// Without a router all tokens go: that one is gone counts once the router has answered a question after it.
    fn look_after_tokens(&mut self, state: &mut State, now: Timestamp) -> Result<(), String> {
        if state.there > TOKENS_MAX && self.follow_at.is_none() {
            // Known ones stay. The library has no bound of its own.
            self.follow(state, Follow::End, Some(now + PAUSE))?;
            state.graph.cut = state.graph.cut.max(1);
        } else if state.echo > 0 && self.follow_at.is_some_and(|at| now >= at) {
            // A token that the router does not tell of again is gone.
            state.graph.lose_all();
            (self.late_until, self.tokens) = (now + PATIENCE, (0, now));
            self.follow(state, Follow::Begin(state.following + 1), None)?;
        }
        if self.is_asking && state.confirmed == self.asked {
            state.graph.confirm();
            self.is_asking = false;
        }
        if !self.is_asking && self.follow_at.is_none() && state.graph.asks() {
            self.asked += 1;
            self.is_asking = true;
            self.give_follower(Follow::Confirm(self.asked))?;
        }
        Ok(())
    }

    fn follow(&mut self, state: &mut State, what: Follow, next: Option<Timestamp>) -> Result<(), String> {
        (self.is_asking, self.follow_at) = (false, next);
        (state.following, state.there) = (state.following + 1, 0);
        self.give_follower(what)
    }

    fn give_follower(&self, what: Follow) -> Result<(), String> {
        self.follow.try_send(what).map_err(|_| STUCK.to_owned())
    }

    fn tell_of_graph(&mut self, state: &mut State, out: &mut ToParent) -> Result<(), String> {
        let changed: BTreeSet<Prefix> = std::mem::take(&mut state.graph.changed);
        self.told.tell(state.graph.endpoints(), state.graph.cut, &mut out.frame)?;
        let nodes = (Channel { name: format!("/{NODES_TOPIC}"), type_name: nodes_type() }, Part::Message);
        let readers = state.readers(&nodes);
        for session in changed {
            let Some((writer, body)) = state.graph.announcement(&session) else { continue };
            self.numbers += 1;
            let body = Ok((Bytes::from(body), Endian::Little));
            let sample = RawSample { writer, sequence: self.numbers, source: None, related: None, body };
            for reader in &readers {
                if let Some(queue) = state.queues.get_mut(reader) {
                    queue.push(sample.clone());
                }
            }
        }
        if state.graph.has_room_again() && self.follow_at.is_none() {
            self.follow_at = Some(self.clock.now());
        }
        self.give(Work::Graph)
    }
}

fn nodes_type() -> String {
    use telltale_msg::messages::{PARTICIPANT_ENTITIES_INFO, dds_type_name};
    dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::graph;
    use super::*;

    #[test]
    fn too_many_tokens_are_left_alone_for_a_while_and_what_was_known_stays() {
        let (work, _to_do) = sync_channel(9);
        let (follow, to_follow) = sync_channel(9);
        let mut child = Child::new(Arc::default(), work, follow);
        let state = &mut State { echo: 1, ..State::default() };
        let now = child.clock.now();
        child.look_after_tokens(state, now).unwrap();
        let first = state.following;
        let node = |number: usize| format!("@ros2_lv/0/a1/0/{number}/NN/%/%/node{number}");
        (0..2).for_each(|number| state.token(first, &node(number), true));
        (0..TOKENS_MAX).for_each(|_| state.token(first, "flood", true));
        child.look_after_tokens(state, now).unwrap();
        // What the library says while it ends counts no more.
        state.token(first, &node(0), false);
        child.look_after_tokens(state, now + PAUSE).unwrap();
        state.token(state.following, &node(1), true);
        let announced = |state: &State| state.graph.announcement(&graph::prefix("a1")).unwrap().1.len();
        let both = announced(state);
        state.confirmed = 1;
        child.look_after_tokens(state, now + PAUSE).unwrap();
        let done: Vec<Follow> = to_follow.try_iter().collect();
        assert_eq!(done, [Follow::Begin(1), Follow::End, Follow::Begin(3), Follow::Confirm(1)]);
        assert!(announced(state) < both && state.graph.cut == 0, "one node is not there again");
    }
}
