//! Detects shell patterns of file names in places for a name or a regular expression.

/// Whether it has a `*` or a set of letters. `[0]`, `[C]`, `[left]` and `well?` occur in real names.
pub(super) fn is_glob(text: &str) -> bool {
    text.contains('*') || sets(text).next().is_some()
}

/// `[a-z]` and `[!a]`.
fn sets(text: &str) -> impl Iterator<Item = &str> {
    let inside = text.split('[').skip(1).filter_map(|rest| rest.split_once(']')).map(|(inside, _)| inside);
    inside.filter(|inside| {
        let letters = inside.chars().count();
        let range = letters == 3 && inside.chars().nth(1) == Some('-');
        range || letters > 1 && inside.starts_with(['!', '^'])
    })
}

/// The equivalent regular expression.
pub(super) fn as_regex(glob: &str) -> String {
    let mut sets = sets(glob).peekable();
    let mut regex = String::new();
    let mut rest = glob;
    while let Some(letter) = rest.chars().next() {
        rest = &rest[letter.len_utf8()..];
        let set = sets.peek().filter(|inside| {
            letter == '[' && rest.strip_prefix(**inside).is_some_and(|after| after.starts_with(']'))
        });
        match (letter, set) {
            ('*', _) => regex.push_str(".*"),
            ('?', _) => regex.push('.'),
            (_, Some(inside)) => {
                rest = &rest[inside.len() + 1..];
                let (not, letters) = inside.strip_prefix('!').map_or(("", *inside), |letters| ("^", letters));
                regex.extend(["[", not, letters, "]"]);
                sets.next();
            }
            _ => regex.push_str(&regex_syntax::escape(letter.encode_utf8(&mut [0; 4]))),
        }
    }
    regex
}

/// Filters that match the same names as such a pattern.
pub(super) fn instead(glob: &str) -> String {
    let parts = glob.split(['*', '?', '[', ']']);
    let longest = parts.map(str::trim).max_by_key(|part| part.len()).unwrap_or_default();
    let is_plain =
        longest.chars().all(|letter| letter.is_alphanumeric() || matches!(letter, '/' | '_' | '.'));
    let contains = match longest {
        "" => String::new(),
        longest if is_plain => format!("`contains: {longest}` or "),
        longest => format!("`contains: '{longest}'` or "),
    };
    format!("{contains}`regex: '{}'`", as_regex(glob))
}
