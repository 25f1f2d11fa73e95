//! The machine's IPv4 addresses, and when their change requires a new participant.

use std::collections::BTreeSet;
use std::io;
use std::net::{IpAddr, Ipv4Addr};

use super::Interface;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    pub interface: Box<str>,
    pub ip: Ipv4Addr,
}

/// Every IPv4 address of the machine. The DDS library speaks no IPv6.
pub fn addresses() -> io::Result<Vec<Address>> {
    let found = if_addrs::get_if_addrs()?.into_iter().filter_map(|interface| match interface.ip() {
        IpAddr::V4(ip) => Some(Address { interface: interface.name.into(), ip }),
        IpAddr::V6(_) => None,
    });
    Ok(found.collect())
}

/// Notices that the addresses in use are no longer those the participant was made with: the participant
/// never learns of new ones by itself.
#[derive(Debug)]
pub struct AddressWatch {
    interface: Interface,
    built_with: BTreeSet<Ipv4Addr>,
    last: BTreeSet<Ipv4Addr>,
    lost_one: bool,
}

impl AddressWatch {
    pub fn new(interface: Interface, now: &[Address]) -> AddressWatch {
        let built_with = in_use(interface, now);
        AddressWatch { interface, last: built_with.clone(), built_with, lost_one: false }
    }

    /// True when a new participant is due: addresses have changed or come back, and were the same at two
    /// looks, so that an interface that comes up in steps causes only one.
    pub fn look(&mut self, now: &[Address]) -> bool {
        let current = in_use(self.interface, now);
        self.lost_one |= !self.built_with.is_subset(&current);
        let stable = current == self.last;
        let due = stable && !current.is_empty() && (self.lost_one || current != self.built_with);
        self.last = current;
        due
    }
}

fn in_use(interface: Interface, now: &[Address]) -> BTreeSet<Ipv4Addr> {
    let addresses = now.iter().map(|address| address.ip);
    match interface {
        Interface::Loopback => BTreeSet::new(),
        Interface::Ip(ip) => addresses.filter(|&other| other == ip).collect(),
        Interface::All => addresses.filter(|other| !other.is_loopback()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);
    const B: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 2);

    fn present(ips: &[Ipv4Addr]) -> Vec<Address> {
        let all = [Ipv4Addr::LOCALHOST].iter().chain(ips);
        all.map(|&ip| Address { interface: "x".into(), ip }).collect()
    }

    #[test]
    fn a_new_participant_is_due_once_a_change_is_stable() {
        type Looks = &'static [&'static [Ipv4Addr]];
        // Interface, addresses at the start, then at each look; due at the last look or never.
        let cases: [(Interface, &[Ipv4Addr], Looks, bool); 8] = [
            (Interface::All, &[A], &[&[A], &[A]], false),
            (Interface::All, &[], &[&[A], &[A]], true),
            (Interface::All, &[A], &[&[A, B], &[A, B]], true),
            (Interface::All, &[A], &[&[], &[], &[A], &[A]], true),
            (Interface::All, &[A], &[&[], &[], &[]], false),
            (Interface::Ip(A), &[A], &[&[A, B], &[A, B]], false),
            (Interface::Ip(A), &[A], &[&[B], &[A], &[A]], true),
            (Interface::Loopback, &[A], &[&[], &[B], &[B]], false),
        ];
        for (interface, start, looks, expected) in cases {
            let mut watch = AddressWatch::new(interface, &present(start));
            let due: Vec<bool> = looks.iter().map(|ips| watch.look(&present(ips))).collect();
            let mut wanted = vec![false; looks.len()];
            *wanted.last_mut().unwrap() = expected;
            assert_eq!(due, wanted, "{interface:?} {start:?} {looks:?}");
        }
    }
}
