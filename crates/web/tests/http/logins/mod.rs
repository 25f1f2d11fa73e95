//! People: logins, their sessions, and what they do while a login or the disk holds them up.

mod expired_sessions;
mod late_actions;
mod login;
mod login_policy;
