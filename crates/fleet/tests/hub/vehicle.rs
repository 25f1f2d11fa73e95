//! A vehicle's program, as far as the fleet goes.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use telltale_clock::Clock;
use telltale_engine::Engine;
use telltale_engine::input::{Input, Upkeep};
use telltale_engine::model::{Model, Parts, StageModel};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::text::Text;
use telltale_fleet::line;
use telltale_fleet::message::{Content, VehicleId};
use telltale_fleet::recordings::Finished;
use telltale_fleet::vehicle::{self, Fleet, Settings, Sources};
use tempfile::TempDir;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

use super::server::Hub;

/// Publishes again and again, as an idle engine does.
async fn pulse(snapshots: watch::Sender<Arc<Snapshot>>) {
    while !snapshots.is_closed() {
        tokio::time::sleep(Duration::from_millis(250)).await;
        snapshots.send_modify(|_| ());
    }
}

pub struct Vehicle {
    engine: Engine,
    clock: Clock,
    snapshots: watch::Sender<Arc<Snapshot>>,
    pulse: JoinHandle<()>,
    _config: watch::Sender<String>,
    pub news: mpsc::Sender<Content>,
    pub wanted: mpsc::Receiver<u64>,
    pub finished: mpsc::Sender<Finished>,
    pub fleet: Fleet,
}

impl Vehicle {
    pub fn start(hub: &Hub, id: &str, data: &TempDir) -> Vehicle {
        Vehicle::with(hub, id, data, true)
    }

    pub fn with(hub: &Hub, id: &str, data: &TempDir, sends_recordings: bool) -> Vehicle {
        Vehicle::over(hub.address(), hub.key_file(id), id, data, sends_recordings)
    }

    pub fn over(
        hub: line::Hub,
        credentials: PathBuf,
        id: &str,
        data: &TempDir,
        sends_recordings: bool,
    ) -> Vehicle {
        let clock = Clock::start();
        let model = Model::new(Parts::empty(id, StageModel::None)).unwrap();
        let mut engine = Engine::new(Arc::new(model), clock.now());
        let (snapshots, shown) = watch::channel(engine.snapshot());
        let pulse = tokio::spawn(pulse(snapshots.clone()));
        let (config, of_config) = watch::channel("c0ffee".to_owned());
        let (news, more) = mpsc::channel(vehicle::NEWS_MAX);
        let settings = Settings {
            id: VehicleId::new(id).unwrap(),
            hub,
            credentials,
            kbit_s_max: 10_000,
            version: "0.1.0".into(),
            sends_recordings,
        };
        let (wants, wanted) = mpsc::channel(16);
        let (finished, to_send) = mpsc::channel(16);
        let sources =
            Sources { snapshots: shown, config: of_config, news: more, finished: to_send, wanted: wants };
        let fleet = vehicle::start(settings, Some(data.path()), sources, clock).unwrap();
        Vehicle { engine, clock, snapshots, pulse, _config: config, news, wanted, finished, fleet }
    }

    /// A fault of the clock, which is a WARNING.
    pub fn clock_is(&mut self, wrong: bool) {
        let clock = wrong.then(|| Text::plain("the clock shows 1970"));
        self.engine.handle(&Input::Upkeep(Upkeep { clock, ..Upkeep::default() }), self.clock.now());
        self.snapshots.send_replace(self.engine.snapshot());
    }

    /// Nothing more is published until the next change.
    #[allow(dead_code, reason = "the console's tests do not look at it")]
    pub fn hang(&self) {
        self.pulse.abort();
    }

    /// All that the engine shows.
    #[allow(dead_code, reason = "the console's tests do not look at it")]
    pub fn engine(&mut self) -> String {
        format!("{:?}", self.engine.snapshot())
    }

    pub async fn end(self) {
        #[expect(clippy::disallowed_methods, reason = "a limit of this test")]
        let until = std::time::Instant::now() + Duration::from_secs(10);
        self.fleet.end(until).await;
    }
}
