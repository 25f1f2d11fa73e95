//! Attacks that try to keep the operator's STOP from arriving: a STOP is requested during each of them.

use std::time::Duration;

use axum::http::StatusCode;
use futures_util::SinkExt;
use serde_json::{Value, json};
use telltale_store::Role;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::MaybeTlsStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;

use crate::connections::sockets::{Server, Socket, closed, next_json};
use crate::fixture::{Fixture, as_program, form_request, until};

/// The longest time that a busy machine may take for things that take a moment.
const PATIENCE: Duration = Duration::from_secs(10);

/// A vehicle that drives, and its operator's cookie.
async fn driving() -> (Server, String) {
    let server = Server::new().await;
    let operator = server.fixture.cookie_of("operator").await;
    server.fixture.drive(true).await;
    (server, operator)
}

/// The next message of a page.
fn version(server: &Server) -> u64 {
    let published = server.app.published();
    server.app.frames.observe(&published);
    published.snapshot.seq
}

/// A request as a browser sends it, over a connection of its own.
fn post(server: &Server, path: &str, cookie: Option<&str>, length: usize) -> String {
    let cookie = cookie.map(|cookie| format!("cookie: {cookie}\r\n")).unwrap_or_default();
    format!(
        "POST {path} HTTP/1.1\r\nhost: {0}\r\norigin: http://{0}\r\n{cookie}accept: application/json\r\n\
         content-type: application/x-www-form-urlencoded\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n",
        server.address
    )
}

/// A stranger who begins a login and does not finish it.
async fn begin_login(server: &Server) -> TcpStream {
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    stream.write_all((post(server, "/login", None, 100) + "name=a").as_bytes()).await.unwrap();
    stream
}

/// Everything that the server sends until it closes.
async fn rest(mut stream: TcpStream) -> String {
    let mut said = Vec::new();
    // A connection that is reset is over too.
    let _ = timeout(PATIENCE, stream.read_to_end(&mut said)).await.expect("the server answers");
    String::from_utf8_lossy(&said).into_owned()
}

/// A stop over a new connection.
async fn stop(server: &Server, operator: &str) -> String {
    let form = format!("version={}", version(server));
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let request = post(server, "/vehicle/stop", Some(operator), form.len()) + &form;
    stream.write_all(request.as_bytes()).await.unwrap();
    rest(stream).await
}

#[tokio::test]
async fn a_stop_gets_through_beside_logins_that_are_begun_and_not_ended() {
    const BEGUN: usize = 128;
    let (server, operator) = driving().await;
    let mut begun: Vec<TcpStream> = Vec::new();
    for round in 0..5 {
        begun.clear();
        for _ in 0..BEGUN {
            begun.push(begin_login(&server).await);
        }
        let said = stop(&server, &operator).await;
        assert!(said.starts_with("HTTP/1.1 200"), "round {round}: {said:?}");
    }
}

#[tokio::test]
async fn a_login_that_is_not_ended_is_cut_off_soon() {
    let (server, operator) = driving().await;
    let sent = server.fixture.clock.now();
    let said = rest(begin_login(&server).await).await;
    let took = server.fixture.clock.now().since(sent);
    assert!(said.starts_with("HTTP/1.1 408"), "{said:?}");
    // Two seconds, and what a busy machine adds; a client with a session has ten.
    assert!(took.as_millis() < 8_000, "{} ms", took.as_millis());
    assert!(stop(&server, &operator).await.starts_with("HTTP/1.1 200"));
}

async fn say(socket: &mut Socket, what: &Value) {
    socket.send(Message::text(what.to_string())).await.unwrap();
}

async fn answered(socket: &mut Socket, tap: &str) -> Value {
    next_json(socket, |value| value["tap"] == tap).await
}

async fn stops_recorded(fixture: &Fixture) -> Vec<String> {
    let entries = fixture.store.audit_entries(None, 100).await.unwrap();
    entries.into_iter().filter(|entry| entry.action == "stop").map(|entry| entry.outcome).collect()
}

#[tokio::test]
async fn a_stop_over_the_socket_is_a_tap_and_over_both_ways_is_one() {
    let (server, operator) = driving().await;
    let mut page = server.connect("/ws", &operator).await;
    let shown = version(&server);
    say(&mut page, &json!({ "stop": { "version": shown, "tap": "first" } })).await;
    let first = answered(&mut page, "first").await;
    assert_eq!((&first["status"], &first["said"]), (&json!(200), &json!({})), "{first}");
    server.fixture.until(|snapshot| !snapshot.countermeasures.is_empty()).await;
    // The same tap over HTTP, which the server behind the socket answers.
    let form = format!("version={shown}&tap=first");
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let request = post(&server, "/vehicle/stop", Some(&operator), form.len()) + &form;
    stream.write_all(request.as_bytes()).await.unwrap();
    let same = rest(stream).await;
    assert!(same.starts_with("HTTP/1.1 200"), "{same}");
    assert_eq!(stops_recorded(&server.fixture).await, ["done"]);
    // Another tap counts too, whatever was shown.
    say(&mut page, &json!({ "stop": { "version": 0, "tap": "second" } })).await;
    assert_eq!(answered(&mut page, "second").await["status"], json!(200));
    say(&mut page, &json!({ "stop": { "version": version(&server), "tap": "x".repeat(65) } })).await;
    let long = next_json(&mut page, |value| value.get("tap").is_some()).await;
    assert_eq!(long["status"], json!(422), "{long}");
}

#[tokio::test]
async fn a_user_who_is_not_in_charge_stops_nothing_over_a_socket() {
    let (server, operator) = driving().await;
    let shown = version(&server);
    let stop = json!({ "stop": { "version": shown, "tap": "first" } });
    for (name, path) in [("authority", "/ws"), ("developer", "/ws"), ("operator", "/api/v1/stream")] {
        let cookie = if name == "operator" { operator.clone() } else { server.fixture.cookie_of(name).await };
        let mut page = server.connect(path, &cookie).await;
        say(&mut page, &stop).await;
        assert_eq!(closed(&mut page).await, CloseCode::Unsupported, "{name}");
    }
    for nonsense in [json!({ "stop": { "version": shown } }), json!({ "stop": { "tap": 7 } })] {
        let mut page = server.connect("/ws", &operator).await;
        say(&mut page, &nonsense).await;
        assert_eq!(closed(&mut page).await, CloseCode::Unsupported, "{nonsense}");
    }
    server.fixture.drive(false).await;
    server.fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let mut page = server.connect("/ws", &operator).await;
    let login = as_program(form_request("/login", None, "name=bert&secret=975310&take_over=1"));
    assert_eq!(server.fixture.send(login).await.status, StatusCode::OK);
    // The server may have closed it already.
    let _ = page.send(Message::text(stop.to_string())).await;
    assert_eq!(closed(&mut page).await, CloseCode::Policy);
    assert!(stops_recorded(&server.fixture).await.is_empty());
}

/// Writes bytes without the client's WebSocket library.
async fn write_raw(socket: &mut Socket, bytes: &[u8]) -> std::io::Result<()> {
    let MaybeTlsStream::Plain(stream) = socket.get_mut() else { panic!("it is plain") };
    stream.write_all(bytes).await
}

/// A masked frame of a client.
fn frame(first: u8, payload: &[u8]) -> Vec<u8> {
    let length = 0x80 | u8::try_from(payload.len()).unwrap();
    [&[first, length, 0, 0, 0, 0], payload].concat()
}

async fn floods_recorded(fixture: &Fixture) -> usize {
    let entries = fixture.store.audit_entries(None, 100).await.unwrap();
    entries.iter().filter(|entry| entry.target == "socket" && entry.outcome.contains("more than")).count()
}

#[tokio::test]
async fn a_client_that_sends_empty_fragments_without_an_end_is_closed_and_delays_nobody() {
    const FLOODS: usize = 12;
    let (server, operator) = driving().await;
    let mut page = server.connect("/ws", &operator).await;
    let authority = server.fixture.cookie_of("authority").await;
    let mut floods: Vec<Socket> = Vec::new();
    for _ in 0..FLOODS {
        floods.push(server.connect("/ws", &authority).await);
    }
    assert_eq!(server.app.displays.count(), FLOODS + 1);
    let fragments = frame(0x00, b"").repeat(20_000);
    for flood in &mut floods {
        write_raw(flood, &frame(0x01, b"")).await.unwrap();
        // The server may be done with it before it has read all.
        let _ = write_raw(flood, &fragments).await;
    }
    assert!(stop(&server, &operator).await.starts_with("HTTP/1.1 200"));
    until(async || server.app.displays.count() == 1).await;
    until(async || floods_recorded(&server.fixture).await == FLOODS).await;
    next_json(&mut page, |value| value.get("beat").is_some()).await;
}

#[tokio::test]
async fn a_client_that_pings_and_reads_nothing_is_closed() {
    let (server, _) = driving().await;
    let authority = server.fixture.cookie_of("authority").await;
    let mut silent = server.connect("/ws", &authority).await;
    // Little enough for its budget.
    let ping = frame(0x89, &[b'x'; 125]);
    until(async || {
        let _ = write_raw(&mut silent, &ping).await;
        server.app.displays.count() == 0
    })
    .await;
    assert_eq!(floods_recorded(&server.fixture).await, 0);
}

#[tokio::test]
async fn before_a_hand_over_while_it_drives_the_page_says_so_and_both_can_stop_it() {
    let (fixture, hand) = Fixture::with_hand().await;
    let store = fixture.store.clone();
    store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let server = Server::with(fixture, store).await;
    let driver = server.fixture.cookie_of("operator").await;
    server.fixture.drive(true).await;
    let mut page = server.connect("/ws", &driver).await;
    let form = "name=bert&secret=975310&take_over=1";
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    stream.write_all((post(&server, "/login", None, form.len()) + form).as_bytes()).await.unwrap();
    let said = rest(stream).await;
    let next = said.split("set-cookie: ").nth(1).and_then(|it| it.split(';').next()).unwrap().to_owned();
    let told = next_json(&mut page, |value| value.get("hand_over").is_some()).await;
    assert!(told["hand_over"].as_str().unwrap().starts_with("bert takes your place in 5 s."), "{told}");
    // A page that opens now says so too.
    let mut new = server.connect("/ws?lang=de", &next).await;
    let told = next_json(&mut new, |value| value.get("hand_over").is_some()).await;
    assert!(told["hand_over"].as_str().unwrap().starts_with("bert löst Sie in 5 s ab."), "{told}");
    for cookie in [&next, &driver] {
        let said = stop(&server, cookie).await;
        assert!(said.starts_with("HTTP/1.1 200"), "{said}");
    }
    hand.advance(telltale_engine::time::Span::from_secs(5));
    server.fixture.until(|snapshot| snapshot.operator.as_deref() == Some("bert")).await;
    assert_eq!(closed(&mut page).await, CloseCode::Policy);
    let told = next_json(&mut new, |value| value.get("hand_over").is_some()).await;
    assert_eq!(told["hand_over"], Value::Null);
    assert!(stop(&server, &next).await.starts_with("HTTP/1.1 200"));
}
