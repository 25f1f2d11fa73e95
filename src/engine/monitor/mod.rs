//! Diagnosis modules that watch from the outside (paper, Sec. III-D; `ENGINE.md` 7).

pub mod spec;
