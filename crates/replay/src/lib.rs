//! Runs a recording through the engine: as it was judged then, or by another configuration.

pub mod bag;
mod bridge;
mod catch_up;
pub mod compare;
pub mod difference;
pub mod expect;
mod flows;
mod gaps;
pub mod line;
mod playback;
mod recording;
mod run;
pub mod series;
mod steps;
mod times;
mod trace;
mod unheard;

pub use flows::{FlowThen, Flows};
pub use gaps::{Gap, Gaps};
pub use playback::Playback;
pub use recording::{Facts, Recording, ReplayError};
pub use run::{Load, Run, Taken};
pub use steps::Notes;
pub use telltale_config::changeable::{Changeable, WhatChanges, changeable};
pub use trace::{Shown, Totals};
