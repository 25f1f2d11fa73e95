//! Bounds on the cost of a client: slow heads and bodies, many connections, many logins at once.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use axum::http::{Method, StatusCode};
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_store::audit::{Action, Record, TELLTALE};
use telltale_web::Peer;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::access::HEADERS;
use crate::connections::sockets::{Server, next_json};
use crate::fixture::{Fixture, as_program, form_request, request};
use crate::folder::TestFolder;

/// A little more than a connection has for its head.
const PATIENCE: Duration = Duration::from_secs(14);

/// Reads until the server closes, and returns the bytes.
async fn rest(mut stream: TcpStream) -> String {
    let mut said = Vec::new();
    // A connection that is reset is over too.
    let _ = timeout(PATIENCE, stream.read_to_end(&mut said)).await.expect("the server ends it in time");
    String::from_utf8_lossy(&said).into_owned()
}

#[tokio::test]
async fn who_speaks_too_slowly_or_too_much_is_cut_off_and_others_are_served() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let host = format!("host: {}\r\n", server.address);
    let form = "content-type: application/x-www-form-urlencoded\r\n";
    let origin = format!("origin: http://{}\r\n", server.address);
    let beginnings = [
        String::new(),
        "GET /login HTTP/1.1\r\n".to_owned(),
        format!("GET /login HTTP/1.1\r\n{host}x-a: b\r\n"),
        format!("POST /login HTTP/1.1\r\n{host}{origin}{form}content-length: 100\r\n\r\nname=a"),
        format!(
            "POST /login HTTP/1.1\r\n{host}{origin}{form}transfer-encoding: chunked\r\n\r\n4\r\nname\r\n"
        ),
    ];
    let mut slow = Vec::new();
    for beginning in &beginnings {
        for _ in 0..20 {
            let mut stream = TcpStream::connect(server.address).await.unwrap();
            stream.write_all(beginning.as_bytes()).await.unwrap();
            slow.push(stream);
        }
    }
    let mut page = server.connect("/ws", &cookie).await;
    next_json(&mut page, |value| value["beat"].as_u64() > Some(1)).await;
    for (index, stream) in slow.into_iter().enumerate().filter(|(index, _)| index % 20 == 0) {
        let said = rest(stream).await;
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 408"), "{index}: {said}");
    }
    let large = format!("POST /login HTTP/1.1\r\n{host}{origin}{form}content-length: 99999999\r\n\r\n");
    for (head, status) in [
        (format!("GET /login HTTP/1.1\r\n{host}x-a: {}\r\n\r\n", "x".repeat(500 * 1024)), "4"),
        (format!("GET /{} HTTP/1.1\r\n{host}\r\n", "x".repeat(500 * 1024)), "4"),
        (large, "413"),
        ("\u{0}\u{1}\u{2}\r\n\r\n".to_owned(), "4"),
    ] {
        let mut stream = TcpStream::connect(server.address).await.unwrap();
        // The server may close before it has read all.
        let _ = stream.write_all(head.as_bytes()).await;
        let said = rest(stream).await;
        assert!(said.is_empty() || said.starts_with(&format!("HTTP/1.1 {status}")), "{said}");
        // The HTTP library's own answers have no content, so nothing that the headers would protect.
        let is_bare = said.is_empty()
            || said.contains("\r\ncontent-length: 0\r\n") && said.contains("\r\nconnection: close\r\n");
        for (name, value) in HEADERS.into_iter().filter(|_| !is_bare) {
            assert!(said.contains(&format!("\r\n{name}: {value}\r\n")), "{name}: {said}");
        }
    }
    next_json(&mut page, |value| value.get("beat").is_some()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hundred_logins_at_once_delay_no_change_of_a_state() {
    const LOGINS: u32 = 100;
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut page = server.connect("/api/v1/stream", &cookie).await;
    let hashes = Arc::new(AtomicU32::new(0));
    let logins: Vec<_> = (0..LOGINS)
        .map(|number| {
            let (router, hashes) = (server.fixture.router.clone(), hashes.clone());
            tokio::spawn(async move {
                let form = format!("name=user-{number}&secret=a+wrong+password");
                let mut login = form_request("/login", None, &form);
                let source = IpAddr::from((0x0a00_0000 + number).to_be_bytes());
                login.extensions_mut().insert(Peer(SocketAddr::from((source, 1))));
                let status = tower::ServiceExt::oneshot(router, as_program(login)).await.unwrap().status();
                hashes.fetch_add(u32::from(status == StatusCode::UNAUTHORIZED), Ordering::Relaxed);
                status
            })
        })
        .collect();
    let own = tokio::spawn({
        let router = server.fixture.router.clone();
        let login = as_program(form_request("/login", None, "name=operator&secret=246810"));
        async move {
            let status = tower::ServiceExt::oneshot(router, login).await.unwrap().status();
            (status, hashes.load(Ordering::Relaxed))
        }
    });
    let mut changes = 0;
    let mut level = 0;
    let deadline = server.fixture.clock.now() + Span::from_secs(120);
    while logins.iter().any(|login| !login.is_finished()) {
        assert!(server.fixture.clock.now() < deadline, "the logins are not answered");
        level = 2 - level;
        let state = if level == 2 { State::Error } else { State::Ok }.as_str();
        server.fixture.status("lidar", level, "it changes").await;
        let is_there = |value: &serde_json::Value| value["groups"][0]["modules"][0]["state"] == state;
        next_json(&mut page, is_there).await;
        changes += 1;
    }
    let mut answers = std::collections::BTreeMap::new();
    for login in logins {
        *answers.entry(login.await.unwrap()).or_insert(0) += 1;
    }
    // Some wait for their hash; the bounds of the queue and of the time refuse the rest.
    let known = [StatusCode::UNAUTHORIZED, StatusCode::REQUEST_TIMEOUT, StatusCode::SERVICE_UNAVAILABLE];
    assert!(answers.keys().all(|status| known.contains(status)), "{answers:?}");
    let hashed = answers[&StatusCode::UNAUTHORIZED];
    // A change that had to wait for hashes would see several of them end.
    assert!(changes > hashed, "{changes} changes during {hashed} hashes, {answers:?}");
    let (status, before) = own.await.unwrap();
    assert_eq!(status, StatusCode::OK);
    assert!(
        before < hashed / 2,
        "the vehicle's own display does not wait for those from outside: {before} of {hashed} were first"
    );
}

#[tokio::test]
async fn what_nobody_reads_is_held_by_the_kernel_within_bounds() {
    /// What waits there if the client reads nothing, and at most.
    const HELD: std::ops::Range<u64> = 256 << 10..1 << 20;
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let _unread = server.connect("/api/v1/stream", &cookie).await;
    let mut reader = server.connect("/api/v1/stream", &cookie).await;
    let mut held = 0;
    // More than the kernel would hold by itself.
    for round in 0..20 {
        let message = format!("{round}x{}", "y".repeat(4000));
        for name in 0..100 {
            server.fixture.status(&format!("big {name}"), round % 2, &message).await;
        }
        server.fixture.status("lidar", 2 * (round % 2), &message).await;
        let start = format!("{round}x");
        let is_new = |value: &serde_json::Value| {
            value["groups"][0]["modules"][0]["message"].as_str().is_some_and(|text| text.starts_with(&start))
        };
        next_json(&mut reader, is_new).await;
        held = held.max(send_queue(server.address));
    }
    assert!(HELD.contains(&held), "{held} bytes wait for one that does not read");
}

/// The most bytes that wait in one connection of this server to be taken by its client.
fn send_queue(address: SocketAddr) -> u64 {
    let table = std::fs::read_to_string("/proc/net/tcp").expect("Linux tells of its sockets");
    let local = format!(":{:04X}", address.port());
    let queues = table.lines().skip(1).filter_map(|line| {
        let mut words = line.split_whitespace();
        let is_ours = words.nth(1)?.ends_with(&local);
        let (sending, _) = words.nth(2)?.split_once(':')?;
        is_ours.then(|| u64::from_str_radix(sending, 16).ok())?
    });
    queues.max().unwrap_or(0)
}

#[tokio::test]
async fn a_flood_of_connections_leaves_the_page_alive() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut page = server.connect("/ws", &cookie).await;
    let mut idle = Vec::new();
    for _ in 0..600 {
        match timeout(Duration::from_millis(200), TcpStream::connect(server.address)).await {
            Ok(Ok(stream)) => idle.push(stream),
            _ => break,
        }
    }
    next_json(&mut page, |value| value["beat"].as_u64() > Some(2)).await;
    let open = server.app.connections.count();
    assert!(open <= 100, "96 without a session, and those of the page, not {open} of {}", idle.len());
    drop(idle);
    let fixture: &Fixture = &server.fixture;
    assert_eq!(fixture.get("/healthz", None).await.status, StatusCode::OK);
}

#[tokio::test]
async fn silent_connections_make_no_request_wait() {
    const SILENT: usize = 300;
    let server = Server::new().await;
    let mut silent = Vec::new();
    let post = format!(
        "POST /login HTTP/1.1\r\nhost: {0}\r\norigin: http://{0}\r\naccept: application/json\r\n\
         content-type: application/x-www-form-urlencoded\r\nconnection: close\r\ncontent-length: 2\r\n\r\na=",
        server.address
    );
    for round in 0..3 {
        for _ in 0..SILENT / 3 {
            silent.push(TcpStream::connect(server.address).await.unwrap());
        }
        let sent = server.fixture.clock.now();
        let mut own = TcpStream::connect(server.address).await.unwrap();
        own.write_all(post.as_bytes()).await.unwrap();
        let said = rest(own).await;
        assert!(said.starts_with("HTTP/1.1 422"), "{said}");
        let took = server.fixture.clock.now().since(sent);
        assert!(took < Span::from_secs(3), "round {round}: {} ms", took.as_millis());
    }
    // Those that were silent longest gave their places away.
    assert_eq!(rest(silent.remove(0)).await, "");
}

#[tokio::test]
async fn what_is_too_large_or_malformed_is_told_in_words() {
    let fixture = Fixture::new().await;
    let long = format!("name=operator&secret={}", "1".repeat(20 * 1024));
    let page = fixture.send(form_request("/login", None, &long)).await;
    assert_eq!(
        (page.status, page.header("content-type")),
        (StatusCode::PAYLOAD_TOO_LARGE, Some("text/html; charset=utf-8"))
    );
    assert!(page.body.contains("at most 16 KiB") && page.header("content-security-policy").is_some());
    let json = fixture.send(as_program(form_request("/login", None, &long))).await;
    assert_eq!(
        (json.status, json.header("content-type")),
        (StatusCode::PAYLOAD_TOO_LARGE, Some("application/json"))
    );
    assert!(json.body.contains(r#"{"error":"Nothing was changed."#), "{}", json.body);
    let cookie = fixture.cookie_of("operator").await;
    let upgrade = fixture.get("/api/v1/stream", Some(&cookie)).await;
    assert_eq!(
        (upgrade.status, upgrade.header("content-type")),
        (StatusCode::UPGRADE_REQUIRED, Some("text/plain; charset=utf-8"))
    );
}

#[tokio::test]
async fn strangers_do_not_make_the_store_busy_for_the_operator() {
    let folder = TestFolder::new("bounds");
    let fixture = Fixture::in_folder(&folder).await;
    let cookie = fixture.cookie_of("operator").await;
    // The disk is slow for every write.
    let disk = rusqlite::Connection::open(folder.join("telltale.db")).unwrap();
    disk.execute_batch("BEGIN IMMEDIATE").unwrap();
    let record = Record::of(Action::Request, TELLTALE);
    let store = fixture.store.clone();
    let slow = tokio::spawn(async move { store.record(record, None).await });
    let ask = |request: axum::http::Request<axum::body::Body>| {
        let router = fixture.router.clone();
        tokio::spawn(async move { tower::ServiceExt::oneshot(router, request).await.unwrap().status() })
    };
    let strangers: Vec<_> = (0..400_u32)
        .map(|number| {
            let mut asked = match number % 3 {
                0 => request(Method::GET, "/readyz", None),
                1 => request(Method::GET, "/login", None),
                _ => form_request("/login", None, "name=operator&secret=a+wrong+password"),
            };
            let source = IpAddr::from((0x0a00_0000 + number).to_be_bytes());
            asked.extensions_mut().insert(Peer(SocketAddr::from((source, 1))));
            ask(asked)
        })
        .collect();
    let logout = ask(as_program(form_request("/logout", Some(&cookie), "")));
    // Each task runs until it waits.
    for _ in 0..100 {
        tokio::task::yield_now().await;
    }
    disk.execute_batch("COMMIT").unwrap();
    assert_eq!(logout.await.unwrap(), StatusCode::OK);
    slow.await.unwrap();
    for (number, stranger) in strangers.into_iter().enumerate() {
        let status = stranger.await.unwrap();
        assert!(number % 3 == 2 || status == StatusCode::OK, "{number}: {status}");
    }
}
