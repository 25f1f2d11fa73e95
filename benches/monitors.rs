//! What a thousand monitors cost the whole process: 200 topics, 20,000 messages a second over DDS.
//! `cargo bench --bench monitors`.
//!
//! Three processes of this program: one publishes; one watches, with the bridge, the monitors and the engine
//! as in `serve`; one reads the same topics and drops the messages, which shows the share of the DDS library
//! and the bridge.

#[allow(dead_code, reason = "the other benchmarks use more of it")]
mod vehicle;
#[allow(dead_code, reason = "the other benchmarks use more of it")]
#[path = "vehicle/watched.rs"]
mod watched;

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../tests/it/peer.rs"]
mod peer;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use telltale::clock::Clock;
use telltale::engine::input::Input;
use telltale::engine::model::sample::Pose;
use telltale::engine::model::{Model, Parts};
use telltale::msg::messages::encode;
use telltale::msg::messages::encode::{Header, Motion};
use telltale::ros::{self, BridgeOptions, Publisher, Quality};
use telltale::runtime;

const ROLE: &str = "TELLTALE_BENCH_ROLE";
const DOMAIN: &str = "TELLTALE_BENCH_DOMAIN";

const RATE_HZ: u64 = 20_000;
const WARM_UP: Duration = Duration::from_secs(10);
const MEASURED: Duration = Duration::from_secs(20);

fn main() {
    match std::env::var(ROLE).as_deref() {
        Ok(role) => play(role),
        Err(_) => compare(),
    }
}

fn compare() {
    let domain = peer::Domain::take();
    let publisher = start("publish", domain.id);
    let readers = measure("read", domain.id);
    println!("read and thrown away:  {readers}");
    let monitors = measure("watch", domain.id);
    println!("with 1,000 monitors:   {monitors}");
    println!(
        "what the monitors add: {:.1} % of a core, {:.1} MB",
        monitors.core_percent - readers.core_percent,
        monitors.rss_mb - readers.rss_mb
    );
    drop(publisher);
}

/// A process of this program, ended when it is dropped.
struct Part(Child);

impl Drop for Part {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(role: &str, domain: u16) -> Part {
    let program = std::env::current_exe().expect("this program has a path");
    let child = Command::new(program)
        .env(ROLE, role)
        .env(DOMAIN, domain.to_string())
        .stdout(Stdio::piped())
        .spawn()
        .expect("this program starts");
    Part(child)
}

struct Figures {
    per_second: f64,
    dropped: u64,
    core_percent: f64,
    rss_mb: f64,
}

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Figures { per_second, dropped, core_percent, rss_mb } = self;
        write!(
            f,
            "{per_second:.0} messages/s, {dropped} dropped, {core_percent:.1} % of a core, {rss_mb:.1} MB"
        )
    }
}

fn measure(role: &str, domain: u16) -> Figures {
    let mut part = start(role, domain);
    let mut lines = BufReader::new(part.0.stdout.take().expect("piped")).lines();
    let mut counts = || -> (u64, u64) {
        let line = lines.next().expect("it says what it counted").expect("text");
        let (taken, dropped) = line.split_once(' ').expect("two numbers");
        (taken.parse().expect("a number"), dropped.parse().expect("a number"))
    };
    let before = (counts(), used(part.0.id()));
    let after = (counts(), used(part.0.id()));
    let seconds = MEASURED.as_secs_f64();
    Figures {
        per_second: (after.0.0 - before.0.0) as f64 / seconds,
        dropped: after.0.1 - before.0.1,
        core_percent: (after.1.0 - before.1.0) / seconds * 100.0,
        rss_mb: after.1.1,
    }
}

/// Seconds of processor time used so far, and resident MB.
fn used(pid: u32) -> (f64, f64) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("it runs");
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |at: usize| fields[at].parse::<f64>().expect("a number");
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it runs");
    let rss = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("it has memory");
    let kib: f64 = rss.trim().trim_end_matches(" kB").parse().expect("a number");
    ((ticks(11) + ticks(12)) / 100.0, kib / 1024.0)
}

fn play(role: &str) {
    let domain = std::env::var(DOMAIN).ok().and_then(|id| id.parse().ok()).expect("a domain");
    let options = BridgeOptions::loopback(domain);
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        match role {
            "publish" => publish(options).await,
            "read" => read(options).await,
            _ => watch(options).await,
        }
    });
}

async fn publish(options: BridgeOptions) {
    let mut publisher = Publisher::open(&options, &[]).await.expect("DDS on the loopback interface");
    let topics = watched::model().watched.topics.clone();
    for topic in &topics {
        publisher.offer(&topic.topic, &topic.type_name, Quality::BestEffort).expect("a writer");
    }
    let clock = Clock::start();
    let mut number = 0_u64;
    let mut turn = tokio::time::interval(Duration::from_millis(1));
    loop {
        turn.tick().await;
        let due = clock.now().as_nanos() / (1_000_000_000 / RATE_HZ);
        // A late message is not made up for.
        number = number.max(due.saturating_sub(RATE_HZ / 10));
        while number < due {
            let seconds = number as f64 / RATE_HZ as f64;
            let at = Pose { x_m: 5.0 * seconds, qw: 1.0, ..Pose::default() };
            let velocity = Motion { linear: [seconds.sin() * 0.4, 0.0, 0.0], angular: [0.0; 3] };
            let head = Header { stamp: clock.wall(), frame_id: "odom" };
            let body = encode::odometry(head, "base_link", at, velocity);
            let topic = &topics[number as usize % topics.len()].topic;
            publisher.publish(topic, body).await.expect("best effort waits for nobody");
            number += 1;
        }
    }
}

fn figures_due(clock: Clock) -> tokio::time::Interval {
    let start = tokio::time::Instant::from_std(clock.instant(clock.now()));
    tokio::time::interval_at(start + WARM_UP, MEASURED)
}

/// The topics alone: no field of their messages is read.
async fn read(options: BridgeOptions) {
    let (clock, mut parts): (_, Parts) = (Clock::start(), (*watched::model()).clone());
    for topic in &mut parts.watched.topics {
        let bare = Arc::make_mut(topic);
        bare.fields.clear();
        bare.stamp = false;
    }
    parts.modules.clear();
    let model = Model::new(parts).expect("nothing depends on anything");
    let (inputs, mut received) = tokio::sync::mpsc::channel(runtime::INPUT_QUEUE);
    let _bridge = ros::start(options, &model, inputs, clock).await.expect("DDS on the loopback interface");
    let mut count = 0_u64;
    let mut say = figures_due(clock);
    loop {
        tokio::select! {
            biased;
            _ = say.tick() => println!("{count} 0"),
            stamped = received.recv() => {
                let stamped = stamped.expect("the bridge runs");
                count += u64::from(matches!(stamped.input, Input::Sample(_)));
            }
        }
    }
}

async fn watch(options: BridgeOptions) {
    let (clock, model) = (Clock::start(), Arc::new(watched::model()));
    let link = runtime::start(model.clone(), clock);
    let _bridge =
        ros::start(options, &model, link.inputs.clone(), clock).await.expect("DDS on the loopback interface");
    let mut say = figures_due(clock);
    loop {
        say.tick().await;
        let counters = link.snapshots.borrow().snapshot.counters;
        println!("{} {}", counters.samples, counters.dropped_samples);
    }
}
