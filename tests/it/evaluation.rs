//! The figures of `docs/evaluation.md` are what the program draws today.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// All files of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, String> {
    let entries = fs::read_dir(folder).expect("the folder is there");
    let file = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry.expect("the folder can be listed");
        let text = fs::read_to_string(entry.path()).expect("figures are text");
        (entry.file_name().to_string_lossy().into_owned(), text)
    };
    entries.map(file).collect()
}

#[test]
fn the_committed_figures_are_what_the_command_draws() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let drawn = std::env::temp_dir().join(format!("telltale-figures-{}", std::process::id()));
    let status = Command::new(root.join("docs/evaluation.sh"))
        .arg(&drawn)
        .env("TELLTALE", env!("CARGO_BIN_EXE_telltale"))
        .stdout(std::process::Stdio::null())
        .status()
        .expect("the script can be run");
    assert!(status.success(), "{status}");
    let (drawn_files, committed) = (files(&drawn), files(&root.join("docs/figures")));
    fs::remove_dir_all(&drawn).expect("the folder is ours");
    let names = |files: &BTreeMap<String, String>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&drawn_files), names(&committed));
    let page = fs::read_to_string(root.join("docs/evaluation.md")).expect("the page is there");
    for (name, text) in &drawn_files {
        // Not assert_eq: nobody reads two drawings as text.
        assert!(*text == committed[name], "docs/figures/{name} is old: run docs/evaluation.sh");
        assert!(page.contains(&format!("figures/{name}")), "docs/evaluation.md does not show {name}");
    }
}
