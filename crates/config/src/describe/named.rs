//! The names of a configuration on the network of the vehicle, each with its place in the file. They are compared with
//! the names that discovery finds.

use std::sync::Arc;

use crate::Loaded;
use telltale_engine::model::filter::Filter;
use telltale_engine::model::monitors::{MonitorSpec, ProbeTarget};
use telltale_engine::model::{ModuleSpec, Policy};
use telltale_engine::time;
use telltale_yaml::Span;

/// Something that others offer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named<'m> {
    pub what: What<'m>,
    /// `None`: no place of the file says it.
    pub place: Option<Span>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum What<'m> {
    Topic {
        name: &'m str,
        /// Empty: the configuration leaves the type to the publisher.
        type_name: &'m str,
        /// The place of the type.
        of_type: Option<Span>,
    },
    /// A status, and the silence that its module allows.
    Status { name: Arc<str>, timeout: time::Span },
    /// Its full name.
    Node(&'m str),
    /// Its full name.
    Service(&'m str),
}

impl Loaded {
    /// Everything that it names, in the order of the model; a name may come several times.
    pub fn named(&self) -> Vec<Named<'_>> {
        let (model, places) = (&self.model, &self.places);
        let mut found = Vec::new();
        let mut add = |what, place| found.push(Named { what, place });
        for (spec, place) in model.watched.topics.iter().zip(&places.topics) {
            let of_type = Some(place.type_name);
            add(What::Topic { name: &spec.topic, type_name: &spec.type_name, of_type }, Some(place.name));
        }
        for (signal, place) in model.signals.iter().zip(&places.signals) {
            if let Some(source) = signal.source.field() {
                let (name, type_name) = (&*source.topic, &*source.type_name);
                add(What::Topic { name, type_name, of_type: Some(place.type_name) }, Some(place.topic));
            }
            let timeout = signal.timeout.unwrap_or(Policy::default().timeout);
            for name in signal.source.condition().into_iter().flat_map(MonitorSpec::keyed_statuses) {
                add(What::Status { name, timeout }, Some(place.field));
            }
        }
        for (topic, place) in model.watched.diagnostics.iter().zip(&places.diagnostics) {
            add(What::Topic { name: &topic.topic, type_name: "", of_type: None }, Some(*place));
        }
        for (group, place) in model.groups.iter().zip(&places.groups) {
            for (filter, of_filter) in group.filters.iter().zip(&place.targets) {
                let policy = filter.policy.as_ref().unwrap_or(&model.discovered);
                if let Filter::Name(name) = &filter.filter {
                    let name = Arc::from(&**name);
                    add(What::Status { name, timeout: policy.timeout }, Some(*of_filter));
                }
                writers(policy).for_each(|node| add(What::Node(node), Some(*of_filter)));
            }
        }
        for (module, place) in model.modules.iter().zip(&places.modules) {
            let target = Some(place.targets.first().copied().unwrap_or(place.id));
            self.of_module(module).for_each(|what| add(what, target));
            writers(&module.policy).for_each(|node| add(What::Node(node), Some(place.id)));
        }
        for topic in model.watched.recorded.iter().filter(|topic| !topic.pattern.contains('*')) {
            add(What::Topic { name: &topic.pattern, type_name: "", of_type: None }, None);
        }
        found
    }

    fn of_module<'m>(&'m self, module: &'m ModuleSpec) -> impl Iterator<Item = What<'m>> {
        let timeout = module.policy.timeout;
        let target = match module.monitor.other() {
            Some(MonitorSpec::Watchdog { watchdog, .. }) => {
                match &self.model.watched.watchdogs[watchdog.0 as usize].target {
                    ProbeTarget::Node { name } | ProbeTarget::Lifecycle { name } => Some(What::Node(name)),
                    ProbeTarget::Service { name } => Some(What::Service(name)),
                    ProbeTarget::Qos { topic } => {
                        Some(What::Topic { name: topic, type_name: "", of_type: None })
                    }
                    // Not of ROS.
                    ProbeTarget::Icmp { .. } | ProbeTarget::Tcp { .. } | ProbeTarget::System(_) => None,
                }
            }
            _ => None,
        };
        module.monitor.statuses().map(move |name| What::Status { name, timeout }).chain(target)
    }
}

fn writers(policy: &Policy) -> impl Iterator<Item = &str> {
    policy.writers.iter().flat_map(|nodes| nodes.iter()).map(|node| &**node)
}
