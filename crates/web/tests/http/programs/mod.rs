//! Programs: the API, its documents, and ROS 2 services.

mod api;
mod services;
mod snapshot_json;
