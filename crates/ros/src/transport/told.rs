//! The endpoints that the program was told of by the process of a transport.

use std::collections::{BTreeMap, BTreeSet};

use super::Found;
use super::places::{self, Places};
use super::wire::{Frame, FromChild};
use telltale_msg::sample_bytes::Guid;

#[derive(Default)]
pub struct Told {
    pub endpoints: BTreeMap<Guid, Found>,
    /// The topics whose endpoints are followed before others.
    pub ours: BTreeSet<String>,
    /// Endpoints that are not followed, as the program knows: those of such topics, and all.
    cut: (u32, u32),
}

impl Told {
    /// Tells of the endpoints that are gone, new or have changed. `passed_over` are others that are not among them, perhaps
    /// of topics of ours.
    /// Returns whether one is new or has changed.
    ///
    /// # Errors
    /// There are more than can be looked at.
    pub fn tell(
        &mut self,
        now: BTreeMap<Guid, Found>,
        passed_over: u32,
        frame: &mut Frame,
    ) -> Result<bool, String> {
        let Places { followed: now, cut_of_ours, cut } = places::choose(now, &self.endpoints, &self.ours)?;
        let (cut_of_ours, cut) = (cut_of_ours.saturating_add(passed_over), cut.saturating_add(passed_over));
        let before = std::mem::replace(&mut self.cut, (cut_of_ours, cut));
        let tell_cut = |frame: &mut Frame| frame.news(&FromChild::Cut { of_ours: cut_of_ours, all: cut });
        // Told first: an endpoint that was cut is not gone.
        let is_more = cut_of_ours > before.0;
        if is_more {
            tell_cut(frame);
        }
        // Before the new ones, which need their places.
        for guid in self.endpoints.keys().filter(|guid| !now.contains_key(*guid)) {
            frame.news(&FromChild::Gone { guid: *guid });
        }
        let mut is_news = false;
        for (guid, found) in &now {
            if self.endpoints.get(guid) != Some(found) {
                frame.news(&FromChild::Found(found.clone()));
                is_news = true;
            }
        }
        if !is_more && before != self.cut {
            tell_cut(frame);
        }
        self.endpoints = now;
        Ok(is_news)
    }
}
