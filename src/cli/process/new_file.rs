//! Files that commands make where none is.

use std::fs::File;
use std::io;
use std::path::Path;

/// Makes a file. `what` begins the sentence that says why not, as "the report cannot be written to".
///
/// # Errors
/// There is a file already, or the disk does not take it.
pub fn create(output: &Path, what: &str, flag: &str) -> anyhow::Result<File> {
    File::options().write(true).create_new(true).open(output).map_err(|error| {
        let what = format!("{what} {}", output.display());
        match error.kind() {
            io::ErrorKind::AlreadyExists => {
                anyhow::anyhow!("{what}: there is a file already. Name another one with {flag}")
            }
            _ => anyhow::Error::new(error).context(what),
        }
    })
}
