//! Publishes lines of the ROS 2 log: warnings and errors of the program, and root causes as they come and go.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use tokio::sync::broadcast::error::RecvError;

use super::{OutputContext, OutputTopic, aggregate, log};
use crate::Publisher;
use crate::engine_queue::stopped;
use crate::publish::log_lines::{self, LogLine, TEXT_BYTES_MAX};
use telltale_clock::rate::{Bucket, Rate};
use telltale_engine::model::output::LogLevel;
use telltale_engine::model::{NodeId, Stage};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_msg::messages::encode;

/// Lines beyond this are left out and counted.
const RATE: Rate = Rate { burst: 50, refill: Span::from_millis(200) };

/// Root causes that are followed.
const CAUSES_MAX: usize = 256;

/// Publishes until this participant's life is over. A new participant says again which causes are there.
pub async fn run(publisher: Arc<Publisher>, topic: OutputTopic, mut context: OutputContext) {
    let mut lines = log_lines::subscribe();
    let mut causes = Causes::default();
    let mut rate = Bucket::new(RATE, context.clock.now());
    let mut left_out = 0_u64;
    let mut waiting: VecDeque<Arc<LogLine>> =
        causes.news(&context.snapshots.tools.borrow_and_update().clone()).into();
    loop {
        while let Some(line) = waiting.pop_front() {
            if line.level < topic.level {
                continue;
            }
            if !rate.take(context.clock.now()) {
                left_out += 1;
                continue;
            }
            let missed = std::mem::take(&mut left_out);
            if missed > 0 {
                publish(&publisher, &topic, &missing(missed), &context).await;
            }
            publish(&publisher, &topic, &line, &context).await;
        }
        tokio::select! {
            () = stopped(&mut context.end) => return,
            changed = context.snapshots.tools.changed() => {
                if changed.is_err() {
                    return;
                }
                waiting.extend(causes.news(&context.snapshots.tools.borrow_and_update().clone()));
            }
            line = lines.recv() => match line {
                Ok(line) => waiting.push_back(line),
                Err(RecvError::Lagged(missed)) => left_out += missed,
                // Its sender lives as long as the program.
                Err(RecvError::Closed) => return,
            }
        }
    }
}

async fn publish(publisher: &Publisher, topic: &OutputTopic, line: &LogLine, context: &OutputContext) {
    let severity = match line.level {
        LogLevel::Warning => encode::Severity::Warn,
        LogLevel::Error => encode::Severity::Error,
    };
    let LogLine { name, text, file, line, .. } = line;
    let body = encode::log(context.clock.wall(), severity, name, text, (file, *line));
    log(publisher.publish(&topic.topic, body).await);
}

fn missing(count: u64) -> LogLine {
    let lines = if count == 1 { "line was" } else { "lines were" };
    let text = format!("{count} {lines} left out: there are too many");
    LogLine { level: LogLevel::Warning, name: "telltale", text, file: "", line: 0 }
}

/// The root causes that were said, with their states.
#[derive(Debug, Default)]
struct Causes(BTreeMap<Box<str>, State>);

impl Causes {
    /// The lines about what has come, changed its state or gone.
    fn news(&mut self, snapshot: &Snapshot) -> Vec<Arc<LogLine>> {
        // One that still has time to report raises no alarm, and no line.
        let roots = snapshot.roots.iter().filter(|root| !root.grace).take(CAUSES_MAX);
        let now: BTreeMap<Box<str>, (State, NodeId, u32)> = roots
            .map(|root| (&**snapshot.node_name(root.node), (snapshot.own(root.node), root.node, root.masks)))
            .map(|(name, root)| (name.into(), root))
            .collect();
        let mut lines = Vec::new();
        for (name, &(state, node, masks)) in &now {
            if self.0.get(name) != Some(&state) {
                lines.push(line(level(state), came(snapshot, name, state, node, masks)));
            }
        }
        for name in self.0.keys().filter(|name| !now.contains_key(*name)) {
            lines.push(line(LogLevel::Warning, format!("{name} is no root cause any more")));
        }
        self.0 = now.into_iter().map(|(name, (state, ..))| (name, state)).collect();
        lines
    }
}

fn level(state: State) -> LogLevel {
    if state >= State::Error { LogLevel::Error } else { LogLevel::Warning }
}

fn came(snapshot: &Snapshot, name: &str, state: State, node: NodeId, masks: u32) -> String {
    let mut text = format!("{name} is {}", state.as_str().to_uppercase());
    if masks > 0 {
        text.push_str(&format!(", and {masks} that depend on it wait"));
    }
    // Before a login nothing that modules report is told.
    if let NodeId::Module(id) = node
        && snapshot.stage != Stage::Locked
    {
        text.push_str(&format!(": {}", aggregate::words(snapshot.module(id).1, snapshot.now)));
    }
    text.truncate(text.floor_char_boundary(TEXT_BYTES_MAX));
    text
}

fn line(level: LogLevel, text: String) -> Arc<LogLine> {
    Arc::new(LogLine { level, name: "telltale.root_cause", text, file: "", line: 0 })
}
