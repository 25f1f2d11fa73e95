//! Tests of the services that are offered to other nodes.

use super::*;
use crate::services::Offer;
use telltale_engine::model::service::Service;

#[test]
fn nothing_is_offered_unless_it_is_named() {
    let offered = |text: &str| {
        let text = format!("{GROUP}{text}");
        parse("c", &text).unwrap_or_else(|problems| panic!("{problems}")).services
    };
    assert_eq!(offered(""), Services::default());
    assert_eq!(offered("services: {}\n"), Services::default());
    assert_eq!(offered("services: { acknowledge: false, mark: false }\n"), Services::default());
    let some =
        offered("services: { acknowledge: true, reset: { while_driving: true }, reload: {}, mark: true }\n");
    assert_eq!(some.names(), Service::ALL.into());
    let while_driving =
        Service::ALL.map(|service| some.offer(service).map(|Offer { while_driving }| while_driving));
    assert_eq!(while_driving, [Some(false), Some(true), Some(false), Some(true)]);
}

#[test]
fn mistakes_are_told_with_their_place() {
    check_beside_group(
        "services: { acknowlege: true, reset: { whiledriving: true }, reload: perhaps, mark: { while_driving: true } }\n",
        &[
            "2:13: unknown key `acknowlege` in the services (did you mean `acknowledge`?)",
            "2:40: unknown key `whiledriving` in a service (did you mean `while_driving`?)",
            "2:70: unknown truth value `perhaps` (one of: true, false)",
            "2:85: unknown truth value a map of keys (one of: true, false)",
        ],
    );
    check_beside_group(
        "vehicle: { stages: none }\nservices: { reset: { while_driving: true } }\n",
        &[
            "3:37: a machine without stages never counts as driving (remove `while_driving`: the service is always done there)",
        ],
    );
}

#[test]
fn a_reload_says_what_is_offered_otherwise() {
    let load = |text: &str| parse("c", &format!("{GROUP}{text}")).unwrap();
    let differences = difference(
        &load("services: { mark: true }\n"),
        &load(
            "services: { acknowledge: true, reset: { while_driving: true } }\npublish: { rosout: { level: error } }\n",
        ),
    );
    let words: Vec<String> = differences.iter().map(ToString::to_string).collect();
    assert_eq!(words.len(), 1, "{words:?}");
    assert!(words[0].contains("services from mark to acknowledge, reset (also while driving)"), "{words:?}");
    assert!(words[0].contains("rosout.level from warning to error"), "{words:?}");
}
