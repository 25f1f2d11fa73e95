//! `telltale sim`: runs only the simulated shuttle, on DDS.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;
use tokio::sync::mpsc;

use super::shutdown_signal::ShutdownSignal;
use super::vehicle::{SWITCHES, Vehicle};
use super::{EXIT_USAGE, check, dds, log};
use crate::clock::Clock;
use crate::config;
use crate::sim::shuttle::{Departure, Fault};

/// Publish what the nodes of a shuttle would, for a `telltale serve` in another process.
///
/// It stands at the first stop, waits to be told where it is and to be cleared, and does what
/// countermeasures ask for. With `--drive` it knows where it is and leaves every stop by itself.
/// Its nodes show in `ros2 node list`: where nodes of Humble or older may join later, set
/// `ROS_DISTRO`, or they fail on announcements of another size.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Faults: sensor_outage, localization_jump, costmap_delay, planner_stall, can_loss, low_battery,\n  camera_crash\n\n\
    Example:\n  telltale sim --config config/shuttle.yaml --interface loopback --domain 7 --drive --fault sensor_outage@40..50"
)]
pub struct Args {
    /// The configuration of the vehicle: its stops, and the topics on which it is spoken to
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Drive from stop to stop without an operator
    #[arg(long)]
    drive: bool,
    /// A fault from so many seconds after the start on, `NAME@20` or `NAME@20..30`; may be repeated
    #[arg(long = "fault", value_name = "NAME@SECONDS[..SECONDS]", value_parser = planned_fault)]
    faults: Vec<PlannedFault>,
    #[command(flatten)]
    dds: dds::DdsFlags,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct PlannedFault {
    fault: Fault,
    from: Duration,
    until: Option<Duration>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("info");
    let loaded = match config::load(&args.config) {
        Ok(loaded) => loaded,
        Err(problems) => {
            check::report(&problems);
            return Ok(ExitCode::from(EXIT_USAGE));
        }
    };
    let options = args.dds.resolve()?;
    let departure = if args.drive { Departure::Alone } else { Departure::Cleared };
    tokio::runtime::Runtime::new().context("the async runtime cannot be started")?.block_on(async {
        let mut signal = ShutdownSignal::listen()?;
        let vehicle = Vehicle::open(&options, &loaded, departure, Clock::start()).await?;
        let (switch, faults) = mpsc::channel(SWITCHES);
        tracing::info!("the simulated shuttle publishes: {}; end it with Ctrl-C", dds::describe(&options));
        let driving = tokio::spawn(vehicle.run(faults));
        tokio::select! {
            () = signal.requested() => {}
            () = inject(&args.faults, &switch) => {}
        }
        drop(switch);
        driving.await.context("the simulated shuttle failed")?;
        Ok(ExitCode::SUCCESS)
    })
}

/// Switches the faults when they are due, and never returns.
async fn inject(planned: &[PlannedFault], switch: &mpsc::Sender<(Fault, bool)>) {
    let on = planned.iter().map(|planned| (planned.from, planned.fault, true));
    let off = planned.iter().filter_map(|planned| Some((planned.until?, planned.fault, false)));
    let mut switches: Vec<_> = on.chain(off).collect();
    switches.sort_by_key(|(at, ..)| *at);
    let mut passed = Duration::ZERO;
    for (at, fault, on) in switches {
        tokio::time::sleep(at - passed).await;
        passed = at;
        let what = if on { fault.about() } else { "it is over" };
        tracing::info!("fault {}: {what}", fault.as_str());
        if switch.send((fault, on)).await.is_err() {
            tracing::error!("the simulated shuttle has ended");
        }
    }
    std::future::pending().await
}

fn planned_fault(text: &str) -> Result<PlannedFault, String> {
    let (name, when) =
        text.split_once('@').ok_or("write it as NAME@SECONDS: sensor_outage@20 or sensor_outage@20..30")?;
    let fault = Fault::from_word(name).ok_or_else(|| {
        let names = Fault::ALL.map(Fault::as_str).join(", ");
        format!("there is no fault {name:?}; there are {names}")
    })?;
    let (from, until) = match when.split_once("..") {
        Some((from, until)) => (seconds(from)?, Some(seconds(until)?)),
        None => (seconds(when)?, None),
    };
    if until.is_some_and(|until| until <= from) {
        return Err(format!("{when} ends before it begins; exchange the two"));
    }
    Ok(PlannedFault { fault, from, until })
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("{text:?} is no number of seconds"))?;
    Duration::try_from_secs_f64(seconds).map_err(|_| format!("{text} s cannot be waited for"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_planned_with_a_name_and_seconds() {
        let planned = planned_fault("can_loss@2.5").unwrap();
        assert_eq!((planned.fault, planned.from.as_millis(), planned.until), (Fault::CanLoss, 2500, None));
        let planned = planned_fault("can_loss@2.5..4").unwrap();
        assert_eq!(planned.until, Some(Duration::from_secs(4)));
        for (text, words) in [
            ("can_loss", "NAME@SECONDS"),
            ("can@1", "there is no fault \"can\"; there are sensor_outage"),
            ("can_loss@soon", "no number of seconds"),
            ("can_loss@-1", "cannot be waited for"),
            ("can_loss@nan", "cannot be waited for"),
            ("can_loss@3..", "no number of seconds"),
            ("can_loss@3..3", "ends before it begins"),
        ] {
            let error = planned_fault(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
