//! What a message of `/api/v1/stream` costs: 1,000 modules, of which one changed its state, with unchanged arrays
//! of 1,000 statuses. `cargo bench --bench frames`; for instructions
//! `valgrind --tool=callgrind --toggle-collect='frames::whole' BINARY` (or `groups`, `deltas`).

mod vehicle;

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use divan::Bencher;
use telltale::engine::time::Timestamp;
use telltale::runtime::Published;
use telltale::web::live::frame::{Form, Frames, Sent};

const MODULES: usize = 1_000;

fn main() {
    divan::main();
}

/// Snapshots ten milliseconds apart, each after an array of all statuses and a change of one.
fn snapshots(count: usize) -> Vec<Published> {
    let mut engine = vehicle::running(MODULES);
    let shown = (1..=count as u64).map(|number| {
        let now = Timestamp::from_millis(1_000_000 + 10 * number);
        engine.handle(&vehicle::array(0..MODULES, 0), now);
        let changed = (number as usize / 2 * 7) % MODULES;
        engine.handle(&vehicle::array(changed..changed + 1, (number % 2) as u8), now);
        let at = UNIX_EPOCH + Duration::from_secs(1_795_176_000) + Duration::from_nanos(now.as_nanos());
        Published::recorded(Arc::clone(&engine.snapshot()), at)
    });
    shown.collect()
}

/// The next message for each of these snapshots in turn, from the beginning after a rewind for each round.
fn messages(
    bencher: Bencher<'_, '_>,
    form: Form,
    write: impl Fn(&Frames, &Published, Form, Option<Sent>) -> Sent,
) {
    let snapshots = snapshots(200);
    let frames = Frames::default();
    let (mut next, mut sent) = (0, None);
    bencher.bench_local(|| {
        let rewinds = (next / snapshots.len()) as u64;
        let published = Published { rewinds, ..snapshots[next % snapshots.len()].clone() };
        sent = Some(write(&frames, &published, form, sent));
        next += 1;
    });
}

#[inline(never)]
fn whole(frames: &Frames, published: &Published, form: Form, sent: Option<Sent>) -> Sent {
    read(frames, published, form, sent)
}

#[inline(never)]
fn groups(frames: &Frames, published: &Published, form: Form, sent: Option<Sent>) -> Sent {
    read(frames, published, form, sent)
}

#[inline(never)]
fn deltas(frames: &Frames, published: &Published, form: Form, sent: Option<Sent>) -> Sent {
    read(frames, published, form, sent)
}

fn read(frames: &Frames, published: &Published, form: Form, sent: Option<Sent>) -> Sent {
    let (message, sent) = frames.stream(published, form, sent);
    black_box(message);
    sent
}

#[divan::bench]
fn stream_whole(bencher: Bencher<'_, '_>) {
    messages(bencher, Form::default(), whole);
}

#[divan::bench]
fn stream_groups(bencher: Bencher<'_, '_>) {
    messages(bencher, Form { groups: true, deltas: false }, groups);
}

#[divan::bench]
fn stream_deltas(bencher: Bencher<'_, '_>) {
    messages(bencher, Form { groups: false, deltas: true }, deltas);
}
