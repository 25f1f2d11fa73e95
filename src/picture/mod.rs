//! Where things stand in a picture, for all who draw: pure, and without a line of SVG.

pub mod layers;
pub mod strips;
