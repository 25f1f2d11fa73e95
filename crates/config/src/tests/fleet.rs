//! Tests of the settings of the fleet.

use super::*;
use crate::fleet::{Fleet, Recordings};

const FLEET: &str = "fleet: { hub: 'tls://hub.example:4222', credentials: vehicle.nk, ca: /etc/ca.pem }\n";

#[test]
fn a_vehicle_belongs_to_no_fleet_unless_one_is_named() {
    assert_eq!(parse("c", GROUP).unwrap().fleet, None);
    let loaded = parse("etc/c.yaml", &format!("{GROUP}vehicle: {{ id: shuttle-03 }}\n{FLEET}")).unwrap();
    let fleet = Fleet {
        hub: "tls://hub.example:4222".into(),
        credentials: "etc/vehicle.nk".into(),
        ca: "/etc/ca.pem".into(),
        max_kbit_s: 512,
        recordings: Recordings::OnDemand,
    };
    assert_eq!(loaded.fleet, Some(fleet));
    for wanted in Recordings::ALL {
        let fleet = FLEET.replace(" }", &format!(", recordings: {} }}", wanted.as_str()));
        let loaded = parse("c", &format!("{GROUP}vehicle: {{ id: shuttle-03 }}\n{fleet}")).unwrap();
        assert_eq!(loaded.fleet.map(|it| it.recordings), Some(wanted));
    }
}

#[test]
fn a_fleet_that_cannot_be_told_is_said_at_its_place() {
    check_beside_group(
        FLEET,
        &[
            "2:8: a fleet knows its vehicles by their ids, and this one has none (give it one: `vehicle: { id: shuttle-03 }`)",
        ],
    );
    check_beside_group(
        "vehicle: { id: Shuttle.3 }\nfleet: { hub: 'nats://hub', credentials: a, ca: b, max_kbit_s: 1 }\n",
        &[
            "2:16: a fleet cannot know a vehicle as `Shuttle.3` (use at most 64 small letters, digits, `_` and `-`)",
            "3:15: `nats://hub` is no address of a hub (write `tls://HOST:PORT`: `tls://hub.example:4222`)",
            "3:64: 1 is not between 8 and 1000000 (the default is 512)",
        ],
    );
}
