//! Values on the wire that are no plain structs: KeyValues, signals, wall time.

use std::collections::HashSet;
use std::time::SystemTime;

use humantime::format_rfc3339_millis;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};
use telltale_clock::with_a_text;

/// More values than this in one status are searched for double keys by hash.
const VALUES_SCANNED_MAX: usize = 16;

/// The signals as an object.
pub(super) struct Signals<'a>(pub &'a [(Box<str>, Option<bool>)]);

impl Serialize for Signals<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, value)| (&**name, value)))
    }
}

/// The KeyValues of a status as an object. A status may name a key twice, an object must not: the first counts.
pub(super) struct Values<'a>(pub &'a [(Box<str>, Box<str>)]);

impl Serialize for Values<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let values = self.0;
        let mut map = serializer.serialize_map(None)?;
        let mut seen = HashSet::new();
        for (index, (key, value)) in values.iter().enumerate() {
            let is_double = if values.len() <= VALUES_SCANNED_MAX {
                values[..index].iter().any(|(earlier, _)| earlier == key)
            } else {
                !seen.insert(&**key)
            };
            if !is_double {
                map.serialize_entry(&**key, &**value)?;
            }
        }
        map.end()
    }
}

/// Wall time on the wire: `2026-11-20T12:00:00.123Z`.
pub(super) struct Wall(pub SystemTime);

impl Serialize for Wall {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_rfc3339_millis(with_a_text(self.0)))
    }
}

/// Wall time on the wire, as text.
pub(super) fn rfc3339(time: SystemTime) -> String {
    format_rfc3339_millis(with_a_text(time)).to_string()
}
