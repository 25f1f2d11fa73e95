//! Trials in real time: the machine publishes over DDS its messages of virtual time, and the bridge and the engine's task of
//! `telltale serve` hear it. The machine does not obey them, as in virtual time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context as _, bail, ensure};
use tokio::sync::oneshot;
use tokio::task::JoinSet;

use super::machine::{Ride, Simulated, is_at};
use crate::cli::process::{async_runtime, log};
use crate::cli::running::demo::free_domains;
use crate::cli::running::vehicle::publisher;
use crate::clock::{self, Clock};
use crate::engine::Engine;
use crate::engine::action::{OperatorAction, Response};
use crate::engine::discovery::TopicSeen;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::{Span, Timestamp};
use crate::evaluate::live::{HELD_UP_MS, Heard, Trials, models};
use crate::evaluate::machine::{Machine as _, STEP};
use crate::evaluate::plan::Plan;
use crate::evaluate::track::Track;
use crate::msg::messages::GidSize;
use crate::msg::received::Message;
use crate::record::feed::{Feed, Turn, Turns};
use crate::ros::{self, Bridge, BridgeOptions, DIAGNOSTICS, DdsProcess, Publisher};
use crate::runtime::{self, Command, Followers, Link, Stamped};

const HELD_UP_MAX: Span = Span::from_millis(HELD_UP_MS);

/// A trial is run so often at most.
const RUNS_MAX: u32 = 10;

/// The publishers are found within this time, or DDS is not heard here.
const FOUND_WITHIN: Span = Span::from_secs(20);

/// Runs the trials of these seeds, so many at a time, each in a DDS domain that nobody uses, or from the given one on.
///
/// # Errors
/// DDS is not heard on the loopback interface.
pub fn run(
    machine: &Arc<Simulated>,
    seeds: Vec<u64>,
    at_a_time: usize,
    domain: Option<u16>,
) -> anyhow::Result<Trials> {
    log::start("warn,telltale::cli::evaluate=info");
    let domains: Vec<u16> = match domain {
        Some(first) => (first..=ros::DOMAIN_MAX).take(at_a_time).collect(),
        None => free_domains().take(at_a_time).collect(),
    };
    ensure!(!domains.is_empty(), "no DDS domain is free here; choose one with --domain");
    async_runtime::start()?.block_on(all(machine, seeds, domains))
}

async fn all(machine: &Arc<Simulated>, seeds: Vec<u64>, domains: Vec<u16>) -> anyhow::Result<Trials> {
    let count = seeds.len();
    let waiting = Arc::new(Mutex::new(VecDeque::from(seeds)));
    let mut running = JoinSet::new();
    for domain in domains {
        running.spawn(in_domain(machine.clone(), domain, waiting.clone(), count));
    }
    let mut trials = Trials::default();
    while let Some(ended) = running.join_next().await {
        let Trials { heard, repeated, left_out } = ended.context("a trial failed")??;
        trials.heard.extend(heard);
        trials.repeated += repeated;
        trials.left_out.extend(left_out);
    }
    Ok(trials)
}

/// Runs one trial after the other, until none waits.
async fn in_domain(
    machine: Arc<Simulated>,
    domain: u16,
    waiting: Arc<Mutex<VecDeque<u64>>>,
    count: usize,
) -> anyhow::Result<Trials> {
    let dds_process = DdsProcess::Child { megabytes: DdsProcess::MEGABYTES, log: log::form().word() };
    let gid_size = Some(GidSize::Bytes16);
    let options = BridgeOptions { dds_process, gid_size, ..BridgeOptions::loopback(domain) };
    let next = || {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        Some((waiting.pop_front()?, count - waiting.len()))
    };
    let mut trials = Trials::default();
    while let Some((seed, number)) = next() {
        tracing::info!("live trial {number} of {count}: seed {seed}");
        for run in 1..=RUNS_MAX {
            match trial(&machine, seed, &options).await? {
                Ok(heard) => {
                    trials.heard.push(heard);
                    break;
                }
                Err(why) => {
                    tracing::info!("run {run} of seed {seed} does not count: {why}");
                    match run < RUNS_MAX {
                        true => trials.repeated += 1,
                        false => trials.left_out.push(seed),
                    }
                }
            }
        }
    }
    Ok(trials)
}

/// Why a run does not count.
type HeldUp = String;

/// Runs a trial with participants and an engine of its own.
async fn trial(
    machine: &Simulated,
    seed: u64,
    options: &BridgeOptions,
) -> anyhow::Result<Result<Heard, HeldUp>> {
    let clock = Clock::start();
    let plan = Plan::draw(seed, machine.faults());
    let [model, off] = models(machine, seed);
    let ride = machine.ride(&plan);
    let publisher = publisher(options, &ride.machine).await?;
    let (feed, turns) = Feed::new(clock);
    let watch = Watch {
        off: Engine::begin(off, clock.now()),
        turns,
        clock,
        zero: Timestamp::MAX,
        shown: Track(Vec::new()),
        shown_off: Track(Vec::new()),
    };
    let followers = Followers { records: None, feed: Some(feed) };
    let link = runtime::start_followed(model.clone(), clock, followers);
    let bridge = ros::start(options.clone(), &model, link.inputs.clone(), clock).await?;
    let outcome = match is_found(&bridge, clock).await {
        true => Ok(drive(ride, &plan, &publisher, watch, &link, clock).await),
        false => Err(options.domain),
    };
    bridge.shutdown().await;
    publisher.shutdown().await;
    match outcome {
        Ok(outcome) => Ok(outcome),
        Err(domain) => bail!(
            "DDS is not heard here: within {} s the diagnosis found no publisher of {DIAGNOSTICS} on the loopback interface, \
             domain {domain}. The interface must be up, and multicast must be allowed on it: `ip link set lo up multicast on`",
            FOUND_WITHIN.as_secs_f64()
        ),
    }
}

/// Waits until the diagnosis has found the machine.
async fn is_found(bridge: &Bridge, clock: Clock) -> bool {
    let mut discovery = bridge.discovery();
    let is_published = |topic: &TopicSeen| topic.name == DIAGNOSTICS && !topic.publishers.is_empty();
    let found = discovery.wait_for(|seen| seen.topics.iter().any(is_published));
    clock.by(clock.now() + FOUND_WITHIN, found).await.is_some_and(|found| found.is_ok())
}

/// Lets the machine go through its trial.
async fn drive(
    mut ride: Ride<'_>,
    plan: &Plan,
    publisher: &Publisher,
    mut watch: Watch,
    link: &Link,
    clock: Clock,
) -> Result<Heard, HeldUp> {
    let start = clock.now();
    let live = |at: Timestamp| start + at.since(Timestamp::ZERO);
    watch.zero = live(ride.zero);
    let mut ticks = tokio::time::interval(Duration::from(STEP));
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let (mut last, mut announced, mut operator) = (start, Vec::new(), VecDeque::new());
    while ride.now.since(ride.zero).as_millis() < plan.length_ms {
        ticks.tick().await;
        let now = clock.now();
        if last >= watch.zero && now.since(last) > HELD_UP_MAX {
            return Err(format!("the program was held up for {} ms", now.since(last).as_millis()));
        }
        last = now;
        while live(ride.now + STEP) <= now {
            let wall = clock.wall();
            for (topic, body) in ride.step(|at| clock::wall_at(wall, now, live(at))) {
                if let Err(error) = publisher.publish(topic, body).await {
                    tracing::warn!("the machine: {error}");
                }
            }
            operator.extend(ride.actions().cloned());
            if ride.now == ride.zero {
                watch.take()?;
                watch.begin(plan)?;
            }
        }
        let nodes = ride.machine.nodes();
        if nodes != announced {
            let entities: Vec<_> = nodes.iter().map(|node| (*node, ride.machine.topics_of(node))).collect();
            if let Err(error) = publisher.announce(&entities, GidSize::Bytes16).await {
                tracing::warn!("the machine: {error}");
            }
            announced = nodes;
        }
        act(&mut operator, link).await;
        watch.take()?;
    }
    Ok(Heard { seed: plan.seed, shown: watch.shown, off: watch.shown_off })
}

/// Does what the operator wants to do, as far as it is granted now.
async fn act(operator: &mut VecDeque<OperatorAction>, link: &Link) {
    while let Some(action) = operator.front().cloned() {
        let (reply, answer) = oneshot::channel();
        let sent = link.commands.send(Command { action, last_stop: None, reply }).await;
        if sent.is_err() || answer.await != Ok(Response::Done) {
            return;
        }
        operator.pop_front();
    }
}

/// Follows what the engine takes and shows, and lets another engine take it too that masks nothing.
struct Watch {
    off: Engine,
    turns: Turns,
    clock: Clock,
    /// When the trial begins.
    zero: Timestamp,
    /// From then on.
    shown: Track,
    shown_off: Track,
}

impl Watch {
    /// Takes what came since the last time.
    fn take(&mut self) -> Result<(), HeldUp> {
        while let Ok(Turn { lost, taken, snapshot, .. }) = self.turns.next(Duration::ZERO) {
            if lost > 0 {
                return Err(format!("{lost} inputs of the engine are missing"));
            }
            for Stamped { input, received, message } in taken {
                let late = on_its_way(message.as_deref()) + Duration::from(self.clock.now().since(received));
                if received >= self.zero && late > Duration::from(HELD_UP_MAX) {
                    return Err(format!("a message was judged after {} ms", late.as_millis()));
                }
                self.off.handle(&input, received);
            }
            snapshot.into_iter().for_each(|it| push(&mut self.shown, it, self.zero));
            // A snapshot costs time.
            if self.shown_off.0.last().is_none_or(|(_, last)| last.seq != self.off.seq()) {
                push(&mut self.shown_off, self.off.snapshot(), self.zero);
            }
        }
        Ok(())
    }

    /// The trial begins.
    fn begin(&self, plan: &Plan) -> Result<(), HeldUp> {
        let is_ready = |track: &Track| track.0.last().is_some_and(|(_, it)| is_at(it, plan.place));
        match is_ready(&self.shown) && is_ready(&self.shown_off) {
            true => Ok(()),
            false => Err("the machine did not come to its place without a fault".to_owned()),
        }
    }
}

/// From the publication of a message to its receipt.
fn on_its_way(message: Option<&Message>) -> Duration {
    let span = |message: &Message| message.received.duration_since(message.source?).ok();
    message.and_then(span).unwrap_or_default()
}

fn push(track: &mut Track, snapshot: Arc<Snapshot>, zero: Timestamp) {
    if track.0.last().is_some_and(|(_, last)| last.seq == snapshot.seq) {
        return;
    }
    let ms = snapshot.now.since(zero).as_millis();
    if ms == 0 {
        // Only the last state from before counts.
        track.0.clear();
    }
    track.0.push((ms, snapshot));
}
