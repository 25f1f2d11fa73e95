//! What it costs to record 200 MB of messages a second: the ring alone, and with an incident being written; and
//! how long a change of a state waits for the engine's copy for a keyframe.
//! `cargo bench --bench recording [-- FOLDER]`; recordings go to a new folder in FOLDER, else in the temporary one.

mod vehicle;
#[path = "vehicle/watched.rs"]
mod watched;

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use telltale::clock::Clock;
use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::time::{Span, Timestamp};
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;
use telltale::msg::received::{Message, Stamped};
use telltale::record::feed::Feed;
use telltale::record::incident::Margins;
use telltale::record::recorder::{Recorder, Settings};
use telltale::record::retention::Policy;
use telltale::record::room::Room;
use telltale::record::writer::{self, News, Place};
use tokio::sync::{mpsc, watch};

const MESSAGES_PER_S: u32 = 100;
const MESSAGE_BYTES: usize = 2_000_000;
const SECONDS: u32 = 20;
const MEMORY: usize = 256_000_000;
const MODULES: usize = 1_000;
/// Copies for keyframes, each after ten seconds of statuses.
const COPIES: usize = 40;
/// The recorder keeps about so many copies.
const COPIES_KEPT: usize = 10;

/// Processor time of this process so far, in seconds.
fn used() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 / 1e9
}

/// A point cloud's worth of bytes that compress as badly as measured values do.
fn cloud() -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut bytes = Vec::with_capacity(MESSAGE_BYTES);
    while bytes.len() < MESSAGE_BYTES {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        bytes.extend_from_slice(&state.to_le_bytes()[..4]);
        bytes.extend_from_slice(&[0, 0, 128, 63]);
    }
    bytes
}

/// Publishes for the stated time what `take` receives, and returns the share of one core that this took.
fn run(clock: Clock, mut take: impl FnMut(Stamped)) -> f64 {
    let cloud = cloud();
    let (began, before) = (clock.now(), used());
    let pause = Duration::from_secs(1) / MESSAGES_PER_S;
    for sequence in 0..MESSAGES_PER_S * SECONDS {
        let due = Duration::from_nanos(clock.now().since(began).as_nanos());
        std::thread::sleep((pause * sequence).saturating_sub(due));
        let message = Message {
            topic: "/points".into(),
            type_name: "sensor_msgs/msg/PointCloud2".into(),
            writer: [1; 16],
            sequence: i64::from(sequence),
            source: None,
            received: clock.wall(),
            body: Ok((Bytes::copy_from_slice(&cloud), Endian::Little)),
            left_out: 0,
            kept: false,
        };
        take(Stamped { input: Input::Tick, received: clock.now(), message: Some(Arc::new(message)) });
    }
    (used() - before) / f64::from(SECONDS)
}

/// The same with a recorder; the second number says how much of the past it held at the end, in seconds.
fn recorded(clock: Clock, engine: &mut Engine, folder: Option<PathBuf>) -> (f64, f64) {
    let (mut feed, turns) = Feed::new(clock);
    let settings = Settings {
        margins: Margins::default(),
        memory: MEMORY,
        longest_memory: Span::from_secs(2),
        configuration: [].into(),
    };
    let recorder = Recorder::start(turns, engine.snapshot(), settings, 1, clock).expect("a thread starts");
    let (tell, mut news) = mpsc::channel(64);
    let writes = folder.is_some();
    let writer = folder.map(|folder| {
        let place = Place { folder, definitions: Definitions::new(Vec::new()), about: BTreeMap::new() };
        writer::start(&recorder, place, Room::new(&Policy::default()), tell, watch::channel(None).0)
            .expect("a thread starts")
    });
    let mut published = 0;
    let share = run(clock, |stamped| {
        engine.handle(&stamped.input, stamped.received);
        feed.took(stamped);
        feed.end_turn(engine);
        // A mark every 5 s: the incident goes on, because it ends 10 s after the last one.
        if writes && published % (5 * MESSAGES_PER_S) == 0 {
            recorder.mark("bench", "").expect("one in five seconds");
        }
        published += 1;
    });
    let meter = recorder.meter();
    let held = meter.topics.iter().map(|held| held.span.as_millis() as f64 / 1000.0).fold(0.0, f64::max);
    drop(feed);
    if let Some(writer) = writer {
        drop(recorder);
        while let Some(said) = news.blocking_recv() {
            if let News::Ended(summary) = said {
                let recording = &summary.recording;
                println!(
                    "    file: {:.0} MB, {} messages, {} missing",
                    recording.bytes as f64 / 1e6,
                    recording.messages,
                    recording.missing
                );
                break;
            }
        }
        writer.join().expect("the writer ends");
    }
    (share, held)
}

/// How long copies of an engine take, and how long the first statuses behind one do: what a copy shares is copied
/// when it changes.
fn copies(clock: Clock, what: &str, mut engine: Engine, mut live: impl FnMut(&mut Engine, usize)) {
    let ms = |since| clock.now().since(since).as_nanos() as f64 / 1e6;
    let (mut copies, mut behind, mut kept) = (Vec::new(), Vec::new(), VecDeque::new());
    for number in 0..COPIES {
        live(&mut engine, number);
        let began = clock.now();
        kept.push_back(Arc::new(engine.clone()));
        copies.push(ms(began));
        let began = clock.now();
        live(&mut engine, number + 1);
        behind.push(ms(began));
        if kept.len() > COPIES_KEPT {
            kept.pop_front();
        }
    }
    copies.sort_by(f64::total_cmp);
    behind.sort_by(f64::total_cmp);
    println!(
        "{what}: a copy {:.2} ms, {:.2} ms at most; the statuses behind it {:.2} ms",
        copies[COPIES / 2],
        copies[COPIES - 1],
        behind[COPIES / 2],
    );
}

fn main() {
    let clock = Clock::start();
    for modules in [1_000, 10_000, 100_000] {
        let what = format!("{modules} modules");
        copies(clock, &what, vehicle::running(modules), |engine, number| {
            let level = u8::from(number.is_multiple_of(2));
            let now = engine.now() + Span::from_secs(1);
            engine.handle(&vehicle::array(0..100, level), now);
            engine.handle(&vehicle::array(100..modules.min(1_100), 0), now);
            engine.snapshot();
        });
    }
    let model = Arc::new(watched::model());
    let topics = model.watched.topics.clone();
    let monitored = Engine::new(model, Timestamp::ZERO);
    let mut number = 0;
    copies(clock, "1,000 monitors on 200 topics", monitored, |engine, _| {
        for _ in 0..40_000 {
            let (input, now) = watched::message(&topics, number);
            engine.handle(&input, now);
            number += 1;
        }
        engine.snapshot();
    });
    let parent = std::env::args().skip(1).find(|word| !word.starts_with("--"));
    let parent = parent.map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = parent.join(format!("telltale-recording-bench-{}", std::process::id()));
    std::fs::create_dir(&folder).expect("a folder for recordings");
    let mut engine = vehicle::running(MODULES);
    let rate = MESSAGE_BYTES as f64 * f64::from(MESSAGES_PER_S) / 1e6;
    let alone = run(clock, drop);
    println!("{rate:.0} MB/s made and dropped: {:.1} % of a core", alone * 100.0);
    let (ring, held) = recorded(clock, &mut engine, None);
    println!("with the ring: {:.1} % of a core; it holds {held:.2} s", ring * 100.0);
    let (file, _) = recorded(clock, &mut engine, Some(folder.clone()));
    println!("with an incident being written: {:.1} % of a core", file * 100.0);
    std::fs::remove_dir_all(&folder).expect("the folder can be removed");
}
