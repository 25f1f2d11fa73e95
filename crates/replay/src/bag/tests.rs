//! Recordings of others: databases, folders, and what is wrong with them.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;

use mcap::records::MessageHeader;
use rusqlite::{Connection, params};

use super::*;
use telltale_record::file::{ABOUT, MessageStamps};

const TABLES: &str = "
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
        serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB);
    INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/UInt8', 'cdr', ''), (2, '/b', 'my_msgs/msg/Own', 'cdr', ''),
        (3, '/c', 'my_msgs/msg/Other', 'protobuf', '');";
const INDEX: &str = "CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const DEFINITIONS: &str = "
    CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,
        encoded_message_definition TEXT, type_description_hash TEXT);
    INSERT INTO message_definitions VALUES (1, 'my_msgs/msg/Own', 'ros2msg', 'uint8 own\n', '');";

/// A database with messages of these topics and times, whose byte is the number of the row.
fn database(path: &Path, more: &str, messages: &[(i64, i64)]) {
    fill(&Connection::open(path).unwrap(), more, messages);
}

fn fill(connection: &Connection, more: &str, messages: &[(i64, i64)]) {
    connection.execute_batch(&format!("{TABLES}{more}")).unwrap();
    for (number, (topic, time)) in messages.iter().enumerate() {
        let data = [0, 1, 0, 0, number as u8];
        let row = params![topic, time, data];
        connection
            .execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)", row)
            .unwrap();
    }
}

/// The topic, the time and the first byte of each message.
fn read(bag: &mut Bag) -> Vec<(String, u64, u8)> {
    let mut read = Vec::new();
    while let Some(entry) = bag.next_entry() {
        let Entry::Message { channel, stamps: MessageStamps { log_time_ns, .. }, body } = entry else {
            continue;
        };
        let byte = body.map_or(255, |(bytes, _)| bytes.first().copied().unwrap_or(254));
        read.push((channel.topic.to_string(), log_time_ns, byte));
    }
    read
}

fn mcap_file(path: &Path, metadata: Option<&str>, times: std::ops::Range<u64>) {
    let mut writer = mcap::Writer::new(fs::File::create(path).unwrap()).unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\n").unwrap();
    let channel_id = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
    for time in times {
        let header = MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &[0, 1, 0, 0, time as u8]).unwrap();
    }
    if let Some(name) = metadata {
        let metadata = BTreeMap::new();
        writer.write_metadata(&mcap::records::Metadata { name: name.to_owned(), metadata }).unwrap();
    }
    writer.finish().unwrap();
}

fn wrong(path: &Path) -> String {
    Bag::open(path).err().map(|error| error.to_string()).unwrap_or_default()
}

#[test]
fn rows_of_a_database_come_by_their_time_and_what_cannot_be_used_is_said() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("odd name?#%41.db3");
    database(
        &path,
        &format!("{INDEX}{DEFINITIONS}"),
        &[(1, 30), (2, 10), (3, 11), (9, 12), (1, 10), (1, -5), (4, 13)],
    );
    let connection = Connection::open(&path).unwrap();
    connection
        .execute_batch(
            "INSERT INTO topics VALUES (4, x'2f64', 'std_msgs/msg/UInt8', 'cdr', '');
            INSERT INTO messages VALUES (20, 1, 'soon', x''), (21, 1, 31, NULL), (22, 1, 32, x'00')",
        )
        .unwrap();
    let mut bag = Bag::open(&path).unwrap();
    assert_eq!((bag.first_ns(), bag.last_ns()), (Some(10), Some(32)));
    let own = bag.channels().iter().map(|channel| channel.definition.as_deref()).collect::<Vec<_>>();
    assert_eq!(own, [None, Some("uint8 own\n")]);
    let told = |topic: &str, time, byte| (topic.to_owned(), time, byte);
    assert_eq!(read(&mut bag), [told("/a", 0, 5), told("/b", 10, 1), told("/a", 10, 4), told("/a", 30, 0)]);
    let said = [
        "messages of /c: their encoding is \"protobuf\"",
        "messages of a topic that is not in the database: 9",
        "messages of topic 4: its name, type or encoding is no text",
        "messages of /a that are no bytes",
        "messages of /a without a body",
        "1 messages have no time",
    ];
    assert_eq!(bag.omissions(), (said.map(str::to_owned).to_vec(), 0));
    assert!(!folder.join("odd name?#%41.db3-shm").exists());
}

#[test]
fn a_long_database_is_read_to_its_end_with_and_without_an_index() {
    for index in [INDEX, ""] {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let path = folder.join("a.db3");
        database(&path, index, &[(1, 7)]);
        let fill = "INSERT INTO messages SELECT value, 1, value / 5000, x'0001000005' FROM generate";
        let generate = "WITH RECURSIVE generate(value) AS (SELECT 2 UNION ALL SELECT value + 1 FROM generate LIMIT 20000)";
        Connection::open(&path).unwrap().execute_batch(&format!("{generate} {fill}")).unwrap();
        let mut bag = Bag::open(&path).unwrap();
        let read = read(&mut bag);
        assert_eq!(read.len(), 20_001, "{index}");
        assert_eq!(read.is_sorted_by_key(|(_, time, _)| *time), !index.is_empty());
    }
}

#[test]
fn a_damaged_database_is_an_error_or_an_omission_and_always_ends() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (path, damaged) = (folder.join("a.db3"), folder.join("b.db3"));
    let times: Vec<(i64, i64)> = (0..500).map(|time| (1 + time % 3, time)).collect();
    database(&path, &format!("{INDEX}{DEFINITIONS}"), &times);
    let whole = fs::read(&path).unwrap();
    let (mut errors, mut omissions) = (0, 0);
    let mut look = |bytes: &[u8]| {
        fs::write(&damaged, bytes).unwrap();
        match Bag::open(&damaged) {
            Err(_) => errors += 1,
            Ok(mut bag) => {
                assert!(read(&mut bag).len() <= 500);
                omissions += usize::from(bag.omissions().0.len() > 1);
            }
        }
    };
    for length in (0..whole.len()).step_by(1499) {
        look(&whole[..length]);
    }
    for at in (16..whole.len()).step_by(97) {
        let mut bytes = whole.clone();
        let end = (at + 9).min(bytes.len());
        bytes[at..end].iter_mut().for_each(|byte| *byte = byte.wrapping_mul(31).wrapping_add(at as u8));
        look(&bytes);
    }
    assert!(errors > 5 && omissions > 5, "{errors} {omissions}");
}

#[test]
fn what_is_no_recording_is_said() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.db3");
    let tables = |text: &str| {
        let _ = fs::remove_file(&path);
        Connection::open(&path).unwrap().execute_batch(text).unwrap();
        wrong(&path)
    };
    assert!(tables("CREATE TABLE other(a)").contains("it has no table \"topics\""));
    let endless = "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i FROM n;";
    let view = tables(&format!("CREATE TABLE topics(a); {endless}"));
    assert!(view.contains("it has no table \"messages\""), "{view}");
    assert!(tables("CREATE TABLE topics(id, name); CREATE TABLE messages(a)").contains("no such column"));
    for column in ["rowid INTEGER", "data BLOB AS (zeroblob(120000000))"] {
        let said = tables(&format!("CREATE TABLE topics(id, name); CREATE TABLE messages(a, {column})"));
        assert!(said.contains("no recorder makes such a column"), "{said}");
    }
    fs::write(&path, "text").unwrap();
    assert!(wrong(&path).contains("neither an MCAP file nor a database"));
    assert!(wrong(folder).contains("neither an MCAP file nor a database"), "the only file of the folder");
    assert!(wrong(&folder.join("none")).contains("cannot be opened"));
    let packed = folder.join("a.mcap.zstd");
    fs::write(&packed, zstd::encode_all(&b"x"[..], 1).unwrap()).unwrap();
    let said = wrong(&packed);
    assert!(said.contains("a.mcap.zstd -o ") && said.ends_with("/a.mcap`"), "{said}");
}

#[test]
fn the_files_of_a_folder_follow_one_another_and_bad_ones_are_said() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    for (name, times) in [("b_2.mcap", 10..15), ("b_10.mcap", 15..20)] {
        mcap_file(&folder.join(name), None, times);
    }
    fs::write(folder.join("b_3.mcap"), "").unwrap();
    let whole = fs::read(folder.join("b_10.mcap")).unwrap();
    fs::write(folder.join("b_11.mcap"), &whole[..whole.len() - 300]).unwrap();
    let mut bag = Bag::open(folder).unwrap();
    assert_eq!(bag.first_ns(), Some(10));
    let times: Vec<u64> = read(&mut bag).into_iter().map(|(_, time, _)| time).collect();
    assert_eq!(times[..10], (10..20).collect::<Vec<_>>());
    let (said, _) = bag.omissions();
    assert!(said[0].contains("b_3.mcap: it is no recording"), "{said:?}");
    assert!(said.iter().any(|sentence| sentence.starts_with("b_11.mcap: ")), "{said:?}");

    let named = "rosbag2_bagfile_information: { relative_file_paths: [b_2.mcap, b_2.mcap, b_2.mcap] }";
    fs::write(folder.join("metadata.yaml"), named).unwrap();
    assert_eq!(read(&mut Bag::open(folder).unwrap()).len(), 5, "each file once");
    fs::remove_file(folder.join("metadata.yaml")).unwrap();

    mcap_file(&folder.join("b_1.mcap"), Some(ABOUT), 1..2);
    assert!(wrong(folder).contains("recordings of Telltale, which do not follow one another"));
    assert_eq!(
        Bag::open(&folder.join("b_1.mcap")).unwrap().single().map(|file| file.is_complete()),
        Some(true)
    );
}

#[test]
fn files_that_are_gone_are_missing_where_they_were() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    for (name, times) in [("b_1.mcap", 10..12), ("b_4.mcap", 40..42)] {
        mcap_file(&folder.join(name), None, times);
    }
    let file = |number: u64| {
        let at = format!("nanoseconds_since_epoch: {}", 10 * number);
        format!("{{ path: b_{number}.mcap, starting_time: {{ {at} }}, duration: {{ nanoseconds: 1 }} }}")
    };
    let metadata = format!(
        "rosbag2_bagfile_information:\n  relative_file_paths: [b_0.mcap, b_1.mcap, b_2.mcap, b_3.mcap, b_4.mcap, b_5.mcap]\n  files: [{}]\n",
        [0, 1, 2, 3, 4].map(file).join(", ")
    );
    fs::write(folder.join("metadata.yaml"), metadata.replace("epoch: 0", "epoch: 1")).unwrap();
    let mut bag = Bag::open(folder).unwrap();
    let all = |bag: &mut Bag| {
        let mut all = Vec::new();
        while let Some(entry) = bag.next_entry() {
            all.push(match entry {
                Entry::Missing(Missing { span_ns }) => Err(span_ns),
                other => Ok(other.stamps().unwrap().log_time_ns),
            });
        }
        all
    };
    let begin = bag.place();
    let expected = [Ok(10), Ok(11), Err(Some((20, 31))), Ok(40), Ok(41), Err(None)];
    assert_eq!(all(&mut bag), expected);
    bag.go_to(begin);
    assert_eq!(all(&mut bag), expected);
    let (said, _) = bag.omissions();
    let begins = "missing 1970-01-01T00:00:00.000Z to 1970-01-01T00:00:00.000Z";
    assert!(said.iter().any(|sentence| sentence.starts_with(begins)), "{said:?}");
    assert!(said.iter().any(|sentence| sentence.contains("b_2.mcap cannot be opened")), "{said:?}");
}

#[test]
fn a_message_that_rosbag2_compressed_by_itself_is_read() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.db3");
    database(&path, INDEX, &[]);
    let packed = zstd::encode_all(&[0, 1, 0, 0, 42][..], 1).unwrap();
    let cut = &packed[..packed.len() - 3];
    let connection = Connection::open(&path).unwrap();
    for data in [&packed[..], cut] {
        connection.execute("INSERT INTO messages VALUES (NULL, 1, 5, ?1)", [data]).unwrap();
    }
    let bytes: Vec<u8> = read(&mut Bag::open(&path).unwrap()).into_iter().map(|(_, _, byte)| byte).collect();
    assert_eq!(bytes, [42, 255]);
}

#[test]
fn what_an_interrupted_recorder_left_beside_its_database_is_read_and_stays_as_it_is() {
    let temporary = tempfile::tempdir().unwrap();
    let recorded = temporary.path().join("recorded.db3");
    let recorder = Connection::open(&recorded).unwrap();
    recorder.execute_batch("PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0;").unwrap();
    fill(&recorder, INDEX, &[(1, 10), (2, 20)]);
    // Its tables are in the log alone, as long as the recorder did not close it.
    assert!(!fs::read(&recorded).unwrap().windows(6).any(|bytes| bytes == b"topics"));
    let folder = temporary.path().join("copied");
    fs::create_dir(&folder).unwrap();
    let [path, log] = ["bag_0.db3", "bag_0.db3-wal"].map(|name| folder.join(name));
    fs::copy(&recorded, &path).unwrap();
    fs::copy(temporary.path().join("recorded.db3-wal"), &log).unwrap();
    drop(recorder);
    let files = || {
        let mut files: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files.into_iter().map(|path| (fs::read(&path).unwrap(), path)).collect::<Vec<_>>()
    };
    let before = files();
    let link = temporary.path().join("link.db3");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let expected = [("/a".to_owned(), 10, 0), ("/b".to_owned(), 20, 1)];
    for named in [&path, &folder, &link] {
        let mut bag = Bag::open(named).unwrap();
        assert_eq!((bag.first_ns(), bag.last_ns()), (Some(10), Some(20)));
        assert_eq!(read(&mut bag), expected, "{}", named.display());
        assert_eq!(bag.omissions(), (Vec::new(), 0));
    }
    assert_eq!(files(), before);

    let mut bag = Bag::open(&path).unwrap();
    fs::OpenOptions::new().append(true).open(&log).unwrap().write_all(&[1; 100]).unwrap();
    read(&mut bag);
    assert!(bag.omissions().0[0].contains("end the recording first"), "{:?}", bag.omissions());

    fs::remove_file(&log).unwrap();
    let said = wrong(&path);
    assert!(said.contains("bag_0.db3-wal first, which is not beside it: copy that file too"), "{said}");
    fs::write(folder.join("bag_0.db3-journal"), "x").unwrap();
    let said = wrong(&path);
    assert!(said.contains("bag_0.db3-journal has what is to be taken back"), "{said}");
}

#[test]
fn one_can_go_back_to_any_place() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    mcap_file(&folder.join("b_1.mcap"), None, 10..15);
    mcap_file(&folder.join("b_2.mcap"), None, 15..20);
    let rows = folder.join("rows.db3");
    database(&rows, INDEX, &[(1, 30), (2, 10), (1, 10), (1, 20), (1, 40)]);
    for path in [folder, &rows] {
        let whole = read(&mut Bag::open(path).unwrap());
        let mut bag = Bag::open(path).unwrap();
        let mut places = vec![bag.place()];
        while bag.next_entry().is_some() {
            places.push(bag.place());
        }
        assert_eq!(places.len(), whole.len() + 1);
        for (index, place) in places.iter().enumerate().rev().chain(places.iter().enumerate()) {
            bag.go_to(*place);
            assert_eq!(read(&mut bag), whole[index..], "{index}");
        }
    }
}

/// Rows of the sample that is damaged.
const SAMPLE_ROWS: usize = 300;

proptest::proptest! {
    /// The same as the fuzz target `database`.
    #[test]
    fn a_damaged_database_is_read_to_an_end(
        edits in proptest::collection::vec((proptest::prelude::any::<proptest::sample::Index>(), proptest::prelude::any::<u8>()), 1..24),
        is_indexed in proptest::prelude::any::<bool>(),
    ) {
        static SAMPLES: std::sync::LazyLock<[Vec<u8>; 2]> = std::sync::LazyLock::new(|| {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path();
            ["", INDEX].map(|index| {
                let path = folder.join(format!("{}.db3", index.len()));
                database(&path, &format!("{index}{DEFINITIONS}"), &[]);
                let rows = format!(
                    "WITH RECURSIVE number(value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM number LIMIT {SAMPLE_ROWS})
                     INSERT INTO messages SELECT value, 1 + value % 2, value * 7 % 1000, x'0001000005' FROM number"
                );
                Connection::open(&path).unwrap().execute_batch(&rows).unwrap();
                fs::read(&path).unwrap()
            })
        });
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let path = folder.join("any.db3");
        let mut bytes = SAMPLES[usize::from(is_indexed)].clone();
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        fs::write(&path, bytes).unwrap();
        if let Ok(mut bag) = Bag::open(&path) {
            let mut found = 0;
            while bag.next_entry().is_some() {
                found += 1;
                assert!(found <= 100 * SAMPLE_ROWS, "it has no end");
            }
        }
    }
}
