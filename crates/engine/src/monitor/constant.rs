//! A state that the configuration sets.

use super::{MonitorKind, Words};
use crate::files::KeyframeError;
use crate::state::State;
use crate::text::say;
use crate::time::Timestamp;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct Constant(pub(super) State);

impl MonitorKind for Constant {
    /// The configuration alone decides.
    fn resume(&mut self, _kept: Constant) -> Result<(), KeyframeError> {
        Ok(())
    }

    fn judge(&mut self, _now: Timestamp) -> Option<State> {
        Some(self.0)
    }

    fn words(&self, _now: Timestamp) -> Words {
        Words::plain(say!("set by the configuration", "von der Konfiguration festgelegt"))
    }
}
