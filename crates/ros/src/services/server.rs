//! The services of one participant: its readers of requests, and its writers of replies.

use std::collections::BTreeSet;
use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;

use super::answered::{Known, LastRequests, RequestId};
use super::limit::{self, Limit};
use super::{Call, ServicesContext};
use crate::BridgeError;
use crate::discovery::graph::service_topics;
use crate::discovery::peers::{self, Announcer};
use crate::discovery::presence;
use crate::transport::ids::{PREFIX, Prefix, participant_name, prefix};
use crate::transport::quality::Via;
use crate::transport::{Participant, Quality, RawSample, Reader, ReaderEvent, SampleId, Writer};
use telltale_clock::rate::{Bucket, Rate};
use telltale_engine::discovery::Discovery;
use telltale_engine::model::service::Service;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages::{self, GidSize, NodeEntities};
use telltale_msg::sample_bytes::Guid;
use telltale_msg::services::{Correlation, Reply, Request, dds_types};

/// Requests that the library keeps until they are taken. The oldest of more are lost, and their clients ask
/// again.
const DEPTH: usize = 64;
/// Calls of all services that are worked on.
const WAITING_MAX: usize = 16;
/// Replies that are being written.
const WRITING_MAX: usize = 256;
/// A call is answered sooner: this is for one without any answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(8);
/// A client may be discovered by its request before its reader of replies is.
const READER_WITHIN: Duration = Duration::from_secs(1);
/// The time to answer before the services are offered otherwise.
const FINISHING: Duration = Duration::from_secs(2);
/// Replies without an effect: a flood of calls must not become a flood of refusals.
const REFUSALS: Rate = Rate { burst: 100, refill: Span::from_millis(10) };
/// How often the log counts what was not answered.
const TELL_EVERY: Span = Span::from_secs(10);
/// Bytes of a node's name that stand in the audit log.
const NODE_BYTES_MAX: usize = 128;

pub struct Server {
    around: Arc<ServicesContext>,
    participant: Participant,
    endpoints: Vec<Endpoint>,
    announcer: Writer,
    /// Announces the participant to hosts that multicast does not reach.
    _peers: Option<Announcer>,
    last: LastRequests,
    refusals: Bucket,
    unanswered: Unanswered,
    /// Calls that are worked on.
    waiting: JoinSet<(ReplyTo, RequestId, Reply)>,
    writing: JoinSet<()>,
}

/// One service.
struct Endpoint {
    service: Service,
    /// Its topics on the wire.
    request_topic: String,
    reply_topic: Arc<str>,
    requests: Reader,
    replies: Arc<Writer>,
    limit: Limit,
}

/// Where the reply to a request goes.
struct ReplyTo {
    replies: Arc<Writer>,
    topic: Arc<str>,
    client: Prefix,
    correlation: Correlation,
    /// The request, for the protocol.
    request: SampleId,
}

impl Server {
    pub async fn open(
        around: Arc<ServicesContext>,
        services: &BTreeSet<Service>,
    ) -> Result<Server, BridgeError> {
        let participant = Participant::open(&around.options).await?;
        around.graph.siblings.add(participant_name(&participant.guid()));
        let now = around.clock.now();
        let node = around.options.whole_name(around.options.node);
        let endpoint = |&service: &Service| {
            let [requests, replies] = dds_types(service);
            let name = format!("{node}/{}", service.as_str());
            let [request_topic, reply_topic] = service_topics(&name);
            Endpoint {
                service,
                requests: participant.reader(&request_topic, &requests, Via::Reliable, DEPTH),
                replies: Arc::new(participant.writer(&reply_topic, &replies, Quality::Reply)),
                request_topic,
                reply_topic: reply_topic.into(),
                limit: Limit::new(service, now),
            }
        };
        Ok(Server {
            endpoints: services.iter().map(endpoint).collect(),
            announcer: presence::announcer(&participant),
            _peers: peers::announce(&participant, &around.options),
            last: LastRequests::default(),
            refusals: Bucket::new(REFUSALS, now),
            unanswered: Unanswered::default(),
            waiting: JoinSet::new(),
            writing: JoinSet::new(),
            participant,
            around,
        })
    }

    /// Serves until the participant is unusable.
    pub async fn serve(&mut self) {
        let participant = self.participant.clone();
        let mut own_readers = participant.own_readers();
        let mut gid_size = self.around.graph.gid_size.clone();
        self.announce().await;
        loop {
            tokio::select! {
                ended = participant.ended() => {
                    tracing::error!("the process of the services is ill and is replaced: {}", ended.reason);
                    return;
                }
                Ok(()) = gid_size.changed() => self.announce().await,
                Ok(()) = own_readers.changed() => self.announce().await,
                Some(answered) = self.waiting.join_next() => {
                    if let Ok((to, id, reply)) = answered {
                        self.last.answer(id, &reply);
                        self.write(to, reply);
                    }
                }
                Some(_) = self.writing.join_next() => {}
                (index, sample) = next(&mut self.endpoints) => self.take(index, sample),
            }
        }
    }

    /// Announces the node with its endpoints, so that the tools of ROS 2 list the services: a tool takes only
    /// what a node announces for the node's.
    async fn announce(&self) {
        let size: Option<GidSize> = *self.around.graph.gid_size.borrow();
        let Some(size) = size else { return };
        let readers: Vec<Guid> = self.participant.own_readers().borrow().iter().copied().collect();
        let mut writers = Vec::with_capacity(self.endpoints.len());
        for endpoint in &self.endpoints {
            // Its participant may end first.
            match tokio::time::timeout(READER_WITHIN, endpoint.replies.guid()).await {
                Ok(guid) => writers.push(guid),
                Err(_) => return,
            }
        }
        let name = self.around.options.whole_name(&format!("{}_services", self.around.options.node));
        let node = NodeEntities { name: &name, readers: &readers, writers: &writers };
        let body = messages::encode_nodes(self.participant.guid(), &[node], size);
        if let Err(error) = self.announcer.write(body).await {
            tracing::warn!("the node {name} was not announced to ROS 2: {error}");
        }
    }

    fn take(&mut self, index: usize, sample: RawSample) {
        let now = self.around.clock.now();
        let endpoint = &mut self.endpoints[index];
        let client = prefix(&sample.writer);
        let request = match &sample.body {
            Ok((body, endian)) => Request::read(endpoint.service, body, *endian, &sample.writer),
            Err(_) => {
                Request { correlation: Correlation::Sample, argument: Err("the request is not plain CDR") }
            }
        };
        let asked = SampleId { writer: sample.writer, sequence: sample.sequence };
        let to = ReplyTo {
            replies: endpoint.replies.clone(),
            topic: endpoint.reply_topic.clone(),
            client,
            correlation: request.correlation,
            // Newer clients of Fast DDS name their reader of replies, older ones are known by their writer.
            request: SampleId { writer: reply_reader(&sample).unwrap_or(sample.writer), ..asked },
        };
        let id = RequestId::new(asked, request.correlation);
        match self.last.find(id) {
            Known::Answered(reply) => return self.refuse(to, reply, now),
            Known::Waits => return,
            Known::New => {}
        }
        if !endpoint.limit.admits(client, now) {
            let Rate { refill, .. } = limit::rate(endpoint.service);
            let words =
                format!("too many calls: call again in {} s at the earliest", refill.as_millis() / 1000);
            return self.refuse(to, Reply::refused(words), now);
        }
        let argument = match request.argument {
            Ok(argument) => argument,
            Err(wrong) => return self.refuse(to, Reply::refused(wrong), now),
        };
        let caller = caller(&self.around.graph.discovery.borrow(), &endpoint.request_topic, &sample.writer);
        let (reply, answer) = oneshot::channel();
        let call = Call { service: endpoint.service, argument, caller, reply };
        let sent = match self.waiting.len() < WAITING_MAX {
            true => self.around.calls.try_send(call),
            false => Err(TrySendError::Full(call)),
        };
        match sent {
            Ok(()) => {
                self.last.begin(id);
                self.waiting.spawn(async move { (to, id, answered(answer).await) });
            }
            Err(TrySendError::Full(_)) => {
                self.refuse(to, Reply::refused("too many other calls wait: call again"), now);
            }
            Err(TrySendError::Closed(_)) => self.refuse(to, Reply::refused("Telltale is ending"), now),
        }
    }

    /// Answers what has no effect.
    fn refuse(&mut self, to: ReplyTo, reply: Reply, now: Timestamp) {
        if self.refusals.take(now) && self.writing.len() < WRITING_MAX {
            self.write(to, reply);
        } else if let Some(count) = self.unanswered.one_more(now) {
            tracing::warn!("{count} calls of services were not answered: there are too many");
        }
    }

    fn write(&mut self, to: ReplyTo, reply: Reply) {
        let participant = self.participant.clone();
        self.writing.spawn(async move {
            to.wait_for_reader(&participant).await;
            let related = (to.correlation == Correlation::Sample).then_some(to.request);
            if let Err(error) = to.replies.write_related(to.correlation.reply(&reply), related).await {
                tracing::debug!("a call was not answered on {}: {error}", to.topic);
            }
        });
    }

    /// Answers the calls that are worked on, for a while.
    pub async fn finish(&mut self) {
        let answering = async {
            while let Some(answered) = self.waiting.join_next().await {
                if let Ok((to, _, reply)) = answered {
                    self.write(to, reply);
                }
            }
            while self.writing.join_next().await.is_some() {}
        };
        let _ = tokio::time::timeout(FINISHING, answering).await;
    }

    /// Ends the readers and writers, then the participant, and waits for its threads.
    pub async fn close(self) {
        let Server { participant, endpoints, announcer, _peers, mut waiting, mut writing, .. } = self;
        waiting.shutdown().await;
        writing.shutdown().await;
        drop((endpoints, announcer, _peers));
        participant.close().await;
    }
}

impl ReplyTo {
    /// A reader that discovery does not know yet would not get the reply.
    async fn wait_for_reader(&self, participant: &Participant) {
        let mut news: watch::Receiver<u64> = participant.news();
        let is_known =
            || participant.seen().readers_of(&self.topic).any(|it| prefix(&it.guid) == self.client);
        let known = async { while !is_known() && news.changed().await.is_ok() {} };
        // A client without a reader wants no reply.
        let _ = tokio::time::timeout(READER_WITHIN, known).await;
    }
}

async fn answered(answer: oneshot::Receiver<Reply>) -> Reply {
    match tokio::time::timeout(ANSWER_WITHIN, answer).await {
        Ok(Ok(reply)) => reply,
        Ok(Err(_)) => Reply::refused("Telltale is ending"),
        Err(_) => Reply::refused(format!(
            "Telltale did not answer within {} s; the audit log says whether it was done",
            ANSWER_WITHIN.as_secs()
        )),
    }
}

/// The next request of any service, with the position of that.
async fn next(endpoints: &mut [Endpoint]) -> (usize, RawSample) {
    poll_fn(|context: &mut Context<'_>| {
        for (index, endpoint) in endpoints.iter_mut().enumerate() {
            // A request that was not handed over cannot be answered.
            while let Poll::Ready(heard) = endpoint.requests.poll(context) {
                if let ReaderEvent::Sample(sample) = heard {
                    return Poll::Ready((index, sample));
                }
            }
        }
        Poll::Pending
    })
    .await
}

/// The reader to which a client of Fast DDS wants its reply. Zeros are nobody.
fn reply_reader(sample: &RawSample) -> Option<Guid> {
    sample.related.map(|related| related.writer).filter(|writer| writer[..PREFIX] != [0; PREFIX])
}

/// The node of a writer, as far as it is announced, and its participant.
fn caller(discovery: &Discovery, topic: &str, writer: &Guid) -> Box<str> {
    let participant = participant_name(writer);
    let topic = discovery.topics.iter().find(|it| it.name == topic);
    let mut publishers = topic.into_iter().flat_map(|it| &it.publishers);
    match publishers.find(|it| it.participant == participant).and_then(|it| it.node.as_deref()) {
        Some(node) => {
            let node = &node[..node.floor_char_boundary(NODE_BYTES_MAX)];
            format!("{node} (participant {participant})").into()
        }
        None => format!("participant {participant}").into(),
    }
}

/// Counts the calls that were not answered.
#[derive(Debug, Default)]
struct Unanswered {
    count: u64,
    told: Option<Timestamp>,
}

impl Unanswered {
    /// Returns the count if it is time to tell it.
    fn one_more(&mut self, now: Timestamp) -> Option<u64> {
        self.count += 1;
        if self.told.is_some_and(|told| now.since(told) < TELL_EVERY) {
            return None;
        }
        self.told = Some(now);
        Some(std::mem::take(&mut self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::discovery::{Endpoint as SeenEndpoint, TopicSeen};

    #[test]
    fn a_caller_is_named_by_what_its_own_participant_announces() {
        let endpoint = |participant: &Guid, node: Option<&str>| SeenEndpoint {
            participant: participant_name(participant),
            node: node.map(str::to_owned),
            ..SeenEndpoint::default()
        };
        let [panel, other, stranger] = [[1; 16], [2; 16], [3; 16]];
        let long = "x".repeat(1000);
        let publishers = vec![endpoint(&other, Some(&long)), endpoint(&panel, Some("/panel"))];
        let name = "rq/telltale/resetRequest".to_owned();
        let topics = vec![TopicSeen { name: name.clone(), publishers, ..TopicSeen::default() }];
        let discovery = Discovery { topics, ..Discovery::default() };
        let named = |writer| caller(&discovery, &name, &writer);
        assert_eq!(&*named(panel), format!("/panel (participant {})", "01".repeat(PREFIX)));
        assert_eq!(&*named(stranger), format!("participant {}", "03".repeat(PREFIX)));
        assert!(named(other).len() < 200);
        assert_eq!(
            &*caller(&Discovery::default(), &name, &panel),
            &*format!("participant {}", "01".repeat(PREFIX))
        );
    }

    #[test]
    fn what_is_not_answered_is_told_now_and_then() {
        let at = Timestamp::from_millis;
        let mut unanswered = Unanswered::default();
        let told: Vec<u64> = (0..25_000).filter_map(|ms| unanswered.one_more(at(ms))).collect();
        assert_eq!(told, [1, 10_000, 10_000]);
    }
}
