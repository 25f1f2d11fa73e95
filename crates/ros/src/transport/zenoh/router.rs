//! A Zenoh router for simulations: on this computer alone, in this process.

use zenoh::Wait as _;

use super::config;

/// Runs until it is dropped.
pub struct ZenohRouter {
    session: zenoh::Session,
    endpoint: String,
}

impl ZenohRouter {
    /// Listens on a free port of the loopback interface.
    ///
    /// # Errors
    /// Zenoh cannot be started here.
    pub fn start() -> Result<ZenohRouter, String> {
        let session = zenoh::open(config::router()?).wait().map_err(|error| error.to_string())?;
        let endpoint = session.info().locators().wait().first().map(ToString::to_string);
        let endpoint = endpoint.ok_or_else(|| "the Zenoh router does not listen".to_owned())?;
        Ok(ZenohRouter { session, endpoint })
    }

    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }
}

impl Drop for ZenohRouter {
    fn drop(&mut self) {
        // Its clients notice it in any case.
        let _ = self.session.close().wait();
    }
}
