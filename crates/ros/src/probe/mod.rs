//! Watchdogs: ask repeatedly whether hosts, ports, nodes and services are there.

pub(super) mod icmp_echo;
pub(super) mod lifecycle;
mod system;

use std::io::{self, ErrorKind};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::sync::{Semaphore, mpsc, watch};
use tokio::task::JoinSet;

use super::discovery::nodes::Nodes;
use super::engine_queue::stopped;
use super::name_lookup::Lookup;
use crate::every;
use icmp_echo::EchoError;
use system::System;
use telltale_clock::Clock;
use telltale_engine::discovery::Discovery;
use telltale_engine::input::Input;
use telltale_engine::model::monitors::{ProbeTarget, WatchdogSpec};
use telltale_engine::model::sample::{Probe, ProbeOutcome};
use telltale_engine::time::Span;
use telltale_msg::received::Stamped;
use telltale_msg::subscription::Plan;

/// Probes that run at once; each needs a socket. Others wait for their turn.
const AT_ONCE_MAX: usize = 128;

/// The shortest interval between probes of one target.
const EVERY_MIN: Duration = Duration::from_millis(10);

/// State shared by all watchdogs.
#[derive(Clone)]
pub struct ProbeContext {
    pub inputs: mpsc::Sender<Stamped>,
    pub nodes: watch::Receiver<Nodes>,
    pub discovery: watch::Receiver<Arc<Discovery>>,
    pub clock: Clock,
}

/// Runs the watchdogs of the plan until it is stopped. A new plan restarts all of them.
pub async fn run(
    context: ProbeContext,
    mut plan: watch::Receiver<Arc<Plan>>,
    mut stop: watch::Receiver<bool>,
) {
    let turns = Arc::new(Semaphore::new(AT_ONCE_MAX));
    loop {
        let mut tasks = JoinSet::new();
        let watchdogs = plan.borrow_and_update().watchdogs.clone();
        for spec in watchdogs {
            tasks.spawn(watch(spec, context.clone(), turns.clone()));
        }
        tokio::select! {
            () = stopped(&mut stop) => return,
            changed = plan.changed() => if changed.is_err() {
                return;
            },
        }
        tasks.shutdown().await;
    }
}

/// Probes one target, never twice at once, until nobody listens.
async fn watch(spec: Arc<WatchdogSpec>, context: ProbeContext, turns: Arc<Semaphore>) {
    let period = Duration::from(spec.every).max(EVERY_MIN);
    // A lifecycle node is called through the participant: `lifecycle.rs` does it.
    let Some(mut asker) = Asker::new(&spec.target, &context) else { return };
    let mut looks = every(period);
    loop {
        looks.tick().await;
        // It is never closed.
        let Ok(turn) = turns.acquire().await else { return };
        let outcome = asker.ask(period).await;
        drop(turn);
        let Some(outcome) = outcome else { continue };
        let received = context.clock.now();
        let input = Input::Probe(Probe { source: spec.clone(), outcome });
        if context.inputs.send(Stamped::new(input, received)).await.is_err() {
            return;
        }
    }
}

struct Asker {
    clock: Clock,
    how: How,
}

enum How {
    Icmp(Lookup),
    Tcp(Lookup),
    Node { name: Box<str>, nodes: watch::Receiver<Nodes> },
    Service { name: Box<str>, nodes: watch::Receiver<Nodes> },
    Qos { topic: Box<str>, discovery: watch::Receiver<Arc<Discovery>> },
    System(System),
}

impl Asker {
    fn new(target: &ProbeTarget, context: &ProbeContext) -> Option<Asker> {
        let clock = context.clock;
        let how = match target {
            ProbeTarget::Icmp { host } => How::Icmp(Lookup::of_host(host, clock)),
            ProbeTarget::Tcp { address } => How::Tcp(Lookup::of_address(address, clock)),
            ProbeTarget::Qos { topic } => {
                How::Qos { topic: topic.clone(), discovery: context.discovery.clone() }
            }
            ProbeTarget::System(resource) => How::System(System::new(resource)),
            ProbeTarget::Lifecycle { .. } => return None,
            ProbeTarget::Node { name } => How::Node { name: name.clone(), nodes: context.nodes.clone() },
            ProbeTarget::Service { name } => {
                How::Service { name: name.clone(), nodes: context.nodes.clone() }
            }
        };
        Some(Asker { clock, how })
    }

    /// `None`: nothing can be said yet.
    async fn ask(&mut self, patience: Duration) -> Option<ProbeOutcome> {
        let clock = self.clock;
        let asked = match &mut self.how {
            How::Node { name, nodes } => return Some(nodes.borrow().ask(name, clock.now())),
            How::Service { name, nodes } => return Some(nodes.borrow().ask_service(name, clock.now())),
            How::Qos { topic, discovery } => return Some(matching(topic, &discovery.borrow())),
            How::System(system) => return system.ask(patience).await,
            How::Icmp(lookup) => tokio::time::timeout(patience, icmp(lookup, clock)).await,
            How::Tcp(lookup) => tokio::time::timeout(patience, tcp(lookup, clock)).await,
        };
        Some(match asked {
            Ok(Ok(after)) => ProbeOutcome::Answered { after },
            Ok(Err(outcome)) => outcome,
            Err(_) if self.is_looking_up() => {
                ProbeOutcome::Impossible(format!("its name is not resolved within {patience:?}").into())
            }
            Err(_) => ProbeOutcome::Missed(format!("no answer within {patience:?}").into()),
        })
    }

    fn is_looking_up(&self) -> bool {
        match &self.how {
            How::Icmp(lookup) | How::Tcp(lookup) => lookup.is_pending(),
            How::Node { .. } | How::Service { .. } | How::Qos { .. } | How::System(_) => false,
        }
    }
}

/// Whether all publishers and subscribers of a topic can match, as far as discovery knows.
fn matching(topic: &str, seen: &Discovery) -> ProbeOutcome {
    if seen.at.is_none() {
        return ProbeOutcome::Impossible("the topics are being discovered still".into());
    }
    let Some(topic) = seen.topics.iter().find(|it| it.name == topic) else {
        return match seen.more {
            0 => ProbeOutcome::Impossible("nobody publishes or subscribes to it".into()),
            _ => ProbeOutcome::Impossible("there are more topics than are looked at".into()),
        };
    };
    topic.why_mismatched().map_or(ProbeOutcome::Announced, |why| ProbeOutcome::Missed(why.into()))
}

/// The time that the target took, without the resolution of its name.
async fn tcp(lookup: &mut Lookup, clock: Clock) -> Result<Span, ProbeOutcome> {
    let addresses = lookup.addresses().await.map_err(|error| unresolved(&error))?;
    let start = clock.now();
    TcpStream::connect(&*addresses).await.map(drop).map_err(|error| failed(&error))?;
    Ok(clock.now().since(start))
}

async fn icmp(lookup: &mut Lookup, clock: Clock) -> Result<Span, ProbeOutcome> {
    let addresses = lookup.addresses().await.map_err(|error| unresolved(&error))?;
    let start = clock.now();
    let Some(address) = addresses.first() else { return Err(unresolved(&ErrorKind::NotFound.into())) };
    icmp_echo::echo(address.ip()).await.map_err(|error| match error {
        EchoError::Forbidden => ProbeOutcome::Impossible(icmp_echo::FORBIDDEN.into()),
        EchoError::NoSocket(error) => ProbeOutcome::Impossible(error.to_string().into()),
        EchoError::Failed(error) => failed(&error),
    })?;
    Ok(clock.now().since(start))
}

fn unresolved(error: &io::Error) -> ProbeOutcome {
    ProbeOutcome::Impossible(format!("its name cannot be resolved: {error}").into())
}

/// Distinguishes errors that say something about the target from errors of this machine.
fn failed(error: &io::Error) -> ProbeOutcome {
    const NO_FILES_LEFT: [i32; 2] = [23, 24];
    let ours = matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::AddrNotAvailable)
        || error.raw_os_error().is_some_and(|code| NO_FILES_LEFT.contains(&code));
    match error.kind() {
        ErrorKind::ConnectionRefused => ProbeOutcome::Missed("refused".into()),
        _ if ours => ProbeOutcome::Impossible(error.to_string().into()),
        _ => ProbeOutcome::Missed(error.to_string().into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::discovery::{Endpoint, TopicSeen};
    use telltale_engine::time::Timestamp;

    fn bench() -> (ProbeContext, mpsc::Receiver<Stamped>, watch::Sender<Nodes>) {
        let (inputs, received) = mpsc::channel(100);
        let (told, nodes) = watch::channel(Nodes::default());
        let discovery = watch::channel(Arc::default()).1;
        (ProbeContext { inputs, nodes, discovery, clock: Clock::start() }, received, told)
    }

    fn plan(targets: Vec<ProbeTarget>) -> Arc<Plan> {
        let every = Span::from_millis(20);
        let watchdogs = targets.into_iter().map(|target| Arc::new(WatchdogSpec { target, every }));
        Arc::new(Plan { watchdogs: watchdogs.collect(), ..Plan::default() })
    }

    async fn ask(target: ProbeTarget) -> ProbeOutcome {
        let (context, ..) = bench();
        let mut asker = Asker::new(&target, &context).expect("it is asked here");
        asker.ask(Duration::from_secs(5)).await.expect("each of these has an answer at once")
    }

    #[test]
    fn a_topic_whose_ends_never_match_is_a_miss_and_ignorance_is_none() {
        let end = |node: &str, reliable| Endpoint {
            node: Some(node.into()),
            type_name: "a".into(),
            reliable,
            ..Endpoint::default()
        };
        let topic = |name: &str, publisher, subscriber| TopicSeen {
            name: name.into(),
            publishers: vec![end("/p", publisher)],
            subscribers: vec![end("/s", subscriber)],
            ..TopicSeen::default()
        };
        let topics = vec![topic("/bad", false, true), topic("/good", true, true)];
        let mut seen = Discovery { topics, ..Discovery::default() };
        assert!(matches!(matching("/bad", &seen), ProbeOutcome::Impossible(_)), "nobody has looked yet");
        seen.at = Some(Timestamp::ZERO);
        let why = "/s asks for reliability, /p does not offer it".into();
        assert_eq!(matching("/bad", &seen), ProbeOutcome::Missed(why));
        assert_eq!(matching("/good", &seen), ProbeOutcome::Announced);
        let nobody = "nobody publishes or subscribes to it".into();
        assert_eq!(matching("/nobody", &seen), ProbeOutcome::Impossible(nobody));
        seen.more = 1;
        assert!(matches!(matching("/nobody", &seen), ProbeOutcome::Impossible(_)));
    }

    fn tcp_target(address: impl ToString) -> ProbeTarget {
        ProbeTarget::Tcp { address: address.to_string().into() }
    }

    #[tokio::test]
    async fn ports_answer_or_refuse_and_names_may_not_resolve() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let listening = tcp_target(format!("127.0.0.1:{port}"));
        assert!(matches!(ask(listening.clone()).await, ProbeOutcome::Answered { .. }));
        let by_name = ask(tcp_target(format!("localhost:{port}"))).await;
        assert!(matches!(by_name, ProbeOutcome::Answered { .. }), "{by_name:?}");
        drop(listener);
        assert_eq!(ask(listening).await, ProbeOutcome::Missed("refused".into()));
        for nonsense in ["no port", "", "host:99999"] {
            let outcome = ask(tcp_target(nonsense)).await;
            assert!(
                matches!(&outcome, ProbeOutcome::Impossible(why) if why.contains("resolved")),
                "{outcome:?}"
            );
        }
    }

    #[tokio::test]
    async fn the_time_that_a_name_takes_is_not_that_of_its_host() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let slow = Span::from_secs(600);
        for is_tcp in [true, false] {
            let (clock, hand) = Clock::with_hand();
            let (answer, pending) = tokio::sync::oneshot::channel();
            let mut lookup = Lookup::answered_by(pending, clock);
            // Asked first, the resolver answers ten minutes later.
            let resolver = async {
                hand.advance(slow);
                answer.send(Ok(vec![address])).unwrap();
            };
            let asked =
                async { if is_tcp { tcp(&mut lookup, clock).await } else { icmp(&mut lookup, clock).await } };
            match tokio::join!(asked, resolver).0 {
                Ok(after) => assert!(after < slow, "{after:?}"),
                // A system that lets nobody send an echo.
                Err(outcome) => {
                    assert!(!is_tcp && matches!(outcome, ProbeOutcome::Impossible(_)), "{outcome:?}")
                }
            }
        }
    }

    #[tokio::test]
    async fn a_host_echoes_or_the_system_says_how_to_allow_it() {
        for host in ["127.0.0.1", "localhost"] {
            let outcome = ask(ProbeTarget::Icmp { host: host.into() }).await;
            let right = match &outcome {
                ProbeOutcome::Answered { .. } => true,
                ProbeOutcome::Impossible(why) => why.contains("ping_group_range"),
                ProbeOutcome::Announced
                | ProbeOutcome::Inactive { .. }
                | ProbeOutcome::Repeated { .. }
                | ProbeOutcome::Measured(_)
                | ProbeOutcome::Missed(_) => false,
            };
            assert!(right, "{outcome:?}");
        }
    }

    #[tokio::test]
    async fn another_plan_starts_anew_and_the_end_leaves_nothing() {
        let (context, mut received, told) = bench();
        let node = |name: &str| ProbeTarget::Node { name: name.into() };
        let (change, planned) = watch::channel(plan(vec![node("/a"), node("/b")]));
        let (stop, stopping) = watch::channel(false);
        let running = tokio::spawn(run(context, planned, stopping));
        let first = received.recv().await.unwrap().input;
        assert!(matches!(first, Input::Probe(Probe { outcome: ProbeOutcome::Impossible(_), .. })));
        let next = plan(vec![node("/c")]);
        change.send_replace(next.clone());
        told.send_replace(Nodes::new(telltale_engine::time::Timestamp::ZERO));
        let of_next = async {
            loop {
                let Input::Probe(probe) = received.recv().await.unwrap().input else { panic!("only probes") };
                if Arc::ptr_eq(&probe.source, &next.watchdogs[0]) {
                    break;
                }
            }
        };
        tokio::time::timeout(Duration::from_secs(60), of_next).await.expect("the next plan is in force");
        stop.send_replace(true);
        running.await.unwrap();
        let rest = async { while received.recv().await.is_some() {} };
        tokio::time::timeout(Duration::from_secs(60), rest).await.expect("nobody asks any more");
    }
}
