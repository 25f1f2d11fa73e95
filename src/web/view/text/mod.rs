//! Texts on the pages: texts from outside are cleaned.

mod clean;

pub use clean::{ID, MESSAGE, NAME, VALUE, address, clean, clean_lines};
