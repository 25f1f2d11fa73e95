//! Reading topics: their publishers, their readers, and losses and faults on the way.

pub(super) mod clock_step;
pub(super) mod delays;
pub(super) mod keeping;
mod last_values;
pub(super) mod learning;
pub(super) mod publishers;
pub(super) mod readers;
pub(super) mod topic;
pub(super) mod topics;
pub(super) mod trouble;
