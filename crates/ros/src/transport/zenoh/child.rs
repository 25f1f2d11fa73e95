//! The Zenoh library in its process.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};

use bytes::Bytes;
use tokio::sync::oneshot;

use super::heard::{Heard, State};
use super::names::{Channel, Part};
use super::session::{self, Work};
use crate::every;
use crate::transport::parent::{Orders, ToParent, next};
use crate::transport::told::Told;
use crate::transport::wire::{FromChild, Order};
use crate::transport::{BEAT, NODES_TOPIC, ORDERS_MAX, RawSample};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::cdr::Endian;

/// The shortest time between two looks at the graph.
const LOOK_MIN: Span = Span::from_millis(5);

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
    let (opened, opening) = oneshot::channel();
    let shared = heard.clone();
    let thread = std::thread::Builder::new().name("zenoh-session".to_owned());
    let thread = thread.spawn(move || session::run(domain, router.as_deref(), &shared, &to_do, opened));
    let thread = thread.map_err(|error| error.to_string())?;
    let guid = opening.await.map_err(|_| "the Zenoh library failed".to_owned())??;
    out.frame.news(&FromChild::Ready { guid, participant: 0 });
    out.send().await?;
    let clock = Clock::start();
    let mut child = Child {
        heard,
        work,
        told: Told::default(),
        clock,
        said: 0,
        lost_at: None,
        look_at: clock.now(),
        waits: false,
        numbers: 0,
    };
    let ended = child.run(first, orders, out).await;
    // Ends the thread, and with it the session.
    drop(child);
    let _ = tokio::task::spawn_blocking(move || thread.join()).await;
    ended
}

struct Child {
    heard: Arc<Heard>,
    work: SyncSender<Work>,
    told: Told,
    clock: Clock,
    /// The number of the last beat.
    said: u64,
    /// The beat that confirms that a token is gone, and not the router.
    lost_at: Option<u64>,
    /// The earliest time of the next look at the graph, and whether one is to come.
    look_at: Timestamp,
    waits: bool,
    /// Of announcements of nodes.
    numbers: i64,
}

impl Child {
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
                    self.beat()?;
                    let echo = heard.state().echo;
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
        self.work.try_send(work).map_err(|_| "the Zenoh library takes no orders any more".to_owned())
    }

    fn beat(&mut self) -> Result<(), String> {
        self.said += 1;
        self.give(Work::Beat(self.said))
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
        self.waits = !state.graph.changed.is_empty() && self.may_tell(state)?;
        if self.waits && now >= self.look_at {
            self.tell_of_graph(state, out)?;
            // A large graph is looked at less often than it changes.
            self.look_at = now + LOOK_MIN + Span::from_nanos(4 * self.clock.now().since(now).as_nanos());
            self.waits = false;
        }
        state.take(&mut out.samples);
        Ok(())
    }

    /// Without a router all tokens go: that one is gone counts once the router has answered after it.
    fn may_tell(&mut self, state: &mut State) -> Result<bool, String> {
        if std::mem::take(&mut state.graph.has_lost) {
            self.beat()?;
            self.lost_at = Some(self.said);
        }
        self.lost_at = self.lost_at.filter(|number| state.echo < *number);
        Ok(self.lost_at.is_none())
    }

    fn tell_of_graph(&mut self, state: &mut State, out: &mut ToParent) -> Result<(), String> {
        let changed: BTreeSet<String> = std::mem::take(&mut state.graph.changed);
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
        self.give(Work::Graph)
    }
}

fn nodes_type() -> String {
    use telltale_msg::messages::{PARTICIPANT_ENTITIES_INFO, dds_type_name};
    dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default()
}
