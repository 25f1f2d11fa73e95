//! Tests of the pages: from a snapshot to attributes and texts.

mod arrows;
mod causes;
mod details;
mod hostile;
mod motion;
mod pages;
pub mod sample;
mod stages;
mod states;
mod urgency;
mod words;

use std::collections::BTreeSet;

use super::versions::Versions;
use super::*;
use sample::{Sample, group, module, on_group, parts, text};
use telltale_engine::input::{AlarmRef, OperatorAction, TroubleKind};
use telltale_engine::model::{DISPLAY_DPI, GroupId, Parts as ModelParts, StageModel, When};
use telltale_engine::text::Text;
use telltale_store::Role;

pub fn context(lang: Lang, palette: Palette) -> PageContext {
    PageContext {
        lang,
        palette,
        user: "operator".to_owned(),
        role: Role::Operator,
        demo: false,
        configuration: false,
        recorder: Some(RecorderState::Ready),
        replay: false,
        part: PagePart::Whole,
    }
}

/// The page as it is for somebody to whom nothing was shown before.
pub fn operator_page(published: &Published, context: &PageContext) -> String {
    super::operator_page(published, &Versions::default().observe(published), context, &Trends::default())
}

pub fn fragments(published: &Published, lang: Lang) -> Vec<Fragment> {
    super::fragments(published, &Versions::default().observe(published), lang, &Trends::default())
}

pub fn fragment(published: &Published, lang: Lang, id: &str) -> String {
    let all = fragments(published, lang);
    let found = all.into_iter().find(|fragment| fragment.id == id);
    found.unwrap_or_else(|| panic!("no fragment {id}")).html
}

/// The fragment `id` contains every part of `expect`, and none of `not`.
#[track_caller]
pub fn check(published: &Published, lang: Lang, id: &str, expect: &[&str], not: &[&str]) {
    let html = fragment(published, lang, id);
    for part in expect {
        assert!(html.contains(part), "{id} lacks {part:?}:\n{html}");
    }
    for part in not {
        assert!(!html.contains(part), "{id} has {part:?}:\n{html}");
    }
}

pub fn jump() -> Sample {
    Sample::shuttle(true).report(
        "localization/tf_quality",
        2,
        "Position jumped by 1.2 m",
        &[("jump_m", "1.20"), ("limit_m", "0.30")],
    )
}
