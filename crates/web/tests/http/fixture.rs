//! A small vehicle behind the real engine, the real store in memory, and requests to the router.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::header::{ACCEPT, CONTENT_TYPE, COOKIE, HOST, LOCATION, ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, Method, Request, StatusCode};
use telltale_clock::{Clock, ClockHand};
use telltale_engine::input::{Input, ListenerReport, StatusArray};
use telltale_engine::model::filter::Filter;
use telltale_engine::model::monitors::{FieldKind, FieldSpec, TopicId, TopicSpec};
use telltale_engine::model::motion::{SpeedSource, WatchedField};
use telltale_engine::model::output::Output;
use telltale_engine::model::sample::{FieldValue, Sample};
use telltale_engine::model::{
    Dependency, DependsOn, Driving, FieldSource, GroupId, GroupSpec, Match, Model, ModuleMonitor, ModuleSpec,
    NodeId, Parts, SignalSource, SignalSpec, Stage, StageModel, Stop, When, Within,
};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::{self as runtime, Link, Rehearsal, Reread, Stamped};
use telltale_store::{DemoSecrets, History, Session, Store, Token};
use telltale_web::{AppState, DemoFault, DemoFaults, FaultSwitch, Origins, Peer, Settings, router};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tower::ServiceExt;

pub const ADDRESS: &str = "127.0.0.1:8080";
pub const OWN_ORIGIN: &str = "http://127.0.0.1:8080";
/// Texts that no answer may contain before the login.
pub const COMPONENTS: [&str; 5] = ["sensors", "localization", "planning", "lidar", "imu"];

pub struct Fixture {
    pub store: Store,
    pub clock: Clock,
    pub link: Link,
    pub router: Router,
    pub app: AppState,
    pub faults: mpsc::Receiver<FaultSwitch>,
    /// Receives the requests to read the configuration again.
    pub rereads: mpsc::Receiver<Reread>,
}

/// While this is held no timer of tokio's comes.
pub struct NoTimers {
    _held: std::sync::mpsc::Sender<()>,
}

impl NoTimers {
    fn stop() -> NoTimers {
        tokio::time::pause();
        // With nothing else to do tokio goes on to its next timer, except while something blocks.
        let (held, end) = std::sync::mpsc::channel();
        tokio::task::spawn_blocking(move || end.recv());
        NoTimers { _held: held }
    }
}

pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: String,
}

impl Answer {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).map(|value| value.to_str().unwrap())
    }

    pub fn leads_to(&self) -> Option<&str> {
        self.header(LOCATION.as_str())
    }

    /// The `name=value` of the cookie that it sets.
    pub fn cookie(&self) -> Option<String> {
        let (pair, _) = self.header(SET_COOKIE.as_str())?.split_once(';')?;
        Some(pair.to_owned())
    }
}

impl Fixture {
    pub async fn new() -> Fixture {
        Fixture::with(ADDRESS, false, DemoSecrets::Accepted).await
    }

    /// On a vehicle: demo secrets open nothing, and there is no simulation.
    pub async fn with(address: &str, secure: bool, demo: DemoSecrets) -> Fixture {
        Fixture::at(Clock::start(), address, secure, demo).await
    }

    /// With a clock that can be set ahead.
    pub async fn with_hand() -> (Fixture, ClockHand) {
        let (clock, hand) = Clock::with_hand();
        (Fixture::at(clock, ADDRESS, false, DemoSecrets::Accepted).await, hand)
    }

    /// With a clock that stands still unless it is set ahead, and timers that never fire: nothing is too
    /// late, however busy the machine is.
    pub async fn without_time() -> (Fixture, ClockHand, NoTimers) {
        let timers = NoTimers::stop();
        let (clock, hand) = Clock::standing();
        (Fixture::at(clock, ADDRESS, false, DemoSecrets::Accepted).await, hand, timers)
    }

    /// With a database in a folder.
    pub async fn in_folder(folder: &std::path::Path) -> Fixture {
        Fixture::in_folder_by(folder, Clock::start()).await
    }

    /// The same with this clock. It goes on where the last one on this folder ended.
    pub async fn in_folder_by(folder: &std::path::Path, clock: Clock) -> Fixture {
        let store = Store::open(folder, clock, DemoSecrets::Accepted).unwrap();
        Fixture::on(store, clock, ADDRESS, false, DemoSecrets::Accepted).await
    }

    /// As `serve` opens the database of a folder, which may be damaged.
    pub async fn serving(folder: &std::path::Path) -> Fixture {
        let clock = Clock::start();
        let store = Store::open_or_read(folder, clock, DemoSecrets::Accepted).unwrap();
        let fault = store.fault().borrow().as_deref().map(Box::from);
        let fixture = Fixture::on(store, clock, ADDRESS, false, DemoSecrets::Accepted).await;
        fixture.input(Input::Storage { fault }).await;
        fixture
    }

    async fn at(clock: Clock, address: &str, secure: bool, demo: DemoSecrets) -> Fixture {
        Fixture::on(Store::in_memory(clock, demo).unwrap(), clock, address, secure, demo).await
    }

    /// A machine without stages.
    pub async fn without_stages() -> Fixture {
        Fixture::changed(|parts| parts.stages = StageModel::None).await
    }

    /// With a source of the speed, which stays for two days, and its messages.
    pub async fn with_speed(clock: Clock) -> (Fixture, impl Fn(f64) -> Input) {
        Fixture::with_speed_and(clock, |_| ()).await
    }

    /// The same with another configuration.
    pub async fn with_speed_and(
        clock: Clock,
        change: impl FnOnce(&mut Parts),
    ) -> (Fixture, impl Fn(f64) -> Input) {
        let topic = Arc::new(TopicSpec {
            topic: "/speed".into(),
            type_name: "std_msgs/msg/Float64".into(),
            stamp: false,
            fields: vec![FieldSpec::new("data", FieldKind::Scalar)],
        });
        let fixture = Fixture::changed_by(clock, |parts| {
            parts.watched.topics.push(topic.clone());
            let value = WatchedField { topic: TopicId(0), field: 0 };
            let timeout = Span::from_secs(48 * 3600);
            parts.driving.speed = Some(SpeedSource { value, timeout, standing_below_mps: 0.3 });
            change(parts);
        })
        .await;
        let speed = move |mps| Input::Sample(Sample::of(topic.clone(), [FieldValue::Number(mps)].into()));
        (fixture, speed)
    }

    /// With another configuration.
    pub async fn changed(change: impl FnOnce(&mut Parts)) -> Fixture {
        Fixture::changed_by(Clock::start(), change).await
    }

    /// The same with this clock.
    async fn changed_by(clock: Clock, change: impl FnOnce(&mut Parts)) -> Fixture {
        let store = Store::in_memory(clock, DemoSecrets::Accepted).unwrap();
        let mut parts = Parts::clone(&model());
        change(&mut parts);
        Fixture::of(Model::new(parts).unwrap(), store, clock, ADDRESS, false, DemoSecrets::Accepted).await
    }

    async fn on(store: Store, clock: Clock, address: &str, secure: bool, demo: DemoSecrets) -> Fixture {
        Fixture::of(model(), store, clock, address, secure, demo).await
    }

    async fn of(
        model: Model,
        store: Store,
        clock: Clock,
        address: &str,
        secure: bool,
        demo: DemoSecrets,
    ) -> Fixture {
        let (history, records) = History::in_memory(clock).unwrap();
        let followers = runtime::Followers { records: Some(records), feed: None };
        let link = match store.recall().await.unwrap() {
            Some(restored) => runtime::resume(Arc::new(model), &restored, clock, followers),
            None => runtime::start_followed(Arc::new(model), clock, followers),
        };
        if store.fault().borrow().is_none() {
            store.add_demo_users().await.unwrap();
        }
        let (switch, faults) = mpsc::channel(4);
        let origins = Origins::of_listener(address.parse().unwrap(), secure);
        let fault =
            |name| DemoFault { name, title: Text::plain(name), about: Text::plain("It falls silent.") };
        let faulty = DemoFaults::new(["sensor_outage", "can_loss"].map(fault).to_vec(), switch);
        let (asks, rereads) = mpsc::channel(4);
        let settings = Settings {
            demo: (demo == DemoSecrets::Accepted).then_some(faulty),
            rereads: Some(asks),
            history: Some(history),
            ..Settings::plain(origins, secure)
        };
        let app = AppState::new(link.clone(), store.clone(), clock, settings);
        Fixture { router: router(app.clone()), app, store, clock, link, faults, rereads }
    }

    /// With an engine that judges an action and then does not receive it.
    pub fn deafened(self) -> Fixture {
        let (commands, _) = mpsc::channel(1);
        let link = Link { commands, ..self.link.clone() };
        self.before(link)
    }

    /// With an engine that receives an action when the test hands it on.
    pub fn held(self) -> (Fixture, mpsc::Receiver<Rehearsal>) {
        let (rehearsals, held) = mpsc::channel(64);
        let link = Link { rehearsals, ..self.link.clone() };
        (self.before(link), held)
    }

    /// With a bridge to DDS that did its work at this time.
    pub fn bridged(mut self, working: watch::Receiver<Timestamp>) -> Fixture {
        self.set(|settings| settings.working = vec![working]);
        self
    }

    fn before(mut self, link: Link) -> Fixture {
        self.serve(link, |_| ());
        self
    }

    /// Serves with these settings from now on, and else as a vehicle without history, simulation and reloads.
    pub fn set(&mut self, change: impl FnOnce(&mut Settings)) {
        self.serve(self.link.clone(), change);
    }

    fn serve(&mut self, link: Link, change: impl FnOnce(&mut Settings)) {
        let mut settings = Settings::plain(Origins::of_listener(ADDRESS.parse().unwrap(), false), false);
        change(&mut settings);
        self.app = AppState::new(link, self.store.clone(), self.clock, settings);
        self.router = router(self.app.clone());
    }

    /// The session of a cookie.
    pub fn session(&self, cookie: &str) -> Session {
        self.app.session(&Token::parse(cookie.split_once('=').unwrap().1).unwrap()).unwrap()
    }

    /// The display of this session shows what is, as long as the test runs.
    pub fn look(&self, cookie: &str) {
        let place = self.app.displays.enter(&self.session(cookie)).unwrap();
        let seq = self.link.snapshots.borrow().snapshot.seq.into();
        place.sent(seq, self.clock.now());
        place.confirm(seq, self.clock.now());
        std::mem::forget(place);
    }

    pub async fn send(&self, request: Request<Body>) -> Answer {
        answer(self.router.clone(), request).await
    }

    /// Sends a request that waits for the test.
    pub fn start(&self, request: Request<Body>) -> JoinHandle<Answer> {
        tokio::spawn(answer(self.router.clone(), request))
    }

    pub async fn get(&self, path: &str, cookie: Option<&str>) -> Answer {
        self.send(request(Method::GET, path, cookie)).await
    }

    pub async fn get_json(&self, path: &str, cookie: &str) -> serde_json::Value {
        let answer = self.get(path, Some(cookie)).await;
        assert_eq!(
            (answer.status, answer.header("content-type")),
            (StatusCode::OK, Some("application/json"))
        );
        serde_json::from_str(&answer.body).unwrap()
    }

    pub async fn post(&self, path: &str, cookie: Option<&str>, form: &str) -> Answer {
        self.send(form_request(path, cookie, form)).await
    }

    pub async fn log_in(&self, name: &str, secret: &str) -> Answer {
        self.post("/login", None, &format!("name={name}&secret={secret}")).await
    }

    /// A session of the demo user with this name.
    pub async fn cookie_of(&self, name: &str) -> String {
        let secret = match name {
            "operator" => "246810",
            "developer" => "demo-developer",
            _ => "demo-authority",
        };
        let answer = self.log_in(name, secret).await;
        let leads_to = if self.stage() == Stage::Locked { "/developer" } else { "/" };
        assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some(leads_to)), "{name}");
        answer.cookie().unwrap()
    }

    pub async fn status(&self, name: &str, level: u8, message: &str) {
        let mut array = StatusArray::default();
        array.push_status(level, name, message, "");
        array.push_value("n", "1");
        self.input(Input::Diagnostics(array)).await;
    }

    /// The vehicle starts or stops to drive by itself, and the engine knows.
    pub async fn drive(&self, active: bool) {
        self.input(Input::Signal { name: "active".into(), value: active }).await;
        let known = |it: &Snapshot| (it.stage == Stage::Active) == active && !it.may_set_off;
        self.until(known).await;
    }

    /// From now on somebody, or nobody, listens to requests to stop.
    pub async fn listeners(&self, heard: bool) {
        let news = ListenerReport { output: Output::ManeuverStop, topic: "/stop".into(), heard };
        self.input(Input::Listened(news)).await;
        self.until(|snapshot| snapshot.unreached.is_empty() == heard).await;
    }

    pub async fn input(&self, input: Input) {
        self.link.inputs.send(Stamped::new(input, self.clock.now())).await.unwrap();
    }

    pub async fn until(&self, condition: impl Fn(&Snapshot) -> bool) -> Arc<Snapshot> {
        let mut snapshots = self.link.snapshots.clone();
        let waited = snapshots.wait_for(|published| condition(&published.snapshot));
        let seen = tokio::time::timeout(std::time::Duration::from_secs(5), waited).await;
        seen.expect("the engine gets there").unwrap().snapshot.clone()
    }

    pub fn stage(&self) -> Stage {
        self.link.snapshots.borrow().snapshot.stage
    }
}

async fn answer(router: Router, request: Request<Body>) -> Answer {
    let answer = router.oneshot(request).await.unwrap();
    let (parts, body) = answer.into_parts();
    let body = to_bytes(body, 1 << 20).await.unwrap();
    Answer { status: parts.status, headers: parts.headers, body: String::from_utf8_lossy(&body).into_owned() }
}

/// Everything that does not depend on another thread has happened.
pub async fn settled() {
    for _ in 0..1000 {
        tokio::task::yield_now().await;
    }
}

/// Asks repeatedly, for as long as a busy machine may take.
pub async fn until(mut condition: impl AsyncFnMut() -> bool) {
    for _ in 0..300 {
        if condition().await {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    panic!("it does not come to that");
}

pub fn request(method: Method, path: &str, cookie: Option<&str>) -> Request<Body> {
    let mut request = Request::builder().method(method).uri(path).header(HOST, ADDRESS);
    if let Some(cookie) = cookie {
        request = request.header(COOKIE, cookie);
    }
    request.body(Body::empty()).unwrap()
}

pub fn form_request(path: &str, cookie: Option<&str>, form: &str) -> Request<Body> {
    let mut request = request(Method::POST, path, cookie);
    let headers = request.headers_mut();
    headers.insert(ORIGIN, OWN_ORIGIN.parse().unwrap());
    headers.insert(CONTENT_TYPE, "application/x-www-form-urlencoded".parse().unwrap());
    *request.body_mut() = Body::from(form.to_owned());
    request
}

/// A program's login from this address.
pub fn login_from(source: &str, form: &str) -> Request<Body> {
    let mut login = form_request("/login", None, form);
    login.extensions_mut().insert(Peer(SocketAddr::new(source.parse().unwrap(), 40_000)));
    as_program(login)
}

/// As a program asks: it wants JSON.
pub fn as_program(mut request: Request<Body>) -> Request<Body> {
    request.headers_mut().insert(ACCEPT, "application/json".parse().unwrap());
    request
}

/// Sensors with a LiDAR and, inside, an IMU; Localization on top of them; Planning while active.
pub fn model() -> Model {
    let active = SignalSource::Field(FieldSource {
        topic: "/mission/active".into(),
        type_name: "std_msgs/msg/Bool".into(),
        field: "data".into(),
    });
    let parts = Parts {
        vehicle_name: Text::plain("Shuttle 1"),
        signals: vec![SignalSpec::new("active", active)],
        groups: vec![
            group("sensors", "Sensors", None),
            GroupSpec { filters: power(), ..group("sensors/inside", "Inside", Some(GroupId(0))) },
            GroupSpec {
                filters: power(),
                depends_on: vec![Dependency {
                    on: DependsOn::Node(NodeId::Group(GroupId(0))),
                    masks_unknown: false,
                    within: Within::default(),
                }],
                ..group("localization", "Localization", None)
            },
            GroupSpec {
                when: Some(When { stages: vec![Stage::Active], ..When::default() }),
                ..group("planning", "Planning", None)
            },
        ],
        modules: vec![
            module("sensors/lidar", 0, "lidar"),
            module("sensors/inside/imu", 1, "imu"),
            module("localization/tf", 2, "tf"),
            module("planning/planner", 3, "planner"),
        ],
        driving: Driving {
            stops: vec![Stop {
                id: "depot".into(),
                name: Text::plain("Depot"),
                x_m: 0.0,
                y_m: 0.0,
                yaw_deg: 0.0,
            }],
            localized_after: Span::ZERO,
            ..Driving::default()
        },
        ..Parts::empty("shuttle-1", StageModel::Shuttle)
    };
    Model::new(parts).unwrap()
}

/// A status that modules of two groups take, once it comes.
fn power() -> Vec<Match> {
    vec![Filter::Name("power".into()).into()]
}

fn group(path: &str, name: &str, parent: Option<GroupId>) -> GroupSpec {
    GroupSpec { parent, ..GroupSpec::new(path, Text::plain(name)) }
}

fn module(id: &str, group: u32, status: &str) -> ModuleSpec {
    ModuleSpec::new(id, GroupId(group), ModuleMonitor::SelfState(status.into()))
}
