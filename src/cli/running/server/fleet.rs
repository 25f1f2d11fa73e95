//! Tells the fleet of this vehicle, if the configuration names one: the thread that does, and what the store knows for
//! it. Nothing comes back from there but whether the fleet hears, and the numbers of incidents with recordings that it wants.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

use super::{outputs, reload};
use crate::clock::Clock;
use crate::config::fleet::Recordings;
use crate::config::{self, Loaded};
use crate::fleet::line::Hub;
use crate::fleet::message::{AuditHead, Content, Incident, NotSent, VehicleId};
use crate::fleet::recordings::{Finished, WISHES_AT_ONCE, refused};
use crate::fleet::status::Status;
use crate::fleet::vehicle::{self, Fleet, NEWS_MAX, Settings, Sources};
use crate::record::summary::Summary;
use crate::record::writer::digest;
use crate::record::{VERSION, folder};
use crate::runtime::Link;
use crate::store::{IncidentFilter, Store};

/// The store is looked at this often for new incidents and records of the audit log.
const LOOK_EVERY: Duration = Duration::from_secs(30);

/// The newest incidents that are looked at, and told again after a start.
const INCIDENTS: u32 = 8;

/// The line to the fleet.
#[derive(Debug)]
pub struct Telling {
    status: watch::Receiver<Status>,
    /// `None` if it could not be started.
    running: Option<Running>,
}

#[derive(Debug)]
struct Running {
    fleet: Fleet,
    config: watch::Sender<String>,
    looking: JoinHandle<()>,
}

/// Starts it, if the configuration names a fleet. A key or an outbox that is of no use keeps no display from starting.
pub fn start(
    loaded: &Loaded,
    link: &Link,
    store: &Store,
    folder: Option<&Path>,
    clock: Clock,
) -> Option<Telling> {
    let fleet = loaded.fleet.as_ref()?;
    Some(match run(fleet, loaded, link, store, folder, clock) {
        Ok(running) => Telling { status: running.fleet.status(), running: Some(running) },
        Err(error) => {
            tracing::error!("the fleet is not told: {error:#}");
            let failed = Status { disk: Some(format!("{error:#}")), ..Status::new(clock.now()) };
            Telling { status: watch::channel(failed).1, running: None }
        }
    })
}

fn run(
    fleet: &config::fleet::Fleet,
    loaded: &Loaded,
    link: &Link,
    store: &Store,
    folder: Option<&Path>,
    clock: Clock,
) -> anyhow::Result<Running> {
    let settings = Settings {
        id: VehicleId::new(&loaded.model.vehicle_id).context("the fleet cannot know a vehicle by this id")?,
        hub: Hub { url: fleet.hub.clone(), ca: fleet.ca.clone() },
        credentials: fleet.credentials.clone(),
        kbit_s_max: fleet.max_kbit_s,
        sends_recordings: fleet.recordings != Recordings::Never,
        version: VERSION.to_owned(),
    };
    let (config, of_config) = watch::channel(digest(&reload::texts(loaded)));
    let (tell, news) = mpsc::channel(NEWS_MAX);
    let (wants, wanted) = mpsc::channel(WISHES_AT_ONCE as usize);
    let (send, finished) = mpsc::channel(NEWS_MAX);
    let snapshots = outputs::latest(link.afterwards.clone());
    let sources = Sources { snapshots, config: of_config, news, finished, wanted: wants };
    let looking = Looking {
        store: store.clone(),
        recordings: folder.map(folder::folder_in),
        is_always: fleet.recordings == Recordings::Always,
        tell,
        send,
    };
    let fleet = vehicle::start(settings, folder, sources, clock)?;
    let looking = tokio::spawn(looking.run(wanted));
    Ok(Running { fleet, config, looking })
}

impl Telling {
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    /// Tells the hash of the vehicle's new configuration. A change of `fleet:` itself needs a new start.
    pub fn follow(&self, loaded: &Loaded) {
        if let Some(running) = &self.running {
            running.config.send_replace(digest(&reload::texts(loaded)));
        }
    }

    /// Says goodbye.
    pub async fn end(self, until: Instant) {
        if let Some(Running { fleet, looking, .. }) = self.running {
            looking.abort();
            fleet.end(until).await;
        }
    }
}

/// What the store knows for the fleet.
struct Looking {
    store: Store,
    /// The folder of the recordings.
    recordings: Option<PathBuf>,
    /// Each finished recording is sent.
    is_always: bool,
    tell: mpsc::Sender<Content>,
    send: mpsc::Sender<Finished>,
}

impl Looking {
    /// Tells incidents that are new or changed, and the end of the audit log where it grew. Looks for the recordings that
    /// are wanted.
    async fn run(self, mut wanted: mpsc::Receiver<u64>) {
        let mut incidents: BTreeMap<u64, Incident> = BTreeMap::new();
        let (mut record, mut before) = (0, None);
        let mut ticks = tokio::time::interval(LOOK_EVERY);
        loop {
            tokio::select! {
                _ = ticks.tick() => {}
                Some(number) = wanted.recv() => {
                    self.answer(number).await;
                    continue;
                }
            }
            let mut news = Vec::new();
            // A store that does not answer now is asked again.
            if let Ok(last) = self.store.audit_entries(None, 1).await
                && let Some(last) = last.first().filter(|last| last.number != record)
            {
                record = last.number;
                news.push(Content::AuditHead(AuditHead { record, hash: last.hash.to_string() }));
            }
            let filter = IncidentFilter { count: INCIDENTS, ..IncidentFilter::default() };
            let mut finished = Vec::new();
            for found in self.store.incidents(filter).await.unwrap_or_default().iter().rev() {
                let incident = incident(&found.summary);
                finished.extend(self.finished(&found.summary, true).filter(|_| self.is_always));
                if incidents.insert(incident.number, incident.clone()).as_ref() != Some(&incident) {
                    news.push(Content::Incident(incident));
                }
            }
            finished.extend(self.older(&mut before).await);
            while incidents.len() > INCIDENTS as usize {
                incidents.pop_first();
            }
            for content in news {
                if self.tell.send(content).await.is_err() {
                    return;
                }
            }
            // The messages about their incidents come first. The outbox passes over recordings that were sent.
            for recording in finished {
                if self.send.send(recording).await.is_err() {
                    return;
                }
            }
        }
    }

    /// The next page of recordings that are sent by themselves, from the newest to the oldest and then from the newest again.
    /// Some may have found no room before, or were finished after later ones.
    async fn older(&self, before: &mut Option<u64>) -> Vec<Finished> {
        if !self.is_always {
            return Vec::new();
        }
        let filter = IncidentFilter { before: *before, count: INCIDENTS, ..IncidentFilter::default() };
        let found = self.store.incidents(filter).await.unwrap_or_default();
        *before = found.last().map(|it| it.summary.id);
        found.iter().filter_map(|it| self.finished(&it.summary, true)).collect()
    }

    async fn answer(&self, number: u64) {
        // A store that does not answer now is asked again by the console.
        let Ok(found) = self.store.incident(number).await else { return };
        let why = match &found {
            None => NotSent::Gone,
            Some(found) if found.summary.recording.is_open() => NotSent::NotFinished,
            Some(found) => match self.finished(&found.summary, false) {
                None => NotSent::Gone,
                Some(finished) => {
                    let _ = self.send.send(finished).await;
                    return;
                }
            },
        };
        let _ = self.tell.send(refused(number, why)).await;
    }

    /// The recording of an incident, if it is finished and there.
    fn finished(&self, summary: &Summary, by_itself: bool) -> Option<Finished> {
        let recording = &summary.recording;
        let path = folder::file_in(self.recordings.as_deref()?, &recording.file)?;
        let path = std::path::absolute(path).ok()?;
        let sha256 = recording.sha256.clone().filter(|_| recording.finished)?;
        Some(Finished { incident: summary.id, path, sha256, bytes: recording.bytes, by_itself })
    }
}

/// What the fleet is told of an incident: no notes, nobody's name, and no values.
fn incident(summary: &Summary) -> Incident {
    Incident {
        number: summary.id,
        since: summary.since_ms,
        until: summary.until_ms,
        stage: summary.stage.clone(),
        causes: summary.causes().into_iter().map(str::to_owned).collect(),
        triggers: summary.trigger_count(),
        version: summary.version.clone(),
        config: summary.configuration.clone(),
        bytes: if summary.recording.finished { summary.recording.bytes } else { 0 },
        sha256: summary.recording.sha256.clone(),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::record::summary::Recording;
    use crate::store::DemoSecrets;

    #[tokio::test(start_paused = true)]
    async fn each_finished_recording_is_sent_by_itself_however_many_came_after_it() {
        let data = tempfile::tempdir().unwrap();
        let store = Store::open(data.path(), Clock::start(), DemoSecrets::Refused).unwrap();
        for id in 1..=20 {
            let (file, sha256) = (folder::file_name(id), Some("ab".repeat(32)));
            std::fs::write(data.path().join(&file), "recorded").unwrap();
            let recording = Recording { file, sha256, bytes: 8, finished: id != 7, ..Recording::default() };
            let summary = Summary { id, recording, ..Summary::default() };
            store.incident_finished(&summary).await.unwrap();
        }
        let (tell, _told) = mpsc::channel(100);
        let (send, mut sent) = mpsc::channel(100);
        let recordings = Some(data.path().to_owned());
        let (_wants, wanted) = mpsc::channel(1);
        let looking = Looking { store, recordings, is_always: true, tell, send };
        let running = tokio::spawn(looking.run(wanted));
        let mut numbers = BTreeSet::new();
        while numbers.len() < 19 {
            numbers.insert(sent.recv().await.unwrap().incident);
        }
        assert_eq!(numbers, (1..=20).filter(|it| *it != 7).collect());
        running.abort();
    }
}
