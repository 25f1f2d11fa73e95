//! The texts of states, stages and silence: which row says them.

use super::{Lang, NAME, Words, clean};
use telltale_engine::model::{ACTIVE_SIGNAL, POSED_SIGNAL, Stage};
use telltale_engine::snapshot::{Layout, NotRelevant, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::{Span, how_long};

impl Lang {
    pub fn state(self, state: State) -> &'static str {
        let words = Words::of(self);
        match state {
            State::Ok => words.ok,
            State::Warning => words.warning,
            State::Error => words.error,
            State::Ignore => words.ignore,
            State::Unknown => words.unknown,
        }
    }

    /// The stage in plain words. A vehicle that cannot be cleared is not "ready".
    pub fn stage(self, stage: Stage, ready: bool) -> &'static str {
        let words = Words::of(self);
        match stage {
            Stage::Locked => words.locked,
            Stage::Localizing => words.localizing,
            Stage::Standby if ready => words.ready,
            Stage::Standby => words.not_ready,
            Stage::Cleared => words.cleared,
            Stage::Active => words.driving,
        }
    }

    /// The stage of a snapshot. A machine without stages is running.
    pub fn stage_of(self, snapshot: &Snapshot) -> &'static str {
        match snapshot.has_stages() {
            true => self.stage(snapshot.stage, snapshot.clearance_refusals.is_empty()),
            false => self.runs(snapshot),
        }
    }

    /// The word for the state of a machine without stages. As long as nothing was heard of it, nothing is known.
    pub fn runs(self, snapshot: &Snapshot) -> &'static str {
        let mut modules = snapshot.module_ids().map(|id| snapshot.module(id));
        let heard = modules.any(|(info, module)| {
            let of_machine = !snapshot.group(info.group).0.is_system;
            of_machine && module.received.is_some()
        });
        if heard { Words::of(self).runs } else { Words::of(self).no_data }
    }

    /// Why a node is not relevant: `not driving`. A signal is called as the configuration says.
    pub fn not_relevant(self, because: &NotRelevant, layout: &Layout) -> String {
        let words = Words::of(self);
        let fixed = match because {
            NotRelevant::Stage(Stage::Locked) => words.not_locked,
            NotRelevant::Stage(Stage::Localizing) => words.not_localized,
            NotRelevant::Stage(Stage::Standby) => words.not_driving,
            NotRelevant::Stage(Stage::Cleared) => words.not_driving_yet,
            NotRelevant::Stage(Stage::Active) => words.not_while_driving,
            NotRelevant::Signal { name, value: false } if &**name == ACTIVE_SIGNAL => words.not_driving,
            NotRelevant::Signal { name, value: true } if &**name == ACTIVE_SIGNAL => words.not_while_driving,
            NotRelevant::Signal { name, value: false } if &**name == POSED_SIGNAL => words.no_pose,
            NotRelevant::Signal { name, value } => {
                let title = layout.signal_titles.iter().find(|(of, _)| of == name);
                return match title {
                    Some((_, title)) => self.titled_signal(*value, &self.pick(title, NAME)),
                    None => self.plain_signal(*value, &clean(name, NAME)),
                };
            }
        };
        fixed.to_owned()
    }

    /// The last message, behind the duration of the silence if there is one.
    pub fn with_silence(self, last: String, silent: Option<Span>) -> String {
        let Some(long) = silent else { return last };
        let silence = self.silent_for(&how_long(long));
        match last.is_empty() {
            true => silence,
            false => format!("{silence}; {} {last}", Words::of(self).last_words),
        }
    }

    /// `Planning, Control: wait for Localization`: components that another one's fault masks.
    pub fn wait_for(self, names: &[String], cause: Option<&str>) -> String {
        let (count, names) = (names.len(), names.join(", "));
        match cause {
            Some(cause) => self.waiting_for(count, &names, cause),
            None => self.not_fit(State::Ignore, &names),
        }
    }

    /// `lasted 9 s`, of a fault that is over. A number and its unit stand on one line.
    pub fn lasted(self, long: Span) -> String {
        self.lasted_so_long(&how_long(long).replace(' ', "\u{a0}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use telltale_engine::model::countermeasure::RequestKind;

    #[test]
    fn what_is_asked_is_not_said_to_be_done() {
        for lang in Lang::ALL {
            for request in [RequestKind::Decelerate, RequestKind::ManeuverStop] {
                for for_a_fault in [false, true] {
                    let [done, asked] =
                        [true, false].map(|done| lang.countermeasure(request, done, for_a_fault));
                    assert_ne!(done, asked);
                }
            }
        }
    }

    #[test]
    fn every_state_and_stage_has_a_word_of_its_own() {
        for lang in Lang::ALL {
            let states = BTreeSet::from(State::ALL.map(|state| lang.state(state)));
            assert_eq!(states.len(), State::ALL.len());
            let stages = BTreeSet::from(Stage::ALL.map(|stage| lang.stage(stage, true)));
            assert_eq!(stages.len(), Stage::ALL.len());
        }
    }

    #[test]
    fn counts_agree_with_their_words() {
        assert_eq!(Lang::En.parts_wait(1), "1 part waits");
        assert_eq!(Lang::De.parts_wait(4), "4 Teile warten");
        assert_eq!(Lang::De.own_faults(1), "1 eigene Störung");
        assert_eq!(Lang::De.own_faults(3), "3 eigene Störungen");
        assert_eq!(Lang::En.own_faults(1), "1 fault of its own");
        assert_eq!(Lang::En.all_ok(7, false), "All 7 active components OK");
        assert_eq!(Lang::En.all_ok(2, false), "Both active components OK");
        assert_eq!(Lang::De.all_ok(1, false), "Die aktive Komponente ist OK");
        assert_eq!(Lang::De.all_ok(8, true), "Alle 8 Komponenten OK");
        assert_eq!(Lang::En.undeclared(State::Error, 1), "1 error outside of the configuration");
        assert_eq!(Lang::En.undeclared(State::Warning, 2), "2 warnings outside of the configuration");
        assert_eq!(Lang::De.undeclared(State::Error, 3), "3 Fehler außerhalb der Konfiguration");
        assert_eq!(Lang::De.undeclared(State::Unknown, 1), "1 unbekannt außerhalb der Konfiguration");
    }
}
