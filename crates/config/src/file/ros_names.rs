//! Checks names in the form of ROS 2: topics, message types and paths of fields.

use crate::decode::Spanned;
use telltale_yaml::{Log, Problem};

/// A longer path names no field of a message.
pub(super) const PATH_BYTES_MAX: usize = 512;

/// A full name with its namespace: `/mission/active`.
pub fn is_full_name(name: &str) -> bool {
    let word = |part: &str| {
        !part.is_empty()
            && !part.starts_with(|c: char| c.is_ascii_digit())
            && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(word))
}

pub fn check_topic(topic: &Spanned<String>, log: &mut Log) {
    if !is_full_name(&topic.value) {
        let problem = Problem::at(topic.span, format!("`{}` is no full topic name", topic.value));
        log.push(problem.help("begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`"));
    }
}

/// Checks a name in which `*` may stand for any characters.
pub fn check_topic_pattern(pattern: &Spanned<String>, log: &mut Log) {
    let text = &pattern.value;
    let is_pattern = text.starts_with('/')
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'/' | b'*'));
    if !is_pattern || !text.contains('*') && !is_full_name(text) {
        let problem = Problem::at(pattern.span, format!("`{text}` names no topic"));
        log.push(problem.help("begin with `/`; letters, digits, `_`, `/` and `*` follow: `/camera/*`"));
    }
}

pub fn check_type(name: &Spanned<String>, log: &mut Log) {
    let parts: Vec<&str> = name.value.split('/').collect();
    let word = |part: &&str| {
        !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    if parts.len() == 3 && parts[1] == "msg" && parts.iter().all(word) {
        return;
    }
    let problem = Problem::at(name.span, format!("`{}` is no message type", name.value));
    log.push(problem.help(match parts[..] {
        [package, message] if word(&package) && word(&message) => {
            format!("did you mean `{package}/msg/{message}`?")
        }
        _ => "write `package/msg/Name`, for example `std_msgs/msg/Bool`".into(),
    }));
}

/// Checks the form of a field's path: `poses[0].position.x`, `transforms[child_frame_id=base].transform`.
pub fn check_path(path: &Spanned<String>, log: &mut Log) {
    if path.value.len() > PATH_BYTES_MAX || path.value.contains("[]") || !is_path(&path.value) {
        let problem = Problem::at(path.span, format!("`{}` is no path of a field", path.value));
        log.push(problem.help(
            "write names with dots, elements in brackets: `twist.linear.x`, `poses[0].position.x`, `transforms[child_frame_id=base_link].transform`",
        ));
    }
}

/// The same for a list, in which `[]` may stand once for each element.
pub fn check_list(path: &Spanned<String>, log: &mut Log) {
    if path.value.len() > PATH_BYTES_MAX || path.value.matches("[]").count() > 1 || !is_path(&path.value) {
        let problem = Problem::at(path.span, format!("`{}` is no path of a list", path.value));
        log.push(problem.help(
            "name the array, or what has `x` and `y` in each element: `poses`, `detections[].bbox.center.position`",
        ));
    }
}

/// Splits at the dots outside of brackets and checks each part.
fn is_path(path: &str) -> bool {
    let mut rest = path;
    loop {
        let name = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
        if name == 0 || rest.starts_with(|c: char| c.is_ascii_digit()) {
            return false;
        }
        rest = &rest[name..];
        while let Some(inside) = rest.strip_prefix('[') {
            let Some((index, after)) = inside.split_once(']') else { return false };
            let last = index == "-1";
            let number = !index.is_empty() && index.bytes().all(|byte| byte.is_ascii_digit());
            let chosen = index.split_once('=').is_some_and(|(field, _)| is_path(field));
            if !number && !last && !chosen && !index.is_empty() {
                return false;
            }
            rest = after;
        }
        match rest.strip_prefix('.') {
            Some(after) => rest = after,
            None => return rest.is_empty(),
        }
    }
}
