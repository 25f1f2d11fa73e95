//! The loop that owns the engine: inputs in, the latest snapshot out.

mod ending;
mod recorder;

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::SystemTime;

use tokio::sync::{broadcast, mpsc, oneshot, watch};

pub use ending::Ending;
use recorder::Recorder;
use telltale_clock::latency::Latency;
use telltale_clock::{Clock, wall_at};
use telltale_engine::Engine;
use telltale_engine::input::{Input, OperatorAction, Refusal, Response};
use telltale_engine::model::{Model, Stage};
use telltale_engine::restart::preview::Preview;
use telltale_engine::restart::resume::Restored;
use telltale_engine::snapshot::{Countermeasure, SILENT_MAX, Snapshot};
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Record;
pub use telltale_msg::received::Stamped;
use telltale_record::feed::Feed;
pub use telltale_record::ring::ConfigurationText;

/// Inputs that may wait for the engine. A full queue holds its senders back: the bridge's
/// readers then lose the oldest samples by their own depth, and count that.
pub const INPUT_QUEUE: usize = 1024;

/// Commands, and rehearsals too, that may wait for the engine. A full queue makes the senders wait.
pub const COMMAND_QUEUE: usize = 64;

/// New configurations that may wait for the engine. A full queue makes the senders wait.
pub const RELOAD_QUEUE: usize = 1;

/// Inputs handled before the others get their turn and a changed state is published.
const BATCH_MAX: usize = 32;

/// Changes of the stage and of requests that may wait for their receiver. Past it the oldest are lost, and
/// the receiver is told how many.
const TURN_QUEUE: usize = 256;

/// New words and values without a new state are published at most this often.
const WORDS_EVERY: Span = Span::from_millis(100);

/// A snapshot is published this often even if nothing changed, so that pages know that the engine lives, and
/// ages are no older than this.
pub const PULSE_EVERY: Span = Span::from_millis(SILENT_MAX.as_millis() / 4);

/// A snapshot as it is shown. Its own times may be those of a recording.
#[derive(Debug, Clone)]
pub struct Published {
    pub snapshot: Arc<Snapshot>,
    /// The wall time at the snapshot's `now`.
    pub at: SystemTime,
    /// When this process received the snapshot, by the clock of this process.
    pub received: Timestamp,
    /// How often the source went back in time; 0 for a running engine.
    pub rewinds: u64,
    /// An incident is being recorded.
    pub recording: bool,
    /// It comes from a replay. Its readers may see a locked vehicle too.
    pub replay: bool,
}

/// The place of a state, or of its words, in what a source shows. After a step back in time the numbers
/// of snapshots come again, with more rewinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Version {
    pub rewinds: u64,
    pub number: u64,
}

/// A number of a running engine, which never goes back.
impl From<u64> for Version {
    fn from(number: u64) -> Version {
        Version { rewinds: 0, number }
    }
}

impl Published {
    /// A snapshot that nobody received from an engine of this process: one of a recording or a test.
    pub fn recorded(snapshot: Arc<Snapshot>, at: SystemTime) -> Published {
        Published { snapshot, at, received: Timestamp::ZERO, rewinds: 0, recording: false, replay: false }
    }

    /// Nobody is logged in at the vehicle, so nothing of it is shown.
    pub fn is_locked(&self) -> bool {
        self.snapshot.stage == Stage::Locked && !self.replay
    }

    fn now(snapshot: Arc<Snapshot>, clock: &Clock, feed: Option<&Feed>) -> Published {
        let received = clock.now();
        let at = wall_at(clock.wall(), received, snapshot.now);
        let recording = feed.is_some_and(Feed::is_recording);
        Published { snapshot, at, received, rewinds: 0, recording, replay: false }
    }

    /// Grows with every state.
    pub fn seq(&self) -> Version {
        Version { rewinds: self.rewinds, number: self.snapshot.seq }
    }

    /// Grows with every state and with all words.
    pub fn revision(&self) -> Version {
        Version { rewinds: self.rewinds, number: self.snapshot.revision }
    }
}

/// An operator's action that waits for the engine's answer.
#[derive(Debug)]
pub struct Command {
    pub action: OperatorAction,
    /// For the second step of an action: the number of the last STOP when it was asked for. After another STOP
    /// it is not done.
    pub last_stop: Option<u64>,
    pub reply: oneshot::Sender<Response>,
}

/// An operator's action that is judged and not done.
#[derive(Debug)]
pub struct Rehearsal {
    pub action: OperatorAction,
    pub reply: oneshot::Sender<Result<Preview, Vec<Refusal>>>,
}

/// Another configuration for the engine, which is free of errors and is taken whole.
#[derive(Debug)]
pub struct Reload {
    pub model: Arc<Model>,
    /// The files from which the model was made.
    pub texts: Arc<[ConfigurationText]>,
    /// Answered when the engine runs by it and has published a snapshot of it.
    pub done: oneshot::Sender<()>,
}

/// Somebody asks that the file of the configuration be read again.
#[derive(Debug)]
pub struct Reread {
    /// Whether the engine is to run by it, or only the difference is asked for.
    pub take: bool,
    /// The [digest](Rereading::digest) of what the developer was shown: anything else is not taken.
    pub shown: Option<String>,
    pub reply: oneshot::Sender<Rereading>,
}

/// The outcome, in words for a developer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rereading {
    pub taken: bool,
    /// One sentence each; empty if it means the same as what runs.
    pub differences: Vec<String>,
    /// Everything that is wrong with the file. Then the old configuration stays.
    pub problems: Option<String>,
    /// How it can go wrong.
    pub warnings: Option<String>,
    /// Every situation was looked at; until then `warnings` says nothing.
    pub judged: bool,
    /// The files that the engine runs by, as they were read.
    pub running: Arc<[ConfigurationText]>,
    /// Of the text of the files and of the differences; empty where there are problems.
    pub digest: String,
}

/// The files of the running configuration, and where each node is written in them.
#[derive(Debug)]
pub struct Written {
    pub texts: Arc<[ConfigurationText]>,
    /// By the name of the node: the position of its file, and its line there, counted from 1.
    pub lines: HashMap<Box<str>, (u16, usize)>,
}

/// The connection of the rest of the program to the engine. Clones lead to the same engine.
#[derive(Debug, Clone)]
pub struct Link {
    pub inputs: mpsc::Sender<Stamped>,
    pub commands: mpsc::Sender<Command>,
    pub rehearsals: mpsc::Sender<Rehearsal>,
    pub reloads: mpsc::Sender<Reload>,
    /// For programs, and for readers that look and do not wait. Holds at most the latest; a slow reader skips what lies
    /// between.
    pub snapshots: watch::Receiver<Published>,
    /// The same for the outputs to the vehicle.
    pub vehicle: watch::Receiver<Arc<Snapshot>>,
    /// The same for pages, the tools of ROS 2 and the store: told after programs and the vehicle, because each would
    /// delay these.
    pub afterwards: watch::Receiver<Published>,
    /// Every snapshot in which the stage or the requests to the vehicle changed, also if the next one followed
    /// before a reader of `snapshots` saw it.
    pub turns: broadcast::Sender<Published>,
    pub latencies: Latencies,
    pub ending: Ending,
}

/// How long inputs take.
#[derive(Debug, Clone, Default)]
pub struct Latencies {
    /// From the receipt of an input to its judgement.
    pub judged: Latency,
    /// From the receipt of the input that changed a state to the publication of that state.
    pub published: Latency,
}

/// Receivers of what happens in the engine. It waits for none of them: a full queue loses what it cannot take,
/// which is counted.
#[derive(Debug, Default)]
pub struct Followers {
    /// The history.
    pub records: Option<SyncSender<Vec<Record>>>,
    /// The recorder of incidents.
    pub feed: Option<Feed>,
}

/// Starts the engine in a task of the current tokio runtime. It ends when all links are dropped.
pub fn start(model: Arc<Model>, clock: Clock) -> Link {
    start_followed(model, clock, Followers::default())
}

/// [`start`] with receivers of what happens.
pub fn start_followed(model: Arc<Model>, clock: Clock, followers: Followers) -> Link {
    run(Engine::begin(model, clock.now()), clock, followers)
}

/// [`start_followed`] from the state at the end of an earlier run of the program.
pub fn resume(model: Arc<Model>, restored: &Restored, clock: Clock, followers: Followers) -> Link {
    run(Engine::resume(model, restored, clock.now()), clock, followers)
}

fn run(mut engine: Engine, clock: Clock, Followers { records, feed }: Followers) -> Link {
    let (inputs, inputs_rx) = mpsc::channel(INPUT_QUEUE);
    let (commands, commands_rx) = mpsc::channel(COMMAND_QUEUE);
    let (rehearsals, rehearsals_rx) = mpsc::channel(COMMAND_QUEUE);
    let (reloads, reloads_rx) = mpsc::channel(RELOAD_QUEUE);
    if records.is_some() || feed.is_some() {
        engine.keep_events();
    }
    let recorder = Recorder::start(&mut engine, records, clock.now());
    let first = Published::now(engine.snapshot(), &clock, feed.as_ref());
    let (to_vehicle, vehicle) = watch::channel(first.snapshot.clone());
    let (to_others, afterwards) = watch::channel(first.clone());
    let (publish, snapshots) = watch::channel(first);
    let turns = broadcast::Sender::new(TURN_QUEUE);
    let latencies = Latencies::default();
    let mut turn = Loop {
        latencies: latencies.clone(),
        changed_by: None,
        requests: engine.requests(),
        turns: turns.clone(),
        published_seq: engine.seq(),
        published_revision: engine.revision(),
        published_at: clock.now(),
        engine,
        recorder,
        feed,
        clock,
        publish,
        to_vehicle,
        to_others,
        is_told_to_all: true,
    };
    turn.hand_on();
    let queues =
        Queues { inputs: inputs_rx, commands: commands_rx, rehearsals: rehearsals_rx, reloads: reloads_rx };
    let ending = Ending::default();
    let asked = ending.clone();
    tokio::spawn(async move {
        tokio::select! {
            () = turn.run(queues) => {}
            () = asked.asked() => {}
        }
        // The pages, the tools of ROS 2 and the store may not have the last snapshot yet.
        turn.tell_others();
        turn.hand_on();
        turn.recorder.hand_on_rest(turn.clock.now());
    });
    Link { inputs, commands, rehearsals, reloads, snapshots, vehicle, afterwards, turns, latencies, ending }
}

struct Queues {
    inputs: mpsc::Receiver<Stamped>,
    commands: mpsc::Receiver<Command>,
    rehearsals: mpsc::Receiver<Rehearsal>,
    reloads: mpsc::Receiver<Reload>,
}

struct Loop {
    engine: Engine,
    recorder: Recorder,
    feed: Option<Feed>,
    clock: Clock,
    publish: watch::Sender<Published>,
    to_vehicle: watch::Sender<Arc<Snapshot>>,
    to_others: watch::Sender<Published>,
    /// Whether the last snapshot was told to the pages, the tools of ROS 2 and the store, too.
    is_told_to_all: bool,
    turns: broadcast::Sender<Published>,
    requests: (Stage, Arc<[Countermeasure]>),
    published_seq: u64,
    published_revision: u64,
    published_at: Timestamp,
    latencies: Latencies,
    /// The receipt of the first input that changed a state which is not published yet.
    changed_by: Option<Timestamp>,
}

impl Loop {
    async fn run(&mut self, queues: Queues) {
        let Queues { mut inputs, mut commands, mut rehearsals, mut reloads } = queues;
        let mut batch = Vec::with_capacity(BATCH_MAX);
        loop {
            let wake = tokio::time::Instant::from_std(self.clock.instant(self.next_turn()));
            // Inputs go before deadlines: what waits in the queue was received before the
            // deadline was noticed, and may be what it waits for.
            tokio::select! {
                biased;
                command = commands.recv() => match command {
                    Some(command) => self.obey(command),
                    None => return,
                },
                rehearsal = rehearsals.recv() => match rehearsal {
                    Some(Rehearsal { action, reply }) => {
                        // A preview judges the present: a recording has that its time has come.
                        let now = self.clock.now();
                        self.handle(Stamped::new(Input::Tick, now));
                        // The asker may have gone; nothing has happened.
                        let _ = reply.send(self.engine.preview(&action, now));
                    }
                    None => return,
                },
                reload = reloads.recv() => match reload {
                    Some(reload) => self.reload(reload),
                    None => return,
                },
                received = inputs.recv_many(&mut batch, BATCH_MAX) => {
                    if received == 0 {
                        return;
                    }
                    for stamped in batch.drain(..) {
                        self.handle(stamped);
                        self.tell_turn();
                    }
                }
                () = tokio::time::sleep_until(wake) => {
                    self.handle(Stamped::new(Input::Tick, self.clock.now()));
                }
            }
            self.tell_turn();
            self.publish_if_due();
            if !self.is_told_to_all && inputs.is_empty() {
                // Programs and the vehicle have their turn: one round of the scheduler. A command ends this wait.
                tokio::task::yield_now().await;
            }
            self.tell_others();
            self.hand_on();
        }
    }

    fn handle(&mut self, mut stamped: Stamped) -> Response {
        let received = stamped.received;
        // Several threads stamp what they receive before it waits here: the engine takes an earlier instant for its
        // last one, and so the recording has it.
        stamped.received = received.max(self.engine.now());
        let response = self.engine.handle(&stamped.input, stamped.received);
        self.latencies.judged.observe(self.clock.now().since(received));
        if self.engine.seq() != self.published_seq {
            self.changed_by.get_or_insert(received);
        }
        if let Some(feed) = &mut self.feed {
            feed.took(stamped);
        }
        // Events keep the places of modules that leave: a replay takes them after each input too.
        self.tell_events();
        response
    }

    /// Tells the followers of everything that happened, with the names that are valid now.
    fn tell_events(&mut self) {
        let events = self.engine.take_events();
        if events.is_empty() {
            return;
        }
        let snapshot = self.engine.snapshot();
        if let Some(feed) = &mut self.feed {
            feed.happened(&events, &snapshot);
        }
        self.recorder.take(events, &snapshot);
    }

    /// Hands on to the history and the recorder what this turn brought. Their threads take the processor.
    fn hand_on(&mut self) {
        self.recorder.hand_on_if_due(self.clock.now());
        if let Some(feed) = &mut self.feed {
            feed.end_turn(&self.engine);
        }
    }

    /// When the loop has work again, even if nothing arrives.
    fn next_turn(&self) -> Timestamp {
        let words = self.engine.revision() != self.published_revision;
        let publish = self.published_at + if words { WORDS_EVERY } else { PULSE_EVERY };
        self.engine.next_deadline().map_or(publish, |deadline| deadline.min(publish))
    }

    fn obey(&mut self, command: Command) {
        // An asker that gave up was told that nothing happened. A stop is never too late.
        if command.reply.is_closed() && command.action != OperatorAction::RequestStop {
            return;
        }
        if command.last_stop.is_some_and(|number| number != self.engine.last_stop()) {
            let _ = command.reply.send(Response::Refused(vec![Refusal::StoppedSince]));
            return;
        }
        let response = self.handle(Stamped::new(Input::Operator(command.action), self.clock.now()));
        self.tell_turn();
        // Published before it is answered: who asked finds the result in the next snapshot.
        self.publish_if_due();
        self.tell_others();
        // The asker may have gone; the action stands all the same.
        let _ = command.reply.send(response);
    }

    fn reload(&mut self, Reload { model, texts, done }: Reload) {
        let now = self.clock.now();
        // Deadlines up to now act under the old configuration: their events name its nodes.
        self.handle(Stamped::new(Input::Tick, now));
        self.engine.reload(model, now);
        if let Some(feed) = &mut self.feed {
            feed.reloaded(now, texts);
        }
        self.tell_events();
        self.recorder.begin(&mut self.engine, true);
        self.publish_if_due();
        self.tell_others();
        // The asker may have gone; the engine runs by it all the same.
        let _ = done.send(());
    }

    fn tell_turn(&mut self) {
        let requests = self.engine.requests();
        if requests.0 == self.requests.0 && Arc::ptr_eq(&requests.1, &self.requests.1) {
            return;
        }
        self.requests = requests;
        // Nobody may listen, as in a test.
        let _ = self.turns.send(Published::now(self.engine.snapshot(), &self.clock, self.feed.as_ref()));
    }

    fn publish_if_due(&mut self) {
        let now = self.clock.now();
        let urgent = self.engine.seq() != self.published_seq;
        let words = self.engine.revision() != self.published_revision;
        let age = now.since(self.published_at);
        if !(urgent || words && age >= WORDS_EVERY || age >= PULSE_EVERY) {
            return;
        }
        self.published_seq = self.engine.seq();
        self.published_revision = self.engine.revision();
        self.published_at = now;
        let snapshot = self.engine.snapshot();
        if let Some(feed) = &mut self.feed {
            feed.published(snapshot.clone());
        }
        self.publish.send_replace(Published::now(snapshot.clone(), &self.clock, self.feed.as_ref()));
        // The last to be told is the first to run.
        self.to_vehicle.send_replace(snapshot);
        self.is_told_to_all = false;
        if let Some(received) = self.changed_by.take() {
            self.latencies.published.observe(self.clock.now().since(received));
        }
    }

    /// Tells the pages, the tools of ROS 2 and the store the last snapshot, unless they have it.
    fn tell_others(&mut self) {
        if !std::mem::replace(&mut self.is_told_to_all, true) {
            self.to_others.send_replace(self.publish.borrow().clone());
        }
    }
}

#[cfg(test)]
mod tests;
