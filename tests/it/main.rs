//! Tests at the boundaries of the program: foreign peers, the real server, the real browser.

mod dds;
mod peer;
