//! Any bytes are read as a recording, and what cannot be used is said.

#![no_main]

use std::io::Cursor;
use std::path::Path;

use libfuzzer_sys::fuzz_target;
use telltale::record::file::{Reader, check_bytes};

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("fuzz");
    let sound = check_bytes(path, Cursor::new(bytes)).expect("memory can be read").is_empty();
    let Ok(mut reader) = Reader::new(path, Cursor::new(bytes)) else {
        assert!(!sound);
        return;
    };
    while reader.next_entry().is_some() {}
    let names: Vec<_> = reader.attachments().map(|(name, _)| name.to_owned()).collect();
    for name in &names {
        reader.attachment(name);
    }
    assert!(reader.is_complete() || !reader.omissions().is_empty());
    assert!(reader.is_complete() || !sound);
    reader.seek(u64::MAX / 2);
    while reader.next_entry().is_some() {}
});
