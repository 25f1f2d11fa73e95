//! Monitors and their topics in a keyframe.

use serde::{Deserialize, Serialize};

use super::windows::Blocked;
use super::{Publishers, Watch, WatchedTopic, Watching};
use crate::files::KeyframeError;
use crate::model::ModuleId;
use crate::monitor::Monitor;
use crate::state::State;
use crate::time::Timestamp;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct KeptWatching {
    monitors: Vec<KeptWatch>,
    topics: Vec<KeptTopic>,
    turned: Vec<ModuleId>,
    searching_until: Option<Timestamp>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KeptWatch {
    monitor: Monitor,
    said: Option<State>,
    due: Option<Timestamp>,
    worded: Option<Timestamp>,
    pending: bool,
    running: bool,
    blocked: Option<Blocked>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KeptTopic {
    news: Option<Publishers>,
    heard: bool,
    left: bool,
    searched_until: Option<Timestamp>,
}

impl Watching {
    pub(crate) fn kept(&self) -> KeptWatching {
        let Watching {
            watches,
            topics,
            turned,
            searching_until,
            // From the configuration.
            of_module: _,
            topic_names: _,
            probes: _,
            statuses: _,
            counts: _,
            // About one input, which is over.
            touched: _,
            judge: _,
        } = self;
        KeptWatching {
            monitors: watches.iter().map(KeptWatch::of).collect(),
            topics: topics.iter().map(KeptTopic::of).collect(),
            turned: turned.clone(),
            searching_until: *searching_until,
        }
    }

    /// Goes on with the state of a keyframe.
    pub(crate) fn resume(&mut self, kept: KeptWatching) -> Result<(), KeyframeError> {
        let KeptWatching { monitors, topics, turned, searching_until } = kept;
        KeyframeError::unless_same("monitors", monitors.len(), self.watches.len())?;
        KeyframeError::unless_same("topics", topics.len(), self.topics.len())?;
        if turned.iter().any(|id| id.0 as usize >= self.of_module.len()) {
            return Err(KeyframeError::new("a monitor turns for a module that does not exist"));
        }
        (self.turned, self.searching_until) = (turned, searching_until);
        for (watch, kept) in self.watches.iter_mut().zip(monitors) {
            let KeptWatch { monitor, said, due, worded, pending, running, blocked } = kept;
            watch.monitor.resume(monitor)?;
            (watch.said, watch.due, watch.worded) = (said, due, worded);
            (watch.pending, watch.running, watch.blocked) = (pending, running, blocked);
        }
        for (topic, kept) in self.topics.iter_mut().zip(topics) {
            let KeptTopic { news, heard, left, searched_until } = kept;
            (topic.news, topic.heard, topic.left) = (news, heard, left);
            topic.searched_until = searched_until;
        }
        Ok(())
    }
}

impl KeptWatch {
    fn of(watch: &Watch) -> KeptWatch {
        let Watch {
            monitor,
            said,
            due,
            worded,
            pending,
            running,
            blocked,
            // From the configuration.
            purpose: _,
            topics: _,
            by_the_clock: _,
            from_dds: _,
        } = watch;
        let (monitor, said, due, worded) = (monitor.clone(), *said, *due, *worded);
        KeptWatch { monitor, said, due, worded, pending: *pending, running: *running, blocked: *blocked }
    }
}

impl KeptTopic {
    fn of(topic: &WatchedTopic) -> KeptTopic {
        // The first two are from the configuration.
        let WatchedTopic { spec: _, readers: _, news, heard, left, searched_until } = topic;
        let (news, searched_until) = (news.clone(), *searched_until);
        KeptTopic { news, heard: *heard, left: *left, searched_until }
    }
}
