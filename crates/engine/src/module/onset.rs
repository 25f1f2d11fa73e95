//! When the present fault of a module began, and since when it is shown: the times by which a cause explains an
//! ERROR.

use serde::{Deserialize, Serialize};

use crate::model::Within;
use crate::model::lateness::{Beginning, Notice};
use crate::state::State;
use crate::time::{Span, Timestamp};

/// Past healthy periods that are kept. Each is shorter than the one before it, so few are needed.
const WELL_MAX: usize = 8;

/// The beginnings of a module's fault. The caller passes every change of the own state at its instant.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Onset {
    /// When the module was made.
    made: Timestamp,
    /// Since when it is well, if it is.
    well_since: Option<Timestamp>,
    /// Whether it was in ERROR when it last became relevant, and was not well since.
    was_error: bool,
    /// It has reported since the start of the program, if only to be forgotten since.
    #[serde(default)]
    reported: bool,
    /// Only modules that had a fault have it.
    fault: Option<Box<Fault>>,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Fault {
    /// Since when it is in ERROR, if it is.
    error: Option<Timestamp>,
    /// Silence made it an ERROR.
    #[serde(default)]
    by_silence: bool,
    /// When it was well, the latest last. One that is followed by a longer one is forgotten.
    well: Vec<Well>,
    /// Since when this ERROR is shown, if it is. After a restart, since its alarm was raised.
    shown_since: Option<Timestamp>,
    /// The longest time for which this ERROR was shown before.
    shown: Span,
}

/// A time in which a module was well.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Well {
    until: Timestamp,
    lasted: Span,
    /// How the fault that followed was noticed.
    #[serde(default = "unheard")]
    then: Notice,
}

fn unheard() -> Notice {
    Notice { state: State::Error, silent: false }
}

/// How long before its notice a fault began, if that is known.
type Late<'a> = &'a dyn Fn(Notice) -> Option<Span>;

/// OK and WARNING: the module does its work.
pub(crate) fn is_well(state: State) -> bool {
    matches!(state, State::Ok | State::Warning)
}

impl Onset {
    pub(crate) fn new(made: Timestamp) -> Onset {
        Onset { made, well_since: None, was_error: false, reported: false, fault: None }
    }

    /// Takes the own state at an instant, and whether the module is silent; an unchanged state changes nothing.
    pub(crate) fn follow(&mut self, notice: Notice, at: Timestamp) {
        let Notice { state, silent } = notice;
        if is_well(state) {
            self.well_since.get_or_insert(at);
            self.was_error = false;
            if let Some(fault) = &mut self.fault {
                fault.error = None;
            }
            return;
        }
        if let Some(since) = self.well_since.take() {
            let lasted = at.since(since);
            let fault = self.fault.get_or_insert_default();
            fault.well.retain(|before| before.lasted > lasted);
            if fault.well.len() == WELL_MAX {
                fault.well.remove(0);
            }
            fault.well.push(Well { until: at, lasted, then: notice });
        }
        if state == State::Error {
            let fault = self.fault.get_or_insert_default();
            if fault.error.is_none() {
                (fault.error, fault.by_silence) = (Some(at), silent);
            }
        } else if let Some(fault) = &mut self.fault {
            fault.error = None;
        }
    }

    /// The module became relevant in this state.
    pub(crate) fn became_relevant(&mut self, state: State) {
        self.was_error = state == State::Error;
    }

    /// The beginnings of this ERROR as the effect of a cause: when it became ERROR, and when the module was last well for
    /// longer than the limit.
    pub(crate) fn as_effect(
        &self,
        relevant_since: Option<Timestamp>,
        limit: Span,
        late: Late<'_>,
    ) -> [Option<Beginning>; 2] {
        let fault = self.fault.as_deref();
        let error = self.error(relevant_since, late);
        let well = fault.and_then(|fault| fault.well.iter().rev().find(|well| well.lasted > limit));
        let left = match well {
            Some(well) => self.beginning(well.until, relevant_since, late(well.then)),
            None => Beginning { noticed: self.made, began: Some(self.made) },
        };
        [error, Some(left)]
    }

    /// The beginning of the present ERROR.
    fn error(&self, relevant_since: Option<Timestamp>, late: Late<'_>) -> Option<Beginning> {
        let fault = self.fault.as_deref()?;
        let notice = Notice { state: State::Error, silent: fault.by_silence };
        Some(self.beginning(fault.error?, relevant_since, late(notice)))
    }

    /// The beginnings of this fault as the cause of others: when it became ERROR, when the module was last well at all,
    /// and when it became relevant while failing. UNKNOWN is a failure if it masks.
    pub(crate) fn as_cause(
        &self,
        relevant_since: Option<Timestamp>,
        masks_unknown: bool,
        late: Late<'_>,
    ) -> [Option<Beginning>; 3] {
        let fault = self.fault.as_deref();
        let well = fault.and_then(|fault| fault.well.last());
        let stood = relevant_since.filter(|&since| well.is_none_or(|well| well.until <= since));
        [
            self.error(relevant_since, late),
            well.map(|well| self.beginning(well.until, relevant_since, late(well.then))),
            stood
                .filter(|_| masks_unknown || self.was_error)
                .map(|noticed| Beginning { noticed, began: Some(noticed) }),
        ]
    }

    /// When the present fault began, if it is estimated to have begun before its notice.
    pub(crate) fn began(&self, relevant_since: Option<Timestamp>, late: Late<'_>) -> Option<Timestamp> {
        let left = self.fault.as_deref()?.well.last().filter(|_| self.well_since.is_none())?;
        self.beginning(left.until, relevant_since, late(left.then)).began.filter(|&began| began < left.until)
    }

    /// A fault begins neither before the module was well nor before it was relevant.
    fn beginning(
        &self,
        noticed: Timestamp,
        relevant_since: Option<Timestamp>,
        late: Option<Span>,
    ) -> Beginning {
        let wells = self.fault.as_deref().map_or(&[][..], |fault| &fault.well);
        let well = wells.iter().rev().find(|well| well.until <= noticed).map(|well| well.until - well.lasted);
        let floors = [Some(self.made), well, relevant_since].into_iter().flatten();
        let earliest = floors.filter(|&at| at <= noticed).max();
        let began = late.map(|late| earliest.map_or(noticed - late, |at| at.max(noticed - late)));
        Beginning { noticed, began }
    }

    /// Whether this ERROR was shown for so long that a dependency with this limit masks it no more.
    pub(crate) fn was_shown_for(&self, limit: Within, now: Timestamp) -> bool {
        let (Within::Limit(limit), Some(fault)) = (limit, &self.fault) else { return false };
        let shown = fault.shown_since.map_or(Span::ZERO, |since| now.since(since));
        fault.shown.max(shown) > limit
    }

    /// Takes what the module shows. Until it is `known` by a report, a time from before the start of the program stays.
    pub(crate) fn note_shown(&mut self, own: State, shown: State, known: bool, now: Timestamp) {
        self.reported |= known;
        match (own, shown) {
            (State::Error, State::Error) => {
                self.fault.get_or_insert_default().shown_since.get_or_insert(now);
            }
            _ => {
                let Some(fault) = &mut self.fault else { return };
                if own == State::Error {
                    let shown = fault.shown_since.take().map_or(Span::ZERO, |since| now.since(since));
                    fault.shown = fault.shown.max(shown);
                } else if self.reported {
                    (fault.shown_since, fault.shown) = (None, Span::ZERO);
                }
            }
        }
    }

    /// Before the start of the program, an ERROR was shown since this instant.
    pub(crate) fn restore_shown(&mut self, since: Timestamp) {
        self.fault.get_or_insert_default().shown_since = Some(since);
    }
}
