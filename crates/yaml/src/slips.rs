//! Finds common mistakes for which the YAML parser has only a general error.

/// A value that contains `: `, as nearly every name of a ROS status does.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Unquoted<'t> {
    /// Byte of the value.
    pub start: usize,
    pub key: &'t str,
    pub value: &'t str,
    /// The value is itself a key, with keys or a list behind or below it: `monitor: value: { ... }`.
    pub nested: bool,
}

/// The lines in which a parser that stopped at `at` may have failed, each with its first byte; it often stops a
/// line later.
fn near(text: &str, at: usize) -> impl Iterator<Item = (usize, &str)> {
    let at = text.floor_char_boundary(at.min(text.len()));
    let line = text[..at].matches('\n').count();
    let starts = text.split_inclusive('\n').scan(0, |next, line| {
        let start = std::mem::replace(next, *next + line.len());
        Some((start, line.trim_end_matches(['\r', '\n'])))
    });
    starts.skip(line.saturating_sub(1)).take(3)
}

/// A tab in the indentation of a line.
pub(super) fn tab(text: &str, at: usize) -> Option<usize> {
    near(text, at).find_map(|(start, line)| {
        let indentation = line.len() - line.trim_start_matches([' ', '\t', '-']).len();
        line[..indentation].find('\t').map(|tab| start + tab)
    })
}

/// The first value near `at` that needs quotes for its colon.
pub(super) fn unquoted(text: &str, at: usize) -> Option<Unquoted<'_>> {
    near(text, at).take(2).find_map(|(start, line)| {
        let line = line.split(" #").next().unwrap_or(line);
        let is_deeper = is_deeper(text, start);
        // Lists and maps are not part of such a value; each part between their brackets may be one.
        let mut from = 0;
        line.split(['{', '}', ',', '[', ']']).find_map(|part| {
            let begin = start + from;
            from += part.len() + 1;
            let (key, value) = part.split_once(": ")?;
            let key = key.trim_start_matches([' ', '-']);
            let lead = value.len() - value.trim_start().len();
            let value_start = begin + part.len() - value.len() + lead;
            let value = value.trim();
            let plain = !value.starts_with(['\'', '"', '|', '>', '&', '*', '!']);
            let colon = value.contains(": ") || value.ends_with(':');
            let after = line[(from - 1).min(line.len())..].chars().next();
            let nested = value.strip_suffix(':').is_some_and(is_word)
                && (matches!(after, Some('{' | '[')) || after.is_none() && is_deeper);
            (plain && colon && is_word(key)).then_some(Unquoted { start: value_start, key, value, nested })
        })
    })
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Whether the line after the one that begins at `start` is indented deeper than its key.
fn is_deeper(text: &str, start: usize) -> bool {
    let column = |line: &str| line.len() - line.trim_start_matches([' ', '-']).len();
    let mut lines = text[start..].lines().filter(|line| !line.trim().is_empty());
    matches!((lines.next(), lines.next()), (Some(line), Some(next)) if column(next) > column(line))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_with_a_colon_is_found_in_lines_and_in_braces() {
        let found = |text: &'static str| unquoted(text, 0).map(|it| (it.start, it.key, it.value));
        assert_eq!(found("- status: imu: status"), Some((10, "status", "imu: status")));
        assert_eq!(found("a: { id: m, status: imu: status }"), Some((20, "status", "imu: status")));
        assert_eq!(found("status: imu:"), Some((8, "status", "imu:")));
        let nested = |text: &'static str| unquoted(text, 0).map(|it| it.nested);
        assert_eq!(nested("monitor: value: { status: s }"), Some(true));
        assert_eq!(nested("- when: stages: [active]"), Some(true));
        assert_eq!(nested("- monitor: value:\n    status: s"), Some(true));
        assert_eq!(nested("- status: imu:\n  timeout: 1s"), Some(false));
        assert_eq!(nested("status: imu: status"), Some(false));
        for fine in ["status: 'imu: status'", "a: { b: c, d: e }", "a: b # c: d", "status: imu:status"] {
            assert_eq!(found(fine), None, "{fine}");
        }
    }

    #[test]
    fn a_tab_is_found_in_the_indentation_alone() {
        assert_eq!(tab("a:\n\tb: 1\n", 3), Some(3));
        assert_eq!(tab("a:\n  - \tb: 1\n", 0), Some(7));
        assert_eq!(tab("a:\n  b: \t1\n", 3), None);
    }
}
