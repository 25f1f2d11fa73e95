//! Fragments of the operator's page as messages of htmx's WebSocket extension.

use std::fmt::Write as _;
use std::sync::{Arc, OnceLock};

use axum::extract::ws::Utf8Bytes;

use crate::view::{DETAIL, Fragment, SHEET};
use telltale_runtime::Version;

/// All fragments of one snapshot, each with the revision of its last change. Pages are told the `seq`, but
/// words change without a new `seq`, so revisions decide which fragments are new.
#[derive(Debug)]
pub struct Frame {
    seq: Version,
    revision: Version,
    /// The revision of the frame before this one, if there was one.
    previous: Option<Version>,
    parts: Vec<Part>,
    /// The message for pages that show the previous frame: most of them do.
    step: OnceLock<Option<Utf8Bytes>>,
    full: OnceLock<Utf8Bytes>,
}

#[derive(Debug)]
struct Part {
    id: String,
    html: String,
    /// `html` as the inside of a JSON string.
    escaped: Arc<str>,
    changed: Version,
}

impl Part {
    /// Whether it is a panel behind a tile.
    fn is_detail(&self) -> bool {
        self.id.starts_with(DETAIL)
    }

    /// Whether it is visible only after somebody opened it.
    fn is_behind(&self) -> bool {
        self.is_detail() || self.id.starts_with(SHEET)
    }
}

impl Frame {
    /// The frame of these fragments. Unchanged fragments keep the revision of their last change.
    pub(super) fn new(
        seq: Version,
        revision: Version,
        fragments: Vec<Fragment>,
        before: Option<&Frame>,
    ) -> Frame {
        let parts = fragments.into_iter().enumerate().map(|(index, Fragment { id, html })| {
            let old = before.and_then(|before| before.part(index, &id)).filter(|old| old.html == html);
            match old {
                Some(old) => Part { escaped: old.escaped.clone(), changed: old.changed, html, id },
                None => Part { escaped: escape(&html).into(), changed: revision, html, id },
            }
        });
        Frame {
            seq,
            revision,
            previous: before.map(Frame::revision),
            parts: parts.collect(),
            step: OnceLock::new(),
            full: OnceLock::new(),
        }
    }

    pub fn seq(&self) -> Version {
        self.seq
    }

    pub fn revision(&self) -> Version {
        self.revision
    }

    /// All fragments, for a new connection.
    pub fn full(&self) -> Utf8Bytes {
        self.full.get_or_init(|| self.message(self.parts.iter())).clone()
    }

    /// The fragments that changed since the revision `shown`, without the panels behind the tiles; `None` if
    /// there are none.
    pub fn since(&self, shown: Version) -> Option<Utf8Bytes> {
        if self.previous == Some(shown) {
            return self.step.get_or_init(|| self.changes(shown, None)).clone();
        }
        self.changes(shown, None)
    }

    /// [`since`](Frame::since), with the panels behind the tiles that changed since the revision `details`.
    pub fn since_with_details(&self, shown: Version, details: Version) -> Option<Utf8Bytes> {
        self.changes(shown, Some(details))
    }

    /// Whether a panel behind a tile changed since this revision.
    pub fn has_details_since(&self, details: Version) -> bool {
        self.parts.iter().any(|part| part.is_detail() && part.changed > details)
    }

    fn changes(&self, shown: Version, details: Option<Version>) -> Option<Utf8Bytes> {
        let is_new = |part: &&Part| {
            let shown = if part.is_detail() { details } else { Some(shown) };
            shown.is_some_and(|shown| part.changed > shown)
        };
        let changed = || self.parts.iter().filter(is_new);
        changed().next()?;
        Some(self.message(changed()))
    }

    /// The visible fragments in one piece, and the hidden ones by their ids: the page updates those when
    /// somebody opens them.
    fn message<'a>(&self, parts: impl Iterator<Item = &'a Part>) -> Utf8Bytes {
        let (mut content, mut behind) = (String::new(), String::new());
        for part in parts {
            if part.is_behind() {
                let comma = if behind.is_empty() { "" } else { "," };
                // Writing to a string cannot fail.
                let _ = write!(behind, "{comma}\"{}\":\"{}\"", escape(&part.id), part.escaped);
            } else {
                content.push_str(&part.escaped);
            }
        }
        let mut message = format!("{{\"seq\":{}", self.seq.number);
        if !content.is_empty() {
            let _ = write!(message, ",\"content\":\"{content}\"");
        }
        if !behind.is_empty() {
            let _ = write!(message, ",\"behind\":{{{behind}}}");
        }
        message.push('}');
        Utf8Bytes::from(message)
    }

    /// Fragments nearly always keep their positions, so the search is rare.
    fn part(&self, index: usize, id: &str) -> Option<&Part> {
        let here = self.parts.get(index).filter(|part| part.id == id);
        here.or_else(|| self.parts.iter().find(|part| part.id == id))
    }
}

fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len() + text.len() / 8);
    for char in text.chars() {
        match char {
            '"' => escaped.push_str("\\\""),
            '\\' => escaped.push_str("\\\\"),
            '\n' => escaped.push_str("\\n"),
            // Writing to a string cannot fail.
            char if char < ' ' => drop(write!(escaped, "\\u{:04x}", char as u32)),
            char => escaped.push(char),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(revision: impl Into<Version>, parts: &[(&str, &str)], before: Option<&Frame>) -> Frame {
        let fragment = |(id, html): &(&str, &str)| Fragment { id: (*id).into(), html: (*html).into() };
        let revision = revision.into();
        let seq = Version { number: 40 + revision.number, ..revision };
        Frame::new(seq, revision, parts.iter().map(fragment).collect(), before)
    }

    #[test]
    fn everybody_gets_what_changed_since_they_looked() {
        let first = frame(1, &[("a", "<a1>"), ("b", "<b1>")], None);
        let second = frame(2, &[("a", "<a2>"), ("b", "<b1>")], Some(&first));
        let third = frame(5, &[("a", "<a2>"), ("b", "<b2>")], Some(&second));
        let same = frame(6, &[("a", "<a2>"), ("b", "<b2>")], Some(&third));
        let more = frame(7, &[("c", "<c1>"), ("a", "<a2>"), ("b", "<b2>")], Some(&same));
        for (frame, since, expected) in [
            (&first, 0, Some("<a1><b1>")),
            (&second, 1, Some("<a2>")),
            (&third, 2, Some("<b2>")),
            (&third, 1, Some("<a2><b2>")),
            (&third, 5, None),
            (&same, 5, None),
            (&same, 2, Some("<b2>")),
            (&more, 6, Some("<c1>")),
        ] {
            let expected =
                expected.map(|html| format!("{{\"seq\":{},\"content\":\"{html}\"}}", frame.seq.number));
            let message = frame.since(since.into());
            assert_eq!(message.as_ref().map(Utf8Bytes::as_str), expected.as_deref(), "{since}");
        }
        assert_eq!(third.full().as_str(), "{\"seq\":45,\"content\":\"<a2><b2>\"}");
        // The same revision after a rewind is another frame.
        let back = Version { rewinds: 1, number: 2 };
        let again = frame(back, &[("a", "<a2>"), ("b", "<b1>")], Some(&third));
        let sent = |shown: Version| again.since(shown).map(|it| it.as_str().to_owned());
        assert_eq!(sent(5.into()).as_deref(), Some("{\"seq\":42,\"content\":\"<b1>\"}"));
        assert_eq!(sent(back), None);
    }

    #[test]
    fn what_stands_behind_the_tiles_is_sent_apart() {
        let first =
            frame(1, &[("a", "<a1>"), ("all-x", "<x1>"), ("detail-a", "<d1>"), ("detail-b", "<b>")], None);
        let second = frame(2, &[("a", "<a1>"), ("all-x", "<x1>"), ("detail-a", "<d2>")], Some(&first));
        let third = frame(3, &[("a", "<a2>"), ("all-x", "<x2>"), ("detail-a", "<d2>")], Some(&second));
        let said = |message: Option<Utf8Bytes>| message.map(|it| it.as_str()[9..].to_owned());
        let whole = r#","content":"<a1>","behind":{"all-x":"<x1>","detail-a":"<d1>","detail-b":"<b>"}}"#;
        assert_eq!(said(Some(first.full())).as_deref(), Some(whole));
        assert_eq!(second.since(1.into()), None);
        let front = r#","content":"<a2>","behind":{"all-x":"<x2>"}}"#;
        assert_eq!(said(third.since(2.into())).as_deref(), Some(front));
        let both = r#","content":"<a2>","behind":{"all-x":"<x2>","detail-a":"<d2>"}}"#;
        assert_eq!(said(third.since_with_details(2.into(), 1.into())).as_deref(), Some(both));
        let behind = r#","behind":{"detail-a":"<d2>"}}"#;
        assert_eq!(said(third.since_with_details(3.into(), 1.into())).as_deref(), Some(behind));
        assert_eq!(third.since_with_details(3.into(), 3.into()), None);
    }

    #[test]
    fn escaped_text_reads_back_as_it_was() {
        let text = "<p class=\"a\\b\">\u{0}\u{1f}\t\r\n\u{7f}\u{2028}ä運\u{1f68c}</p>";
        let message = format!("\"{}\"", escape(text));
        assert_eq!(serde_json::from_str::<String>(&message).unwrap(), text);
    }
}
