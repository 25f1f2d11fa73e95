//! A simulated vehicle in real time, and the line by which it tells the hub.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::sync::{mpsc, watch};
use tokio::time::MissedTickBehavior;

use super::cast::{Fate, Member};
use super::past;
use super::simulated::{Incidents, PERIOD, Simulated};
use crate::clock::{Clock, unix_ms, wall_at};
use crate::config::Loaded;
use crate::engine::time::{Span, Timestamp};
use crate::fleet::line::Hub;
use crate::fleet::message::NotSent;
use crate::fleet::recordings::{Finished, WISHES_AT_ONCE, refused};
use crate::fleet::vehicle::{self, NEWS_MAX, Settings, Sources};

/// A demo that was put to sleep for longer goes on where it wakes up.
const BEHIND_MAX: Span = Span::from_secs(3);

/// A vehicle that does not stay is switched off when it stands, but not before this.
const OFF_AFTER: Span = Span::from_secs(25);

/// Its goodbye takes no longer.
const ENDS_WITHIN: Duration = Duration::from_secs(2);

/// A vehicle that is not started yet.
pub struct Vehicle {
    pub member: Member,
    pub loaded: Loaded,
    /// SHA-256 of its configuration.
    pub config: String,
    pub hub: Hub,
    pub key_file: PathBuf,
    /// Of its outbox.
    pub folder: PathBuf,
    pub kbit_s_max: u32,
    /// Of its past.
    pub recordings: Vec<Finished>,
    pub clock: Clock,
}

impl Vehicle {
    /// Writes its past.
    ///
    /// # Errors
    /// Of the disk.
    pub fn write_past(&mut self) -> anyhow::Result<()> {
        self.recordings = past::write(&self.member, &self.loaded, &self.config, &self.folder, self.clock)?;
        Ok(())
    }

    /// Drives until it is switched off, or the time to end by is told.
    ///
    /// # Errors
    /// It cannot tell the hub.
    pub async fn run(self, mut ended: watch::Receiver<Option<Instant>>) -> anyhow::Result<()> {
        let clock = self.clock;
        let start = clock.now();
        let mut simulated = Simulated::new(&self.member, &self.loaded, start);
        let mut incidents = Incidents::new(past::LAST_NUMBER, &self.member.version, &self.config);
        let (told, snapshots) = watch::channel(simulated.pass(|_| clock.wall()));
        // Its sender stays: the configuration never changes.
        let (_config, config) = watch::channel(self.config.clone());
        let (tell, news) = mpsc::channel(NEWS_MAX);
        let settings = Settings {
            id: self.member.id.clone(),
            hub: self.hub.clone(),
            credentials: self.key_file.clone(),
            kbit_s_max: self.kbit_s_max,
            sends_recordings: true,
            version: self.member.version.clone(),
        };
        let (wants, mut wanted) = mpsc::channel(WISHES_AT_ONCE as usize);
        let (send, finished) = mpsc::channel(NEWS_MAX);
        let sources = Sources { snapshots, config, news, finished, wanted: wants };
        let fleet = vehicle::start(settings, Some(&self.folder), sources, clock)
            .with_context(|| format!("{} cannot tell the hub", self.member.id))?;
        let mut ticks = tokio::time::interval(Duration::from(PERIOD));
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut on = vec![false; self.member.faults.len()];
        let until = loop {
            tokio::select! {
                _ = ticks.tick() => {}
                Some(number) = wanted.recv() => {
                    // With a line that takes none, the console asks again.
                    let _ = match self.recordings.iter().find(|it| it.incident == number) {
                        Some(recording) => send.try_send(recording.clone()).is_ok(),
                        None => tell.try_send(refused(number, NotSent::Gone)).is_ok(),
                    };
                    continue;
                }
                Ok(()) = ended.changed() => {
                    if let Some(until) = *ended.borrow_and_update() {
                        break until;
                    }
                }
            }
            let (now, wall) = (clock.now(), clock.wall());
            let wall = |at: Timestamp| wall_at(wall, now, at);
            let passed = now.since(start);
            let stands = told.borrow().motion.speed_kmh == Some(0);
            if self.member.fate == Fate::Off && passed >= OFF_AFTER && stands {
                break clock.instant(now) + ENDS_WITHIN;
            }
            for (planned, on) in self.member.faults.iter().zip(&mut on) {
                if planned.is_on(passed) != *on {
                    *on = !*on;
                    simulated.set_fault(planned.fault, *on);
                }
            }
            if now.since(simulated.at()) > BEHIND_MAX {
                simulated.skip_to(now);
            }
            while simulated.at() + PERIOD <= now {
                let snapshot = simulated.pass(wall);
                for content in incidents.news(&snapshot, |at| unix_ms(wall(at))) {
                    // With a line that takes none, the alarm is told all the same.
                    let _ = tell.try_send(content);
                }
                told.send_replace(snapshot);
            }
        };
        fleet.end(until).await;
        Ok(())
    }
}
