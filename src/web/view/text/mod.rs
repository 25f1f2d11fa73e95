//! Text for the pages: from outside, made fit to be shown; and how wide it is.

mod clean;
pub mod width;

pub use clean::{ID, MESSAGE, NAME, VALUE, address, clean, clean_lines};
