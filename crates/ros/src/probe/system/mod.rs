//! Measures the computer: each reading in a thread of its own, because a disk may not answer for hours.

mod files;
mod process;
mod processor;
mod resources;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use tokio::sync::oneshot;

use process::Processes;
use processor::Processor;
use telltale_engine::model::monitors::Resource;
use telltale_engine::model::sample::ProbeOutcome;

/// Readings that are under way at once, with those that hang and whose configuration is gone.
const READINGS_MAX: usize = 64;

static READINGS: AtomicUsize = AtomicUsize::new(0);

/// Reads a resource again and again, never twice at once.
#[derive(Debug)]
pub struct System {
    resource: Resource,
    meter: Option<Meter>,
    /// The reading that is under way.
    pending: Option<oneshot::Receiver<(Meter, Reading)>>,
}

/// The state that one reading leaves for the next.
#[derive(Debug)]
struct Meter {
    resource: Resource,
    roots: Roots,
    processor: Option<Processor>,
    processes: Option<Processes>,
}

/// Where the kernel tells of itself.
#[derive(Debug, Clone)]
struct Roots {
    proc: PathBuf,
    sys: PathBuf,
}

/// `None`: it is the first one, with which the next one is compared. An error says why nothing is known.
type Reading = Result<Option<ProbeOutcome>, String>;

impl System {
    pub fn new(resource: &Resource) -> System {
        System { resource: resource.clone(), meter: None, pending: None }
    }

    /// `None`: nothing can be said yet. A reading that takes longer than `patience` goes on, and the next call waits
    /// for the same one.
    pub async fn ask(&mut self, patience: Duration) -> Option<ProbeOutcome> {
        self.ask_by(Meter::read, patience).await
    }

    async fn ask_by(
        &mut self,
        read: impl FnOnce(&mut Meter) -> Reading + Send + 'static,
        patience: Duration,
    ) -> Option<ProbeOutcome> {
        let impossible = |why: String| Some(ProbeOutcome::Impossible(why.into()));
        let pending = match &mut self.pending {
            Some(pending) => pending,
            None => {
                let meter = self.meter.take().unwrap_or_else(|| Meter::new(&self.resource, Roots::default()));
                match start(meter, read) {
                    Ok(pending) => self.pending.insert(pending),
                    Err(why) => return impossible(why),
                }
            }
        };
        let Ok(answer) = tokio::time::timeout(patience, pending).await else {
            return impossible(format!("it does not answer within {patience:?}"));
        };
        self.pending = None;
        let Ok((meter, reading)) = answer else { return impossible("the reading broke off".to_owned()) };
        self.meter = Some(meter);
        reading.unwrap_or_else(impossible)
    }
}

/// Counts a reading while it is under way.
struct Place;

impl Place {
    fn take() -> Option<Place> {
        let place = (READINGS.fetch_add(1, Ordering::Relaxed) < READINGS_MAX).then_some(Place);
        if place.is_none() {
            READINGS.fetch_sub(1, Ordering::Relaxed);
        }
        place
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        READINGS.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Not a thread of the runtime's pool, which would be waited for at the end.
fn start(
    mut meter: Meter,
    read: impl FnOnce(&mut Meter) -> Reading + Send + 'static,
) -> Result<oneshot::Receiver<(Meter, Reading)>, String> {
    // A place that is not taken was not counted, and one that is not moved into the thread is given back.
    let Some(place) = Place::take() else {
        return Err(format!("{READINGS_MAX} earlier readings wait for a disk that does not answer"));
    };
    let (answer, pending) = oneshot::channel();
    let thread = std::thread::Builder::new().name("system".to_owned()).spawn(move || {
        let reading = read(&mut meter);
        drop(place);
        // The caller may have gone.
        let _ = answer.send((meter, reading));
    });
    thread.map(|_| pending).map_err(|error| error.to_string())
}

impl Meter {
    fn new(resource: &Resource, roots: Roots) -> Meter {
        Meter { resource: resource.clone(), roots, processor: None, processes: None }
    }

    fn read(&mut self) -> Reading {
        let Roots { proc, sys } = &self.roots;
        let measured = |value: f64| Some(ProbeOutcome::Measured(value));
        match &self.resource {
            Resource::Cpu => {
                let now = Processor::read(proc)?;
                let before = self.processor.replace(now);
                before.map(|before| now.busy_percent(&before).map(ProbeOutcome::Measured)).transpose()
            }
            Resource::Memory => resources::memory_percent(proc).map(measured),
            Resource::Disk { path } => resources::disk_percent(path).map(measured),
            Resource::Temperature { sensor } => resources::celsius(sensor, sys).map(measured),
            Resource::Process { name, measure } => process::read(name, *measure, proc, &mut self.processes),
        }
    }
}

impl Default for Roots {
    fn default() -> Roots {
        Roots { proc: "/proc".into(), sys: "/sys".into() }
    }
}
