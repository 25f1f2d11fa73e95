//! Texts on the pages: texts from outside are cleaned, and the width of texts is estimated.

mod clean;
pub mod width;

pub use clean::{ID, MESSAGE, NAME, VALUE, address, clean, clean_lines};
