//! The tutorial and the how-to pages, followed to the letter: their files are written, their commands typed, and
//! what they print is what the page shows.

use std::sync::Mutex;
use std::thread;

use super::session::Session;
use super::transcript::steps;
use super::{pages, read, shown};

/// So many pages are followed side by side.
const SIDE_BY_SIDE: usize = 4;

#[test]
fn every_command_does_what_its_page_shows() {
    let all: Vec<_> = ["docs/tutorial", "docs/how-to"].into_iter().flat_map(pages).collect();
    assert!(!all.is_empty(), "there are pages to follow");
    let (waiting, wrong) = (Mutex::new(all), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..SIDE_BY_SIDE {
            scope.spawn(|| {
                while let Some(page) = { waiting.lock().expect("nobody panics with it").pop() } {
                    if let Err(why) = follow(&read(&page)) {
                        wrong.lock().expect("nobody panics with it").push(format!("{}: {why}", shown(&page)));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("nobody panics with it");
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

fn follow(page: &str) -> Result<(), String> {
    let steps = steps(page)?;
    if steps.is_empty() {
        return Ok(());
    }
    let mut session = Session::open("page");
    steps.iter().try_for_each(|step| session.take(step))
}

#[test]
fn a_page_that_shows_something_else_is_found() {
    let wrong = |page: &str| follow(page).is_err();
    assert!(!wrong("```console\n$ echo one; echo two\none\n...\n```\n"));
    assert!(wrong("```console\n$ echo two\none\n```\n"), "another output");
    assert!(wrong("```console\n$ false\n```\n"), "it fails");
    assert!(wrong("```console fails\n$ true\n```\n"), "it does not fail");
    assert!(wrong("```console background\n$ echo one\ntwo\n```\n"), "it ends with another output");
    assert!(wrong("```console\n^C\n```\n"), "nothing runs");
    let kept =
        "```yaml a/b.yaml\nx: 1\n```\n```console\n$ export A=1\n$ echo $A; cat a/b.yaml\n1\nx: 1\n```\n";
    assert_eq!(follow(kept), Ok(()));
}
