//! Estimates the width of texts without a browser, so that entries without room are counted instead of cut.

/// Height of a line of large and of small type on the reference display, in pixels.
pub const LARGE: usize = 35;
pub const SMALL: usize = 29;
/// The width of a line in the list of causes, in letter heights.
pub const LARGE_EM: f64 = 9.86;
pub const SMALL_EM: f64 = 13.1;
/// The same for the action bar's list.
pub const SMALL_EM_BAR: f64 = 19.0;
/// The same with one more button beside it.
pub const SMALL_EM_BAR_NARROW: f64 = 13.0;

/// The number of lines of a text, if a line is `em` wide and breaks at words, in the embedded font.
pub fn lines(text: &str, em: f64, most: usize) -> usize {
    let widths = if em <= LARGE_EM { &BOLD } else { &PLAIN };
    let space = width(' ', widths);
    let (mut lines, mut used) = (0, em);
    for word in text.split(' ').filter(|word| !word.is_empty()) {
        let width: f64 = word.chars().map(|letter| width(letter, widths)).sum();
        if lines == 0 || used + space + width > em {
            // A word longer than a line is broken wherever the line ends.
            lines += (width / em).ceil().max(1.0) as usize;
            used = width % em;
        } else {
            used += space + width;
        }
    }
    lines.min(most)
}

/// Widths of the embedded font's letters from space to tilde, in hundredths of their height: in
/// titles and actions, which are bold and set closer, and in running text.
#[rustfmt::skip]
const BOLD: [u8; 95] = [
    21, 32, 54, 63, 64, 100, 65, 32, 36, 36, 54, 66, 32, 45, 32, 37, 66, 41, 61,
    63, 66, 60, 63, 56, 63, 63, 32, 33, 66, 66, 66, 54, 100, 73, 64, 72, 70, 59,
    57, 73, 73, 26, 57, 70, 55, 91, 74, 75, 63, 76, 64, 64, 65, 71, 73, 102, 72,
    72, 65, 36, 37, 36, 47, 46, 35, 56, 61, 57, 61, 58, 38, 61, 61, 25, 25, 56,
    25, 90, 61, 59, 61, 61, 39, 54, 35, 61, 58, 83, 56, 58, 55, 45, 36, 45, 66,
];
#[rustfmt::skip]
const PLAIN: [u8; 95] = [
    27, 30, 49, 64, 65, 99, 65, 31, 37, 37, 52, 67, 30, 46, 30, 37, 65, 42, 62,
    63, 66, 60, 63, 57, 63, 63, 30, 32, 67, 67, 67, 53, 98, 71, 66, 73, 72, 60,
    59, 75, 74, 27, 58, 69, 57, 91, 76, 77, 64, 77, 65, 65, 65, 74, 71, 100, 70,
    70, 64, 37, 37, 37, 48, 46, 34, 57, 62, 58, 62, 59, 38, 62, 60, 25, 25, 56,
    25, 89, 60, 60, 62, 62, 39, 54, 34, 60, 57, 83, 56, 58, 56, 44, 35, 44, 67,
];

fn width(letter: char, widths: &[u8; 95]) -> f64 {
    let plain = match letter {
        'ä' => 'a',
        'ö' => 'o',
        'ü' => 'u',
        'Ä' => 'A',
        'Ö' => 'O',
        'Ü' => 'U',
        'ß' => 'B',
        // It keeps two words together.
        '\u{a0}' => ' ',
        other => other,
    };
    let known = (plain as usize).checked_sub(' ' as usize).and_then(|index| widths.get(index));
    known.map_or(1.0, |&hundredths| f64::from(hundredths) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_estimated_as_a_browser_breaks_them() {
        for (text, expect) in [
            ("", 0),
            ("LiDAR data missing", 1),
            ("Position ist gesprungen", 2),
            ("Keine Verbindung zum Fahrzeug", 2),
            ("Am nächsten sicheren Ort anhalten. Leitstelle rufen.", 4),
            ("Take over. Stop. Call the control room.", 2),
        ] {
            assert_eq!(lines(text, LARGE_EM, 9), expect, "{text}");
        }
        assert_eq!(lines(&"w".repeat(500), LARGE_EM, 2), 2);
    }
}
