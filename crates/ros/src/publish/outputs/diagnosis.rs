//! Publishes the aggregated diagnosis at its own pace, and at once what must not wait for it.

use std::sync::Arc;
use std::time::Duration;

use super::aggregate::{self, Level};
use super::{OutputContext, OutputTopic, log, other_aggregators};
use crate::Publisher;
use crate::engine_queue::stopped;
use crate::every;
use telltale_engine::model::output::Publication;
use telltale_engine::snapshot::{SILENT_MAX, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages::encode_diagnostic_status;

/// Publishes until the end of the participant.
pub(super) async fn run(
    publisher: Arc<Publisher>,
    others: other_aggregators::OtherAggregators,
    mut context: OutputContext,
) {
    let of = |publication| context.topics.iter().find(|topic| topic.publication == publication).cloned();
    let (tree, top) = (of(Publication::DiagnosticsAgg), of(Publication::TopLevelState));
    let form = tree.as_ref().or(top.as_ref()).map(|it| it.tree.clone()).unwrap_or_default();
    let every = |period: Span| every(Duration::from(period));
    let mut trees = tree.as_ref().and_then(|it| it.period).map(every);
    let mut tops = top.as_ref().and_then(|it| it.period).map(every);
    let whole = |snapshot: &Snapshot| (snapshot.overall, aggregate::top_level(snapshot, &form));
    let mut told = Told { at_once: form.at_once, last: None, heard_at: context.clock.now() };
    loop {
        let due = tokio::select! {
            () = stopped(&mut context.end) => return,
            () = tick(&mut trees) => Due { tree: true, top: false },
            () = tick(&mut tops) => Due { tree: false, top: true },
            changed = context.snapshots.tools.changed() => {
                if changed.is_err() {
                    return;
                }
                told.heard_at = context.clock.now();
                told.changed(whole(&context.snapshots.tools.borrow_and_update()))
            }
        };
        if told.is_old(context.clock.now()) {
            continue;
        }
        let snapshot = context.snapshots.tools.borrow().clone();
        if let Some(OutputTopic { topic, .. }) = tree.as_ref().filter(|_| due.tree)
            && !others.silence(topic)
        {
            let tree = aggregate::tree(&snapshot, &form);
            log(publisher.statuses(topic, &tree, context.clock.wall()).await);
        }
        if let Some(OutputTopic { topic, .. }) = top.as_ref().filter(|_| due.top)
            && !others.silence(topic)
        {
            let top = aggregate::top(&snapshot, &form);
            log(publisher.publish(topic, encode_diagnostic_status(top.get(0))).await);
        }
    }
}

/// The messages to publish now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Due {
    tree: bool,
    top: bool,
}

/// The state and the level of the whole, as they were last.
struct Told {
    /// Whether the tree follows at once, where the level gets worse.
    at_once: bool,
    last: Option<(State, Level)>,
    /// When the last snapshot came.
    heard_at: Timestamp,
}

impl Told {
    /// Of an engine that hangs, readers hear nothing more, as of a program that has ended.
    fn is_old(&self, now: Timestamp) -> bool {
        now.since(self.heard_at) >= SILENT_MAX
    }

    fn changed(&mut self, now: (State, Level)) -> Due {
        let last = self.last.replace(now);
        let is_worse = last.is_none_or(|(_, level)| now.1.is_worse_than(level));
        Due { tree: self.at_once && is_worse, top: last != Some(now) }
    }
}

async fn tick(interval: &mut Option<tokio::time::Interval>) {
    match interval {
        Some(interval) => {
            interval.tick().await;
        }
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_the_whole_is_told_at_once_and_with_its_tree_where_that_is_wanted() {
        let changes = [
            ((State::Ok, Level::Ok), [true, true]),
            ((State::Ok, Level::Ok), [false, false]),
            ((State::Warning, Level::Warning), [true, true]),
            // The state that people see changed, the level did not.
            ((State::Unknown, Level::Warning), [false, true]),
            ((State::Unknown, Level::Stale), [true, true]),
            ((State::Error, Level::Error), [true, true]),
            ((State::Ok, Level::Ok), [false, true]),
        ];
        for at_once in [false, true] {
            let mut told = Told { at_once, last: None, heard_at: Timestamp::ZERO };
            for (now, [tree, top]) in changes {
                assert_eq!(told.changed(now), Due { tree: tree && at_once, top }, "{now:?}");
            }
        }
    }
}
