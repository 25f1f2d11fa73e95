//! The messages between the program and its DDS process.

use std::net::Ipv4Addr;

use bytes::Bytes;

use crate::transport::ids::Prefix;
use crate::transport::quality::Via;
use crate::transport::{Found, Quality, RawSample, SampleId};
use telltale_msg::sample_bytes::Guid;

/// From the program to the DDS process.
#[derive(Debug, Clone, PartialEq)]
pub enum Order {
    /// The first order: make a participant.
    Open(Network),
    Reader {
        id: u32,
        topic: String,
        type_name: String,
        via: Via,
        depth: u32,
    },
    EndReader {
        id: u32,
    },
    /// So many bytes of a reader were taken; as many may follow.
    Taken {
        id: u32,
        bytes: u32,
    },
    /// Keep more samples of a topic.
    Deepen {
        topic: String,
        type_name: String,
        depth: u32,
    },
    Writer {
        id: u32,
        topic: String,
        type_name: String,
        quality: Quality,
    },
    Write {
        id: u32,
        number: u32,
        /// The sample to which it replies.
        related: Option<SampleId>,
        body: Bytes,
    },
    /// End, and say goodbye to the other participants.
    Close,
    /// A participant that the library has lost is gone.
    Forget {
        participant: Prefix,
    },
    /// The endpoints of this topic are followed before others.
    FollowFirst {
        topic: String,
    },
}

/// Where a participant is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Network {
    /// On these interfaces, or on all.
    Dds { domain: u16, interfaces: Option<Vec<Ipv4Addr>> },
    /// At this router, or at the one that the environment names.
    Zenoh { domain: u16, router: Option<String> },
}

/// From the DDS process to the program.
#[derive(Debug, Clone, PartialEq)]
pub enum FromChild {
    /// The participant is made.
    Ready {
        guid: Guid,
        participant: u16,
    },
    /// The reader or writer of this id is made.
    Made {
        id: u32,
        guid: Guid,
    },
    Found(Found),
    Gone {
        guid: Guid,
    },
    /// So many endpoints are not told of, because there are more than may be: those of topics that are followed first,
    /// and all.
    Cut {
        of_ours: u32,
        all: u32,
    },
    Sample {
        reader: u32,
        sample: RawSample,
    },
    /// A sample could not be handed over.
    Fault {
        reader: u32,
        reason: String,
    },
    /// Messages may be lost that nobody sends again to this reader.
    Missed {
        reader: u32,
    },
    Written {
        number: u32,
        error: Option<String>,
    },
    /// It lives. `heard` is the newest of its own beats, counted from 1, that came to it through the
    /// network.
    Beat {
        heard: u64,
    },
    /// It cannot go on.
    Broken {
        reason: String,
    },
    Participant {
        participant: Prefix,
        change: Change,
    },
}

/// The state of another participant in the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The library has heard it for the first time.
    Here,
    /// It was not heard for its lease. Its endpoints still count.
    Lost,
    /// It said that it leaves.
    Left,
    /// It was lost, and was discovered again. The library does not match its endpoints again.
    Back,
    /// As [`Change::Back`], by a copy of its announcement, which may have been under way while it left.
    Copied,
}

impl Change {
    pub const ALL: [Change; 5] = [Change::Here, Change::Lost, Change::Left, Change::Back, Change::Copied];
}
