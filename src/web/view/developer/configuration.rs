//! The configuration's file against what runs: what would change, and the button that takes it.

use askama::Template;

use crate::runtime::Rereading;
use crate::web::view::clean::{MESSAGE, clean, clean_lines};
use crate::web::view::pages::Frame;
use crate::web::view::{PageContext, View, html};

use super::{DevFrame, Page};

#[derive(Template)]
#[template(path = "developer/configuration.html")]
struct ConfigurationHtml {
    frame: Frame,
    dev: DevFrame,
    taken: bool,
    differences: Vec<String>,
    problems: Option<String>,
    warnings: Option<String>,
    /// The reader may let the engine run by it.
    may_take: bool,
    /// It is not what the reader was shown before, and was not taken.
    is_other: bool,
    /// What is shown here, for the button.
    shown: String,
}

pub fn page(
    view: &View<'_>,
    read: &Rereading,
    may_take: bool,
    is_other: bool,
    context: &PageContext,
) -> String {
    let mut dev = DevFrame::new(view, context, Page::Configuration, 0);
    // The file is no diagnosis: it may be mended before anybody logs in.
    dev.locked = false;
    dev.fixed = true;
    let lines = |text: &Option<String>| text.as_deref().map(clean_lines);
    html(&ConfigurationHtml {
        frame: super::frame(context),
        dev,
        taken: read.taken,
        differences: read.differences.iter().map(|text| clean(text, 4 * MESSAGE)).collect(),
        problems: lines(&read.problems),
        warnings: lines(&read.warnings),
        may_take,
        is_other,
        shown: read.digest.clone(),
    })
}
