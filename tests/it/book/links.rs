//! Every link of the documentation leads to a file and a heading that exist. Links to other sites are checked for
//! their form only.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

use super::{pages, read, root, shown};

#[test]
fn every_link_leads_somewhere() {
    let mut anchors = BTreeMap::new();
    let mut wrong = Vec::new();
    let mut all = pages("docs");
    all.push(root().join("README.md"));
    for page in &all {
        for link in links(&read(page)) {
            if let Err(why) = follow(page, &link, &mut anchors) {
                wrong.push(format!("{}: {link}: {why}", shown(page)));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_contents_list_every_page_once() {
    let docs = root().join("docs");
    let mut listed = links(&read(&docs.join("SUMMARY.md")));
    listed.sort();
    let inside = |page: &PathBuf| shown(page).trim_start_matches("docs/").to_owned();
    let mut there: Vec<String> =
        pages("docs").iter().map(inside).filter(|page| page != "SUMMARY.md").collect();
    there.sort();
    assert_eq!(listed, there);
}

fn links(text: &str) -> Vec<String> {
    let events = Parser::new_ext(text, Options::ENABLE_TABLES);
    events
        .filter_map(|event| match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                Some(dest_url.into_string())
            }
            _ => None,
        })
        .collect()
}

type Anchors = BTreeMap<PathBuf, BTreeSet<String>>;

fn follow(page: &Path, link: &str, anchors: &mut Anchors) -> Result<(), String> {
    if link.contains(' ') || link.is_empty() {
        return Err("no address".into());
    }
    if let Some((scheme, rest)) = link.split_once(':') {
        return match (scheme, rest.strip_prefix("//")) {
            ("https", Some(host)) if host.contains('.') => Ok(()),
            // The address of the reader's own server.
            ("http", Some(host)) if host.starts_with("127.0.0.1") => Ok(()),
            _ => Err("no https address".into()),
        };
    }
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    let folder = page.parent().expect("a page lies in a folder");
    let target = if file.is_empty() { page.to_owned() } else { folder.join(file) };
    let target = target.canonicalize().map_err(|_| "no such file")?;
    if !target.starts_with(root()) {
        return Err("leaves the repository".into());
    }
    if anchor.is_empty() {
        return Ok(());
    }
    let known = anchors.entry(target.clone()).or_insert_with(|| headings(&read(&target)));
    if known.contains(anchor) { Ok(()) } else { Err(format!("no such heading; there are {known:?}")) }
}

/// The anchors of a page's headings, as the book and the pages of a repository make them.
fn headings(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut heading: Option<String> = None;
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::End(TagEnd::Heading(_)) => {
                let words = heading.take().unwrap_or_default();
                let anchor = anchor(&words);
                let mut unique = anchor.clone();
                for number in 1.. {
                    if found.insert(unique) {
                        break;
                    }
                    unique = format!("{anchor}-{number}");
                }
            }
            Event::Text(words) | Event::Code(words) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&words);
                }
            }
            _ => {}
        }
    }
    found
}

fn anchor(words: &str) -> String {
    let kept = words.trim().chars().filter(|it| it.is_alphanumeric() || matches!(it, ' ' | '-' | '_'));
    kept.flat_map(char::to_lowercase).map(|it| if it == ' ' { '-' } else { it }).collect()
}

#[test]
fn a_wrong_link_is_found() {
    let page = root().join("docs/testing.md");
    let mut anchors = Anchors::new();
    let mut follow = |link| follow(&page, link, &mut anchors);
    assert_eq!(follow("architecture.md#invariants"), Ok(()));
    assert_eq!(follow("#fuzzing"), Ok(()));
    assert_eq!(follow("https://cel.dev"), Ok(()));
    for wrong in
        ["nothing.md", "architecture.md#nothing", "#nothing", "http://cel.dev", "../../../etc/passwd", "a b"]
    {
        assert!(follow(wrong).is_err(), "{wrong}");
    }
    assert_eq!(anchor("A `monitor`'s kinds, in C++"), "a-monitors-kinds-in-c");
}
