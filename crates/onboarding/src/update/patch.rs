//! What differs between two texts, line by line, as `patch` reads it.

use std::fmt::Write as _;

/// Lines around each change.
const AROUND: usize = 3;
/// So many equal lines end a change.
const EQUAL: usize = 2;

/// A unified diff; empty if both texts are the same. It need not be the shortest.
pub fn patch(name: &str, old: &str, new: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) =
        (old.split_inclusive('\n').collect(), new.split_inclusive('\n').collect());
    let mut changes = changes(&old, &new).into_iter().peekable();
    let mut out = String::new();
    while let Some(first) = changes.next() {
        // Changes that lie close to each other have one heading.
        let mut all = vec![first];
        while let Some(next) = changes.next_if(|next| next.old.0 <= all[all.len() - 1].old.1 + 2 * AROUND) {
            all.push(next);
        }
        hunk(&mut out, &old, &new, &all);
    }
    if out.is_empty() { out } else { format!("--- {name}\n+++ {name}\n{out}") }
}

/// Lines of the old text, from one up to another, and the new ones in their place.
struct Change {
    old: (usize, usize),
    new: (usize, usize),
}

fn changes(old: &[&str], new: &[&str]) -> Vec<Change> {
    let (mut at, mut changes) = ((0, 0), Vec::new());
    while at.0 < old.len() || at.1 < new.len() {
        let equal = |(left, right): (usize, usize)| match (old.get(left..), new.get(right..)) {
            (Some([]), Some([])) => true,
            (Some(left @ [_, ..]), Some(right @ [_, ..])) => {
                let count = EQUAL.min(left.len()).min(right.len());
                left[..count] == right[..count]
            }
            _ => false,
        };
        if at.0 < old.len() && at.1 < new.len() && old[at.0] == new[at.1] {
            at = (at.0 + 1, at.1 + 1);
            continue;
        }
        // The nearest place where both go on alike; at the latest that is the end of both.
        let end = (old.len() - at.0) + (new.len() - at.1);
        let mut places =
            (1..=end).flat_map(|sum| (0..=sum).map(move |left| (at.0 + left, at.1 + sum - left)));
        let next = places.find(|it| equal(*it)).unwrap_or((old.len(), new.len()));
        changes.push(Change { old: (at.0, next.0), new: (at.1, next.1) });
        at = next;
    }
    changes
}

fn hunk(out: &mut String, old: &[&str], new: &[&str], all: &[Change]) {
    let (first, last) = (&all[0], &all[all.len() - 1]);
    let before = first.old.0.min(AROUND);
    let after = (old.len() - last.old.1).min(AROUND);
    let from = (first.old.0 - before, first.new.0 - before);
    let counts = (last.old.1 + after - from.0, last.new.1 + after - from.1);
    let start = |from: usize, count: usize| if count == 0 { from } else { from + 1 };
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "@@ -{},{} +{},{} @@",
        start(from.0, counts.0),
        counts.0,
        start(from.1, counts.1),
        counts.1
    );
    let mut put = |sign: char, lines: &[&str]| {
        for line in lines {
            let end = if line.ends_with('\n') { "" } else { "\n\\ No newline at end of file\n" };
            let _ = write!(out, "{sign}{line}{end}");
        }
    };
    let mut at = from.0;
    for change in all {
        put(' ', &old[at..change.old.0]);
        put('-', &old[change.old.0..change.old.1]);
        put('+', &new[change.new.0..change.new.1]);
        at = change.old.1;
    }
    put(' ', &old[at..at + after]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_has_the_changed_lines_and_three_around_them() {
        let old = "a\nb\nc\nd\ne\nf\ng\nh\ni\nj\nk\nl\nm\nn\no\np\n";
        let new = "a\nb\nc\nd\nE\nf\ng\nh\ni\nj\nk\nl\nm\nm2\nn\no\np";
        let expected = "--- f\n+++ f\n@@ -2,7 +2,7 @@\n b\n c\n d\n-e\n+E\n f\n g\n h\n\
             @@ -11,6 +11,7 @@\n k\n l\n m\n+m2\n n\n o\n-p\n+p\n\\ No newline at end of file\n";
        assert_eq!(patch("f", old, new), expected);
        assert_eq!(patch("f", old, old), "");
        assert_eq!(patch("f", "", "a\n"), "--- f\n+++ f\n@@ -0,0 +1,1 @@\n+a\n");
        assert_eq!(patch("f", "a\nb\n", "a\n"), "--- f\n+++ f\n@@ -1,2 +1,1 @@\n a\n-b\n");
    }
}
