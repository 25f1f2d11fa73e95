//! The folder of the recordings in the data folder, and the names of the files in it.

use std::io;
use std::path::{Path, PathBuf};

/// The folder of the recordings, in the data folder.
pub const INCIDENTS: &str = "incidents";

/// No incident has a larger number: larger ones in names of files are not ours.
const NUMBER_MAX: u64 = 1 << 48;

pub fn folder_in(data: &Path) -> PathBuf {
    data.join(INCIDENTS)
}

/// The name of the recording of an incident.
pub fn file_name(id: u64) -> String {
    format!("incident-{id}.mcap")
}

/// The number of the incident in the name of a recording; `None` for other files.
pub fn number_of(name: &str) -> Option<u64> {
    let number: u64 = name.strip_prefix("incident-")?.strip_suffix(".mcap")?.parse().ok()?;
    (1..=NUMBER_MAX).contains(&number).then_some(number)
}

/// The path of a recording in their folder. `None` for a name that would lead out of it.
pub fn path_of(folder: &Path, file: &str) -> Option<PathBuf> {
    let is_plain = !file.is_empty() && !file.contains(['/', '\0']) && file != "." && file != "..";
    is_plain.then(|| folder.join(file))
}

/// The path of a recording that is a file: a link leads elsewhere, and a pipe may never end.
pub fn file_in(folder: &Path, file: &str) -> Option<PathBuf> {
    path_of(folder, file).filter(|path| path.symlink_metadata().is_ok_and(|it| it.is_file()))
}

/// The numbers of all recordings in their folder, the smallest first. Without a folder there are none.
pub fn numbers(folder: &Path) -> io::Result<Vec<u64>> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut numbers = Vec::new();
    for entry in entries {
        numbers.extend(entry?.file_name().to_str().and_then(number_of));
    }
    numbers.sort_unstable();
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_has_the_number_and_other_files_have_none() {
        for id in [1, 12, 1_000_000] {
            assert_eq!(number_of(&file_name(id)), Some(id));
        }
        for other in ["", "incident-.mcap", "incident-0.mcap", "incident-1.mcap.new", "12.mcap"] {
            assert_eq!(number_of(other), None, "{other}");
        }
        assert_eq!(number_of(&format!("incident-{}.mcap", u64::MAX)), None);
    }

    #[test]
    fn a_name_never_leads_out_of_the_folder() {
        let folder = folder_in(Path::new("/data"));
        assert_eq!(path_of(&folder, "incident-1.mcap"), Some("/data/incidents/incident-1.mcap".into()));
        for wrong in ["", ".", "..", "../telltale.db", "/etc/passwd", "a/b", "a\0"] {
            assert_eq!(path_of(&folder, wrong), None, "{wrong:?}");
        }
    }
}
