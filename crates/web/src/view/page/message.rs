//! A page of one sentence.

use askama::Template;

use super::Palette;
use super::frame::PageFrame;
use crate::texts::{Lang, MESSAGE, clean};
use crate::view::html;

#[derive(Template)]
#[template(path = "message.html")]
struct MessageHtml {
    frame: PageFrame,
    status: u16,
    title: String,
    text: String,
}

/// A page that says one thing; `title` and `text` are in the reader's language and not yet escaped.
pub fn message_page(status: u16, title: &str, text: &str, lang: Lang, palette: Palette) -> String {
    html(&MessageHtml {
        frame: PageFrame::new(lang, palette),
        status,
        title: clean(title, MESSAGE),
        text: clean(text, 2 * MESSAGE),
    })
}
