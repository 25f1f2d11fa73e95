//! Live connections over real sockets on a free port.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use axum::http::Method;
use futures_util::{FutureExt as _, SinkExt, StreamExt};
use serde_json::Value;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_store::{DemoSecrets, Role, Store, Token};
use telltale_web::texts::Lang;
use telltale_web::view::{Fragment, fragments};
use telltale_web::{AppState, Origins, Peer, Settings, Source, serve};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{self, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

use crate::fixture::{Fixture, settled};
use crate::folder::TestFolder;

const PATIENCE: Duration = Duration::from_secs(5);

/// The fixture's vehicle behind a listener.
pub struct Server {
    pub fixture: Fixture,
    pub app: AppState,
    pub address: SocketAddr,
    pub shutdown: oneshot::Sender<()>,
    pub served: tokio::task::JoinHandle<std::io::Result<Instant>>,
}

pub type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

impl Server {
    pub async fn new() -> Server {
        let fixture = Fixture::new().await;
        let store = fixture.store.clone();
        Server::with(fixture, store).await
    }

    pub async fn with(fixture: Fixture, store: Store) -> Server {
        let link = fixture.link.clone();
        Server::showing(link, fixture, store).await
    }

    /// Shows another source than the fixture's engine.
    pub async fn showing(source: impl Into<Source>, fixture: Fixture, store: Store) -> Server {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let settings = Settings::plain(Origins::of_listener(address, false), false);
        let app = AppState::new(source, store, fixture.clock, settings);
        let (shutdown, ended) = oneshot::channel::<()>();
        let clock = fixture.clock;
        let served = tokio::spawn(serve(listener, None, app.clone(), async move {
            let _ = ended.await;
            clock.instant(clock.now())
        }));
        Server { fixture, app, address, shutdown, served }
    }

    pub fn origin(&self) -> String {
        format!("http://{}", self.address)
    }

    pub async fn try_connect(
        &self,
        path: &str,
        headers: &[(&'static str, &str)],
    ) -> Result<Socket, StatusCode> {
        let mut request = format!("ws://{}{path}", self.address).into_client_request().unwrap();
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().unwrap());
        }
        match connect_async(request).await {
            Ok((socket, _)) => Ok(socket),
            Err(tungstenite::Error::Http(answer)) => Err(answer.status()),
            Err(error) => panic!("{error}"),
        }
    }

    pub async fn connect(&self, path: &str, cookie: &str) -> Socket {
        self.try_connect(path, &[("cookie", cookie), ("origin", &self.origin())]).await.unwrap()
    }

    pub async fn break_lidar(&self) {
        self.fixture.status("lidar", 2, "no packets").await;
        self.fixture.until(|snapshot| snapshot.overall == State::Error).await;
    }
}

async fn next(socket: &mut Socket) -> Option<Message> {
    timeout(PATIENCE, socket.next()).await.expect("a message comes in time").map(Result::unwrap)
}

/// The next JSON message that meets the condition.
pub async fn next_json(socket: &mut Socket, condition: impl Fn(&Value) -> bool) -> Value {
    let fits = async {
        loop {
            if let Message::Text(text) = next(socket).await.expect("the socket is open") {
                let value: Value = serde_json::from_str(&text).unwrap();
                if condition(&value) {
                    return value;
                }
            }
        }
    };
    // Others keep coming.
    timeout(8 * PATIENCE, fits).await.expect("a message that fits comes in time")
}

pub async fn next_content(socket: &mut Socket) -> Value {
    next_json(socket, |value| value.get("content").is_some()).await
}

/// Reads until the server closes, and returns the reason.
pub async fn closed(socket: &mut Socket) -> CloseCode {
    loop {
        if let Message::Close(frame) = next(socket).await.expect("a close frame comes first") {
            return frame.expect("it has a reason").code;
        }
    }
}

fn shown(server: &Server, lang: Lang) -> Vec<Fragment> {
    let published = server.app.published();
    fragments(&published, &server.app.frames.observe(&published), lang, &server.app.trends)
}

/// The visible parts in one piece, and the hidden parts by their ids.
fn apart(fragments: &[Fragment]) -> (String, serde_json::Map<String, Value>) {
    let is_behind = |it: &&Fragment| it.id.starts_with("detail-") || it.id.starts_with("all-");
    let (behind, front): (Vec<&Fragment>, Vec<&Fragment>) = fragments.iter().partition(is_behind);
    let by_id = behind.into_iter().map(|it| (it.id.clone(), Value::from(it.html.as_str())));
    (front.into_iter().map(|it| it.html.as_str()).collect(), by_id.collect())
}

#[tokio::test]
async fn an_upgrade_needs_a_session_and_an_origin_of_ours() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let own = server.origin();
    let suffix = format!("{own}.evil.example");
    let other_port = format!("http://127.0.0.1:{}", server.address.port() ^ 1);
    let forged = format!("telltale={}", "0".repeat(64));
    let bearer = format!("Bearer {}", cookie.split_once('=').unwrap().1);
    let (cookie, own) = (cookie.as_str(), own.as_str());
    for path in ["/ws", "/api/v1/stream"] {
        for (headers, refused) in [
            (vec![], Some(StatusCode::UNAUTHORIZED)),
            (vec![("origin", own)], Some(StatusCode::UNAUTHORIZED)),
            (vec![("origin", own), ("cookie", &forged)], Some(StatusCode::UNAUTHORIZED)),
            (vec![("cookie", cookie)], Some(StatusCode::FORBIDDEN)),
            (vec![("cookie", cookie), ("origin", "null")], Some(StatusCode::FORBIDDEN)),
            (vec![("cookie", cookie), ("origin", &suffix)], Some(StatusCode::FORBIDDEN)),
            (vec![("cookie", cookie), ("origin", &other_port)], Some(StatusCode::FORBIDDEN)),
            (vec![("cookie", cookie), ("origin", own)], None),
            (vec![("authorization", &bearer)], None),
        ] {
            let connected = server.try_connect(path, &headers).await;
            assert_eq!(connected.err(), refused, "{path} {headers:?}");
        }
    }
}

#[tokio::test]
async fn a_lone_change_brings_the_panel_behind_its_tile() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut page = server.connect("/ws", &cookie).await;
    let whole = next_content(&mut page).await;
    server.break_lidar().await;
    let change = next_content(&mut page).await;
    assert!(change["seq"].as_u64() > whole["seq"].as_u64());
    let panel = change["behind"]["detail-sensors"].as_str().unwrap_or_default();
    assert!(panel.contains("no packets"), "{change}");
}

#[tokio::test]
async fn a_page_gets_everything_once_and_then_what_changed() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    for (path, lang) in [("/ws", Lang::En), ("/ws?lang=de", Lang::De)] {
        let message = format!("fine, {path}");
        server.fixture.status("lidar", 0, &message).await;
        server.fixture.until(|snapshot| *snapshot.modules[0].report.message == *message).await;
        let before = shown(&server, lang);
        let mut socket = server.connect(path, &cookie).await;
        let full = next_content(&mut socket).await;
        let (front, behind) = apart(&before);
        assert_eq!(full["content"].as_str(), Some(front.as_str()));
        assert_eq!(full["behind"].as_object(), Some(&behind));
        assert_eq!(full["seq"].as_u64(), Some(server.app.published().snapshot.seq));

        server.fixture.drive(true).await;
        let after = shown(&server, lang);
        let changed: Vec<Fragment> = after.into_iter().filter(|it| !before.contains(it)).collect();
        let changed = apart(&changed);
        // The hidden parts may come a little later.
        let mut got = (String::new(), serde_json::Map::new());
        while got.0.len() < changed.0.len() || got.1.len() < changed.1.len() {
            let step = next_json(&mut socket, |value| value.get("beat").is_none()).await;
            got.0 += step["content"].as_str().unwrap_or_default();
            got.1.extend(step["behind"].as_object().cloned().unwrap_or_default());
            assert!(step["seq"].as_u64() > full["seq"].as_u64());
        }
        assert_eq!(got, changed);
        server.fixture.drive(false).await;
    }
}

#[tokio::test]
async fn beats_count_up_and_time_alone_sends_no_page() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("developer").await;
    let mut socket = server.connect("/ws", &cookie).await;
    let full = next_content(&mut socket).await;
    for number in 1..=4 {
        let beat = next_json(&mut socket, |_| true).await;
        assert_eq!((beat["beat"].as_u64(), &beat["seq"]), (Some(number), &full["seq"]), "{beat}");
        assert!(beat["at"].as_str().unwrap().ends_with('Z') && beat.get("content").is_none());
    }
}

#[tokio::test]
async fn the_first_change_of_a_state_waits_for_no_pause() {
    // No pause ends.
    let (fixture, hand, _timers) = Fixture::without_time().await;
    let store = fixture.store.clone();
    let cookie = fixture.cookie_of("operator").await;
    let server = Server::with(fixture, store).await;
    let mut page = server.connect("/ws", &cookie).await;
    next_content(&mut page).await;
    for round in 0..6 {
        hand.advance(Span::from_millis(200));
        let (level, own) = if round % 2 == 0 { (2, State::Error) } else { (0, State::Ok) };
        // Words go with the next state.
        server.fixture.status("imu", 0, &format!("fine, round {round}")).await;
        server.fixture.status("lidar", level, "no packets").await;
        let seq = server.fixture.until(|it| it.modules[0].own == own).await.seq;
        let shown = next_json(&mut page, |it| it["seq"].as_u64() >= Some(seq)).await;
        assert!(shown.get("content").is_some(), "{shown}");
    }
}

#[tokio::test]
async fn a_change_of_a_state_waits_for_no_tick() {
    let (fixture, hand, _timers) = Fixture::without_time().await;
    let store = fixture.store.clone();
    let cookie = fixture.cookie_of("operator").await;
    let server = Server::with(fixture, store).await;
    let mut page = server.connect("/ws", &cookie).await;
    next_content(&mut page).await;
    for round in 0..4 {
        // The pause ends, and all that was due is done.
        hand.advance(Span::from_millis(200));
        tokio::time::advance(Duration::from_secs(1)).await;
        settled().await;
        let (level, own) = if round % 2 == 0 { (2, State::Error) } else { (0, State::Ok) };
        server.fixture.status("lidar", level, "no packets").await;
        let seq = server.fixture.until(|it| it.modules[0].own == own).await.seq;
        // No time passes, so no tick comes.
        let mut is_shown = false;
        for _ in 0..50 {
            settled().await;
            while let Some(Some(Ok(Message::Text(text)))) = page.next().now_or_never() {
                let value: Value = serde_json::from_str(&text).unwrap();
                is_shown |= value["seq"].as_u64() >= Some(seq) && value.get("content").is_some();
            }
            if is_shown {
                break;
            }
        }
        assert!(is_shown, "round {round}: {own:?} waits for a tick");
    }
}

#[tokio::test]
async fn a_client_that_does_not_read_is_closed_and_delays_nobody() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut silent = Vec::new();
    for path in ["/ws", "/api/v1/stream", "/api/v1/stream"] {
        silent.push(server.connect(path, &cookie).await);
    }
    let mut reader = server.connect("/api/v1/stream", &cookie).await;
    // Far more than the sockets' buffers hold, so that clients that do not read are stuck.
    for round in 0..20 {
        let message = format!("{round}{}", "x".repeat(4000));
        for name in 0..100 {
            server.fixture.status(&format!("big {name}"), round % 2, &message).await;
        }
        let level = if round % 2 == 0 { 2 } else { 0 };
        server.fixture.status("lidar", level, &message).await;
        let sent_at = server.fixture.clock.now();
        let is_new = |snapshot: &Value| {
            let text = snapshot["groups"][0]["modules"][0]["message"].as_str();
            text.is_some_and(|text| text.starts_with(&format!("{round}x")))
        };
        next_json(&mut reader, is_new).await;
        let took = server.fixture.clock.now().since(sent_at);
        assert!(took.as_millis() < 1000, "round {round} took {} ms", took.as_millis());
    }
    let deadline = server.fixture.clock.now() + telltale_engine::time::Span::from_secs(12);
    while server.app.displays.count() > 1 {
        assert!(server.fixture.clock.now() < deadline, "{} sockets open", server.app.displays.count());
        next_json(&mut reader, |_| true).await;
    }
}

#[tokio::test]
async fn a_socket_ends_with_its_session() {
    for how in ["logout", "passwd", "role", "remove"] {
        let server = Server::new().await;
        let cookie = server.fixture.cookie_of("operator").await;
        let bystander = server.fixture.cookie_of("developer").await;
        let mut sockets =
            [server.connect("/ws", &cookie).await, server.connect("/api/v1/stream", &cookie).await];
        let mut other = server.connect("/ws", &bystander).await;
        for socket in &mut sockets {
            next_json(socket, |_| true).await;
        }
        let store = &server.fixture.store;
        match how {
            "logout" => drop(server.fixture.post("/logout", Some(&cookie), "").await),
            "passwd" => store.change_secret("operator", "135791").await.unwrap(),
            "role" => store.change_role("operator", Role::Authority, "a long password").await.unwrap(),
            _ => store.remove_user("operator").await.unwrap(),
        }
        for socket in &mut sockets {
            let closed = timeout(Duration::from_secs(1), closed(socket)).await.expect("within a second");
            assert_eq!(closed, CloseCode::Policy, "{how}");
            assert!(next(socket).await.is_none());
        }
        // Nobody leads the vehicle.
        server.fixture.until(|snapshot| snapshot.stage == Stage::Locked).await;
        next_json(&mut other, |value| value.get("beat").is_some()).await;
    }
}

#[tokio::test]
async fn a_socket_ends_when_another_process_removes_its_user() {
    let folder = TestFolder::new("web");
    let fixture = Fixture::new().await;
    let clock = fixture.clock;
    let store = Store::open(&folder, clock, DemoSecrets::Accepted).unwrap();
    store.add_demo_users().await.unwrap();
    let user = store.authenticate("developer", "demo-developer").await.unwrap().unwrap();
    let (token, _) = store.open_session(&user).await.unwrap();
    let server = Server::with(fixture, store).await;
    let mut socket = server.connect("/ws", &format!("telltale={}", token.as_str())).await;
    next_content(&mut socket).await;

    let other = Store::open(&folder, clock, DemoSecrets::Refused).unwrap();
    other.remove_user("developer").await.unwrap();
    let closed = timeout(Duration::from_secs(1), closed(&mut socket)).await.expect("within a second");
    assert_eq!(closed, CloseCode::Policy);
    assert!(server.app.session(&Token::parse(token.as_str()).unwrap()).is_none());
}

#[tokio::test]
async fn a_page_may_say_what_it_shows_and_nothing_else() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let token = Token::parse(cookie.split_once('=').unwrap().1).unwrap();
    let session = server.app.session(&token).unwrap();
    let mut socket = server.connect("/ws", &cookie).await;
    let seq = next_content(&mut socket).await["seq"].as_u64().unwrap();
    assert_eq!(server.app.displays.shows_as_of(&session), None);
    socket.send(Message::text(format!("{{\"shown\":{seq}}}"))).await.unwrap();
    socket.send(Message::text("{\"shown\":0}")).await.unwrap();
    // A page may speak with more words than are needed.
    socket.send(Message::text(format!("{{\"shown\":{seq},\"headers\":{{}}}}"))).await.unwrap();
    next_json(&mut socket, |value| value["beat"].as_u64() > Some(1)).await;
    assert!(server.app.displays.is_live_for(&session, server.fixture.clock.now()));

    // By its beats it says when, where `seq` stands still.
    let mut beating = server.connect("/ws", &cookie).await;
    next_json(&mut beating, |value| value["beat"].as_u64() > Some(1)).await;
    for said in [format!("{{\"shown\":{seq},\"beat\":1}}"), "{\"beat\":2}".to_owned()] {
        beating.send(Message::text(said)).await.unwrap();
    }
    next_json(&mut beating, |value| value["beat"].as_u64() > Some(3)).await;

    let future = format!("{{\"shown\":{}}}", seq + 1000);
    let long = format!("{{\"shown\":1,\"x\":\"{}\"}}", "x".repeat(17 * 1024));
    for nonsense in [
        "",
        "hello",
        "{}",
        "{\"shown\":0,\"beat\":99}",
        "{\"beat\":-1}",
        "{\"shown\":-1}",
        "{\"shown\":\"1\"}",
        "[]",
        &future,
    ] {
        let mut socket = server.connect("/ws", &cookie).await;
        next_content(&mut socket).await;
        socket.send(Message::text(nonsense)).await.unwrap();
        assert_eq!(closed(&mut socket).await, CloseCode::Unsupported, "{nonsense}");
    }
    let mut socket = server.connect("/ws", &cookie).await;
    next_content(&mut socket).await;
    socket.send(Message::text(long)).await.unwrap();
    // The protocol's own bound ends this one, perhaps without a farewell.
    while let Some(Ok(message)) = timeout(PATIENCE, socket.next()).await.expect("it ends in time") {
        assert!(!matches!(&message, Message::Text(text) if text.contains("\"beat\":9")), "it goes on");
    }
}

#[tokio::test]
async fn sockets_are_bounded_and_the_end_of_the_server_is_told() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut sockets = Vec::new();
    for _ in 0..16 {
        sockets.push(server.connect("/ws", &cookie).await);
    }
    let (cookie_header, origin) = (("cookie", cookie.as_str()), server.origin());
    let headers = [cookie_header, ("origin", origin.as_str())];
    let refused = server.try_connect("/ws", &headers).await.err();
    assert_eq!(refused, Some(StatusCode::SERVICE_UNAVAILABLE));
    server.shutdown.send(()).unwrap();
    for socket in &mut sockets {
        assert_eq!(closed(socket).await, CloseCode::Restart);
    }
    timeout(PATIENCE, server.served).await.expect("it ends in time").unwrap().unwrap();
}

#[tokio::test]
async fn a_session_that_is_used_from_elsewhere_is_recorded_and_told_its_page() {
    let server = Server::new().await;
    for (user, page, words) in [
        ("operator", "/ws?lang=de", "Ihre Anmeldung wird auch von 10.0.0.66 aus benutzt."),
        ("developer", "/developer/live", "Your login is also used from 10.0.0.66."),
    ] {
        let cookie = server.fixture.cookie_of(user).await;
        let mut open = server.connect(page, &cookie).await;
        for from in ["127.0.0.1", "::1", "10.0.0.66", "10.0.0.66"] {
            let mut stolen = crate::fixture::request(Method::GET, "/api/v1/snapshot", Some(&cookie));
            stolen.extensions_mut().insert(Peer(SocketAddr::new(from.parse().unwrap(), 40_000)));
            assert_eq!(server.fixture.send(stolen).await.status, StatusCode::OK, "{from}");
        }
        let said = next_json(&mut open, |value| value.get("elsewhere").is_some()).await;
        assert!(said["elsewhere"].as_str().unwrap().starts_with(words), "{said}");
        // A page that is opened later says it too.
        let mut later = server.connect(page, &cookie).await;
        next_json(&mut later, |value| value.get("elsewhere").is_some()).await;
        let entries = server.fixture.store.audit_entries(None, 100).await.unwrap();
        let recorded = entries.iter().filter(|it| it.action == "session elsewhere" && it.who == user);
        let recorded: Vec<_> = recorded.map(|it| (it.source.as_str(), it.target.as_str())).collect();
        assert_eq!(recorded, [("10.0.0.66", "before: 127.0.0.1")], "once");
    }
}
