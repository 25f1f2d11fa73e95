//! `telltale fleet export` and a real hub: nats-server in the folder that `telltale fleet hub-config` makes.

use std::fs;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::Child;
use std::time::Duration;

use serde_json::{Value, json};
use telltale::console::state::time;
use telltale::fleet::delivery::Answer;
use telltale::fleet::identity::Identity;
use telltale::fleet::line::{self, Line};
use telltale::fleet::message::{AuditHead, Batch, Content, Epoch, Gap, GapReason, Message, VehicleId};
use telltale::fleet::reading::Logs;
use tempfile::TempDir;

use crate::program::{run, said};

#[path = "../../crates/fleet/tests/hub/nats_server.rs"]
mod nats_server;

/// Nothing here takes longer, even on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(30);
pub const LOOK_EVERY: Duration = Duration::from_millis(50);

/// A hub with an enrolled vehicle `a`, and another one, `b`, that tells nothing.
pub struct Hub {
    folder: TempDir,
    url: String,
    process: Child,
}

impl Hub {
    pub async fn start() -> Hub {
        let folder = TempDir::new().unwrap();
        // Nobody else takes a port that was free a moment ago.
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let dir = folder.path().join("hub").to_str().unwrap().to_owned();
        let fleet = |words: &[&str]| {
            let (_, error, code) = said(&run([&["fleet"], words].concat()));
            (code == Some(0), error)
        };
        for words in [
            &["hub-config", &*dir, "--listen", &*format!("127.0.0.1:{port}"), "--disk", "1"][..],
            &["enrol", "a", "--dir", &*dir],
            &["enrol", "b", "--dir", &*dir],
        ] {
            assert_eq!(fleet(words), (true, String::new()));
        }
        let process = nats_server::start(dir.as_ref(), "nats-server.conf", &folder.path().join("log"));
        let hub = Hub { folder, url: format!("tls://127.0.0.1:{port}"), process };
        let mut trouble = String::new();
        let made = tokio::time::timeout(PATIENCE, async {
            loop {
                let (is_made, error) = fleet(&["streams", "--dir", &dir, "--hub", &hub.url, "--disk", "1"]);
                if is_made {
                    return;
                }
                trouble = error;
                tokio::time::sleep(LOOK_EVERY).await;
            }
        });
        assert!(made.await.is_ok(), "the hub does not start: {trouble}");
        hub
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("hub").join(name)
    }

    pub fn address(&self) -> line::Hub {
        line::Hub { url: self.url.clone(), ca: self.file("hub.pem") }
    }

    /// Lets the vehicle `a` tell these batches.
    pub async fn tell(&self, batches: &[Vec<Message>]) {
        let (id, key) = (VehicleId::new("a").unwrap(), Identity::read(&self.file("a.nk")).unwrap());
        let line = Line::open(&self.address(), &id, &key).await.unwrap();
        let mut last = 0;
        for batch in batches {
            let sent = batch.last().unwrap().at;
            let messages: Vec<String> = batch.iter().map(|it| serde_json::to_string(it).unwrap()).collect();
            let messages: Vec<&str> = messages.iter().map(String::as_str).collect();
            let packed = Batch::pack(&id, key.public(), sent, &messages).unwrap();
            match line.requests().log(last, packed).await {
                Answer::Stored(number) => last = number,
                other => panic!("the hub does not take it: {other:?}"),
            }
        }
    }

    /// What an export with these words writes, says and ends with.
    fn export(&self, words: &[&str]) -> (Vec<Value>, String, Option<i32>) {
        let key = self.file("console.nk").to_str().unwrap().to_owned();
        let common = ["fleet", "export", "--hub", &self.url];
        let own = if words.contains(&"--credentials") { vec![] } else { vec!["--credentials", &key] };
        let (told, error, code) = said(&run([&common, &own[..], words].concat()));
        let lines = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        (lines, error, code)
    }

    fn kill(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        self.kill();
    }
}

const EPOCH: Epoch = Epoch { start: 7, nonce: 9 };

/// Message `n` of a drive that begins now: one each minute.
pub fn message(began_ms: i64, n: u64, content: Content) -> Message {
    Message { epoch: EPOCH, n, at: began_ms + n as i64 * 60_000, content }
}

fn record(began_ms: i64, n: u64) -> Message {
    message(began_ms, n, Content::AuditHead(AuditHead { record: n, hash: "ab".repeat(32) }))
}

fn now_ms() -> i64 {
    telltale::clock::unix_ms(telltale::clock::Clock::start().wall())
}

/// The kinds and places of lines.
fn places(lines: &[Value]) -> Vec<(&str, u64)> {
    lines.iter().map(|it| (it["kind"].as_str().unwrap(), it["n"].as_u64().unwrap())).collect()
}

#[tokio::test]
async fn the_log_of_a_vehicle_is_exported_with_its_gaps() {
    let hub = Hub::start().await;
    let began = now_ms();
    let gap = message(began, 5, Content::Gap(Gap { to: 7, why: GapReason::Overflow }));
    // Message 3 is nowhere, and 5 to 7 are declared as missing.
    hub.tell(&[
        vec![record(began, 1), record(began, 2)],
        vec![record(began, 4), gap],
        vec![record(began, 8), message(began, 9, Content::Goodbye)],
    ])
    .await;
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", "0s"]);
    assert_eq!(code, Some(0), "{said}");
    let audit = "audit_head";
    assert_eq!(
        places(&lines),
        [(audit, 1), (audit, 2), ("gap", 3), (audit, 4), ("gap", 5), (audit, 8), ("goodbye", 9)]
    );
    assert_eq!(
        lines[0],
        json!({ "epoch": EPOCH.to_string(), "n": 1, "at": time(began + 60_000), "kind": audit, "record": 1,
            "hash": "ab".repeat(32) })
    );
    assert_eq!(lines[2], json!({ "epoch": EPOCH.to_string(), "n": 3, "to": 3, "kind": "gap", "why": null }));
    assert_eq!(lines[4]["to"], 7);
    assert_eq!(lines[4]["why"], "overflow");
    assert_eq!(
        said,
        format!(
            "telltale: 5 messages of a, from {} to {}\ntelltale: 4 messages are missing, in 2 gaps\n",
            time(began + 60_000),
            time(began + 9 * 60_000)
        )
    );

    // A range, in both ways to write a time: gaps outside it are not written.
    let to = time(began + 8 * 60_000);
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", "6m 30s", "--to", &to]);
    assert_eq!((places(&lines), code), (vec![("gap", 5), (audit, 8)], Some(0)), "{said}");
    assert!(said.contains("1 message of a") && said.contains("3 messages are missing, in 1 gap\n"), "{said}");
    let from = time(began + 8 * 60_000);
    let (lines, said, _) = hub.export(&["--vehicle", "a", "--from", &from]);
    assert_eq!(places(&lines), [(audit, 8), ("goodbye", 9)]);
    assert!(!said.contains("missing"), "{said}");
    // Nothing is kept from before, and nothing is there from after.
    let (lines, said, code) =
        hub.export(&["--vehicle", "a", "--from", "2020-01-01T00:00:00Z", "--to", "60s"]);
    assert_eq!((places(&lines), code), (vec![(audit, 1), (audit, 2)], Some(0)));
    assert!(said.contains(&format!("keeps nothing of a from before {}", time(began + 60_000))), "{said}");
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", "2099-01-01T00:00:00Z"]);
    assert_eq!((lines.len(), code), (0, Some(0)));
    assert_eq!(said, "telltale: no messages of a are of this time\n");

    let file = hub.folder.path().join("a.jsonl");
    let words = ["--vehicle", "a", "--from", "0s", "-o", file.to_str().unwrap()];
    let (lines, _, code) = hub.export(&words);
    assert_eq!((lines.len(), code), (0, Some(0)));
    let written = fs::read_to_string(&file).unwrap();
    assert!(written.lines().count() == 7 && written.ends_with("}\n"), "{written}");
    let (_, error, code) = hub.export(&words);
    assert!(code == Some(2) && error.contains("there is a file already. Name another one"), "{error}");
}

#[tokio::test]
async fn what_the_hub_no_longer_keeps_and_what_it_holds_that_is_no_log_is_said() {
    let hub = Hub::start().await;
    let began = now_ms();
    // The beginning of the log is gone, and the vehicle's clock is an hour ahead.
    let ahead = began + 3_600_000;
    hub.tell(&[vec![record(ahead, 101), record(ahead, 102)]]).await;
    let from = time(ahead + 100 * 60_000);
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", &from]);
    assert_eq!(places(&lines), [("gap", 1), ("audit_head", 101), ("audit_head", 102)]);
    assert_eq!(lines[0]["to"], 100);
    assert!(code == Some(0) && said.contains("100 messages are missing"), "{said}");
    assert!(said.contains("keeps nothing of a from before"), "{said}");
    let key = Identity::read(&hub.file("a.nk")).unwrap();
    let line = Line::open(&hub.address(), &VehicleId::new("a").unwrap(), &key).await.unwrap();
    assert!(matches!(line.requests().log(1, b"no batch".to_vec()).await, Answer::Stored(2)));
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", "0s"]);
    assert_eq!((lines.len(), code), (3, Some(0)));
    assert!(said.contains("One part of the log cannot be read."), "{said}");
}

#[tokio::test]
async fn more_than_is_read_at_once_is_cut_and_the_rest_is_asked_for() {
    let hub = Hub::start().await;
    let began = now_ms() - 20_000 * 60_000;
    let all: Vec<Message> = (1..=10_001).map(|n| record(began, n)).collect();
    hub.tell(&all.chunks(4096).map(<[Message]>::to_vec).collect::<Vec<_>>()).await;
    let (lines, said, code) = hub.export(&["--vehicle", "a", "--from", "0s"]);
    assert_eq!((lines.len(), code), (10_000, Some(1)));
    let last = time(began + 10_000 * 60_000);
    assert!(said.contains(&format!("there is more: go on with --from {last}")), "{said}");
    let (lines, _, code) = hub.export(&["--vehicle", "a", "--from", &last]);
    assert_eq!((places(&lines), code), (vec![("audit_head", 10_000), ("audit_head", 10_001)], Some(0)));
}

#[tokio::test]
async fn what_keeps_an_export_from_its_log_is_said_with_what_to_do() {
    let mut hub = Hub::start().await;
    let began = now_ms();
    hub.tell(&[vec![record(began, 1)]]).await;
    let fails = |words: &[&str], expected: &[&str]| {
        let (lines, error, code) = hub.export(words);
        assert!(lines.is_empty() && code == Some(2), "{words:?}: {error}");
        for expected in expected {
            assert!(error.contains(expected), "{words:?}: {error}");
        }
    };
    let all = ["--vehicle", "a", "--from", "0s"];
    fails(&["--vehicle", "b", "--from", "0s"], &["keeps no log of b", "`telltale fleet list`"]);
    fails(&["--vehicle", "A", "--from", "0s"], &["small letters"]);
    fails(&["--vehicle", "a", "--from", "yesterday"], &["write `12s` or `2026-11-20T12:00:00Z`"]);
    let order = ["--vehicle", "a", "--from", "2026-11-20T12:00:00Z", "--to", "2026-11-20T11:00:00Z"];
    fails(&order, &["--from 2026-11-20T12:00:00.000Z is later than --to 2026-11-20T11:00:00.000Z"]);
    fails(&["--vehicle", "a", "--from", "9s", "--to", "8s"], &["is later than --to"]);
    let path = |name: &str| hub.file(name).to_str().unwrap().to_owned();
    let with_key =
        |file: &str, expected: &[&str]| fails(&[&all[..], &["--credentials", file]].concat(), expected);
    with_key(&path("none.nk"), &["none.nk"]);
    // One of a vehicle, which is admitted, and one of nobody.
    let of_vehicle = path("b.nk");
    with_key(&of_vehicle, &["lets the key", "read no logs", "console.nk"]);
    let stranger = path("stranger.nk");
    Identity::make(&hub.file("stranger.nk")).unwrap();
    with_key(&stranger, &["stranger.nk read no logs", "console.nk"]);
    // The certificate of another hub.
    let other = hub.folder.path().join("other");
    said(&run(["fleet", "hub-config", other.to_str().unwrap()]));
    let ca = other.join("hub.pem");
    fails(&[&all[..], &["--ca", ca.to_str().unwrap()]].concat(), &["cannot be read", "--ca"]);

    let console = Identity::read(&hub.file("console.nk")).unwrap();
    let logs = Logs::open(&hub.address(), &console).await.unwrap();
    hub.kill();
    assert!(logs.last(&VehicleId::new("a").unwrap()).await.is_err());
    let (lines, error, code) = hub.export(&all);
    assert!(lines.is_empty() && code == Some(2), "{error}");
    let away = format!("the hub {} cannot be read", hub.url);
    assert!(error.contains(&away) && error.contains("Look whether nats-server runs there"), "{error}");
}
