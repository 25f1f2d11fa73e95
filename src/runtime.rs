//! The loop that owns the engine: inputs in, the latest snapshot out.

mod recorder;

use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::SystemTime;

use tokio::sync::{broadcast, mpsc, oneshot, watch};

use crate::clock::Clock;
use crate::engine::Engine;
use crate::engine::input::{Input, OperatorAction, Refusal, Response};
use crate::engine::model::{Model, Stage};
use crate::engine::restart::preview::Preview;
use crate::engine::restart::resume::Restored;
use crate::engine::snapshot::{Countermeasure, Snapshot};
use crate::engine::time::{Span, Timestamp};
use crate::engine::view::record::Record;
pub use crate::msg::received::Stamped;
use recorder::Recorder;

/// Inputs that may wait for the engine. A full queue holds its senders back: the bridge's
/// readers then lose the oldest samples by their own depth, and count that.
pub const INPUT_QUEUE: usize = 1024;

/// Commands, and rehearsals too, that may wait for the engine. A full queue makes the senders wait.
pub const COMMAND_QUEUE: usize = 64;

/// New configurations that may wait for the engine. A full queue makes the senders wait.
pub const RELOAD_QUEUE: usize = 1;

/// Inputs handled before the others get their turn and a changed state is published.
const BATCH_MAX: usize = 32;

/// Turns of the vehicle that may wait for their receiver. Past it the oldest are lost, and the receiver is
/// told how many.
const TURN_QUEUE: usize = 256;

/// New words and values, without a new state, wait this long for others.
const WORDS_EVERY: Span = Span::from_millis(100);

/// A snapshot is published this often even if nothing changed: the pages know by that
/// that the engine lives, and reads ages no older than this.
pub const PULSE_EVERY: Span = Span::from_millis(250);

/// The latest snapshot with the wall time at which it was taken.
#[derive(Debug, Clone)]
pub struct Published {
    pub snapshot: Arc<Snapshot>,
    pub at: SystemTime,
}

/// An operator's action that waits for the engine's answer.
#[derive(Debug)]
pub struct Command {
    pub action: OperatorAction,
    pub reply: oneshot::Sender<Response>,
}

/// An operator's action that is to be judged and not done.
#[derive(Debug)]
pub struct Rehearsal {
    pub action: OperatorAction,
    pub reply: oneshot::Sender<Result<Preview, Vec<Refusal>>>,
}

/// Another configuration for the engine, to be taken whole. What was wrong with it was said before.
#[derive(Debug)]
pub struct Reload {
    pub model: Arc<Model>,
    /// Told when the engine runs by it and has published a snapshot of it.
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

/// What came of it, in words for a developer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rereading {
    pub taken: bool,
    /// One sentence each; empty if it means the same as what runs.
    pub differences: Vec<String>,
    /// Everything that is wrong with the file. Then the old configuration stays.
    pub problems: Option<String>,
    /// What can happen with it and should not.
    pub warnings: Option<String>,
    /// Every situation was looked at; until then `warnings` says nothing.
    pub judged: bool,
    /// The files that the engine runs by, as they were read.
    pub running: Arc<[ConfigurationText]>,
    /// Of the text of the files and of the differences; empty where there are problems.
    pub digest: String,
}

/// A file of a configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigurationText {
    pub name: String,
    pub text: String,
}

/// What the rest of the program holds of the engine. Clones feed and watch the same one.
#[derive(Debug, Clone)]
pub struct Link {
    pub inputs: mpsc::Sender<Stamped>,
    pub commands: mpsc::Sender<Command>,
    pub rehearsals: mpsc::Sender<Rehearsal>,
    pub reloads: mpsc::Sender<Reload>,
    /// Holds at most the latest; a slow reader skips what lies between.
    pub snapshots: watch::Receiver<Published>,
    /// Every state in which the stage or what is asked of the vehicle was another one than before,
    /// also those that were over before anybody saw them.
    pub turns: broadcast::Sender<Published>,
}

/// Starts the engine in a task of the current tokio runtime. It ends when all links are dropped.
pub fn start(model: Arc<Model>, clock: Clock) -> Link {
    run(Engine::begin(model, clock.now()), clock, None)
}

/// [`start`], and hands on what happens. A full queue loses records, which are counted: the engine
/// never waits for a disk.
pub fn start_recorded(model: Arc<Model>, clock: Clock, records: Option<SyncSender<Vec<Record>>>) -> Link {
    run(Engine::begin(model, clock.now()), clock, records)
}

/// [`start_recorded`] where an earlier run of the program ended.
pub fn resume(
    model: Arc<Model>,
    restored: &Restored,
    clock: Clock,
    records: Option<SyncSender<Vec<Record>>>,
) -> Link {
    run(Engine::resume(model, restored, clock.now()), clock, records)
}

fn run(mut engine: Engine, clock: Clock, records: Option<SyncSender<Vec<Record>>>) -> Link {
    let (inputs, inputs_rx) = mpsc::channel(INPUT_QUEUE);
    let (commands, commands_rx) = mpsc::channel(COMMAND_QUEUE);
    let (rehearsals, rehearsals_rx) = mpsc::channel(COMMAND_QUEUE);
    let (reloads, reloads_rx) = mpsc::channel(RELOAD_QUEUE);
    let recorder = Recorder::start(&mut engine, records, clock.now());
    let first = Published { snapshot: engine.snapshot(), at: clock.wall() };
    let (publish, snapshots) = watch::channel(first);
    let turns = broadcast::Sender::new(TURN_QUEUE);
    let mut turn = Loop {
        requests: engine.requests(),
        turns: turns.clone(),
        published_seq: engine.seq(),
        published_revision: engine.revision(),
        published_at: clock.now(),
        engine,
        recorder,
        clock,
        publish,
    };
    let queues =
        Queues { inputs: inputs_rx, commands: commands_rx, rehearsals: rehearsals_rx, reloads: reloads_rx };
    tokio::spawn(async move { turn.run(queues).await });
    Link { inputs, commands, rehearsals, reloads, snapshots, turns }
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
    clock: Clock,
    publish: watch::Sender<Published>,
    turns: broadcast::Sender<Published>,
    requests: (Stage, Arc<[Countermeasure]>),
    published_seq: u64,
    published_revision: u64,
    published_at: Timestamp,
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
                        // Who asked may have gone; nothing has happened.
                        let _ = reply.send(self.engine.preview(&action, self.clock.now()));
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
                    for Stamped { input, received, .. } in batch.drain(..) {
                        self.engine.handle(&input, received);
                        self.tell_turn();
                    }
                }
                () = tokio::time::sleep_until(wake) => {
                    self.engine.handle(&Input::Tick, self.clock.now());
                }
            }
            self.tell_turn();
            self.publish_if_due();
            self.recorder.follow(&mut self.engine, self.clock.now());
        }
    }

    /// When the loop has to turn next, even if nothing comes.
    fn next_turn(&self) -> Timestamp {
        let words = self.engine.revision() != self.published_revision;
        let publish = self.published_at + if words { WORDS_EVERY } else { PULSE_EVERY };
        self.engine.next_deadline().map_or(publish, |deadline| deadline.min(publish))
    }

    fn obey(&mut self, command: Command) {
        // Who gave up was told that nothing happened. A stop is never too late.
        if command.reply.is_closed() && command.action != OperatorAction::RequestStop {
            return;
        }
        let response = self.engine.handle(&Input::Operator(command.action), self.clock.now());
        self.tell_turn();
        // Published before it is answered: who asked finds the result in the next snapshot.
        self.publish_if_due();
        // Who asked may have gone; the action stands all the same.
        let _ = command.reply.send(response);
    }

    fn reload(&mut self, Reload { model, done }: Reload) {
        self.recorder.take(&mut self.engine);
        self.engine.reload(model, self.clock.now());
        self.recorder.begin(&mut self.engine, true);
        self.publish_if_due();
        // Who asked may have gone; the engine runs by it all the same.
        let _ = done.send(());
    }

    fn tell_turn(&mut self) {
        let requests = self.engine.requests();
        if requests.0 == self.requests.0 && Arc::ptr_eq(&requests.1, &self.requests.1) {
            return;
        }
        self.requests = requests;
        // Nobody may listen, as in a test.
        let _ = self.turns.send(Published { snapshot: self.engine.snapshot(), at: self.clock.wall() });
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
        self.publish.send_replace(Published { snapshot: self.engine.snapshot(), at: self.clock.wall() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::input::{Input, StatusArray};
    use crate::engine::model::monitors::Watched;
    use crate::engine::model::{Driving, Limits, NodeId, Parts, Policy, StageModel};
    use crate::engine::state::State;
    use crate::engine::text::Text;

    fn empty_model() -> Arc<Model> {
        let parts = Parts {
            vehicle_id: "v".into(),
            vehicle_name: Text::plain("V"),
            stages: StageModel::Shuttle,
            signals: Vec::new(),
            groups: Vec::new(),
            modules: Vec::new(),
            watched: Watched::default(),
            driving: Driving::default(),
            discovered: Policy::default(),
            other: Default::default(),
            limits: Limits::default(),
        };
        Arc::new(Model::new(parts).unwrap())
    }

    #[tokio::test]
    async fn a_status_comes_out_and_a_command_is_answered_after_its_effect_is_published() {
        let clock = Clock::start();
        let mut link = start(empty_model(), clock);
        let (reply, answer) = oneshot::channel();
        let action = OperatorAction::Login { name: "anna".into() };
        link.commands.send(Command { action, reply }).await.unwrap();
        assert_eq!(answer.await.unwrap(), Response::Done);
        assert_eq!(link.snapshots.borrow().snapshot.stage, Stage::Localizing);

        let mut array = StatusArray::default();
        array.push_status(2, "pump", "broken", "");
        let input = Input::Diagnostics(array);
        link.inputs.send(Stamped::new(input, clock.now())).await.unwrap();
        let heard = |published: &Published| published.snapshot.node("other/pump").is_some();
        let seen = link.snapshots.wait_for(heard).await.unwrap();
        let Some(NodeId::Module(id)) = seen.snapshot.node("other/pump") else { panic!("it is a module") };
        assert_eq!(seen.snapshot.module(id).1.state, State::Error);
        assert_eq!(&*seen.snapshot.module(id).1.report.message, "broken");
    }

    #[tokio::test]
    async fn snapshots_pulse_while_nothing_happens() {
        let mut link = start(empty_model(), Clock::start());
        let first = link.snapshots.borrow_and_update().at;
        link.snapshots.changed().await.unwrap();
        assert!(link.snapshots.borrow().at > first);
    }
}
