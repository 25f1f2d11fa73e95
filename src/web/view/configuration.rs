//! The configuration's file against what runs: what would change, and the button that takes it.

use askama::Template;

use crate::runtime::Rereading;

use super::pages::Frame;
use super::{PageContext, html};

#[derive(Template)]
#[template(path = "developer/configuration.html")]
struct ConfigurationHtml<'a> {
    frame: Frame,
    read: &'a Rereading,
    /// The reader may let the engine run by it.
    may_take: bool,
}

pub fn page(read: &Rereading, may_take: bool, context: &PageContext) -> String {
    html(&ConfigurationHtml { frame: Frame::new(context.lang, context.palette), read, may_take })
}
