//! `telltale sim`: runs only the simulated shuttle or robot, on DDS.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, bail};
use tokio::sync::mpsc;

use super::vehicle::machine::Kind;
use super::vehicle::{SWITCHES, Vehicle};
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::process::{dds, log};
use crate::clock::Clock;
use crate::config;
use crate::sim::machine::FaultInfo;
use crate::web::FaultSwitch;

/// Publish what the nodes of a shuttle would, for a `telltale serve` in another process.
///
/// It stands at the first stop, waits to be told where it is and to be cleared, and does what
/// countermeasures ask for. With `--drive` it knows where it is and leaves every stop by itself.
/// Its nodes show in `ros2 node list`: where nodes of Humble or older may join later, set
/// `ROS_DISTRO`, or they fail on announcements of another size.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Faults: sensor_outage, localization_jump, costmap_delay, planner_stall, can_loss, low_battery,\n  camera_crash\n\
    Faults of the robot: lidar_outage, wheel_slip, localization_lost, navigation_stall, controller_crash,\n  docking_failed, battery_low\n\n\
    Examples:\n  telltale sim --config config/shuttle.yaml --interface loopback --domain 7 --drive --fault sensor_outage@40..50\n  \
    telltale sim --robot --config config/robot.yaml --interface loopback --fault lidar_outage@20..30"
)]
pub struct Args {
    /// The configuration of the vehicle, with its stops and the topics of requests
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Drive from stop to stop without an operator
    #[arg(long)]
    drive: bool,
    /// The warehouse robot instead of the shuttle
    #[arg(long, conflicts_with = "drive")]
    robot: bool,
    /// A fault and its seconds after the start: `NAME@20` or `NAME@20..30`; may be repeated
    #[arg(long = "fault", value_name = "NAME@SECONDS[..SECONDS]", value_parser = planned_fault)]
    faults: Vec<PlannedFault>,
    #[command(flatten)]
    dds: dds::DdsFlags,
}

#[derive(Debug, Clone, PartialEq)]
struct PlannedFault {
    name: String,
    from: Duration,
    until: Option<Duration>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("info");
    let loaded = config::load(&args.config)?;
    let options = args.dds.resolve()?;
    let kind = Kind::of(args.robot, args.drive);
    let switches = switches(&args.faults, &kind.faults())?;
    tokio::runtime::Runtime::new().context("the async runtime cannot be started")?.block_on(async {
        let mut signal = ShutdownSignal::listen()?;
        let mut vehicle = Vehicle::open(&options, &loaded, kind, Clock::start()).await?;
        vehicle.subscribe()?;
        let (switch, faults) = mpsc::channel(SWITCHES);
        tracing::info!("the simulation publishes: {}; end it with Ctrl-C", dds::describe(&options));
        let driving = tokio::spawn(vehicle.run(faults));
        tokio::select! {
            _ = signal.requested() => {}
            () = inject(switches, &switch) => {}
        }
        drop(switch);
        driving.await.context("the simulation failed")?;
        Ok(ExitCode::SUCCESS)
    })
}

/// A fault that is switched on or off after this time.
type Planned = (Duration, FaultInfo, bool);

/// The switches in order of time; the machine must have the faults.
fn switches(planned: &[PlannedFault], known: &[FaultInfo]) -> anyhow::Result<Vec<Planned>> {
    let mut switches = Vec::new();
    for planned in planned {
        let Some(fault) = known.iter().find(|fault| fault.name == planned.name) else {
            let names: Vec<&str> = known.iter().map(|fault| fault.name).collect();
            bail!("there is no fault {:?}; there are {}", planned.name, names.join(", "));
        };
        switches.push((planned.from, fault.clone(), true));
        switches.extend(planned.until.map(|until| (until, fault.clone(), false)));
    }
    switches.sort_by_key(|(at, ..)| *at);
    Ok(switches)
}

/// Switches the faults when they are due, and never returns.
async fn inject(switches: Vec<Planned>, switch: &mpsc::Sender<FaultSwitch>) {
    let mut passed = Duration::ZERO;
    for (at, fault, active) in switches {
        tokio::time::sleep(at - passed).await;
        passed = at;
        let what = if active { &*fault.about.en } else { "it is over" };
        tracing::info!("fault {}: {what}", fault.name);
        if switch.send(FaultSwitch { name: fault.name, active }).await.is_err() {
            tracing::error!("the simulation has ended");
        }
    }
    std::future::pending().await
}

fn planned_fault(text: &str) -> Result<PlannedFault, String> {
    let (name, when) =
        text.split_once('@').ok_or("write it as NAME@SECONDS: sensor_outage@20 or sensor_outage@20..30")?;
    let (from, until) = match when.split_once("..") {
        Some((from, until)) => (seconds(from)?, Some(seconds(until)?)),
        None => (seconds(when)?, None),
    };
    if until.is_some_and(|until| until <= from) {
        return Err(format!("{when} ends before it begins; exchange the two"));
    }
    Ok(PlannedFault { name: name.to_owned(), from, until })
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
        assert_eq!((&*planned.name, planned.from.as_millis(), planned.until), ("can_loss", 2500, None));
        let planned = planned_fault("can_loss@2.5..4").unwrap();
        assert_eq!(planned.until, Some(Duration::from_secs(4)));
        for (text, words) in [
            ("can_loss", "NAME@SECONDS"),
            ("can_loss@soon", "no number of seconds"),
            ("can_loss@-1", "cannot be waited for"),
            ("can_loss@nan", "cannot be waited for"),
            ("can_loss@3..", "no number of seconds"),
            ("can_loss@3..3", "ends before it begins"),
        ] {
            let error = planned_fault(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
        let switches = |text, kind: Kind| switches(&[planned_fault(text).unwrap()], &kind.faults());
        let shuttle = Kind::of(false, true);
        assert_eq!(switches("can_loss@2.5..4", shuttle).unwrap().len(), 2);
        let error = switches("lidar_outage@1", shuttle).unwrap_err().to_string();
        assert!(error.contains("there is no fault \"lidar_outage\"; there are sensor_outage"), "{error}");
        assert!(switches("lidar_outage@1", Kind::Robot).is_ok());
    }
}
