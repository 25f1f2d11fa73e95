//! How much room words take, estimated without a browser: so that what has none is counted, not cut.

/// Height of a line of large and of small type on the reference display, in pixels.
pub const LARGE: usize = 35;
pub const SMALL: usize = 29;
/// How many letters' heights a line of the list of causes is wide.
pub const LARGE_EM: f64 = 9.85;
pub const SMALL_EM: f64 = 13.1;
/// The same for the action bar's list.
pub const SMALL_EM_BAR: f64 = 19.0;
/// And with one more button beside it.
pub const SMALL_EM_BAR_NARROW: f64 = 13.0;
const SPACE_EM: f64 = 0.27;

/// How many lines a text takes where one is `em` wide: broken at words, in the embedded font.
pub fn lines(text: &str, em: f64, most: usize) -> usize {
    let (mut lines, mut used) = (0, em);
    for word in text.split(' ').filter(|word| !word.is_empty()) {
        let width: f64 = word.chars().map(width).sum();
        if lines == 0 || used + SPACE_EM + width > em {
            // A word longer than a line is broken wherever the line ends.
            lines += (width / em).ceil().max(1.0) as usize;
            used = width % em;
        } else {
            used += SPACE_EM + width;
        }
    }
    lines.min(most)
}

/// Widths of the embedded font's letters from space to tilde, in hundredths of their height: the
/// wider one of running text and of titles.
#[rustfmt::skip]
const WIDTHS: [u8; 95] = [
    27, 32, 54, 64, 65, 100, 65, 32, 37, 37, 54, 67, 32, 46, 32, 37, 66, 42, 62,
    63, 66, 60, 63, 57, 63, 63, 32, 33, 67, 67, 67, 54, 100, 73, 66, 73, 72, 60,
    59, 75, 74, 27, 58, 70, 57, 91, 76, 77, 64, 77, 65, 65, 65, 74, 73, 102, 72,
    72, 65, 37, 37, 37, 48, 46, 35, 57, 62, 58, 62, 59, 38, 62, 61, 25, 25, 56,
    25, 90, 61, 60, 62, 62, 39, 54, 35, 61, 58, 83, 56, 58, 56, 45, 36, 45, 67,
];

fn width(letter: char) -> f64 {
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
    let known = (plain as usize).checked_sub(' ' as usize).and_then(|index| WIDTHS.get(index));
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
