//! MCAP files of incidents. A file is written so that a crash costs at most its last chunk, is read whatever
//! it holds, and is made whole again after a crash.

mod budget;
mod definitions;
mod doctor;
mod entry;
mod error;
mod json;
mod layout;
mod omission;
mod output;
mod reader;
mod records;
mod repair;
mod source;
mod writer;

pub use budget::{Budget, SPENT};
pub use definitions::Channel;
pub use doctor::{check, check_bytes};
pub use entry::Entry;
pub use error::FileError;
pub use json::{JOURNAL, JsonChannel, KEYFRAMES, TRANSITIONS};
pub use omission::{Missing, Omission, Omissions};
pub use reader::{Place, Reader};
pub use repair::{REPAIRED, Repair, repair};
pub use source::{CHUNK_BYTES_MAX, is_packed, raw_body};
pub use writer::{IncidentFile, MessageStamps, Topic, Written};

/// The name of the metadata record that describes a file of ours.
pub const ABOUT: &str = "telltale";

/// The name of the metadata record with what was known of an incident when its recording began.
pub const BEGUN: &str = "telltale:begun";

/// The name of the metadata record with what each topic lacks, for want of room.
pub const LEFT_OUT: &str = "telltale:left_out";

/// The schema of a type whose definition is not known.
const UNDEFINED: &str = "# The definition of this type was not known where it was recorded.\n";

#[cfg(test)]
mod tests;
