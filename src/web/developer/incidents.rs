//! The pages of incidents: their list, and one with everything that is known of it.

pub mod list;
pub mod one;
mod words;
