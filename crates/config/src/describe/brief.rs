//! Shortens two long values to the part in which they differ.

/// Shorter values are told whole.
const WHOLE_BYTES_MAX: usize = 80;
/// Words that stand around the difference.
const AROUND: usize = 2;
/// Of what differs no more is told.
const TOLD_CHARS_MAX: usize = 200;
/// Stands for words that both have.
const ALIKE: &str = "\u{2026}";

/// Both values without their common beginning and end, but for some words around the difference.
pub(super) fn brief(was: &str, is: &str) -> (String, String) {
    if was.len().max(is.len()) <= WHOLE_BYTES_MAX {
        return (was.to_owned(), is.to_owned());
    }
    let words = |text| str::split(text, ' ').collect::<Vec<_>>();
    let (was, is) = (words(was), words(is));
    let begin = was.iter().zip(&is).take_while(|(was, is)| was == is).count();
    let ends = was[begin..].iter().rev().zip(is[begin..].iter().rev());
    let end = ends.take_while(|(was, is)| was == is).count();
    (told(&was, begin, end), told(&is, begin, end))
}

/// One side without so many words at its beginning and its end.
fn told(words: &[&str], begin: usize, end: usize) -> String {
    let (begin, end) = (begin.saturating_sub(AROUND), end.saturating_sub(AROUND));
    let mut parts = vec![ALIKE; usize::from(begin > 0)];
    parts.extend(&words[begin..words.len() - end]);
    parts.extend(vec![ALIKE; usize::from(end > 0)]);
    let text = parts.join(" ");
    match text.char_indices().nth(TOLD_CHARS_MAX) {
        Some((cut, _)) => format!("{}{ALIKE}", &text[..cut]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: &str = "be ready to take over and to stop at the next safe place, then call the control room and wait for it";

    fn of(was: &str, is: &str) -> (String, String) {
        brief(was, is)
    }

    #[test]
    fn of_long_values_what_differs_is_told_with_some_words_around() {
        let both = |was: &str, is: &str| (was.to_owned(), is.to_owned());
        assert_eq!(of("5 s", "7 s"), both("5 s", "7 s"));
        for (new, told) in [
            // A word in the middle, one at either end, and two far from one another.
            (
                LONG.replace("safe", "free"),
                both(
                    "\u{2026} the next safe place, then \u{2026}",
                    "\u{2026} the next free place, then \u{2026}",
                ),
            ),
            (LONG.replacen("be", "stay", 1), both("be ready to \u{2026}", "stay ready to \u{2026}")),
            (LONG.replace("for it", "there"), both("\u{2026} and wait for it", "\u{2026} and wait there")),
            (
                LONG.replace("stop", "halt").replace("safe", "free"),
                both(
                    "\u{2026} and to stop at the next safe place, then \u{2026}",
                    "\u{2026} and to halt at the next free place, then \u{2026}",
                ),
            ),
            // Words that one side alone has.
            (
                LONG.replace("next safe ", "next "),
                both("\u{2026} the next safe place, then \u{2026}", "\u{2026} the next place, then \u{2026}"),
            ),
            (format!("{LONG} there"), both("\u{2026} for it", "\u{2026} for it there")),
        ] {
            assert_eq!(of(LONG, &new), told, "{new}");
        }
        let other = "x ".repeat(300);
        let (was, is) = of(LONG, other.trim());
        assert_eq!(was, LONG);
        assert_eq!(is.chars().count(), TOLD_CHARS_MAX + 1, "it has an end: {is}");
    }
}
