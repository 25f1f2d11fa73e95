//! `telltale sim`: the simulated shuttle alone, on DDS.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;
use tokio::sync::mpsc;

use super::ending::Ending;
use super::vehicle::{SWITCHES, Vehicle};
use super::{EXIT_USAGE, check, dds, log};
use crate::clock::Clock;
use crate::config;
use crate::sim::shuttle::Fault;

/// Publish what the nodes of a shuttle would, for a `telltale serve` in another process.
///
/// It drives a loop of three stops: about 10 s at each, about 45 s between them.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Faults: sensor_outage, localization_jump, costmap_delay, planner_stall, can_loss, low_battery\n\n\
    Example:\n  telltale sim --config config/shuttle.yaml --interface loopback --domain 7 --fault sensor_outage@20"
)]
pub struct Args {
    /// The configuration that names the topic of the `active` signal
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// A fault to switch on so many seconds after the start; may be repeated
    #[arg(long = "fault", value_name = "NAME@SECONDS", value_parser = planned_fault)]
    faults: Vec<PlannedFault>,
    #[command(flatten)]
    dds: dds::DdsFlags,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct PlannedFault {
    fault: Fault,
    after: Duration,
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
    tokio::runtime::Runtime::new().context("the async runtime cannot be started")?.block_on(async {
        let mut ending = Ending::listen()?;
        let vehicle = Vehicle::open(&options, &loaded.model, Clock::start()).await?;
        let (switch, faults) = mpsc::channel(SWITCHES);
        tracing::info!("the simulated shuttle publishes: {}; end it with Ctrl-C", dds::describe(&options));
        let driving = tokio::spawn(vehicle.run(faults));
        tokio::select! {
            () = ending.asked() => {}
            () = inject(&args.faults, &switch) => {}
        }
        drop(switch);
        driving.await.context("the simulated shuttle failed")?;
        Ok(ExitCode::SUCCESS)
    })
}

/// Switches the faults on when they are due, and never returns.
async fn inject(planned: &[PlannedFault], switch: &mpsc::Sender<(Fault, bool)>) {
    let mut planned = planned.to_vec();
    planned.sort_by_key(|planned| planned.after);
    let mut passed = Duration::ZERO;
    for PlannedFault { fault, after } in planned {
        tokio::time::sleep(after - passed).await;
        passed = after;
        tracing::info!("fault {}: {}", fault.as_str(), fault.about());
        if switch.send((fault, true)).await.is_err() {
            tracing::error!("the simulated shuttle has ended");
        }
    }
    std::future::pending().await
}

fn planned_fault(text: &str) -> Result<PlannedFault, String> {
    let (name, seconds) = text.split_once('@').ok_or("write it as NAME@SECONDS: sensor_outage@20")?;
    let fault = Fault::from_word(name).ok_or_else(|| {
        let names = Fault::ALL.map(Fault::as_str).join(", ");
        format!("there is no fault {name:?}; there are {names}")
    })?;
    let seconds: f64 = seconds.parse().map_err(|_| format!("{seconds:?} is no number of seconds"))?;
    let after =
        Duration::try_from_secs_f64(seconds).map_err(|_| format!("{seconds} s cannot be waited for"))?;
    Ok(PlannedFault { fault, after })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_planned_with_a_name_and_seconds() {
        let planned = planned_fault("can_loss@2.5").unwrap();
        assert_eq!((planned.fault, planned.after.as_millis()), (Fault::CanLoss, 2500));
        for (text, words) in [
            ("can_loss", "NAME@SECONDS"),
            ("can@1", "there is no fault \"can\"; there are sensor_outage"),
            ("can_loss@soon", "no number of seconds"),
            ("can_loss@-1", "cannot be waited for"),
            ("can_loss@nan", "cannot be waited for"),
        ] {
            let error = planned_fault(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
