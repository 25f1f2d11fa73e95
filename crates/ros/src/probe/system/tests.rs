//! Tests of the measurements of the computer, with files made by hand in place of the kernel's.

use std::fs;
use std::path::Path;
use std::sync::mpsc;

use super::*;
use telltale_engine::model::monitors::ProcessMeasure;

/// A computer in a folder.
struct Computer(tempfile::TempDir);

impl Computer {
    fn new() -> Computer {
        let computer = Computer(tempfile::tempdir().unwrap());
        computer.process(1, "/sbin/init\0", "S", 5);
        computer.processor(0, 0);
        computer
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.0.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    /// Two cores that were busy and idle for so many ticks.
    fn processor(&self, busy: u64, idle: u64) {
        self.write("proc/stat", &format!("cpu  {busy} 0 0 {idle} 0 0 0 0 7 7\ncpu0 1 2\ncpu1 1 2\nintr 5\n"));
    }

    fn process(&self, pid: u32, command: &str, state: &str, ticks: u64) {
        self.write(&format!("proc/{pid}/cmdline"), command);
        let zeros = "0 ".repeat(10);
        let stat = format!("{pid} (a) b) {state} {zeros}{ticks} 0 0 0 0 0 0 0 {pid}77 0\n");
        self.write(&format!("proc/{pid}/stat"), &stat);
        self.write(&format!("proc/{pid}/status"), "Name:\ta\nVmRSS:\t   2000 kB\n");
    }

    fn meter(&self, resource: Resource) -> Meter {
        let root = self.0.path();
        Meter::new(&resource, Roots { proc: root.join("proc"), sys: root.join("sys") })
    }

    fn read(&self, resource: Resource) -> Reading {
        self.meter(resource).read()
    }
}

fn process(name: &str, measure: Option<ProcessMeasure>) -> Resource {
    Resource::Process { name: name.into(), measure }
}

fn measured(value: f64) -> Reading {
    Ok(Some(ProbeOutcome::Measured(value)))
}

#[test]
fn the_processor_is_measured_between_two_readings() {
    let computer = Computer::new();
    computer.processor(1000, 9000);
    let mut meter = computer.meter(Resource::Cpu);
    assert_eq!(meter.read(), Ok(None), "the first one has nothing to be compared with");
    assert!(meter.read().is_err(), "the counters stand still");
    computer.processor(1075, 9025);
    assert_eq!(meter.read(), measured(75.0));
    computer.write("proc/stat", "cpu one two\n");
    assert!(meter.read().is_err());
    fs::remove_file(computer.0.path().join("proc/stat")).unwrap();
    assert!(meter.read().unwrap_err().contains("ProcSubset=all"));
}

#[test]
fn the_memory_that_is_left_is_what_a_new_program_could_have() {
    let computer = Computer::new();
    assert!(computer.read(Resource::Memory).unwrap_err().contains("meminfo"));
    computer.write("proc/meminfo", "MemTotal:  8000 kB\nMemFree: 10 kB\nMemAvailable:   2000 kB\n");
    assert_eq!(computer.read(Resource::Memory), measured(75.0));
    computer.write("proc/meminfo", "MemTotal:  8000 kB\n");
    assert!(computer.read(Resource::Memory).unwrap_err().contains("MemAvailable"));
}

#[test]
fn a_disk_is_measured_where_there_is_one() {
    let computer = Computer::new();
    let disk = |path: &Path| computer.read(Resource::Disk { path: path.to_str().unwrap().into() });
    let found = disk(computer.0.path());
    assert!(
        matches!(found, Ok(Some(ProbeOutcome::Measured(used))) if (0.0..=100.0).contains(&used)),
        "{found:?}"
    );
    assert!(disk(Path::new("/no/such/folder")).unwrap_err().starts_with("/no/such/folder: "));
    assert!(disk(Path::new("/proc")).is_err(), "it has no size");
}

#[test]
fn the_hottest_sensor_of_a_name_counts() {
    let computer = Computer::new();
    let celsius = |sensor: &str| computer.read(Resource::Temperature { sensor: sensor.into() });
    assert_eq!(celsius("cpu"), Err("there is no sensor cpu, and no other one".to_owned()));
    computer.write("sys/class/thermal/thermal_zone0/type", "x86_pkg_temp\n");
    computer.write("sys/class/thermal/thermal_zone0/temp", "61500\n");
    computer.write("sys/class/hwmon/hwmon1/name", "coretemp\n");
    computer.write("sys/class/hwmon/hwmon1/temp1_input", "58000\n");
    computer.write("sys/class/hwmon/hwmon1/temp1_label", "Core 0\n");
    computer.write("sys/class/hwmon/hwmon1/temp2_input", "70000\n");
    for (sensor, expected) in [("x86_pkg_temp", 61.5), ("coretemp", 70.0), ("Core 0", 58.0)] {
        assert_eq!(celsius(sensor), measured(expected), "{sensor}");
    }
    let missing = celsius("gpu").unwrap_err();
    assert_eq!(missing, "there is no sensor gpu; there are Core 0, coretemp, x86_pkg_temp");
    computer.write("sys/class/hwmon/hwmon1/temp2_input", "\n");
    assert!(celsius("coretemp").is_err(), "one that cannot be read may be the hottest");
}

#[test]
fn a_process_is_found_by_its_program_or_its_script() {
    let computer = Computer::new();
    let runs = |name: &str| computer.read(process(name, None));
    computer.process(20, "/opt/ros/lib/planner_server\0--ros-args\0", "S", 0);
    computer.process(21, "/usr/bin/python3.12\0-u\0/opt/ros/lib/watcher\0", "R", 0);
    computer.process(22, "/usr/bin/vim\0amcl\0", "S", 0);
    computer.process(23, "/opt/ros/lib/map_server\0", "Z", 0);
    for name in ["planner_server", "watcher", "init"] {
        assert_eq!(runs(name), Ok(Some(ProbeOutcome::Announced)), "{name}");
    }
    // An editor with the name of a program, one that has ended, and a part of a name.
    for name in ["amcl", "map_server", "planner"] {
        assert!(matches!(runs(name), Ok(Some(ProbeOutcome::Missed(_)))), "{name}");
    }
    fs::remove_dir_all(computer.0.path().join("proc/1")).unwrap();
    assert_eq!(runs("planner_server"), Ok(Some(ProbeOutcome::Announced)));
    assert!(runs("amcl").unwrap_err().contains("ProtectProc=default"), "it may be hidden");
}

#[test]
fn all_processes_of_a_name_are_measured_together() {
    let computer = Computer::new();
    let both = |ticks: [u64; 2]| {
        computer.process(20, "/bin/node\0", "R", ticks[0]);
        computer.process(30, "/bin/node\0", "R", ticks[1]);
    };
    both([100, 500]);
    let memory = computer.read(process("node", Some(ProcessMeasure::Memory)));
    assert_eq!(memory, measured(2.0 * 2000.0 * 1024.0 / 1e6));
    let mut meter = computer.meter(process("node", Some(ProcessMeasure::Cpu)));
    assert_eq!(meter.read(), Ok(None));
    both([140, 510]);
    computer.process(40, "/bin/node\0", "R", 10);
    // 60 of 200 ticks of two cores.
    computer.processor(100, 100);
    assert_eq!(meter.read(), measured(60.0));
}

#[tokio::test]
async fn a_disk_that_hangs_holds_nothing_up_and_is_read_by_one_thread() {
    let mut system = System::new(&Resource::Memory);
    let (release, hanging) = mpsc::channel::<()>();
    let hang = move |_: &mut Meter| {
        // Until the test lets go.
        let _ = hanging.recv();
        measured(1.0)
    };
    let soon = Duration::from_millis(1);
    let outcome = system.ask_by(hang, soon).await;
    assert!(matches!(outcome, Some(ProbeOutcome::Impossible(why)) if why.contains("does not answer")));
    let second = |_: &mut Meter| -> Reading { panic!("the first reading is still under way") };
    assert!(matches!(system.ask_by(second, soon).await, Some(ProbeOutcome::Impossible(_))));
    drop(release);
    let outcome = system.ask_by(second, Duration::from_secs(60)).await;
    assert_eq!(outcome, Some(ProbeOutcome::Measured(1.0)));
}

#[tokio::test]
async fn this_computer_can_be_measured() {
    for resource in [Resource::Cpu, Resource::Memory, Resource::Disk { path: "/".into() }] {
        let mut system = System::new(&resource);
        let outcome = loop {
            match system.ask(Duration::from_secs(60)).await {
                None => {}
                // The kernel's counters have not moved since the first reading.
                Some(ProbeOutcome::Impossible(why)) if why.contains("stand still") => {}
                Some(outcome) => break outcome,
            }
        };
        assert!(
            matches!(outcome, ProbeOutcome::Measured(percent) if (0.0..=100.0).contains(&percent)),
            "{resource:?}: {outcome:?}"
        );
    }
}
