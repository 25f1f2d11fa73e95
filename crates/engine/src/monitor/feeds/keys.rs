//! Passes KeyValues of statuses to the monitors that watch them.

use super::Watching;
use crate::input::StatusArray;
use crate::model::Limits;
use crate::model::sample::FieldValue;
use crate::monitor::{NO_SUCH_KEY, parse};
use crate::state::State;
use crate::time::Timestamp;

/// A number without the unit that follows it; any other text unchanged.
fn bare<'t>(text: &'t str, unit: Option<&str>) -> &'t str {
    let number = unit.and_then(|unit| text.trim().strip_suffix(unit)).map(str::trim_end);
    number.filter(|number| number.parse::<f64>().is_ok()).unwrap_or(text)
}

impl Watching {
    /// Takes the KeyValues of an array. Of two statuses with one name only the worse one counts, and only if
    /// the name counts.
    pub(crate) fn take_keys(
        &mut self,
        array: &StatusArray,
        counts: impl Fn(&str) -> bool,
        limits: &Limits,
        now: Timestamp,
        judge: &mut Vec<u32>,
    ) {
        if self.statuses.is_empty() {
            return;
        }
        let mut touched = std::mem::take(&mut self.touched);
        for (position, status) in array.iter().enumerate() {
            let Some((name, _)) = self.statuses.get_key_value(status.name()) else { continue };
            let name = name.clone();
            let Some(keyed) = self.statuses.get_mut(&name) else { continue };
            match keyed.position {
                None => {
                    keyed.position = Some(position);
                    touched.push(name);
                }
                Some(known) if status.state() > array.get(known).state() => keyed.position = Some(position),
                Some(_) => {}
            }
        }
        let mut taken = Vec::new();
        for name in touched.drain(..) {
            let Some(keyed) = self.statuses.get_mut(&name) else { continue };
            let Some(position) = keyed.position.take().filter(|_| counts(&name)) else { continue };
            let status = array.get(position);
            for reader in &keyed.keys {
                let text = status.values().find(|(key, _)| **key == *reader.key).map(|(_, text)| text);
                let value = match text {
                    // A repeated status repeats its values.
                    _ if status.state() == State::Unknown => {
                        FieldValue::Unreadable("the status is STALE".into())
                    }
                    Some(text) if text.len() > limits.string_bytes => {
                        let why = format!("longer than {} bytes", limits.string_bytes);
                        FieldValue::Unreadable(why.into())
                    }
                    Some(text) if reader.as_text => FieldValue::Text(text.into()),
                    Some(text) => parse(bare(text, reader.unit.as_deref())),
                    None => FieldValue::Unreadable(NO_SUCH_KEY.into()),
                };
                taken.push((reader.watch, reader.slot, value));
            }
        }
        self.touched = touched;
        taken.sort_by_key(|&(watch, slot, _)| (watch, slot));
        for (index, slot, value) in taken {
            let watch = &mut self.watches[index as usize];
            watch.monitor.take_value(slot as usize, &value, now);
            watch.pending = true;
            if judge.last() != Some(&index) {
                judge.push(index);
            }
        }
    }
}
