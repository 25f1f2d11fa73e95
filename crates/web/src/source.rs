//! The source of the snapshots that pages and programs are shown: the running engine, or a recording.

use std::fmt::Write as _;
use std::net::IpAddr;
use std::ops::Deref;
use std::sync::Arc;
use std::time::SystemTime;

use tokio::sync::watch;

use super::AppState;
use telltale_engine::snapshot::SILENT_MAX;
use telltale_engine::time::{Span, Timestamp};
use telltale_replay::Flows;
use telltale_runtime::{Link, Published};
use telltale_store::audit::Record;

/// The running engine, or a recording.
#[derive(Debug)]
pub enum Source {
    Live(Link),
    Replay(Replay),
}

impl From<Link> for Source {
    fn from(link: Link) -> Source {
        Source::Live(link)
    }
}

impl From<Replay> for Source {
    fn from(replay: Replay) -> Source {
        Source::Replay(replay)
    }
}

/// The snapshots of a recording, at the place that its [`Player`] shows. A recording has no inputs and no
/// commands.
#[derive(Debug, Clone)]
pub struct Replay {
    snapshots: watch::Receiver<Published>,
    /// The messages of the recording.
    pub flows: Arc<Flows>,
    /// The gaps in it.
    pub gaps: Arc<[GapThen]>,
}

/// A gap of a recording. Times are milliseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GapThen {
    pub from_ms: i64,
    /// `None`: nothing follows.
    pub to_ms: Option<i64>,
    /// From here on all is as it was shown.
    pub exact_ms: Option<i64>,
}

/// Marks over a strip with these ends: what is missing, and as long as it may differ.
pub fn gap_marks(gaps: &[GapThen], from_ms: i64, to_ms: i64) -> String {
    let whole = (to_ms - from_ms).max(1) as f64;
    let x = |ms: i64| ((ms - from_ms) as f64 / whole * 100.0).clamp(0.0, 100.0);
    let mut marks = String::new();
    for gap in gaps {
        let (exact, to) = (gap.exact_ms.unwrap_or(to_ms), gap.to_ms.unwrap_or(to_ms));
        for (class, end, y, height) in [("differing", exact.max(to), 20, 4), ("gap", to, 0, 24)] {
            if gap.from_ms > to_ms || end < from_ms {
                continue;
            }
            // Writing to a string cannot fail. A short one is seen, too.
            let _ = write!(
                marks,
                "<rect class=\"{class}\" x=\"{:.2}%\" width=\"{:.2}%\" y=\"{y}\" height=\"{height}\"/>",
                x(gap.from_ms),
                (x(end) - x(gap.from_ms)).max(0.3)
            );
        }
    }
    marks
}

/// Moves through a recording, forwards and back.
#[derive(Debug)]
pub struct Player {
    snapshots: watch::Sender<Published>,
}

impl Replay {
    /// The snapshot that is shown, now and from now on.
    pub fn snapshots(&self) -> &watch::Receiver<Published> {
        &self.snapshots
    }
}

impl Player {
    pub fn start(first: Published) -> (Player, Replay) {
        let (snapshots, shown) = watch::channel(Published { replay: true, ..first });
        (Player { snapshots }, Replay { snapshots: shown, flows: Arc::default(), gaps: Arc::default() })
    }

    /// Shows this snapshot. An earlier one than before is a rewind.
    pub fn show(&self, next: Published) {
        self.snapshots.send_modify(|shown| {
            let place = |it: &Published| (it.snapshot.now, it.snapshot.seq, it.snapshot.revision);
            let ((now, seq, revision), before) = (place(&next), place(shown));
            let is_back = now < before.0 || seq < before.1 || revision < before.2;
            let rewinds = shown.rewinds + u64::from(is_back);
            *shown = Published { rewinds, replay: true, ..next };
        });
    }
}

/// Making a participant takes ten seconds at most; otherwise the bridge turns four times a second.
const BRIDGE_IDLE_MAX: Span = Span::from_secs(15);

impl AppState {
    /// The snapshot that is shown now.
    pub fn published(&self) -> Published {
        self.snapshots().borrow().clone()
    }

    /// The snapshot that is shown, now and from now on.
    pub fn snapshots(&self) -> &watch::Receiver<Published> {
        match &self.source {
            Source::Live(link) => &link.snapshots,
            Source::Replay(replay) => replay.snapshots(),
        }
    }

    /// The same for pages and other readers that need not be first.
    pub fn afterwards(&self) -> &watch::Receiver<Published> {
        match &self.source {
            Source::Live(link) => &link.afterwards,
            Source::Replay(replay) => replay.snapshots(),
        }
    }

    /// The wall time that a page shows: now, or that of the recording.
    pub fn wall(&self) -> SystemTime {
        match &self.source {
            Source::Live(_) => self.clock.wall(),
            Source::Replay(replay) => replay.snapshots.borrow().at,
        }
    }

    /// Whether the engine published something lately: it does even when nothing happens. A display must
    /// not show the last snapshot of an engine that hangs. A recording stands still when it is paused, and
    /// lives as long as its player.
    pub fn is_source_alive(&self) -> bool {
        let is_open = self.snapshots().has_changed().is_ok();
        match &self.source {
            Source::Live(link) => {
                let received = link.snapshots.borrow().received;
                is_open && self.clock.now().since(received) < SILENT_MAX
            }
            Source::Replay(_) => is_open,
        }
    }

    /// Whether the bridge to DDS does its work in both directions, be DDS well or ill. An ill one is replaced and said;
    /// a bridge that has ended or hangs can say nothing itself.
    pub fn is_bridge_working(&self) -> bool {
        let works = |working: &watch::Receiver<Timestamp>| {
            self.clock.now().since(*working.borrow()) < BRIDGE_IDLE_MAX
        };
        self.settings.working.iter().all(works)
    }

    /// Records a refused request, which anybody can cause. A replay records nothing.
    pub async fn record_refused(&self, record: Record, source: IpAddr) {
        if let Source::Live(_) = &self.source {
            self.store.record(record.by_anybody(self.caller(source)), None).await;
        }
    }

    /// The means to act on the vehicle; `None` in a replay.
    pub fn live(&self) -> Option<Live> {
        match &self.source {
            Source::Live(link) => Some(Live { link: link.clone(), app: self.clone() }),
            Source::Replay(_) => None,
        }
    }
}

/// The state of a server that shows the running vehicle. Everything that commands the engine or stores
/// something about the vehicle takes this, so that a replay can do neither.
#[derive(Debug, Clone)]
pub struct Live {
    pub link: Link,
    app: AppState,
}

impl Deref for Live {
    type Target = AppState;

    fn deref(&self) -> &AppState {
        &self.app
    }
}
