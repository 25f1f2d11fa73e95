//! Topics whose type the configuration leaves out; their publishers announce it.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{
    FieldError, Keeping, Signal, Subscription, SubscriptionError, WatchedFields, meaning, subscribe,
};
use crate::fields::{Definitions, Reader};
use telltale_engine::model::monitors::{StampClock, TopicSpec};
use telltale_engine::model::{FieldSource, Limits, Model, SignalSpec};

/// The wanted fields of a topic until its type is known.
#[derive(Debug, Clone)]
pub(super) struct Untyped {
    signals: Vec<SignalSpec>,
    pub(super) watch: Option<Arc<TopicSpec>>,
    definitions: Definitions,
}

/// A topic whose type is known now.
#[derive(Debug)]
pub struct Learned {
    pub subscription: Subscription,
    /// The fields that messages of this type do not have, one sentence each. All others are read.
    pub missing: Vec<String>,
}

/// One subscription for each such topic of a model.
pub(super) fn subscriptions(model: &Model, definitions: &Definitions) -> Vec<Subscription> {
    let new = || Untyped { signals: Vec::new(), watch: None, definitions: definitions.clone() };
    let mut topics: BTreeMap<&str, Untyped> = BTreeMap::new();
    for signal in &model.signals {
        if let Some(source) = signal.source.field().filter(|source| source.type_name.is_empty()) {
            topics.entry(&source.topic).or_insert_with(new).signals.push(signal.clone());
        }
    }
    for spec in model.watched.topics.iter().filter(|spec| spec.type_name.is_empty()) {
        topics.entry(&spec.topic).or_insert_with(new).watch = Some(spec.clone());
    }
    topics.into_iter().map(|(topic, untyped)| Subscription::untyped(topic, untyped, &model.limits)).collect()
}

impl Subscription {
    fn untyped(topic: &str, untyped: Untyped, limits: &Limits) -> Subscription {
        let topic = format!("/{}", topic.trim_start_matches('/'));
        Subscription {
            dds_topic: format!("rt{topic}"),
            topic: topic.into(),
            type_name: "".into(),
            dds_type: String::new(),
            diagnostics: None,
            is_clock: false,
            stamps: StampClock::default(),
            signals: Vec::new(),
            watch: None,
            untyped: Some(Arc::new(untyped)),
            recorded_every: None,
            keeping: Keeping::Whole,
            may_be_large: true,
            limits: limits.clone(),
        }
    }

    /// Whether its type must be learned before it can be read.
    pub fn is_untyped(&self) -> bool {
        self.untyped.is_some()
    }

    /// The subscription with this type, `package/msg/Name`. Only missing fields are missing: the others are
    /// read.
    ///
    /// # Errors
    /// None of the wanted fields can be read from it.
    pub fn learn(&self, type_name: &str) -> Result<Learned, SubscriptionError> {
        let mut missing = Vec::new();
        let Some(untyped) = &self.untyped else { return Ok(Learned { subscription: self.clone(), missing }) };
        let mut all = Vec::with_capacity(1);
        let learned = subscribe(&mut all, &self.topic, type_name, &self.limits)?;
        (learned.stamps, learned.keeping) = (self.stamps, self.keeping);
        let mut refused = None;
        for spec in &untyped.signals {
            let Some(source) = spec.source.field() else { continue };
            let source = FieldSource { type_name: type_name.into(), ..source.clone() };
            match meaning(spec, &source, &untyped.definitions) {
                Ok(meaning) => {
                    learned.signals.push(Signal { name: spec.name.clone(), timeout: spec.timeout, meaning })
                }
                Err(why) => {
                    missing.push(why.to_string());
                    refused = Some(why);
                }
            }
        }
        if let Some(spec) = &untyped.watch {
            let typed = TopicSpec { type_name: type_name.into(), ..(**spec).clone() };
            let reader = match untyped.definitions.reader(&typed) {
                Ok((reader, errors)) => {
                    missing.extend(errors.iter().map(FieldError::brief));
                    reader
                }
                // Its messages can still be counted.
                Err(why) => {
                    missing.push(why.to_string());
                    Reader::of_nothing(&typed, &why)
                }
            };
            // The engine identifies its samples by the configuration.
            learned.watch = Some(WatchedFields { spec: spec.clone(), reader });
        }
        match refused {
            Some(why) if learned.signals.is_empty() && learned.watch.is_none() => Err(why),
            _ => Ok(Learned { subscription: learned.clone(), missing }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Endian;
    use crate::subscription::{Plan, PublicationTime, Received};
    use telltale_config as config;
    use telltale_engine::input::Input;
    use telltale_engine::model::sample::FieldValue;

    const TEXT: &str = "
vehicle: { stages: none }
signals: { on: { topic: /lamp }, docked: { topic: /number, field: data, when: value > 1 } }
groups: [{ id: g, modules: [{ id: rate, monitor: { frequency: { topic: /lamp, error_below: 1 } } }] }]
";

    #[test]
    fn a_type_is_learned_and_read_by() {
        let model = config::parse("c", TEXT).unwrap().model;
        let plan = Plan::of(&model, &Definitions::default()).unwrap();
        let untyped: Vec<_> = plan.subscriptions.iter().filter(|it| it.is_untyped()).collect();
        let topics: Vec<&str> = untyped.iter().map(|it| &*it.topic).collect();
        assert_eq!(topics, ["/lamp", "/number"]);
        let lamp = untyped[0].learn("std_msgs/msg/Bool").unwrap().subscription;
        assert_eq!((&*lamp.dds_type, lamp.is_untyped()), ("std_msgs::msg::dds_::Bool_", false));
        let body = Ok((vec![1].into(), Endian::Little));
        let (inputs, wrong) =
            lamp.decode(Received { body: &body, writer: [0; 16], wall_ns: 0, when: PublicationTime::Now });
        assert!(inputs.len() == 2 && wrong.is_none(), "{inputs:?} {wrong:?}");
        let number = untyped[1].learn("std_msgs/msg/Float64").unwrap().subscription;
        assert_eq!(
            number.watched(),
            Some(&model.watched.topics[0]),
            "samples are known by the configuration's"
        );
        let thing = untyped[1].learn("my_msgs/msg/Thing").unwrap();
        assert!(
            thing.missing.len() == 1 && thing.subscription.watched().is_some(),
            "it can be counted: {thing:?}"
        );
        let lamp = untyped[0].learn("std_msgs/msg/String").unwrap();
        assert!(lamp.subscription.signals.is_empty() && lamp.missing.len() == 1, "{lamp:?}");
    }

    #[test]
    fn a_field_that_is_not_there_is_missing_alone() {
        let text = "
vehicle: { stages: none }
signals: { moving: { topic: /odom, field: twist.twist.linear.x, when: value > 0 }, on: { topic: /lamp, field: dat } }
groups:
- id: g
  modules:
  - { id: rate, monitor: { frequency: { topic: /number, error_below: 1 } } }
  - { id: good, monitor: { value: { topic: /number, field: data, error_above: 1 } } }
  - { id: typo, monitor: { value: { topic: /number, field: dat, error_above: 1 } } }
  - { id: late, monitor: { latency: { topic: /number, error_above: 1s } } }
  - { id: low, monitor: { value: { topic: /battery, field: percent, error_below: 0.1 } } }
";
        let model = config::parse("c", text).unwrap().model;
        let plan = Plan::of(&model, &Definitions::default()).unwrap();
        let learn = |topic: &str, type_name: &str| {
            let found = plan.subscriptions.iter().find(|it| it.is_untyped() && *it.topic == *topic);
            found.unwrap().learn(type_name)
        };
        let number = learn("/number", "std_msgs/msg/Float64").unwrap();
        assert_eq!(
            number.missing,
            [
                "std_msgs/msg/Float64 has no stamp, so its age cannot be known",
                "std_msgs/msg/Float64 has no field `dat`; did you mean `data`?"
            ]
        );
        let body = Ok((2.5_f64.to_le_bytes().to_vec().into(), Endian::Little));
        let (inputs, wrong) = number.subscription.decode(Received {
            body: &body,
            writer: [0; 16],
            wall_ns: 0,
            when: PublicationTime::Now,
        });
        let [Input::Sample(sample)] = &inputs[..] else { panic!("{inputs:?}") };
        let typo =
            FieldValue::Unreadable("std_msgs/msg/Float64 has no field `dat`; did you mean `data`?".into());
        assert_eq!((&*sample.values, wrong), (&[FieldValue::Number(2.5), typo][..], None));
        let battery = learn("/battery", "sensor_msgs/msg/BatteryState").unwrap();
        assert_eq!(
            battery.missing,
            ["sensor_msgs/msg/BatteryState has no field `percent`; did you mean `percentage`?"]
        );
        assert!(learn("/lamp", "std_msgs/msg/Bool").is_err(), "nothing is left to be read");
    }

    #[test]
    fn a_type_that_stands_elsewhere_is_taken() {
        let text =
            TEXT.replace("frequency: { topic: /lamp,", "frequency: { topic: /lamp, type: std_msgs/msg/Bool,");
        let model = config::parse("c", &text).unwrap().model;
        let source = model.signals[0].source.field().unwrap();
        assert_eq!(&*source.type_name, "std_msgs/msg/Bool");
        assert_eq!(super::subscriptions(&model, &Definitions::default()).len(), 1);
    }
}
