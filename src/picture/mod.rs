//! Layouts of pictures, shared by figures and pages: pure, and without SVG.

pub mod layers;
pub mod strips;
