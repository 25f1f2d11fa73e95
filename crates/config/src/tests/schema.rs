//! The schema for editors has every key that the reader has, and says how each is written.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::{parse, schema};

/// Every map that a configuration knows, each with a key that none of them has.
const EVERY_MAP: &str = "
zzzz: 1
vehicle: { zzzz: 1, name: { zzzz: 1, en: a, de: a } }
signals: { s: { zzzz: 1 } }
stops: [{ zzzz: 1 }]
motion: { zzzz: 1, speed: { zzzz: 1 }, position: { zzzz: 1 } }
defaults: { zzzz: 1 }
limits: { zzzz: 1 }
display: { zzzz: 1 }
recording: { zzzz: 1, topics: [{ zzzz: 1 }] }
fleet: { zzzz: 1 }
groups:
  - zzzz: 1
    tile: { zzzz: 1 }
    match: [{ zzzz: 1, except: [{ zzzz: 1 }] }]
    depends_on: [{ zzzz: 1 }]
    when: { zzzz: 1 }
    modules:
      - { zzzz: 1, monitor: { self_state: { zzzz: 1 } } }
      - { name: { zzzz: 1, error: { zzzz: 1 } } }
      - { help: { zzzz: 1, error: { zzzz: 1, active: { zzzz: 1, en: a } } } }
      - { monitor: { external: { zzzz: 1, class: { zzzz: 1 } } } }
      - { monitor: { frequency: { zzzz: 1 } } }
      - { monitor: { latency: { zzzz: 1 } } }
      - { monitor: { value: { zzzz: 1, topic: /t } } }
      - { monitor: { frozen: { zzzz: 1 } } }
      - { monitor: { system: { zzzz: 1 } } }
      - { monitor: { watchdog: { zzzz: 1 } } }
      - { monitor: { rate_ratio: { zzzz: 1, input: { zzzz: 1 } } } }
      - { monitor: { sequence: { zzzz: 1, earlier: { zzzz: 1 } } } }
      - { monitor: { agreement: { zzzz: 1, a: { zzzz: 1 }, translation: { zzzz: 1 }, rotation_deg: { zzzz: 1 }, count: { zzzz: 1 }, nearest: { zzzz: 1 } } } }
      - { monitor: { tf: { zzzz: 1 } } }
      - { monitor: { expression: { zzzz: 1 } } }
      - { monitor: { constant: { zzzz: 1 } } }
countermeasures: [{ zzzz: 1, when: { zzzz: 1 }, confirmed_by: { zzzz: 1 } }]
services: { zzzz: 1, reset: { zzzz: 1 } }
publish: { zzzz: 1, rosout: { zzzz: 1 }, stage: { zzzz: 1 }, diagnostics_agg: { zzzz: 1 }, toplevel_state: { zzzz: 1 }, deceleration_request: { zzzz: 1 } }
other: { zzzz: 1 }
diagnostics: { zzzz: 1, topics: [{ zzzz: 1 }] }
";

#[test]
fn the_schema_knows_the_keys_that_the_reader_knows() {
    let problems = parse("c", EVERY_MAP).unwrap_err();
    let mut reader: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for problem in problems.list() {
        let Some(what) = problem.message.strip_prefix("unknown key `zzzz` in ") else { continue };
        let keys = problem.help.as_ref().and_then(|help| help.strip_prefix("known here: ")).unwrap();
        reader.insert(what.to_owned(), keys.split(", ").map(str::to_owned).collect());
    }
    assert_eq!(reader.len(), 62, "{reader:#?}");

    let schema: Value = serde_json::from_str(&schema()).unwrap();
    let definitions = schema["$defs"].as_object().unwrap().values();
    for definition in definitions.clone().chain([&schema]) {
        for (key, form) in definition["properties"].as_object().into_iter().flatten() {
            let is_said =
                ["type", "$ref", "enum", "oneOf"].iter().any(|form_key| form.get(form_key).is_some());
            assert!(is_said, "the schema does not say how `{key}` is written");
        }
    }
    let titled = definitions
        .chain([&schema])
        .filter_map(|definition| Some((definition["title"].as_str()?, definition)));
    let keys = |definition: &Value| definition["properties"].as_object().unwrap().keys().cloned().collect();
    let schema: BTreeMap<String, BTreeSet<String>> =
        titled.map(|(title, definition)| (title.to_owned(), keys(definition))).collect();
    assert_eq!(schema, reader);
}
