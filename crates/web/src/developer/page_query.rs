//! Reads the address of a developer page: its filter, its order, its open parts. The address is the whole
//! state of a page, so that it can be kept, sent and reloaded.

use crate::texts::{clean, encode};

/// Fields that are read; more are ignored.
const PAIRS: usize = 64;
/// A field that no address may have: only the page's script asks for so many rows, for a file.
const ROWS: &str = "rows";
/// Letters of one value.
const LETTERS: usize = 400;

/// The fields of an address in their order; a name may stand there more than once.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PageQuery(Vec<(String, String)>);

impl PageQuery {
    pub fn of(pairs: Vec<(String, String)>) -> PageQuery {
        let short = |(_, value): &(String, String)| value.chars().count() <= LETTERS;
        let may_stand = |(name, _): &(String, String)| name != ROWS;
        PageQuery(pairs.into_iter().filter(short).filter(may_stand).take(PAIRS).collect())
    }

    /// The same page with all rows of its tables.
    pub fn of_all_rows(mut self) -> PageQuery {
        self.0.push((ROWS.to_owned(), "all".to_owned()));
        self
    }

    pub fn wants_all_rows(&self) -> bool {
        !self.get(ROWS).is_empty()
    }

    /// The first value of a field; empty if it is not there.
    pub fn get(&self, name: &str) -> &str {
        self.all(name).next().unwrap_or("")
    }

    /// All values of a field that are not empty.
    pub fn all(&self, name: &str) -> impl Iterator<Item = &str> {
        let named = self.0.iter().filter(move |(key, value)| key == name && !value.is_empty());
        named.map(|(_, value)| &**value)
    }

    pub fn number(&self, name: &str) -> Option<u64> {
        self.get(name).parse().ok()
    }

    /// The address of this page with another value of a field; without the field if `value` is empty.
    pub fn with(&self, name: &str, value: &str) -> String {
        let kept = self.0.iter().filter(|(key, _)| key != name);
        address(kept.map(pair).chain([(name, value)]))
    }

    /// The address of this page with other values of some fields; without those that are empty.
    pub fn with_all(&self, fields: &[(&str, &str)]) -> String {
        let is_new = |key: &str| fields.iter().any(|(name, _)| *name == key);
        address(self.0.iter().filter(|(key, _)| !is_new(key)).map(pair).chain(fields.iter().copied()))
    }

    /// The address of this page with a value of a field added, or removed if it is there.
    pub fn toggled(&self, name: &str, value: &str) -> String {
        let there = self.0.iter().any(|(key, old)| key == name && old == value);
        let kept = self.0.iter().filter(|(key, old)| key != name || old != value);
        let more = (!there).then_some((name, value));
        address(kept.map(pair).chain(more))
    }

    /// These fields, for a form that keeps them; without values that contain invisible characters.
    pub fn kept(&self, names: &[&'static str]) -> Vec<(&'static str, String)> {
        let values = |&name: &&'static str| self.all(name).map(move |value| (name, value));
        let visible = names.iter().flat_map(values).filter(|(_, value)| is_clean(value));
        visible.map(|(name, value)| (name, value.to_owned())).collect()
    }

    /// The address of this page without some fields.
    pub fn without(&self, names: &[&str]) -> String {
        address(self.0.iter().filter(|(key, _)| !names.contains(&&**key)).map(pair))
    }
}

/// Whether a text can stand in a page as it is.
pub fn is_clean(text: &str) -> bool {
    clean(text, text.len()) == text
}

fn pair((name, value): &(String, String)) -> (&str, &str) {
    (name, value)
}

/// `?a=1&b=2`, without empty values.
pub fn address<'a>(pairs: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut out = String::from("?");
    for (name, value) in pairs.filter(|(_, value)| !value.is_empty()) {
        if out.len() > 1 {
            out.push('&');
        }
        encode(&mut out, name, b"-_.~");
        out.push('=');
        encode(&mut out, value, b"-_.~");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(pairs: &[(&str, &str)]) -> PageQuery {
        PageQuery::of(pairs.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect())
    }

    #[test]
    fn addresses_keep_what_they_do_not_change() {
        let query = query(&[("q", "a b"), ("pin", "x/y"), ("pin", "z"), ("page", "3"), ("level", "")]);
        assert_eq!(query.with("page", "4"), "?q=a%20b&pin=x%2Fy&pin=z&page=4");
        assert_eq!(query.with("q", ""), "?pin=x%2Fy&pin=z&page=3");
        assert_eq!(query.toggled("pin", "z"), "?q=a%20b&pin=x%2Fy&page=3");
        assert_eq!(query.toggled("pin", "\"&<é"), "?q=a%20b&pin=x%2Fy&pin=z&page=3&pin=%22%26%3C%C3%A9");
        assert_eq!(query.without(&["pin", "page"]), "?q=a%20b");
        assert_eq!((query.get("pin"), query.number("page"), query.number("q")), ("x/y", Some(3), None));
    }

    #[test]
    fn an_endless_address_is_cut() {
        let many: Vec<_> = (0..1000).map(|index| ("pin".to_owned(), index.to_string())).collect();
        assert_eq!(PageQuery::of(many).all("pin").count(), PAIRS);
        assert_eq!(query(&[("q", &"x".repeat(LETTERS + 1))]).get("q"), "");
    }
}
