//! Shortens two long values to the parts in which they differ.

/// Shorter values are told whole.
const WHOLE_BYTES_MAX: usize = 80;
/// Words that stand around a difference.
const AROUND: usize = 2;
/// Of longer values only the beginnings and the ends are compared.
const WORDS_MAX: usize = 500;
/// Of what differs no more is told.
const TOLD_CHARS_MAX: usize = 200;
/// Stands for words that both have.
const ALIKE: &str = "\u{2026}";

/// Both values without what is alike in them, but for some words around each difference.
pub(super) fn brief(was: &str, is: &str) -> (String, String) {
    if was.len().max(is.len()) <= WHOLE_BYTES_MAX {
        return (was.to_owned(), is.to_owned());
    }
    let words = |text| str::split(text, ' ').collect::<Vec<_>>();
    let (was, is) = (words(was), words(is));
    let pairs = alike(&was, &is);
    let of_was = pairs.iter().map(|&(was, is)| (was, is));
    let of_is = pairs.iter().map(|&(was, is)| (is, was));
    (told(&was, is.len(), of_was), told(&is, was.len(), of_is))
}

/// The places of words that both have, in their order.
fn alike(was: &[&str], is: &[&str]) -> Vec<(usize, usize)> {
    let begin = was.iter().zip(is).take_while(|(was, is)| was == is).count();
    let ends = was[begin..].iter().rev().zip(is[begin..].iter().rev());
    let end = ends.take_while(|(was, is)| was == is).count();
    let (was_end, is_end) = (was.len() - end, is.len() - end);
    let mut pairs: Vec<(usize, usize)> = (0..begin).map(|place| (place, place)).collect();
    let (was, is) = (&was[begin..was_end], &is[begin..is_end]);
    if was.len().max(is.len()) <= WORDS_MAX {
        pairs.extend(in_order(was, is).into_iter().map(|(was, is)| (begin + was, begin + is)));
    }
    pairs.extend((0..end).map(|place| (was_end + place, is_end + place)));
    pairs
}

/// As many places of words that both have as stand in the same order.
fn in_order(was: &[&str], is: &[&str]) -> Vec<(usize, usize)> {
    let width = is.len() + 1;
    // How many there are from these two places on.
    let mut counts = vec![0_u16; (was.len() + 1) * width];
    for left in (0..was.len()).rev() {
        for right in (0..is.len()).rev() {
            let [down, aside, both] = [(left + 1, right), (left, right + 1), (left + 1, right + 1)]
                .map(|(l, r)| counts[l * width + r]);
            counts[left * width + right] = if was[left] == is[right] { both + 1 } else { down.max(aside) };
        }
    }
    let (mut left, mut right, mut pairs) = (0, 0, Vec::new());
    while left < was.len() && right < is.len() {
        if was[left] == is[right] {
            pairs.push((left, right));
            (left, right) = (left + 1, right + 1);
        } else if counts[(left + 1) * width + right] >= counts[left * width + right + 1] {
            left += 1;
        } else {
            right += 1;
        }
    }
    pairs
}

/// One side, given the number of words of the other side, and the places of those that both have.
fn told(words: &[&str], others_count: usize, alike: impl Iterator<Item = (usize, usize)>) -> String {
    let mut others = vec![None; words.len()];
    alike.for_each(|(place, other)| others[place] = Some(other));
    let mut is_told = vec![false; words.len()];
    let mut tell_around = |from: usize, to: usize| {
        let to = (to + AROUND).min(words.len());
        is_told[from.saturating_sub(AROUND)..to].fill(true);
    };
    // Before the next word, the other side may have some that this one lacks.
    let mut next = 0;
    for (place, other) in others.iter().enumerate() {
        match *other {
            None => tell_around(place, place + 1),
            Some(other) if other == next => {}
            Some(_) => tell_around(place, place),
        }
        next = other.map_or(next, |other| other + 1);
    }
    if next < others_count {
        tell_around(words.len(), words.len());
    }
    let mut parts = Vec::new();
    for (word, is_told) in words.iter().zip(&is_told) {
        match is_told {
            true => parts.push(*word),
            false if parts.last() == Some(&ALIKE) => {}
            false => parts.push(ALIKE),
        }
    }
    let text = parts.join(" ");
    match text.char_indices().nth(TOLD_CHARS_MAX) {
        Some((end, _)) => format!("{}{ALIKE}", &text[..end]),
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
                LONG.replace("ready", "prepared").replace("control", "service"),
                both(
                    "be ready to take \u{2026} call the control room and \u{2026}",
                    "be prepared to take \u{2026} call the service room and \u{2026}",
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
