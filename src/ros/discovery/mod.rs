//! What DDS discovery tells: topics, nodes, who writes statuses; and our own announcement.

pub(super) mod graph;
pub(super) mod nodes;
pub(super) mod peers;
pub(super) mod presence;
pub(super) mod status_writers;
