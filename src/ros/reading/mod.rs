//! Topics that are read: their publishers, their readers, and what is lost or wrong on the way.

pub(super) mod clock_step;
pub(super) mod learning;
pub(super) mod publishers;
pub(super) mod readers;
pub(super) mod topic;
pub(super) mod trouble;
