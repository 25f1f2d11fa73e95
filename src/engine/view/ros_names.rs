//! The names of nodes in the tree for the tools of ROS 2, which identify a status by its path.

use std::collections::HashSet;

/// A name as a part of a path: a `/` in it would make another level of the tree.
pub fn part(name: &str) -> String {
    name.replace('/', " ").trim().to_owned()
}

/// The names of siblings as parts of a path, in order. No two are equal, and none is empty: a later one becomes
/// `NAME (2)`.
pub fn unique(parts: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut taken = HashSet::new();
    let distinct = |part: String| {
        let part = if part.is_empty() { "(no name)".to_owned() } else { part };
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
}
