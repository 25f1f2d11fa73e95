//! The thread of a replay: moves through the recording as its page asks, and shows the state at that instant.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use serde::Serialize;
use tokio::sync::{oneshot, watch};

use crate::source::Player;
use telltale_clock::Clock;
use telltale_clock::unix_ms;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};
use telltale_replay::Playback;
use telltale_runtime::Published;

/// Orders that may wait. A full queue loses further ones: the slider sends the next one soon.
const ORDERS_MAX: usize = 64;
/// While it plays, so often.
const PLAYING_EVERY: Duration = Duration::from_millis(100);
/// While it stands still, a page must hear that the server lives.
const PULSE_EVERY: Duration = Duration::from_millis(250);

/// The wish of a viewer.
#[derive(Debug)]
pub(super) enum Order {
    /// Milliseconds since 1970.
    GoTo(i64),
    /// The next change, or the one before.
    Step {
        forwards: bool,
    },
    /// 1 is the speed of the recording.
    Play(f64),
    /// Sets the speed. It neither starts nor pauses the replay.
    Speed(f64),
    Pause,
    /// Where it is, told when the orders before are done.
    Tell(oneshot::Sender<PlayState>),
    /// Asks for the picture of this time, once. The place stays.
    Look {
        at_ms: i64,
        answer: oneshot::Sender<Option<Look>>,
    },
}

/// The picture of a time: milliseconds since 1970.
#[derive(Debug)]
pub(super) struct Look {
    pub at_ms: i64,
    pub snapshot: Arc<Snapshot>,
}

/// Sends orders to the thread, which ends when all are dropped.
#[derive(Debug, Clone)]
pub(super) struct Controls(SyncSender<Order>);

impl Controls {
    pub fn order(&self, order: Order) {
        let _ = self.0.try_send(order);
    }

    /// Where it is when all orders until now are done; `None` if too many wait.
    pub async fn place(&self) -> Option<PlayState> {
        let (answer, told) = oneshot::channel();
        self.order(Order::Tell(answer));
        told.await.ok()
    }

    /// The picture of a time; `None` if the recording lacks it, or too many orders wait.
    pub async fn look(&self, at_ms: i64) -> Option<Look> {
        let (answer, told) = oneshot::channel();
        self.order(Order::Look { at_ms, answer });
        told.await.ok().flatten()
    }
}

/// Where a replay is. Times are milliseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlayState {
    pub at_ms: i64,
    pub from_ms: i64,
    pub to_ms: i64,
    pub playing: bool,
    pub speed: f64,
    /// Something is missing before, so what is shown may differ from what was shown then.
    pub may_differ: bool,
}

/// Starts the thread.
///
/// # Errors
/// If no thread can be started.
pub(super) fn start(
    playback: Playback,
    show: Player,
    clock: Clock,
) -> std::io::Result<(Controls, watch::Receiver<PlayState>)> {
    let (orders, taken) = sync_channel(ORDERS_MAX);
    let mut thread =
        Thread { playback, show, clock, shown: None, playing: None, speed: 1.0, asked: Vec::new() };
    let (state, states) = watch::channel(thread.state());
    std::thread::Builder::new().name("replay".into()).spawn(move || {
        // On Linux this sets the priority of the calling thread only: the vehicle goes first.
        let _ = rustix::process::setpriority_process(None, 10);
        thread.run(&taken, &state);
    })?;
    Ok((Controls(orders), states))
}

/// The present picture; `None` if the recording lacks it.
pub(super) fn published(playback: &mut Playback) -> Option<Published> {
    let at = playback.facts().wall(playback.at());
    Some(Published::recorded(playback.snapshot()?, at))
}

struct Thread {
    playback: Playback,
    show: Player,
    clock: Clock,
    /// The picture, and its instant.
    shown: Option<(Timestamp, Published)>,
    /// When it began to play, and where.
    playing: Option<(Timestamp, Timestamp)>,
    speed: f64,
    /// The channel that is told the place, once it is shown.
    asked: Vec<oneshot::Sender<PlayState>>,
}

impl Thread {
    fn run(&mut self, orders: &Receiver<Order>, state: &watch::Sender<PlayState>) {
        loop {
            let every = if self.playing.is_some() { PLAYING_EVERY } else { PULSE_EVERY };
            match orders.recv_timeout(every) {
                Ok(order) => {
                    self.obey(order);
                    // Of the places of a slider that is moved, only the last one counts.
                    while let Ok(order) = orders.try_recv() {
                        self.obey(order);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            self.advance();
            // Standing still, it shows the same again: a copy of a large engine costs time.
            if self.shown.as_ref().is_none_or(|(at, _)| *at != self.playback.at()) {
                self.shown = published(&mut self.playback).map(|published| (self.playback.at(), published));
            }
            if let Some((_, published)) = &self.shown {
                self.show.show(published.clone());
            }
            let shown = self.state();
            state.send_replace(shown);
            for answer in self.asked.drain(..) {
                let _ = answer.send(shown);
            }
        }
    }

    fn obey(&mut self, order: Order) {
        let now = self.clock.now();
        match order {
            Order::GoTo(at_ms) => {
                self.go_to_ms(at_ms);
                self.playing = self.playing.map(|_| (now, self.playback.at()));
            }
            Order::Step { forwards } => {
                self.playing = None;
                if let Some(at) = self.playback.next_change(forwards) {
                    self.go_to(at);
                }
            }
            Order::Play(speed) => {
                self.speed = speed;
                // From the end it begins anew.
                if self.playback.at() >= self.playback.to() {
                    self.go_to(self.playback.facts().from);
                }
                self.playing = Some((now, self.playback.at()));
            }
            Order::Speed(speed) => {
                self.speed = speed;
                self.playing = self.playing.map(|_| (now, self.playback.at()));
            }
            Order::Pause => self.playing = None,
            Order::Tell(answer) => self.asked.push(answer),
            Order::Look { at_ms, answer } => {
                let place = self.playback.at();
                self.go_to_ms(at_ms);
                let at_ms = self.state().at_ms;
                let _ = answer.send(self.playback.snapshot().map(|snapshot| Look { at_ms, snapshot }));
                self.go_to(place);
            }
        }
    }

    fn advance(&mut self) {
        let Some((began, from)) = self.playing else { return };
        let played = self.clock.now().since(began).as_nanos() as f64 * self.speed;
        let at = from + Span::from_nanos(played as u64);
        self.go_to(at);
        if at >= self.playback.to() {
            self.playing = None;
        }
    }

    fn go_to_ms(&mut self, at_ms: i64) {
        let at_ns = u64::try_from(at_ms).unwrap_or(0).saturating_mul(1_000_000);
        self.go_to(self.playback.instant_of(at_ns));
    }

    fn go_to(&mut self, at: Timestamp) {
        if let Err(error) = self.playback.go_to(at) {
            tracing::warn!(%error, "a replay cannot go on");
            self.playing = None;
        }
    }

    fn state(&self) -> PlayState {
        let ms = |at| unix_ms(self.playback.facts().wall(at));
        PlayState {
            at_ms: ms(self.playback.at()),
            from_ms: ms(self.playback.facts().from),
            to_ms: ms(self.playback.to()),
            playing: self.playing.is_some(),
            speed: self.speed,
            may_differ: self.playback.gaps().may_differ(self.playback.at()),
        }
    }
}
