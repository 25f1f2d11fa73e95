//! Files that end in the middle, with wrong bytes, or with lengths that lie.

use std::fs;
use std::path::PathBuf;

use mcap::MAGIC;
use mcap::records::op;
use serde_json::json;

use super::*;
use crate::file::Missing;

/// A file with a few chunks, and after each its length and the entries so far.
fn sample(folder: &Path, finished: bool) -> (PathBuf, Vec<(u64, usize)>) {
    let path = folder.join("a.mcap");
    let mut file = IncidentFile::create(&path, about()).unwrap();
    let topic = file.topic("/a", "std_msgs/msg/String", || Some("string data\n".to_owned())).unwrap();
    let mut ended = vec![(file.len(), 0)];
    for at in 1..=12_u64 {
        if at == 7 {
            file.attach("config.yaml", "application/yaml", at, b"groups: []").unwrap();
            ended.push((file.len(), (at as usize - 1) * 3 / 2));
        }
        file.message(topic, stamps(at), (format!("body {at}").as_bytes(), Endian::Little)).unwrap();
        if at % 2 == 0 {
            file.json(&JOURNAL, at, &json!({ "at": at })).unwrap();
            file.end_chunk().unwrap();
            ended.push((file.len(), at as usize * 3 / 2));
        }
    }
    if finished {
        file.finish().unwrap();
    }
    (path, ended)
}

#[test]
fn where_a_chunk_is_damaged_its_times_are_told() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, ended) = sample(folder, true);
    let whole = fs::read(&path).unwrap();
    let places = |bytes: &[u8]| {
        let mut reader = of(bytes).unwrap();
        let mut told: Vec<(u64, Option<(u64, u64)>)> = Vec::new();
        while let Some(entry) = reader.next_entry() {
            let at = entry.stamps().map_or(0, |stamps| stamps.log_time_ns);
            let Entry::Missing(Missing { span_ns }) = entry else {
                told.push((at, None));
                continue;
            };
            told.push((at, Some(span_ns.unwrap_or_default())));
        }
        told
    };
    let undamaged = places(&whole);
    assert!(undamaged.iter().all(|(_, missing)| missing.is_none()));
    // A bit of the second chunk, behind its head.
    let mut flipped = whole.clone();
    flipped[ended[1].0 as usize + 80] ^= 1;
    let mut expected = undamaged.clone();
    expected.splice(3..6, [(0, Some((3, 4)))]);
    assert_eq!(places(&flipped), expected);
    // Its length: only that something stood there is known.
    let mut broken = whole;
    broken[ended[1].0 as usize + 3] ^= 0x40;
    expected[3] = (0, Some((0, 0)));
    assert_eq!(places(&broken), expected);
}

#[test]
fn a_file_cut_anywhere_is_read_up_to_its_last_whole_chunk() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, ended) = sample(folder, true);
    let bytes = fs::read(&path).unwrap();
    let whole = entries(&mut of(&bytes).unwrap());
    assert_eq!(whole.len(), 18);
    for length in 0..bytes.len() {
        let Ok(mut reader) = of(&bytes[..length]) else {
            assert!(length < MAGIC.len());
            continue;
        };
        let known = ended.iter().rev().find(|(at, _)| *at <= length as u64).map_or(0, |(_, count)| *count);
        let found = entries(&mut reader);
        // The chunk itself ends before its indexes.
        assert!(found.len() >= known && found.len() <= known + 3, "{length}: {known} {}", found.len());
        assert_eq!(found, whole[..found.len()]);
        assert!(!reader.is_complete() && !reader.omissions().is_empty(), "{length}");
        assert!(!findings(&bytes[..length]).is_empty(), "{length}");
    }
}

#[test]
fn a_file_that_ends_in_the_middle_is_made_whole() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, ended) = sample(folder, false);
    let bytes = fs::read(&path).unwrap();
    let all = entries(&mut of(&bytes).unwrap());
    let middles = (1..12).map(|step| bytes.len() * step / 12);
    for length in middles.chain(ended.iter().map(|(at, _)| *at as usize)) {
        fs::write(&path, &bytes[..length]).unwrap();
        // The leftovers of an interrupted repair.
        fs::write(folder.join("a.mcap.part"), b"half").unwrap();
        let done = repair(&path).unwrap().unwrap();
        let mut reader = Reader::open(&path).unwrap();
        assert!(reader.is_complete());
        let found = entries(&mut reader);
        assert_eq!(found, all[..done.messages as usize], "{length}");
        assert_eq!((left_out(&reader), check(&path).unwrap()), (vec![], vec![]));
        let told = reader.metadata().find(|(name, _)| *name == REPAIRED).unwrap().1;
        assert_eq!(told["messages"], done.messages.to_string());
        assert_eq!(told["left_out"].lines().count(), done.left_out.list().len());
        assert!(!done.left_out.is_empty());
        assert_eq!(reader.attachments().count(), usize::from(length as u64 >= ended[4].0));
        assert_eq!(done.bytes, fs::metadata(&path).unwrap().len());
        assert!(repair(&path).unwrap().is_none());
        assert!(!folder.join("a.mcap.part").exists());
    }
    fs::write(&path, b"").unwrap();
    assert!(repair(&path).unwrap_err().to_string().contains("no MCAP file"));
    assert_eq!(fs::read(&path).unwrap(), b"");
}

#[test]
fn a_wrong_byte_is_found_and_what_it_costs_is_said() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, _) = sample(folder, true);
    let bytes = fs::read(&path).unwrap();
    let whole = entries(&mut of(&bytes).unwrap());
    for at in 0..bytes.len() {
        let mut wrong = bytes.clone();
        wrong[at] ^= [1, 0x80, 0xff][at % 3];
        assert!(!findings(&wrong).is_empty(), "{at}");
        let Ok(mut reader) = of(&wrong) else { continue };
        let found = entries(&mut reader);
        assert!(found == whole || !reader.omissions().is_empty(), "{at}");
        // A damaged length costs one chunk, because the index tells where the next begins.
        assert!(found.len() + 3 >= whole.len(), "{at}: {} {:?}", found.len(), left_out(&reader));
    }
}

#[test]
fn a_part_without_definitions_is_left_out_and_the_rest_is_read() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, _) = sample(folder, false);
    let mut bytes = fs::read(&path).unwrap();
    // In the data of the first chunk, which defines the channels.
    let mut reader = of(&bytes).unwrap();
    assert_eq!(entries(&mut reader).len(), 18);
    let first = bytes.windows(4).position(|it| it == b"zstd").unwrap();
    bytes[first + 40] ^= 0xff;
    fs::write(&path, &bytes).unwrap();
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(entries(&mut reader), [""; 0]);
    let told = left_out(&reader).join("\n");
    assert!(told.contains("a chunk") && told.contains("a channel that is not defined: 1"), "{told}");
    assert_eq!(repair(&path).unwrap().unwrap().messages, 0);
    assert_eq!(check(&path).unwrap(), [""; 0]);
}

fn record(op: u8, content: &[u8]) -> Vec<u8> {
    [&[op], &(content.len() as u64).to_le_bytes()[..], content].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn chunk(size: u64, compression: &str, data: &[u8]) -> Vec<u8> {
    let head = [&[0; 16][..], &size.to_le_bytes(), &[0; 4], &text(compression)].concat();
    record(op::CHUNK, &[&head, &(data.len() as u64).to_le_bytes()[..], data].concat())
}

fn file(records: &[Vec<u8>]) -> Vec<u8> {
    let header = record(op::HEADER, &[text("ros2"), text("x")].concat());
    [MAGIC, &header, &records.concat()].concat()
}

#[test]
fn lengths_that_lie_cost_no_memory() {
    let zeros = zstd::encode_all(&vec![0; 64 << 20][..], 1).unwrap();
    assert!(zeros.len() < 10_000);
    let endless = [&[op::MESSAGE], &u64::MAX.to_le_bytes()[..], b"x"].concat();
    let huge_text = [&[0, 0][..], &u32::MAX.to_le_bytes()].concat();
    let attachment = [&[0; 16][..], &text("a"), &text("b"), &u64::MAX.to_le_bytes(), &[0; 4]].concat();
    let cases = [
        (chunk(1 << 40, "zstd", &zeros), "too large"),
        (chunk(100, "zstd", &zeros), "has 101 or more"),
        (chunk(100, "", b"short"), "a chunk of 100 bytes has 5"),
        (chunk(9, "lz77", b""), "is not known"),
        (chunk(9, "lz4", b"no frame"), "cannot be decompressed"),
        (chunk(endless.len() as u64, "", &endless), "middle of a record"),
        (chunk(15, "", &record(op::MESSAGE, b"tooshy")), "shorter than its head"),
        (endless, "middle of a record"),
        (record(op::SCHEMA, &huge_text), "cannot be read"),
        (record(op::CHANNEL, &huge_text), "cannot be read"),
        (record(op::METADATA, &huge_text[2..]), "cannot be read"),
        (record(op::CHUNK, &[0xff; 40]), "head of a chunk"),
        (record(op::ATTACHMENT, b"x"), "head of an attachment"),
        (record(op::ATTACHMENT, &attachment), "lengths of an attachment"),
        (vec![0; 5000], "there is no record"),
    ];
    for (bytes, why) in cases {
        let bytes = file(&[bytes]);
        let mut reader = of(&bytes).unwrap();
        assert_eq!(entries(&mut reader), [""; 0]);
        let told = left_out(&reader);
        assert!(told.iter().any(|told| told.contains(why)), "{why}: {told:?}");
        assert!(!findings(&bytes).is_empty(), "{why}");
    }
}

#[test]
fn a_document_that_is_too_large_is_left_out() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.mcap");
    let mut file = IncidentFile::create(&path, about()).unwrap();
    let unbounded = JsonChannel { bytes_max: usize::MAX, ..JOURNAL };
    let document = |bytes: usize| "x".repeat(bytes - 2);
    assert!(file.json(&unbounded, 1, &document(JOURNAL.bytes_max)).unwrap());
    assert!(file.json(&unbounded, 2, &document(JOURNAL.bytes_max + 1)).unwrap());
    assert!(!file.json(&JOURNAL, 3, &document(JOURNAL.bytes_max + 1)).unwrap(), "nor is it written");
    assert!(file.json(&KEYFRAMES, 4, &document(JOURNAL.bytes_max + 1)).unwrap(), "a state is larger");
    file.finish().unwrap();
    assert_eq!(check(&path).unwrap(), [""; 0]);
    let mut reader = Reader::open(&path).unwrap();
    let mut times = Vec::new();
    while let Some(entry) = reader.next_entry() {
        times.push(match entry {
            Entry::Missing(Missing { span_ns }) => span_ns,
            entry => entry.stamps().map(|stamps| (stamps.log_time_ns, 0)),
        });
    }
    // That something of the journal is missing is said where it is.
    assert_eq!(times, [Some((1, 0)), Some((2, 2)), Some((4, 0))]);
    let told = left_out(&reader).join("\n");
    assert!(told.contains("a document of /telltale/journal with 16777217 bytes is too large"), "{told}");
}

#[test]
fn an_end_in_the_middle_does_not_hide_what_follows() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, _) = sample(folder, false);
    let bytes = fs::read(&path).unwrap();
    let header = MAGIC.len() + 9 + usize::from(bytes[MAGIC.len() + 1]);
    let ends = [record(op::DATA_END, &[0; 4]), record(op::FOOTER, &[0; 20])].concat();
    let bytes = [&bytes[..header], &ends, &bytes[header..]].concat();
    assert_eq!(entries(&mut of(&bytes).unwrap()).len(), 18);
}

#[test]
fn what_is_left_out_is_listed_within_a_bound() {
    let many = file(&vec![record(op::SCHEMA, b"x"); 150]);
    let reader = of(&many).unwrap();
    assert_eq!((reader.omissions().list().len(), reader.omissions().more()), (100, 50));
    assert_eq!(findings(&many).len(), 100);
}

proptest::proptest! {
    /// The same as the fuzz target `recording`.
    #[test]
    fn any_bytes_are_read_without_a_panic(
        edits in proptest::collection::vec((proptest::prelude::any::<proptest::sample::Index>(), 0..9_usize, proptest::prelude::any::<u64>()), 1..8),
    ) {
        static SAMPLE: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(|| {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path();
            fs::read(sample(folder, true).0).unwrap()
        });
        let mut bytes = SAMPLE.clone();
        for (at, length, value) in edits {
            let at = at.index(bytes.len());
            let end = (at + length).min(bytes.len());
            bytes.splice(at..end, value.to_le_bytes()[..(length * 7) % 9].iter().copied());
        }
        findings(&bytes);
        if let Ok(mut reader) = of(&bytes) {
            let found = entries(&mut reader);
            reader.attachment("config.yaml");
            reader.seek(u64::MAX / 2);
            entries(&mut reader);
            assert!(found.len() <= 18);
        }
    }
}
