//! The pages of a server with what the program gives it: certificates, what-ifs, learned dependencies.

// Shared with the tests of the server's own package, which use all of it.
#[allow(dead_code)]
#[path = "../../../crates/web/tests/http/fixture.rs"]
mod fixture;
mod learn;
mod open_replays;
mod tls;
mod what_if;
