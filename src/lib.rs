//! Telltale: the operator HMI of an autonomous shuttle bus.

// `cli::print` keeps lines apart and outlives a closed pipe.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod cli;
pub use telltale_clock as clock;
pub use telltale_config as config;
pub use telltale_console as console;
pub use telltale_engine as engine;
pub use telltale_evaluate as evaluate;
pub use telltale_fleet as fleet;
pub use telltale_learn as learn;
pub mod metrics;
pub use telltale_msg as msg;
pub use telltale_onboarding as onboarding;
pub use telltale_picture as picture;
pub use telltale_record as record;
pub use telltale_replay as replay;
pub use telltale_ros as ros;
pub use telltale_runtime as runtime;
pub use telltale_sim as sim;
pub use telltale_store as store;
pub use telltale_web as web;
pub use telltale_yaml as yaml;
