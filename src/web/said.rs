//! What the monitors measured, in the operator's language. They say it in English, in few forms.

use super::view::Lang;

/// Messages without measured words; a pair that ends in a space goes before something else.
const FORMS: &[(&str, &str)] = &[
    ("not measured while it does not matter", "zählt zurzeit nicht, nicht gemessen"),
    ("not asked while it does not matter", "zählt zurzeit nicht, nicht gefragt"),
    ("not asked yet", "noch nicht gefragt"),
    ("the message has no readable stamp", "Nachricht ohne lesbaren Zeitstempel"),
    ("the stamp was not set", "Zeitstempel nicht gesetzt"),
    ("measuring for ", "wird gemessen seit "),
    ("no message for ", "keine Nachricht seit "),
    ("no input for ", "keine Eingabe seit "),
    ("nothing came yet of ", "noch nichts gekommen von "),
    ("nobody asked it for ", "nicht gefragt seit "),
    ("it cannot be asked: ", "nicht zu fragen: "),
    ("they differ by ", "Abweichung "),
    ("later minus earlier: ", "später minus früher: "),
];

/// Turns a cleaned message into the language where it has one of the forms; others stay.
pub fn said(lang: Lang, message: String) -> String {
    match lang {
        Lang::En => message,
        Lang::De => of_form(&message).or_else(|| measured(&message)).unwrap_or(message),
    }
}

fn of_form(message: &str) -> Option<String> {
    FORMS.iter().find_map(|(english, german)| match message.strip_prefix(english)? {
        "" => Some((*german).to_owned()),
        rest if english.ends_with(' ') => {
            Some(format!("{german}{}", measured(rest).unwrap_or_else(|| rest.to_owned())))
        }
        _ => None,
    })
}

/// `4.2 Hz, at least 9 wanted`, `17, -2 to 6 wanted`: a comma, what was wanted, `wanted`.
fn measured(message: &str) -> Option<String> {
    let (value, wanted) = message.strip_suffix(" wanted")?.rsplit_once(", ")?;
    let wanted = if let Some(limit) = wanted.strip_prefix("at least ") {
        format!("mindestens {}", comma(limit))
    } else if let Some(limit) = wanted.strip_prefix("at most ") {
        format!("höchstens {}", comma(limit))
    } else if let Some((lower, upper)) = wanted.split_once(" to ") {
        format!("{} bis {}", comma(lower), comma(upper))
    } else {
        wanted.to_owned()
    };
    let (value, unit) = value.split_once(' ').unwrap_or((value, ""));
    Some(format!("{} {unit}", comma(value)).trim_end().to_owned() + &format!(", erwartet {wanted}"))
}

/// A number with the decimal comma; anything else stays.
fn comma(number: &str) -> String {
    if number.parse::<f64>().is_ok() { number.replace('.', ",") } else { number.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measured_words_are_german_and_others_stay() {
        for (english, german) in [
            ("0 Hz, at least 8 wanted", "0 Hz, erwartet mindestens 8"),
            ("4.2 Hz, at most 2.5 wanted", "4,2 Hz, erwartet höchstens 2,5"),
            ("17.3, -200 to 600 wanted", "17,3, erwartet -200 bis 600"),
            ("manual, auto wanted", "manual, erwartet auto"),
            ("no message for 2 s", "keine Nachricht seit 2 s"),
            ("they differ by 0.5, at most 0.2 wanted", "Abweichung 0,5, erwartet höchstens 0,2"),
            ("not asked yet, never", "not asked yet, never"),
            ("Images arrive", "Images arrive"),
            (" wanted", " wanted"),
        ] {
            assert_eq!(said(Lang::De, english.to_owned()), german);
            assert_eq!(said(Lang::En, english.to_owned()), english);
        }
    }
}
