//! Checks whether a keyframe is of a configuration: by the names of all that the state refers to.

use crate::model::{Model, SignalSource};

/// A number that distinguishes configurations by their names, as hexadecimal digits. Limits and texts do not
/// count.
pub(super) fn fingerprint(model: &Model) -> String {
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    hash.names("stages", std::iter::once(format!("{:?}", model.stages)));
    let signal = |source: &SignalSource| source.field().map_or("condition", |it| &*it.topic).to_owned();
    hash.names("signals", model.signals.iter().flat_map(|it| [it.name.to_string(), signal(&it.source)]));
    hash.names("groups", model.groups.iter().map(|group| group.path.to_string()));
    let module = |it: &crate::model::ModuleSpec| [it.id.to_string(), it.monitor.kind().to_owned()];
    hash.names("modules", model.modules.iter().flat_map(module));
    for topic in &model.watched.topics {
        hash.names(&topic.topic, topic.fields.iter().map(|field| field.path.to_string()));
    }
    hash.names("probes", model.watched.watchdogs.iter().map(|it| it.target.name().to_owned()));
    hash.names("rules", model.driving.countermeasures.iter().map(|it| it.request.as_str().to_owned()));
    format!("{:016x}", hash.0)
}

/// The hash function FNV-1a. It finds mistakes, not attacks: the loaded state is checked by itself.
struct Fnv(u64);

impl Fnv {
    /// A list of names, with its title.
    fn names(&mut self, title: &str, names: impl Iterator<Item = String>) {
        self.take(title);
        names.for_each(|name| self.take(&name));
        self.byte(0xfe);
    }

    fn take(&mut self, name: &str) {
        name.bytes().for_each(|byte| self.byte(byte));
        // No name has this byte.
        self.byte(0xff);
    }

    fn byte(&mut self, byte: u8) {
        self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
}
