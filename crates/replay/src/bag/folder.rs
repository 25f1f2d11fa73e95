//! The files of a rosbag2 in a folder, in their order.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use telltale_record::file::FileError;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Log, Node, Sources, tree};

const METADATA: &str = "metadata.yaml";
/// The ends of the names of recordings, the first ones that are there count.
const ENDS: [&[&str]; 2] = [&[".mcap", ".mcap.zstd"], &[".db3", ".db3.zstd"]];
/// More files are left out.
pub(super) const FILES_MAX: usize = 10_000;

/// The files, and what is to be said of them.
pub(super) struct Files {
    pub parts: Vec<Part>,
    pub said: Vec<String>,
}

/// A file, and the first and the last time in it, where `metadata.yaml` says them: nanoseconds since 1970.
pub(super) struct Part {
    pub path: PathBuf,
    pub span_ns: Option<(u64, u64)>,
}

impl Part {
    pub fn alone(path: PathBuf) -> Part {
        Part { path, span_ns: None }
    }
}

/// By `metadata.yaml`; without one by their names.
///
/// # Errors
/// There are none, or the folder cannot be read.
pub(super) fn files(folder: &Path) -> Result<Files, FileError> {
    let mut said = Vec::new();
    let metadata = folder.join(METADATA);
    let listed = metadata.exists().then(|| listed(&metadata));
    let mut parts: Vec<Part> = match listed {
        Some(Some(named)) => {
            named.into_iter().map(|part| Part { path: unpacked(folder.join(&part.path)), ..part }).collect()
        }
        listed => {
            if listed.is_some() {
                said.push(format!(
                    "{METADATA} cannot be used: the files are read in the order of their names"
                ));
            }
            by_names(folder)?.into_iter().map(Part::alone).collect()
        }
    };
    if parts.is_empty() {
        let why = "it has no recording: no .mcap or .db3 file, and no metadata.yaml that lists one";
        return Err(FileError::format(folder, why));
    }
    if parts.len() > FILES_MAX {
        said.push(format!("{} files are left out: {FILES_MAX} are read", parts.len() - FILES_MAX));
        parts.truncate(FILES_MAX);
    }
    Ok(Files { parts, said })
}

/// The names of files that `metadata.yaml` lists, with the first and the last time of each.
fn listed(metadata: &Path) -> Option<Vec<Part>> {
    let (mut sources, mut log) = (Sources::default(), Log::default());
    let file = sources.read(metadata).ok()?;
    let tree = tree::parse(&sources, file, &mut log)?;
    let about = tree.get("rosbag2_bagfile_information")?;
    let Kind::Sequence(paths) = &about.get("relative_file_paths")?.kind else { return None };
    // Older versions do not have it.
    let spans: HashMap<String, (u64, u64)> = match about.get("files").map(|files| &files.kind) {
        Some(Kind::Sequence(files)) => {
            files.iter().filter_map(|it| Some((name(it.get("path")?)?, span_ns(it)?))).collect()
        }
        _ => HashMap::new(),
    };
    let mut before = BTreeSet::new();
    let names = paths.iter().filter_map(name).filter(|name| before.insert(name.clone()));
    let part = |name: String| Part { span_ns: spans.get(&name).copied(), path: name.into() };
    let named: Vec<Part> = names.map(part).collect();
    (!named.is_empty()).then_some(named)
}

/// The name of a file. Old versions wrote the folder's own name before it.
fn name(node: &Node) -> Option<String> {
    Some(Path::new(scalar(node)?).file_name()?.to_str()?.to_owned())
}

fn span_ns(file: &Node) -> Option<(u64, u64)> {
    let ns = |key, unit| scalar(file.get(key)?.get(unit)?)?.parse::<u64>().ok();
    let from_ns = ns("starting_time", "nanoseconds_since_epoch").filter(|&ns| ns > 0)?;
    Some((from_ns, from_ns.saturating_add(ns("duration", "nanoseconds")?)))
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

    fn names(folder: &Path) -> Vec<String> {
        let parts = files(folder).unwrap().parts;
        parts.iter().map(|part| part.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn files_follow_the_metadata_and_without_it_the_numbers_in_their_names() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
        assert!(files(folder).err().unwrap().to_string().contains("it has no recording"));
        for name in ["b_10.mcap", "b_9.mcap", "b_0.db3", "b_11.mcap.zstd", "note.txt"] {
            write(name, "");
        }
        assert_eq!(names(folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap.zstd"]);
        // Somebody decompressed the last one.
        write("b_11.mcap", "");
        assert_eq!(names(folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap"]);
        write(
            METADATA,
            "rosbag2_bagfile_information:\n  version: 3\n  relative_file_paths: [b/b_1.mcap, ../../b_0.mcap, b_11.mcap.zstd]\n",
        );
        assert_eq!(names(folder), ["b_1.mcap", "b_0.mcap", "b_11.mcap"]);
        let old = files(folder).unwrap().parts;
        assert!(old.iter().all(|part| part.span_ns.is_none()));
        let file = "{ path: b/b_1.mcap, starting_time: { nanoseconds_since_epoch: 1000 }, duration: { nanoseconds: 500 } }";
        write(
            METADATA,
            &format!(
                "rosbag2_bagfile_information:\n  relative_file_paths: [b_0.mcap, b_1.mcap]\n  files: [{file}]\n"
            ),
        );
        let spans: Vec<_> = files(folder).unwrap().parts.iter().map(|part| part.span_ns).collect();
        assert_eq!(spans, [None, Some((1000, 1500))]);
        write(METADATA, "rosbag2_bagfile_information: [");
        assert_eq!(names(folder), ["b_9.mcap", "b_10.mcap", "b_11.mcap"]);
        assert_eq!(files(folder).unwrap().said.len(), 1);
    }
}
