//! Finds received names that resemble a configured name without a status, and shows them where the status is
//! missing.

use super::Engine;
use super::model::filter::Filter;
use super::model::{GroupId, ModuleId};
use super::monitor::cut;
use super::text::Text;
use super::text::say;

/// Letters of a name that are compared.
const LETTERS_MAX: usize = 96;
/// Comparisons of names after a start or a reload. A vehicle needs a few thousand; a flood of names costs some
/// tens of milliseconds in total.
pub(super) const COMPARISONS_MAX: u32 = 20_000;
/// A shorter part of a filter would match too many names.
const PART_MIN: usize = 3;

impl Engine {
    /// Compares a name that is received for the first time with every status and filter that has not matched
    /// yet, and notes the similar ones.
    pub(super) fn compare_new_name(&mut self, heard: &str, unclaimed: bool) {
        let model = self.model.clone();
        for (id, module) in (0..).map(ModuleId).zip(&model.modules) {
            let unheard = self.net.modules[id.0 as usize].own.received().is_none();
            if !unheard || !self.views.says_nothing(id) {
                continue;
            }
            if module.monitor.statuses().any(|it| self.may_compare() && alike(&it, heard)) {
                self.views.set_message(id, never_heard(heard));
            }
        }
        if !unclaimed {
            return;
        }
        for (id, group) in (0..).map(GroupId).zip(&model.groups) {
            if self.net.groups[id.0 as usize].members.is_empty()
                && group
                    .filters
                    .iter()
                    .any(|filter| self.may_compare() && nearly_matches(&filter.filter, heard))
            {
                self.views.hint(id, nothing_matches(heard));
            }
        }
    }

    fn may_compare(&mut self) -> bool {
        self.comparisons = self.comparisons.saturating_sub(1);
        self.comparisons > 0
    }
}

fn never_heard(heard: &str) -> Text {
    say!("never heard; `{heard}` is heard", "nie empfangen; `{heard}` wird empfangen", heard = cut(heard))
}

fn nothing_matches(heard: &str) -> Text {
    say!(
        "nothing matches; `{heard}` in other looks alike",
        "nichts passt; `{heard}` unter Sonstige sieht ähnlich aus",
        heard = cut(heard)
    )
}

/// The letters and digits of a name, in lower case: the part that distinguishes names.
fn plain(name: &str) -> Vec<char> {
    let letters = name.chars().filter(|letter| letter.is_alphanumeric());
    letters.flat_map(char::to_lowercase).take(LETTERS_MAX).collect()
}

/// Whether one name may be a misspelling of the other. Names with different numbers belong to different things.
fn alike(wanted: &str, heard: &str) -> bool {
    let (a, b) = (plain(wanted), plain(heard));
    let (short, long) = if a.len() < b.len() { (&a, &b) } else { (&b, &a) };
    if wanted == heard || short.len() < PART_MIN || numbers(&a) != numbers(&b) {
        return false;
    }
    let part = long.starts_with(short) || long.ends_with(short);
    part || distance(&a, &b) <= long.len() / 6
}

fn numbers(name: &[char]) -> Vec<char> {
    name.iter().copied().filter(char::is_ascii_digit).collect()
}

/// Whether a filter was probably meant to match this name but does not.
fn nearly_matches(filter: &Filter, heard: &str) -> bool {
    let part = match filter {
        Filter::Name(name) => return alike(name, heard),
        Filter::Namespace(text) | Filter::Contains(text) => text,
        Filter::Regex(regex) => {
            let literal = |letter: char| letter.is_alphanumeric() || "_/:- ".contains(letter);
            let parts = regex.as_str().split(|letter| !literal(letter));
            parts.max_by_key(|part| part.len()).unwrap_or_default()
        }
    };
    let (part, name) = (plain(part), plain(heard));
    if part.len() < PART_MIN || name.len() < part.len() {
        return false;
    }
    let near = |start: &[char]| distance(&part, start) <= part.len() / 4;
    name.windows(part.len()).any(|inside| *inside == *part) || near(&name[..part.len()])
}

/// The edit distance: letters to change, add or remove.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, y) in b.iter().enumerate() {
            let changed = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_were_meant_are_told_from_those_of_other_things() {
        for (wanted, heard) in [
            ("imu: status", "imu: Status"),
            ("imu: status", "/imu: status"),
            ("imu", "imu: Status"),
            ("lidar_front: temperature", "lidar_front: temprature"),
            ("velodyne_packet_alive", "velodyne packet alive"),
        ] {
            assert!(alike(wanted, heard), "{wanted} {heard}");
        }
        for (wanted, heard) in [
            ("imu: status", "imu: status"),
            ("wheel_1: speed", "wheel_2: speed"),
            ("lidar: status", "radar: status"),
            ("gps", "planner"),
            ("a", "ab"),
        ] {
            assert!(!alike(wanted, heard), "{wanted} {heard}");
        }
    }

    #[test]
    fn filters_that_miss_by_little_are_known() {
        let regex = |pattern| Filter::regex(pattern).unwrap();
        for (filter, heard) in [
            (Filter::Namespace("/sensor".into()), "/sensors/imu"),
            (Filter::Namespace("amcl".into()), "/amcl: x"),
            (Filter::Name("amcl: X".into()), "/amcl: x"),
            (regex("velodine_.*"), "velodyne_packets: rate"),
            (regex(r"amcl\d+"), "/amcl: x"),
            (Filter::Contains("Lidar".into()), "front lidar"),
        ] {
            assert!(nearly_matches(&filter, heard), "{filter:?} {heard}");
        }
        for (filter, heard) in
            [(Filter::Namespace("/sensors".into()), "/planner"), (regex(".*"), "x"), (regex("a.*"), "/amcl")]
        {
            assert!(!nearly_matches(&filter, heard), "{filter:?} {heard}");
        }
    }
}
