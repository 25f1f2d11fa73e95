//! Pictures as SVG, pure: the graph of a vehicle, and its states over time. Figures of commands and pages of
//! the web server give data, classes and links; layout and shapes stand here.

pub mod bars;
pub mod figure;
pub mod graph;
mod layers;
pub mod strips;
pub mod svg;
