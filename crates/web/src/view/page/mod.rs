//! Whole pages and their frame.

mod context;
mod demo;
pub mod frame;
mod login;
mod message;
mod operator;

pub use context::{PageContext, PagePart, Palette, RecorderState};
pub use demo::{DemoFault, demo_page};
pub use login::{LoginContext, LoginFailure, login_page};
pub use message::{Home, message_page};
pub use operator::operator_page;
