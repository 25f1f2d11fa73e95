//! The names of nodes in the tree for the tools of ROS 2, which identify a status by its path.

use std::collections::HashSet;

/// Stands in a path for a name that has no permitted character.
pub const NO_NAME: &str = "(no name)";

/// A name as a part of a path: a `/` in it would make another level of the tree.
pub fn part(name: &str) -> String {
    name.replace('/', " ").trim().to_owned()
}

/// A status name without the prefixes, each removed in turn where it is there, with a `:` and the spaces behind it;
/// `None` if that leaves the whole name. Nothing may be left. A `/` is like a space, as in the paths of the tree.
pub fn shortened(name: &str, prefixes: &[Box<str>]) -> Option<String> {
    let is_border = |letter: char| letter == ' ' || letter == '/';
    let same = |(a, b): (char, char)| a == b || is_border(a) && is_border(b);
    let mut rest = name;
    for prefix in prefixes.iter().filter(|prefix| !prefix.is_empty()) {
        let head = rest.get(..prefix.len());
        if head.is_some_and(|head| head.chars().zip(prefix.chars()).all(same)) {
            rest = &rest[prefix.len()..];
        }
        rest = rest.strip_prefix(':').unwrap_or(rest).trim_start_matches(is_border);
    }
    (rest.len() < name.len()).then(|| rest.to_owned())
}

/// The names of siblings as parts of a path, in order. No two are equal, and none is empty: a later one becomes
/// `NAME (2)`.
pub fn unique(parts: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut taken = HashSet::new();
    let distinct = |part: String| {
        let part = if part.is_empty() { NO_NAME.to_owned() } else { part };
        let second = (2..).map(|number| format!("{part} ({number})"));
        let free = std::iter::once(part.clone()).chain(second).find(|part| !taken.contains(part));
        let free = free.unwrap_or(part);
        taken.insert(free.clone());
        free
    };
    parts.into_iter().map(distinct).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_parts_are_the_same_whatever_they_are_called() {
        let parts = |names: &[&str]| unique(names.iter().map(|name| part(name)));
        assert_eq!(parts(&["a", "b", "a"]), ["a", "b", "a (2)"]);
        assert_eq!(parts(&["a/b", "a b", " a b "]), ["a b", "a b (2)", "a b (3)"]);
        assert_eq!(parts(&["a", "a (2)", "a", "a"]), ["a", "a (2)", "a (3)", "a (4)"]);
        assert_eq!(parts(&["/", ""]), ["(no name)", "(no name) (2)"]);
    }

    #[test]
    fn a_prefix_goes_with_the_colon_and_the_spaces_behind_it() {
        let short = |name: &str, prefixes: &[&str]| {
            let prefixes: Vec<Box<str>> = prefixes.iter().map(|&prefix| prefix.into()).collect();
            shortened(name, &prefixes)
        };
        for (name, prefixes, expected) in [
            ("hokuyo: Connection", &["hokuyo"][..], Some("Connection")),
            ("/arms/left/motor", &["/arms"], Some("left/motor")),
            ("/arms/left/motor", &[" arms "], Some("left/motor")),
            ("a: b: c", &["a", "b"], Some("c")),
            ("/legs/motor", &["arms"], Some("legs/motor")),
            ("legs", &["arms"], None),
            ("arms", &["arms"], Some("")),
            ("arms", &[""], None),
            ("ärme: x", &["ärm"], Some("e: x")),
            ("ä", &["a"], None),
        ] {
            assert_eq!(short(name, prefixes).as_deref(), expected, "{name} {prefixes:?}");
        }
    }
}
