//! The book builds, and its table of contents has every page.

use std::collections::BTreeSet;
use std::path::Path;

use mdbook_driver::MDBook;
use mdbook_driver::book::BookItem;

use super::{pages, root, shown};
use crate::folder::TestFolder;

#[test]
fn the_book_builds_and_has_every_page() {
    let folder = TestFolder::new("book");
    let mut book = MDBook::load(root().join("docs")).expect("docs/book.toml and docs/SUMMARY.md are right");
    book.config.build.build_dir = folder.to_path_buf();
    // A page that is listed and missing is an error, not an empty page.
    assert!(!book.config.build.create_missing, "docs/book.toml: create-missing = false");
    book.build().expect("the book builds");
    assert!(folder.join("index.html").exists(), "the book has a first page");

    let listed: BTreeSet<String> = book
        .book
        .iter()
        .filter_map(|item| match item {
            BookItem::Chapter(chapter) => chapter.source_path.clone(),
            _ => None,
        })
        .map(|path| path.display().to_string())
        .collect();
    let docs = root().join("docs");
    let inside = |page: &Path| shown(page).trim_start_matches("docs/").to_owned();
    let there: BTreeSet<String> =
        pages("docs").iter().map(|page| inside(page)).filter(|page| page != "SUMMARY.md").collect();
    let missing: Vec<&String> = there.difference(&listed).collect();
    assert!(missing.is_empty(), "{}/SUMMARY.md lacks {missing:?}", docs.display());
}
