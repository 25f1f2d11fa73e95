//! The outage of the DDS process. Modules that depend on DDS are UNKNOWN at once, and their silence is not
//! their own fault.

use super::discovery::DISCOVERY;
use super::mask::node::ModuleKind;
use super::model::ModuleId;
use super::model::sample::Probe;
use super::module::system;
use super::monitor::feeds::Purpose;
use super::state::State;
use super::{Engine, SystemCheck};

impl Engine {
    pub(super) fn take_dds(&mut self, fault: Option<Box<str>>) {
        let state = if fault.is_some() { State::Error } else { State::Ok };
        let words = fault.as_deref().map(system::dds_down).unwrap_or_default();
        self.report_on_self(SystemCheck::Dds, state, words);
        let was_down = std::mem::replace(&mut self.dds_fault, fault).is_some();
        if self.dds_fault.is_some() {
            self.motion.lose_speed();
            self.cut_off();
        } else if was_down {
            self.restart_measurements();
        }
    }

    fn cut_off(&mut self) {
        for index in 0..self.net.modules.len() {
            let module = &mut self.net.modules[index];
            let is_told = matches!(module.kind, ModuleKind::Declared | ModuleKind::Discovered);
            let id = ModuleId(index as u32);
            if is_told && self.watching.hears_dds(id) && module.own.cut_off() {
                self.net.mark_module(id);
            }
        }
    }

    /// Discards earlier measurements, except an ERROR, which ends only when a report ends it.
    fn restart_measurements(&mut self) {
        for index in 0..self.watching.watches.len() as u32 {
            if let Purpose::Module(id) = self.watching.watches[index as usize].purpose
                && self.watching.hears_dds(id)
            {
                self.watching.begin_anew(index, self.now + DISCOVERY, self.now);
                self.judge_monitor(index, false);
            }
        }
    }

    /// Whether DDS answers this probe, so that no answer is possible now.
    pub(super) fn has_no_answer(&self, probe: &Probe) -> bool {
        self.dds_fault.is_some() && probe.source.target.asks_dds()
    }
}
