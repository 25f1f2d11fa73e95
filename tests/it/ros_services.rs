//! Telltale's services with clients of Cyclone DDS and Fast DDS, in processes of their own.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::engine::model::service::Service;
use telltale::msg::messages::GidSize;
use telltale::msg::services::Reply;
use telltale::ros::services::{self, CALLS_MAX, Call, Services};
use telltale::ros::{Bridge, BridgeOptions};
use tokio::sync::{Semaphore, mpsc};

use crate::dds::Reading;
use crate::peer::{Domain, Limit, Peer, Vendor};

/// The services beside a bridge. Each call is answered with its service, argument and caller; for the argument
/// `held` only once the test permits it.
struct Serving {
    bridge: Bridge,
    services: Services,
    done: Arc<AtomicUsize>,
    held: Arc<Semaphore>,
}

impl Serving {
    async fn start(domain: &Domain) -> Serving {
        let options =
            BridgeOptions { gid_size: Some(GidSize::Bytes16), ..BridgeOptions::loopback(domain.id) };
        let bridge = Reading::with(options.clone()).await.bridge;
        let (sender, mut calls) = mpsc::channel(CALLS_MAX);
        let services = services::start(options, Service::ALL.into(), sender, bridge.graph(), Clock::start());
        let (done, held) = (Arc::new(AtomicUsize::new(0)), Arc::new(Semaphore::new(0)));
        let (counted, permitted) = (done.clone(), held.clone());
        tokio::spawn(async move {
            while let Some(Call { service, argument, caller, reply }) = calls.recv().await {
                counted.fetch_add(1, Ordering::Relaxed);
                if &*argument == "held" {
                    permitted.acquire().await.expect("it is not closed").forget();
                }
                let words = format!("{} {argument:?} by {caller}", service.as_str());
                let answer = if &*argument == "wrong" { Reply::refused(words) } else { Reply::done(words) };
                let _ = reply.send(answer);
            }
        });
        Serving { bridge, services, done, held }
    }

    fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    async fn shutdown(self) {
        self.services.shutdown().await;
        self.bridge.shutdown().await;
    }
}

/// A client that was not answered within this asks again.
const AGAIN: Duration = Duration::from_secs(3);

/// A client of one service. What it receives while something else is waited for stays in `replies`.
struct Client {
    peer: Peer,
    replies: VecDeque<Answer>,
    /// The last request of the beginning.
    greeted: u64,
}

/// A reply to a request of this client.
struct Answer {
    request: u64,
    success: bool,
    message: String,
}

impl Client {
    /// Starts a client and waits until it has found the service and was answered. The first calls of a client
    /// may be lost, in ROS 2 as here: each side finds the other at an instant of its own.
    fn start(domain: &Domain, service: Service, more: &str) -> Client {
        let type_name = if service.has_argument() {
            "diagnostic_msgs::srv::dds_::AddDiagnostics"
        } else {
            "std_srvs::srv::dds_::Trigger"
        };
        let greeting = if service.has_argument() { json!({"text": "hello"}) } else { json!({}) };
        let service = service.as_str();
        let mut peer =
            Peer::start(domain, &format!("client --service /telltale/{service} --type {type_name} {more}"));
        peer.wait_matched(1);
        let mut client = Client { peer, replies: VecDeque::new(), greeted: 0 };
        let limit = Limit::start();
        while limit.holds() {
            let asked = client.ask(&greeting);
            while let Some(line) = client.peer.next_within(AGAIN) {
                client.take(&line);
                if client.replies.iter().any(|answer| answer.request == asked) {
                    client.replies.clear();
                    client.greeted = asked;
                    return client;
                }
            }
        }
        unreachable!("a limit that does not hold fails")
    }

    /// Sends a request. Returns its number.
    fn ask(&mut self, command: &Value) -> u64 {
        self.peer.tell(command);
        loop {
            if let Some(asked) = self.next_line()["asked"].as_u64() {
                return asked;
            }
        }
    }

    fn reply(&mut self) -> Answer {
        let limit = Limit::start();
        loop {
            if let Some(reply) = self.replies.pop_front() {
                return reply;
            }
            assert!(limit.holds());
            self.next_line();
        }
    }

    /// Sends a request and waits for its reply.
    fn call(&mut self, command: &Value) -> Answer {
        let asked = self.ask(command);
        loop {
            let answer = self.reply();
            if answer.request == asked {
                return answer;
            }
        }
    }

    fn next_line(&mut self) -> Value {
        let line = self.peer.next().expect("the client goes on");
        self.take(&line);
        line
    }

    fn take(&mut self, line: &Value) {
        let request = line["sequence"].as_u64().unwrap_or(0);
        if line["mine"] == json!(true) && request > self.greeted {
            let message = line["reply"]["message"].as_str().expect("a text").to_owned();
            self.replies.push_back(Answer {
                request,
                success: line["reply"]["success"] == json!(true),
                message,
            });
        }
    }
}

with_each_peer!(
    every_service_answers_its_caller,
    a_wrong_argument_is_answered,
    clients_at_once_get_their_own_answers,
    a_flood_is_refused_and_another_client_is_served,
    the_tools_of_ros_find_the_services_at_their_node,
);

async fn every_service_answers_its_caller(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let serving = Serving::start(&domain).await;
    let older: &[&str] = if matches!(vendor, Vendor::FastDds) { &["", "--older"] } else { &[""] };
    for service in Service::ALL {
        for more in older {
            let mut client = Client::start(&domain, service, more);
            let (command, argument) =
                if service.has_argument() { (json!({"text": " a/b "}), "a/b") } else { (json!({}), "") };
            let Answer { success, message, .. } = client.call(&command);
            let expected = format!("{} {argument:?} by participant ", service.as_str());
            assert!(success && message.starts_with(&expected), "{message}");
        }
    }
    serving.shutdown().await;
}

async fn a_wrong_argument_is_answered(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let serving = Serving::start(&domain).await;
    let mut client = Client::start(&domain, Service::Reset, "");
    let done = serving.done();
    let Answer { success, message, .. } = client.call(&json!({"text": "wrong"}));
    assert!(!success && message.starts_with("reset \"wrong\""), "{message}");
    let Answer { success, message, .. } = client.call(&json!({"text": "x".repeat(5000)}));
    assert_eq!((success, &*message), (false, "the argument is too long"));
    // Another type, and a length that lies.
    for command in [json!({}), json!({"raw": "00010000ffffffff"})] {
        let Answer { success, message, .. } = client.call(&command);
        assert!(!success && message.contains("needs one string"), "{message}");
    }
    assert_eq!(serving.done(), 1 + done);
    serving.shutdown().await;
}

async fn clients_at_once_get_their_own_answers(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let serving = Serving::start(&domain).await;
    let start = || Client::start(&domain, Service::Acknowledge, "");
    let mut clients = [start(), start()];
    let done = serving.done();
    let mut expected: [BTreeMap<u64, String>; 2] = Default::default();
    for round in 0..4 {
        for (index, client) in clients.iter_mut().enumerate() {
            let text = if round == 0 { "held".to_owned() } else { format!("{index} {round}") };
            let asked = client.ask(&json!({"text": text}));
            expected[index].insert(asked, format!("acknowledge {text:?}"));
        }
    }
    serving.held.add_permits(2);
    for (client, mut expected) in clients.iter_mut().zip(expected) {
        while !expected.is_empty() {
            let Answer { request, success, message } = client.reply();
            let wanted = expected.remove(&request).expect("each request is answered once");
            assert!(success && message.starts_with(&wanted), "{wanted}: {message}");
        }
    }
    assert_eq!(serving.done(), 8 + done);
    if matches!(vendor, Vendor::Cyclone) {
        // A client whose reply was lost repeats its request: it is answered, and done once.
        for _ in 0..3 {
            let answer = clients[0].call(&json!({"text": "again", "sequence": 77}));
            assert!(answer.success, "{}", answer.message);
        }
        assert_eq!(serving.done(), 9 + done);
    }
    serving.shutdown().await;
}

async fn a_flood_is_refused_and_another_client_is_served(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let serving = Serving::start(&domain).await;
    let start = || Client::start(&domain, Service::Reload, "");
    let (mut flood, mut other) = (start(), start());
    flood.ask(&json!({"times": 2000}));
    // Nobody else can use up what one client may call.
    let answer = other.call(&json!({}));
    assert!(answer.success, "{}", answer.message);
    // Some of the flood are refused in so many words; the rest are not answered.
    let refusal = loop {
        let answer = flood.reply();
        if !answer.success {
            break answer.message;
        }
    };
    assert_eq!(refusal, "too many calls: call again in 10 s at the earliest");
    assert!(flood.replies.len() < 1000, "{}", flood.replies.len());
    assert!((2..=8).contains(&serving.done()), "{}", serving.done());
    serving.shutdown().await;
}

async fn the_tools_of_ros_find_the_services_at_their_node(vendor: Vendor) {
    const LISTEN: &str =
        "--durability transient_local sub --topic ros_discovery_info=ParticipantEntitiesInfo";
    let domain = Domain::of(vendor);
    let mut listener = Peer::start(&domain, LISTEN);
    let serving = Serving::start(&domain).await;
    let limit = Limit::start();
    let gids = |node: &Value, kind: &str| -> BTreeSet<String> {
        let gids = node[kind].as_array().expect("gids").iter();
        gids.map(|gid| gid.as_str().expect("a gid").to_owned()).collect()
    };
    loop {
        let line = listener.next().expect("the node is announced");
        let node = &line["value"]["nodes"][0];
        assert!(limit.holds());
        // Its readers are made one after the other.
        if node["name"] == "telltale_services" && gids(node, "readers").len() == 4 {
            assert_eq!((gids(node, "writers").len(), &node["namespace"]), (4, &json!("/")));
            break;
        }
    }
    // What is offered no more is gone.
    serving.services.follow([Service::Mark].into());
    loop {
        let line = listener.next().expect("the node is announced again");
        let node = &line["value"]["nodes"][0];
        assert!(limit.holds());
        if node["name"] == "telltale_services" && gids(node, "readers").len() == 1 {
            break;
        }
    }
    serving.shutdown().await;
}
