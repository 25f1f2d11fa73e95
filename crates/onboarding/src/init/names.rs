//! Names from outside: ids that a configuration takes, and text that cannot break out of a line or a terminal.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use telltale_yaml::plain::escaped;

const ID_BYTES_MAX: usize = 40;
const COMMENT_CHARS_MAX: usize = 160;

/// Ids of groups that the program itself makes, and words that YAML takes for something else than text.
const RESERVED: [&str; 5] = ["other", "telltale", "null", "true", "false"];

/// An id that is like the name and not taken yet; it is taken then.
pub fn id(name: &str, otherwise: &str, taken: &mut BTreeSet<String>) -> String {
    let mut id = String::new();
    for letter in name.chars() {
        match letter {
            letter if letter.is_ascii_alphanumeric() => id.push(letter.to_ascii_lowercase()),
            _ if id.ends_with('_') || id.is_empty() => {}
            _ => id.push('_'),
        }
        if id.len() >= ID_BYTES_MAX {
            break;
        }
    }
    let id = id.trim_end_matches('_');
    let id = if id.is_empty() { otherwise } else { id };
    let numbered = (2..).map(|number| format!("{id}_{number}"));
    let mut free = std::iter::once(id.to_owned()).chain(numbered);
    let is_free = |id: &String| !RESERVED.contains(&&**id) && !taken.contains(id);
    let id = free.find(is_free).unwrap_or_default();
    taken.insert(id.clone());
    id
}

/// The label for people: `Lidar front` of `lidar_front`, `IMU` of `imu`.
pub fn title(key: &str) -> String {
    let words = key.replace(['_', '-', '/'], " ");
    let words: String = words.trim().chars().take(ID_BYTES_MAX).collect();
    if words.len() <= 3 {
        return words.to_uppercase();
    }
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A text as a YAML scalar.
pub fn scalar(text: &str) -> String {
    if !text.contains('\n') && !text.contains('\t') && escaped(text) == text {
        return format!("'{}'", text.replace('\'', "''"));
    }
    let mut out = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => out.extend(['\\', letter]),
            ' '..='~' => out.push(letter),
            _ => drop(write!(out, "\\U{:08X}", letter as u32)),
        }
    }
    out.push('"');
    out
}

/// A text for a comment: one line, of a bounded length, without what acts on a terminal.
pub fn comment(text: &str) -> String {
    let mut short: String = text.chars().take(COMMENT_CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    escaped(&short.replace(['\n', '\t'], " ")).into_owned()
}

/// A full name of ROS with its namespace: `/camera/image`.
pub fn is_full_name(name: &str) -> bool {
    name.len() <= 256 && name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_word))
}

/// `package/msg/Name`.
pub fn is_type(name: &str) -> bool {
    let parts: Vec<&str> = name.split('/').collect();
    name.len() <= 256 && parts.len() == 3 && parts[1] == "msg" && parts.iter().all(|part| is_word(part))
}

fn is_word(part: &str) -> bool {
    !part.is_empty()
        && !part.starts_with(|first: char| first.is_ascii_digit())
        && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Whether a node belongs to a tool, which comes and goes: those of Telltale, and hidden ones such as the daemon
/// of `ros2`.
pub fn is_tool(node: &str) -> bool {
    let name = node.rsplit('/').next().unwrap_or(node);
    name.starts_with('_') || name.starts_with("telltale")
}

/// The origin in a status' name: `driver` of `driver: temperature`, `/base` of `/base/motors`.
pub fn prefix(status: &str) -> Option<&str> {
    let before = match status.split_once(':') {
        Some((before, _)) => before,
        None => status.rsplit_once('/')?.0,
    };
    Some(before.trim()).filter(|it| !it.trim_matches('/').is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn titles_are_words() {
        for (key, expected) in [
            ("lidar_front", "Lidar front"),
            ("imu", "IMU"),
            ("_", ""),
            ("amcl", "Amcl"),
            ("日本語版", "日本語版"),
        ] {
            assert_eq!(title(key), expected);
        }
    }
}
