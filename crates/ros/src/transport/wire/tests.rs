//! Messages arrive over the socket as they were sent, and garbage is refused.

use proptest::prelude::*;

use super::*;

const RELATED: SampleId = SampleId { writer: [8; 16], sequence: 1 << 40 };

fn some_orders() -> Vec<Order> {
    let (topic, type_name) = ("rt/x".to_owned(), "std_msgs::msg::dds_::Bool_".to_owned());
    vec![
        Order::Open(Network::Dds { domain: 7, interfaces: Some(vec![Ipv4Addr::LOCALHOST]) }),
        Order::Open(Network::Dds { domain: 232, interfaces: None }),
        Order::Open(Network::Zenoh { domain: 3, router: None }),
        Order::Open(Network::Zenoh { domain: 3, router: Some("tcp/127.0.0.1:7447".to_owned()) }),
        Order::Reader {
            id: 1,
            topic: topic.clone(),
            type_name: type_name.clone(),
            via: Via::LastValue,
            depth: 8,
        },
        Order::Deepen { topic: topic.clone(), type_name: type_name.clone(), depth: 512 },
        Order::Taken { id: 1, bytes: 4096 },
        Order::Writer { id: 2, topic, type_name, quality: Quality::BestEffort },
        Order::Write { id: 2, number: 9, related: None, body: Bytes::from_static(&[1, 2, 3, 4]) },
        Order::Write { id: 2, number: 10, related: Some(RELATED), body: Bytes::new() },
        Order::EndReader { id: 1 },
        Order::Close,
        Order::Forget { participant: [7; 12] },
        Order::FollowFirst { topic: "rt/x".to_owned() },
    ]
}

fn some_news() -> Vec<FromChild> {
    let liveliness = Liveliness { kind: LivelinessKind::ManualByTopic, lease_ns: Some(5) };
    let found = Found {
        guid: [3; 16],
        writes: true,
        topic: "rt/ü".to_owned(),
        type_name: String::new(),
        reliable: true,
        transient_local: false,
        deadline_ns: None,
        liveliness,
        takes: 5,
    };
    let fault = |what| Err(Fault { at: 0, what });
    let sample = |body| FromChild::Sample {
        reader: 4,
        sample: RawSample { writer: [9; 16], sequence: -1, source: Some(77), related: Some(RELATED), body },
    };
    vec![
        FromChild::Ready { guid: [1; 16], participant: 3 },
        FromChild::Made { id: 5, guid: [2; 16] },
        FromChild::Found(found),
        FromChild::Gone { guid: [3; 16] },
        FromChild::Cut { of_ours: 1, all: 70_000 },
        sample(Ok((Bytes::from_static(&[1, 2, 3]), Endian::Big))),
        sample(Ok((vec![7; 500].into(), Endian::Little))),
        sample(fault(FaultKind::Encoding([0, 7]))),
        sample(fault(FaultKind::TooLarge { bytes: 1 << 30, limit: BODY_BYTES_MAX })),
        FromChild::Fault { reader: 4, reason: "no".to_owned() },
        FromChild::Missed { reader: 4 },
        FromChild::Written { number: 9, error: Some("late".to_owned()) },
        FromChild::Written { number: 10, error: None },
        FromChild::Beat { heard: 12 },
        FromChild::Broken { reason: "over".to_owned() },
        FromChild::Participant { participant: [7; 12], change: Change::Left },
    ]
}

fn frame(write: impl FnOnce(&mut Frame)) -> Bytes {
    let mut frame = Frame::new();
    write(&mut frame);
    frame.take().split_off(4)
}

#[test]
fn what_is_said_is_heard_as_it_was_said() {
    let (orders, news) = (some_orders(), some_news());
    let said = frame(|frame| orders.iter().for_each(|order| frame.order(order)));
    assert_eq!(super::orders(&said), Ok(orders));
    let said = frame(|frame| news.iter().for_each(|one| frame.news(one)));
    assert_eq!(super::news(&said), Ok(news));
}

#[test]
fn what_is_cut_or_too_long_is_refused_and_never_taken_in_part() {
    for news in some_news() {
        let whole = frame(|frame| frame.news(&news));
        for length in 1..whole.len() {
            assert!(super::news(&whole.slice(..length)).is_err(), "{news:?} cut to {length}");
        }
    }
    let name = "x".repeat(NAME_BYTES_MAX + 1);
    assert!(super::news(&frame(|frame| frame.news(&FromChild::Broken { reason: name.clone() }))).is_err());
    assert_eq!(cut(&name).len(), NAME_BYTES_MAX);
    // A body that claims to be larger than allowed.
    let mut claim = frame(|frame| {
        frame.order(&Order::Write { id: 1, number: 1, related: None, body: vec![0; 8].into() })
    })
    .to_vec();
    claim[10..14].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(super::orders(&claim.into()).is_err());
}

proptest! {
    #[test]
    fn garbage_is_refused_or_harmless(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let bytes = Bytes::from(bytes);
        let heard = (super::news(&bytes), super::orders(&bytes));
        let count = |parts: usize| parts <= bytes.len();
        prop_assert!(heard.0.is_err() || count(heard.0.unwrap().len()));
        prop_assert!(heard.1.is_err() || count(heard.1.unwrap().len()));
    }

    #[test]
    fn one_changed_byte_is_refused_or_changes_one_message(at in 0_usize..2000, value in any::<u8>()) {
        let mut said = Vec::from(frame(|frame| some_news().iter().for_each(|one| frame.news(one))));
        let at = at % said.len();
        said[at] = value;
        let _ = super::news(&said.into());
    }
}

#[test]
fn a_body_keeps_nothing_of_the_buffer_that_it_came_in() {
    let sample = |body: Vec<u8>| FromChild::Sample {
        reader: 4,
        sample: RawSample {
            writer: [9; 16],
            sequence: 1,
            source: None,
            related: None,
            body: Ok((body.into(), Endian::Little)),
        },
    };
    // A small message follows a large one on the socket: both come out of one buffer.
    let mut buffer = bytes::BytesMut::new();
    for body in [vec![1; 1 << 20], vec![2; 100]] {
        let mut frame = Frame::new();
        frame.news(&sample(body));
        buffer.extend_from_slice(&frame.take());
    }
    let mut codec = frames();
    for _ in 0..2 {
        let frame = tokio_util::codec::Decoder::decode(&mut codec, &mut buffer).unwrap().unwrap().freeze();
        let all = news(&frame).unwrap();
        let [FromChild::Sample { sample: RawSample { body: Ok((body, _)), .. }, .. }] = &all[..] else {
            panic!("{all:?}")
        };
        assert!(body.is_unique(), "{} bytes", body.len());
    }
}
