//! The meaning of a monitor, without the indices that one configuration gives to topics.

use crate::model::monitors::Class;
use crate::model::monitors::{
    FieldSpec, ModuleMonitor, MonitorSpec, TopicId, ValueSource, WatchdogId, WatchdogSpec, Watched,
};

const fn class(location: &'static str, information: &'static str, flow: Option<&'static str>) -> Class {
    Class { location, information, flow }
}

/// A topic without its index: its name, its type, and the field that is read.
type TopicMeaning<'a> = (&'a str, &'a str, Option<&'a FieldSpec>);

/// The class of a module that judges itself.
const SELF_STATE: Class = class("isolated", "content", None);

impl ModuleMonitor {
    /// Its kind, as in the configuration.
    pub fn kind(&self) -> &'static str {
        self.other().map_or("self_state", MonitorSpec::kind)
    }

    /// Its class in the paper's classification.
    pub fn class(&self) -> Class {
        self.other().map_or(SELF_STATE, MonitorSpec::class)
    }

    /// Whether the monitor itself judges silence, so that the module's timeout has no effect.
    pub fn by_the_clock(&self) -> bool {
        self.other().is_some_and(MonitorSpec::by_the_clock)
    }

    /// Whether it judges the same sources in the same way, whatever their indices are.
    pub(crate) fn means_the_same(&self, watched: &Watched, other: &ModuleMonitor, others: &Watched) -> bool {
        match (self, other) {
            (ModuleMonitor::Other(spec), ModuleMonitor::Other(other)) => {
                spec.means_the_same(watched, other, others)
            }
            _ => self == other,
        }
    }
}

impl MonitorSpec {
    /// Its kind, as in the configuration.
    pub fn kind(&self) -> &'static str {
        match self {
            MonitorSpec::External { .. } => "external",
            MonitorSpec::Frequency { .. } => "frequency",
            MonitorSpec::Latency { .. } => "latency",
            MonitorSpec::Value { .. } => "value",
            MonitorSpec::Frozen { .. } => "frozen",
            MonitorSpec::Watchdog { .. } => "watchdog",
            MonitorSpec::System { .. } => "system",
            MonitorSpec::RateRatio { .. } => "rate_ratio",
            MonitorSpec::Sequence { .. } => "sequence",
            MonitorSpec::Agreement { .. } => "agreement",
            MonitorSpec::Constant { .. } => "constant",
            MonitorSpec::Count { .. } => "count",
            MonitorSpec::Expression { .. } => "expression",
        }
    }

    /// Its class in the paper's classification.
    pub fn class(&self) -> Class {
        match self {
            MonitorSpec::Value { .. } | MonitorSpec::Frozen { .. } | MonitorSpec::Constant { .. } => {
                SELF_STATE
            }
            MonitorSpec::Frequency { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::System { .. }
            | MonitorSpec::Count { .. } => class("isolated", "meta", None),
            MonitorSpec::RateRatio { .. } => class("contextual", "meta", Some("sequential")),
            MonitorSpec::Sequence { .. } => class("contextual", "content", Some("sequential")),
            MonitorSpec::Agreement { .. } => class("contextual", "content", Some("parallel")),
            MonitorSpec::Expression { class, .. } | MonitorSpec::External { class, .. } => *class,
        }
    }

    /// Whether the monitor itself judges silence, so that the module's timeout has no effect.
    pub fn by_the_clock(&self) -> bool {
        match self {
            MonitorSpec::Frequency { .. }
            | MonitorSpec::RateRatio { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::System { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. } => true,
            MonitorSpec::External { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Frozen { .. }
            | MonitorSpec::Sequence { .. }
            | MonitorSpec::Agreement { .. }
            | MonitorSpec::Expression { .. } => false,
        }
    }

    /// Whether it judges the same sources in the same way, whatever their indices are.
    pub(crate) fn means_the_same(&self, watched: &Watched, other: &MonitorSpec, others: &Watched) -> bool {
        self.meaning(watched) == other.meaning(others)
    }

    /// The monitor without indices, and the topics behind the indices.
    fn meaning<'a>(
        &self,
        watched: &'a Watched,
    ) -> (MonitorSpec, Vec<TopicMeaning<'a>>, Option<&'a WatchdogSpec>) {
        let mut bare = self.clone();
        let mut sources = Vec::new();
        let mut name_topic = |topic: &mut TopicId| {
            let spec = &watched.topics[std::mem::replace(topic, TopicId(0)).0 as usize];
            sources.push((&*spec.topic, &*spec.type_name, None));
        };
        let mut probe = None;
        let mut values: Vec<&mut ValueSource> = Vec::new();
        match &mut bare {
            MonitorSpec::External { .. } | MonitorSpec::Constant { .. } | MonitorSpec::Count { .. } => {}
            MonitorSpec::Frequency { topic, .. } | MonitorSpec::Latency { topic, .. } => name_topic(topic),
            MonitorSpec::RateRatio { input, output, .. } => {
                name_topic(input);
                name_topic(output);
            }
            MonitorSpec::Watchdog { watchdog, .. } | MonitorSpec::System { watchdog, .. } => {
                let id = std::mem::replace(watchdog, WatchdogId(0));
                probe = Some(&*watched.watchdogs[id.0 as usize]);
            }
            MonitorSpec::Value { source, .. } | MonitorSpec::Frozen { source, .. } => values.push(source),
            MonitorSpec::Sequence { earlier, later, .. } => values.extend([earlier, later]),
            MonitorSpec::Agreement { a, b, .. } => values.extend([a, b]),
            MonitorSpec::Expression { inputs, .. } => {
                values.extend(inputs.iter_mut().map(|(_, source)| source));
            }
        }
        for value in values {
            if let ValueSource::Field { topic, field } = value {
                let spec = &watched.topics[std::mem::replace(topic, TopicId(0)).0 as usize];
                let field = &spec.fields[std::mem::replace(field, 0) as usize];
                sources.push((&spec.topic, &spec.type_name, Some(field)));
            }
        }
        (bare, sources, probe)
    }
}
