//! The integration tests, in one binary: it links once.

// Helpers of tests are outside of tests for clippy.
#![allow(clippy::unwrap_used)]

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

mod alarms_that_are_over;
mod answer_sizes;
mod book;
mod by_hand;
mod commands;
mod countermeasures;
mod damaged_recordings;
mod dds;
mod dds_down;
mod discovered_modules;
mod driving;
mod evaluation;
mod evaluation_campaign;
mod evaluation_page;
mod fields;
mod first_configuration;
mod fleet;
mod fleet_export;
mod fleet_what_if;
mod folder;
mod freeze_frames;
mod goals;
mod graph;
mod held_requests;
mod hostile;
mod imports;
mod incidents;
mod late_reports;
mod learned_types;
mod learning;
mod live;
mod memory;
mod misspelt_names;
mod monitoring;
mod network;
mod optional_topics;
mod peer;
mod printed;
mod program;
mod properties;
mod publishers;
mod recorded_messages;
mod recording_files;
mod recording_schemas;
mod ros_services;
mod schemas;
mod second_faults;
mod shelving;
mod signals;
mod source_messages;
mod start_errors;
mod tidy;
mod two_faults;
mod unheard_requests;
mod way_to_the_stop;
mod web;
mod what_if;
mod writers;
