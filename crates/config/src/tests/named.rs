//! The names of a configuration on the network, with their places.

use super::*;
use crate::What;

#[test]
fn every_name_on_the_network_has_its_place() {
    let text = "\
signals:
  on:
    topic: /s
    type: a/msg/C
    field: on
diagnostics: { topics: [/r/diagnostics] }
recording: { topics: [{ topic: /only/recorded }, { topic: '/some*' }] }
groups:
- id: g
  match: [{ namespace: x }, { name: 'y: a', writers: [/n] }]
  modules:
  - id: s
    status: 'x: a'
    timeout: 7s
  - id: w
    monitor:
      watchdog: { node: /w }
  - { id: o, monitor: { watchdog: { service: /o } } }
  - { id: f, monitor: { frequency: { topic: /t, type: a/msg/B, error_below: 1 } } }
  - { id: v, monitor: { value: { status: 'x: b', key: k, error_above: 1 } } }
  - { id: p, monitor: { watchdog: { tcp: 'h:1' } } }
";
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let line = |span| loaded.sources().line_column(span);
    let found = loaded.named().into_iter().map(|named| {
        let what = match named.what {
            What::Topic { name, type_name, of_type } => {
                format!("topic {name} {type_name} {:?}", of_type.map(line))
            }
            What::Status { name, timeout } => format!("status {name} {}", timeout.as_millis()),
            What::Node(name) => format!("node {name}"),
            What::Service(name) => format!("service {name}"),
        };
        (what, named.place.map(line))
    });
    let expected = [
        ("topic /t a/msg/B Some((19, 55))", Some((19, 45))),
        ("topic /s a/msg/C Some((4, 11))", Some((3, 12))),
        ("topic /r/diagnostics  None", Some((6, 25))),
        ("status y: a 2000", Some((10, 37))),
        ("node /n", Some((10, 37))),
        ("status x: a 7000", Some((13, 13))),
        ("node /w", Some((17, 25))),
        ("service /o", Some((18, 46))),
        ("status x: b 2000", Some((20, 11))),
        ("topic /only/recorded  None", None),
    ];
    let expected = expected.map(|(what, place)| (what.to_owned(), place));
    assert_eq!(found.collect::<Vec<_>>(), expected);
}
