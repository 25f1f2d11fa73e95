//! Who is in the simulated fleet: the vehicles, their faults, and what becomes of some of them.

use crate::cli::running::vehicle::machine::Kind;
use crate::engine::text::Text;
use crate::engine::time::Span;
use crate::fleet::message::VehicleId;
use crate::record::VERSION;
use crate::sim::machine::{Departure, FaultInfo};
use crate::sim::shuttle;

/// A fault that comes and goes: seconds since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planned {
    pub fault: &'static str,
    first_s: u64,
    lasts_s: u64,
    every_s: u64,
}

impl Planned {
    pub fn is_on(&self, passed: Span) -> bool {
        let passed_s = passed.as_millis() / 1000;
        passed_s >= self.first_s && (passed_s - self.first_s) % self.every_s < self.lasts_s
    }
}

/// What becomes of a vehicle beside its faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    None,
    /// It drives through tunnels: its line to the hub is cut for two minutes, again and again.
    Tunnels,
    /// It is switched off soon after the start.
    Off,
    /// Another vehicle has a copy of its key.
    Copied,
}

#[derive(Debug, Clone)]
pub struct Member {
    pub id: VehicleId,
    pub name: Text,
    pub kind: Kind,
    /// Each vehicle of the fleet moves differently.
    pub seed: u64,
    /// Of its Telltale.
    pub version: String,
    pub faults: Vec<Planned>,
    pub fate: Fate,
}

/// The fault that only shuttles of the next version have.
const OF_NEXT_VERSION: shuttle::Fault = shuttle::Fault::CostmapDelay;

/// The first `count` vehicles: each third one is a robot, and each fourth one has the next version.
pub fn members(count: u32) -> Vec<Member> {
    (1..=count).filter_map(member).collect()
}

fn member(number: u32) -> Option<Member> {
    let is_robot = number.is_multiple_of(3);
    let is_next = number.is_multiple_of(4);
    let (word, kind) = match is_robot {
        true => ("robot", Kind::Robot),
        false => ("shuttle", Kind::Shuttle(Departure::Cleared)),
    };
    let fate = match number {
        2 => Fate::Tunnels,
        3 => Fate::Off,
        5 => Fate::Copied,
        _ => Fate::None,
    };
    let name = |word: &str| format!("{word} {number}").into();
    let (en, de) = match is_robot {
        true => (name("Robot"), name("Roboter")),
        false => (name("Shuttle"), name("Shuttle")),
    };
    let own = own_faults(kind);
    let number = u64::from(number);
    let fault = own[number as usize % own.len()].name;
    let mut faults =
        vec![Planned { fault, first_s: 20 + number * 37 % 150, lasts_s: 45, every_s: 210 + number * 13 }];
    if is_next && !is_robot {
        faults.push(Planned { fault: OF_NEXT_VERSION.info().name, first_s: 40, lasts_s: 40, every_s: 130 });
    }
    Some(Member {
        id: VehicleId::new(&format!("{word}-{number:02}"))?,
        name: Text { en, de },
        kind,
        seed: number,
        version: if is_next { format!("{VERSION}-next") } else { VERSION.to_owned() },
        faults,
        fate,
    })
}

/// The faults of its simulation that vehicles of both versions have.
fn own_faults(kind: Kind) -> Vec<FaultInfo> {
    let mut faults = kind.faults();
    faults.retain(|it| kind == Kind::Robot || it.name != OF_NEXT_VERSION.info().name);
    faults
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn one_fault_is_only_of_the_next_version_and_each_fault_is_one_of_its_machine() {
        let all = members(12);
        let faults = |is_next: bool| -> BTreeSet<&str> {
            let of = all.iter().filter(|it| it.version.ends_with("-next") == is_next);
            of.flat_map(|it| it.faults.iter().map(|planned| planned.fault)).collect()
        };
        assert!(faults(true).contains("costmap_delay") && !faults(false).contains("costmap_delay"));
        for member in &all {
            let known = member.kind.faults();
            assert!(member.faults.iter().all(|it| known.iter().any(|fault| fault.name == it.fault)));
        }
        let names: BTreeSet<_> = all.iter().map(|it| it.id.as_str()).collect();
        assert_eq!(names.len(), 12);
        assert!(names.contains("shuttle-01") && names.contains("robot-12"), "{names:?}");
    }

    #[test]
    fn a_fault_comes_and_goes() {
        let planned = Planned { fault: "can_loss", first_s: 20, lasts_s: 5, every_s: 60 };
        let on: Vec<u64> = (0..100).filter(|&s| planned.is_on(Span::from_secs(s))).collect();
        assert_eq!(on, [20, 21, 22, 23, 24, 80, 81, 82, 83, 84]);
    }
}
