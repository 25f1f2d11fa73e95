//! In place of `zenoh` in a program that was built without it: everything is refused.

/// What to do.
const WITHOUT: &str = "this program was built without Zenoh: build it with --features zenoh";

pub mod child {
    use crate::transport::parent::{Orders, ToParent};
    use crate::transport::wire::Order;

    pub async fn run(
        _: u16,
        _: Option<String>,
        _: Vec<Order>,
        _: &mut Orders,
        _: &mut ToParent,
    ) -> Result<(), String> {
        Err(super::WITHOUT.to_owned())
    }
}

pub mod router {
    /// There is none.
    pub enum ZenohRouter {}

    impl ZenohRouter {
        /// # Errors
        /// Always.
        pub fn start() -> Result<ZenohRouter, String> {
            Err(super::WITHOUT.to_owned())
        }

        pub fn endpoint(&self) -> &str {
            match *self {}
        }
    }
}
