//! Self checks: the engine receives news of other aggregators, its disk, its display, its clock, its
//! certificate and its recorder. Each is a module of the group `telltale`.

use super::system::{self, SystemCheck};
use crate::Engine;
use crate::input::Upkeep;
use crate::state::State;

impl Engine {
    pub(crate) fn take_aggregator(&mut self, other: Option<&str>) {
        let state = if other.is_some() { State::Warning } else { State::Ok };
        let words = other.map(system::other_aggregator).unwrap_or_default();
        self.report_on_self(SystemCheck::Aggregator, state, words);
    }

    pub(crate) fn take_nodes(&mut self, repeated: Option<&str>) {
        let state = if repeated.is_some() { State::Warning } else { State::Ok };
        let words = repeated.map(system::repeated_nodes).unwrap_or_default();
        self.report_on_self(SystemCheck::Nodes, state, words);
    }

    pub(crate) fn take_storage(&mut self, fault: Option<&str>) {
        let state = if fault.is_some() { State::Warning } else { State::Ok };
        self.report_on_self(SystemCheck::Storage, state, fault.unwrap_or_default());
    }

    pub(crate) fn take_display(&mut self, late: Option<&str>) {
        let state = if late.is_some() { State::Warning } else { State::Ok };
        self.report_on_self(SystemCheck::Display, state, late.map(system::display_late).unwrap_or_default());
    }

    pub(crate) fn take_upkeep(&mut self, upkeep: &Upkeep) {
        let parts = [
            (SystemCheck::Clock, &upkeep.clock),
            (SystemCheck::Certificate, &upkeep.certificate),
            (SystemCheck::Recording, &upkeep.recording),
        ];
        for (check, fault) in parts {
            let state = if fault.is_some() { State::Warning } else { State::Ok };
            self.report_on_self(check, state, fault.clone().unwrap_or_default());
        }
    }
}
