//! Two machines without multicast between them: two network namespaces with a cable.

use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use telltale::engine::discovery::Discovery;
use telltale::engine::input::StatusArray;
use telltale::ros::{BridgeOptions, Interface, Publisher};

use crate::dds::{Reading, one};
use crate::peer::{Domain, Peer};
use crate::publishers::found;

/// A process of the other machine, which `tests/dds/cable.sh` names.
const OTHER: &str = "TELLTALE_TEST_OTHER_MACHINE";

/// The time after which a silent peer counts as gone.
const LEASE_S: u64 = 2;

/// Lays a cable and runs itself at one end of it.
#[tokio::test(flavor = "multi_thread")]
async fn a_host_without_multicast_is_reached_by_its_address_alone() {
    const NAME: &str = "network::a_host_without_multicast_is_reached_by_its_address_alone";
    if let Ok(other) = std::env::var(OTHER) {
        return of_the_two_machines(&other).await;
    }
    let cable = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/dds/cable.sh");
    let this = std::env::current_exe().expect("it runs");
    let ran = Command::new(cable).arg("off").arg(this).args([NAME, "--exact", "--nocapture"]).status();
    assert!(ran.expect("a shell is there").success(), "see above; it needs iproute2 and network namespaces");
}

async fn of_the_two_machines(other: &str) {
    let there = ["nsenter", "--target", other, "--net"];
    let domain = Domain::take();
    let without = BridgeOptions { interface: Interface::All, ..BridgeOptions::loopback(domain.id) };
    let with = BridgeOptions { peers: vec!["10.77.0.2".into()], ..without.clone() };
    let mut peer = Peer::start_by(&domain, &there, &format!("--interface there --lease-s {LEASE_S} pub"));
    let is_found = |seen: &Arc<Discovery>| {
        seen.topics.iter().any(|topic| topic.name == "/diagnostics" && !topic.publishers.is_empty())
    };

    let blind = Reading::with(without).await;
    let mut reading = Reading::with(with.clone()).await;
    peer.wait_matched(1);
    found(&reading, "/diagnostics", 1).await;
    peer.write(&one("first"));
    reading.status("first").await;
    // Longer than the lease of the peer: both go on to say that they live.
    tokio::time::sleep(Duration::from_secs(2 * LEASE_S)).await;
    peer.wait_matched(1);
    peer.write(&one("later"));
    reading.status("later").await;
    reading.bridge.shutdown().await;
    // It had as long as the other peer, and multicast would have found it.
    assert!(!is_found(&blind.bridge.discovery().borrow()), "it was found without its address");
    blind.bridge.shutdown().await;

    let mut listener =
        Peer::start_by(&domain, &there, "--interface there sub --topic rt/diagnostics=DiagnosticArray");
    let publisher = Publisher::open(&with, &[]).await.expect("the publisher starts");
    let mut array = StatusArray::default();
    array.push_status(0, "ours", "fine", "");
    let published = async {
        loop {
            publisher.diagnostics(&array, std::time::UNIX_EPOCH).await.expect("nobody holds it back");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::select! {
        heard = tokio::task::spawn_blocking(move || listener.expect("value")) => {
            assert_eq!(heard.expect("it is heard")["value"]["statuses"][0]["name"], "ours");
        }
        () = published => {}
    }
    publisher.shutdown().await;
}
