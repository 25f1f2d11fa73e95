//! The integration tests, in one binary: it links once.

/// A test for each of these functions with each vendor's peer.
macro_rules! with_each_peer {
    ($($test:ident),* $(,)?) => {
        mod cyclone {
            with_each_peer!(@Cyclone $($test)*);
        }
        mod fast_dds {
            with_each_peer!(@FastDds $($test)*);
        }
    };
    (@$vendor:ident $($test:ident)*) => {$(
        #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $test() {
            super::$test(crate::peer::Vendor::$vendor).await;
        }
    )*};
}

mod alike;
mod coming;
mod commands;
mod countermeasures;
mod cut_off;
mod dds;
mod driving;
mod evaluation;
mod fields;
mod folder;
mod goals;
mod graph;
mod held;
mod hostile;
mod incidents;
mod learned;
mod memory;
mod monitoring;
mod network;
mod observed;
mod over;
mod peer;
mod properties;
mod publishers;
mod raw;
mod recorded;
mod recording_files;
mod replayed;
mod signals;
mod sizes;
mod start;
mod tidy;
mod unheard;
mod web;
mod what_if;
mod writers;
