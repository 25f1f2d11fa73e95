//! A folder of one test among the temporary files, removed at its end.

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

pub struct TestFolder(PathBuf);

impl TestFolder {
    /// The path of a folder that is not there yet.
    pub fn new(name: &str) -> TestFolder {
        // Tests run side by side, and two may choose the same name.
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let (process, number) = (std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(format!("telltale-it-{name}-{process}-{number}"));
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
