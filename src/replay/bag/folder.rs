//! The files of a rosbag2 in a folder, in their order.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::record::file::FileError;
use crate::yaml::{Kind, Log, Node, Sources, tree};

const METADATA: &str = "metadata.yaml";
/// The ends of the names of recordings, the first ones that are there count.
const ENDS: [&[&str]; 2] = [&[".mcap", ".mcap.zstd"], &[".db3", ".db3.zstd"]];
/// More files are left out.
pub(super) const FILES_MAX: usize = 10_000;

/// The files, and what is to be said of them.
pub(super) struct Files {
    pub paths: Vec<PathBuf>,
    pub said: Vec<String>,
}

/// By `metadata.yaml`; without one by their names.
///
/// # Errors
/// There are none, or the folder cannot be read.
pub(super) fn files(folder: &Path) -> Result<Files, FileError> {
    let mut said = Vec::new();
    let metadata = folder.join(METADATA);
    let listed = metadata.exists().then(|| listed(&metadata));
    let mut paths = match listed {
        Some(Some(names)) => names.iter().map(|name| unpacked(folder.join(name))).collect(),
        listed => {
            if listed.is_some() {
                said.push(format!(
                    "{METADATA} cannot be used: the files are read in the order of their names"
                ));
            }
            by_names(folder)?
        }
    };
    if paths.is_empty() {
        let why = "it has no recording: no .mcap or .db3 file, and no metadata.yaml that lists one";
        return Err(FileError::format(folder, why));
    }
    if paths.len() > FILES_MAX {
        said.push(format!("{} files are left out: {FILES_MAX} are read", paths.len() - FILES_MAX));
        paths.truncate(FILES_MAX);
    }
    Ok(Files { paths, said })
}

/// The names of files that `metadata.yaml` lists.
fn listed(metadata: &Path) -> Option<Vec<String>> {
    let (mut sources, mut log) = (Sources::default(), Log::default());
    let file = sources.read(metadata).ok()?;
    let tree = tree::parse(&sources, file, &mut log)?;
    let Kind::Sequence(paths) =
        &value(value(&tree, "rosbag2_bagfile_information")?, "relative_file_paths")?.kind
    else {
        return None;
    };
    // Old versions wrote the folder's own name before it.
    let name = |node: &Node| match &node.kind {
        Kind::Scalar { text, .. } => Some(Path::new(text).file_name()?.to_str()?.to_owned()),
        _ => None,
    };
    let names: Vec<String> = paths.iter().filter_map(name).collect();
    (!names.is_empty()).then_some(names)
}

fn value<'n>(node: &'n Node, key: &str) -> Option<&'n Node> {
    let Kind::Mapping(entries) = &node.kind else { return None };
    entries.iter().find(|(found, _)| found.text == key).map(|(_, value)| value)
}

/// The file that somebody made of a compressed one, if it is there.
fn unpacked(path: PathBuf) -> PathBuf {
    let plain = path.to_str().and_then(|text| text.strip_suffix(".zstd")).map(PathBuf::from);
    plain.filter(|plain| plain.exists()).unwrap_or(path)
}

fn by_names(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let failed = |error| FileError::io(folder, "read", error);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        names.extend(entry.map_err(failed)?.file_name().into_string().ok());
    }
    names.sort_by_cached_key(|name| counted(name));
    let with = |ends: &[&str]| -> BTreeSet<(String, PathBuf)> {
        let of_kind = names.iter().filter(|name| ends.iter().any(|end| name.ends_with(end)));
        of_kind
            .map(|name| unpacked(folder.join(name)))
            .map(|path| (counted(&path.to_string_lossy()), path))
            .collect()
    };
    let found = ENDS.into_iter().map(with).find(|found| !found.is_empty());
    Ok(found.unwrap_or_default().into_iter().map(|(_, path)| path).collect())
}

/// A name that sorts by its numbers: `bag_10` comes after `bag_9`.
fn counted(name: &str) -> String {
    let (mut sortable, mut digits) = (String::new(), String::new());
    for letter in name.chars() {
        if letter.is_ascii_digit() {
            digits.push(letter);
            continue;
        }
        sortable += &padded(&digits);
        digits.clear();
        sortable.push(letter);
    }
    sortable + &padded(&digits)
}

fn padded(digits: &str) -> String {
    if digits.is_empty() { String::new() } else { format!("{digits:0>20}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::TestFolder;

    fn names(folder: &TestFolder) -> Vec<String> {
        let paths = files(folder).unwrap().paths;
        paths.iter().map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn files_follow_the_metadata_and_without_it_the_numbers_in_their_names() {
        let folder = TestFolder::new("bag-folder");
        let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
        assert!(files(&folder).err().unwrap().to_string().contains("it has no recording"));
        for name in ["b_10.mcap", "b_9.mcap", "b_0.db3", "b_11.mcap.zstd", "note.txt"] {
            write(name, "");
        }
        assert_eq!(names(&folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap.zstd"]);
        // Somebody decompressed the last one.
        write("b_11.mcap", "");
        assert_eq!(names(&folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap"]);
        write(
            METADATA,
            "rosbag2_bagfile_information:\n  version: 3\n  relative_file_paths: [b/b_1.mcap, ../../b_0.mcap, b_11.mcap.zstd]\n",
        );
        assert_eq!(names(&folder), ["b_1.mcap", "b_0.mcap", "b_11.mcap"]);
        write(METADATA, "rosbag2_bagfile_information: [");
        assert_eq!(names(&folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap"]);
        assert_eq!(files(&folder).unwrap().said.len(), 1);
    }
}
