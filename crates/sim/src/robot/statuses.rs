//! The nodes of the robot, and what they say of themselves on `/diagnostics`.

use super::world::World;
use super::{Fault, Message};
use telltale_engine::input::StatusArray;

const OK: u8 = 0;
const ERROR: u8 = 2;

/// Each says what it says twice a second.
const EVERY_MS: u64 = 500;

const CONTROLLER: &str = "controller_server";
const DOCKING: &str = "docking_server";
const NAVIGATION: &str = "lifecycle_manager_navigation";

/// Nodes, with the status of each that has one, and its message while all is well.
const NODES: [(&str, Option<(&str, &str)>); 11] = [
    ("lidar_front", Some(("lidar_front: device", "Rotates, window clean"))),
    ("lidar_rear", Some(("lidar_rear: device", "Rotates, window clean"))),
    ("imu", Some(("imu: device", "Calibrated"))),
    ("base_driver", Some(("base: motors", "Both motors in control"))),
    ("battery_driver", None),
    ("amcl", None),
    (
        "lifecycle_manager_localization",
        Some(("lifecycle_manager_localization: Nav2 Health", "Nav2 is active")),
    ),
    (NAVIGATION, Some(("lifecycle_manager_navigation: Nav2 Health", "Nav2 is active"))),
    ("planner_server", None),
    (CONTROLLER, None),
    (DOCKING, Some(("docking: contacts", "Apart"))),
];

pub(super) fn nodes(world: &World) -> Vec<&'static str> {
    let runs = |node: &&str| *node != CONTROLLER || !world.has(Fault::ControllerCrash);
    NODES.into_iter().map(|(node, _)| node).filter(runs).collect()
}

/// The statuses of this step: each node at another moment.
pub(super) fn publish(world: &mut World, send: &mut dyn FnMut(Message)) {
    for (index, (node, status)) in NODES.into_iter().enumerate() {
        let Some((name, fine)) = status.filter(|_| world.now_ms() % EVERY_MS == index as u64 * 40) else {
            continue;
        };
        let (level, message) = match node {
            NAVIGATION if world.misses_controller() => (ERROR, "Nav2 is inactive"),
            DOCKING if world.docked() => (OK, "Closed"),
            _ => (OK, fine),
        };
        let mut array = StatusArray::default();
        array.push_status(level, name, message, node);
        match node {
            "lidar_front" | "lidar_rear" => {
                let celsius = world.measured(41.0, 0.4);
                array.push_value("temperature_c", &format!("{celsius:.1}"));
            }
            "base_driver" => {
                let celsius = world.measured(52.0, 1.0);
                array.push_value("motor_temperature_c", &format!("{celsius:.1}"));
            }
            _ => {}
        }
        send(Message::Diagnostics(array));
    }
}
