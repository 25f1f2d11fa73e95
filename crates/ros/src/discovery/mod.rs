//! The results of DDS discovery: topics, nodes and the writers of statuses; and the announcement of
//! Telltale's own nodes.

pub(super) mod graph;
pub(super) mod nodes;
pub(super) mod peers;
pub(super) mod presence;
pub(super) mod repeated;
pub(super) mod status_writers;
