//! Texts on the pages: texts from outside are cleaned.

mod clean;

pub use clean::{ID, MESSAGE, NAME, VALUE, address, clean, clean_configured, clean_lines, plain_json};
