//! A folder of one test among the temporary files, removed at its end.

use std::ops::Deref;
use std::path::{Path, PathBuf};

pub struct TestFolder(PathBuf);

impl TestFolder {
    /// The path of a folder that is not there yet.
    pub fn new(name: &str) -> TestFolder {
        let folder = std::env::temp_dir().join(format!("telltale-it-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        TestFolder(folder)
    }
}

impl Deref for TestFolder {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Drop for TestFolder {
    fn drop(&mut self) {
        // The store's threads may still be closing their files; what they leave stays among the temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
