//! The places of a model's nodes in the file.

use telltale_engine::model::monitors::TopicId;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_yaml::{Sources, Span};

/// A part of the configuration that can only be checked with the definitions of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelPlace {
    /// The type of a watched topic.
    Type(TopicId),
    /// The type of a watched topic, for its header stamp.
    Stamp(TopicId),
    /// A field of a watched topic, by its position.
    Field(TopicId, u32),
    /// The type of a signal's topic, by the signal's position.
    SignalType(usize),
    /// The field of a signal.
    SignalField(usize),
    /// The id of a module, for an error in its monitor.
    Module(ModuleId),
}

#[derive(Debug, Clone)]
pub(crate) struct Places {
    pub sources: Sources,
    /// By the ids of the model.
    pub groups: Vec<NodePlace>,
    pub modules: Vec<NodePlace>,
    /// By the ids of watched topics.
    pub topics: Vec<TopicPlace>,
    /// By position.
    pub signals: Vec<SignalPlace>,
    /// The topics of diagnostics that are written, by position.
    pub diagnostics: Vec<Span>,
    /// The nodes of each countermeasure.
    pub rules: Vec<Vec<Span>>,
    /// The place where requests to stop are switched off.
    pub stop_off: Option<Span>,
    /// The model of stages, where it is written.
    pub stages: Option<Span>,
}

/// Of a condition, three times its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SignalPlace {
    pub topic: Span,
    pub type_name: Span,
    /// The field, or else the type.
    pub field: Span,
}

impl SignalPlace {
    pub fn at(span: Span) -> SignalPlace {
        SignalPlace { topic: span, type_name: span, field: span }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct TopicPlace {
    pub name: Span,
    pub type_name: Span,
    /// The first place that needs the stamp of its messages.
    pub stamp: Option<Span>,
    pub fields: Vec<Span>,
}

#[derive(Debug, Clone)]
pub(crate) struct NodePlace {
    pub id: Span,
    pub when: Option<Span>,
    /// By position in the node's `depends_on`.
    pub depends_on: Vec<Span>,
    /// Its names on the network: the filters of a group by position, or the status, node or service of a module.
    pub targets: Vec<Span>,
}

impl Places {
    pub fn span(&self, place: ModelPlace) -> Option<Span> {
        let topic = |id: TopicId| self.topics.get(id.0 as usize);
        match place {
            ModelPlace::Type(id) => topic(id).map(|topic| topic.type_name),
            ModelPlace::Stamp(id) => topic(id).map(|topic| topic.stamp.unwrap_or(topic.name)),
            ModelPlace::Field(id, field) => topic(id)?.fields.get(field as usize).copied(),
            ModelPlace::SignalType(index) => self.signals.get(index).map(|signal| signal.type_name),
            ModelPlace::SignalField(index) => self.signals.get(index).map(|signal| signal.field),
            ModelPlace::Module(id) => self.modules.get(id.0 as usize).map(|module| module.id),
        }
    }

    /// The file of each node by its position, and the line, counted from 1, of its id.
    pub fn lines(&self) -> impl Iterator<Item = (NodeId, u16, usize)> {
        let starts: Vec<Vec<usize>> = self.sources.texts().map(|(_, text)| line_starts(text)).collect();
        let groups =
            self.groups.iter().enumerate().map(|(id, place)| (NodeId::Group(GroupId(id as u32)), place));
        let modules =
            self.modules.iter().enumerate().map(|(id, place)| (NodeId::Module(ModuleId(id as u32)), place));
        groups.chain(modules).filter_map(move |(node, place)| {
            let starts = starts.get(usize::from(place.id.file))?;
            Some((node, place.id.file, starts.partition_point(|&start| start <= place.id.start as usize)))
        })
    }

    pub fn of(&self, node: NodeId) -> &NodePlace {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize],
            NodeId::Module(id) => &self.modules[id.0 as usize],
        }
    }
}

fn line_starts(text: &str) -> Vec<usize> {
    std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect()
}
