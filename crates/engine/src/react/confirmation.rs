//! The vehicle's confirmation of a request. Every rule has its own confirmation, and none replaces another.

use super::held::{Countermeasures, HeldRequest, RequestOrigin};
use crate::mask::net::Net;
use crate::model::Model;
use crate::model::countermeasure::{Confirmation, ConfirmedBy, Request, RequestKind};
use crate::module::names::Names;
use crate::signals::Signals;
use crate::snapshot::CountermeasureState;
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::Timestamp;
use serde::{Deserialize, Serialize};

/// A request of one kind, while it is in force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ActiveRequest {
    pub(crate) request: Request,
    pub(crate) since: Timestamp,
    /// The time since which the vehicle could have confirmed it and has not.
    unconfirmed_since: Timestamp,
    pub(crate) state: CountermeasureState,
}

/// The last value of one confirmation.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct ConfirmationHeard {
    /// The index of its rule.
    rule: usize,
    is: bool,
    lost: Option<Timestamp>,
    /// The time for it has passed.
    late: bool,
}

impl ConfirmationHeard {
    /// The same confirmation under another configuration, if that confirms in the same way.
    fn kept(&self, before: &Model, model: &Model) -> Option<ConfirmationHeard> {
        let means = |model: &Model, index: usize| {
            let rule = model.driving.countermeasures.get(index)?;
            let by = match &rule.confirmation.as_ref()?.by {
                ConfirmedBy::Signal(index) => model.signals[*index].name.to_string(),
                ConfirmedBy::Status(name) => format!("status {name}"),
            };
            Some((rule.request.kind(), by))
        };
        let meant = means(before, self.rule)?;
        let same = |index: &usize| means(model, *index).as_ref() == Some(&meant);
        let rule =
            Some(self.rule).filter(same).or_else(|| (0..model.driving.countermeasures.len()).find(same))?;
        Some(ConfirmationHeard { rule, ..*self })
    }
}

impl Countermeasures {
    /// Whether the vehicle still has time to confirm a request.
    pub(crate) fn waits(&self, model: &Model) -> bool {
        let waits = |asked: &ActiveRequest| {
            asked.state == CountermeasureState::Requested
                && !self.confirmations(model, asked.request.kind()).is_empty()
        };
        self.asked.iter().flatten().any(waits)
    }

    /// Compares the requests with the confirmations. Returns the time at which time alone changes the result.
    pub(crate) fn confirm(
        &mut self,
        model: &Model,
        net: &Net,
        names: &Names,
        signals: &Signals,
        now: Timestamp,
    ) -> Option<Timestamp> {
        let is = |by: &ConfirmedBy| match by {
            ConfirmedBy::Signal(index) => signals.value(*index) == Some(true),
            ConfirmedBy::Status(name) => is_ok(net, names, name),
        };
        let mut next: Option<Timestamp> = self.arrives.filter(|&at| at > now && !self.held.is_empty());
        let mut waited_for = Vec::new();
        for kind in RequestKind::ALL {
            let slot = kind as usize;
            let Some(request) = self.strongest(kind) else {
                self.asked[slot] = None;
                continue;
            };
            let before = self.asked[slot].filter(|asked| asked.request == request);
            let since = self.asked[slot].map_or(self.earliest(kind).at, |asked| asked.since);
            let mut asked = before.unwrap_or(ActiveRequest {
                request,
                since,
                unconfirmed_since: now,
                state: CountermeasureState::Requested,
            });
            let confirmations = self.confirmations(model, kind);
            let is_unsent = kind.output().is_some_and(|output| self.unsent.contains_key(&output));
            if is_unsent || self.unreached(model, kind).is_some() {
                (asked.state, asked.unconfirmed_since) = (CountermeasureState::Unconfirmed, now);
            } else if confirmations.is_empty() {
                asked.state = CountermeasureState::Requested;
            } else {
                let mut due = None;
                for &(rule, since) in &confirmations {
                    let Some(Confirmation { by, within }) = &model.driving.countermeasures[rule].confirmation
                    else {
                        continue;
                    };
                    let known = self.hear(rule, is(by), now);
                    let since = since.max(asked.unconfirmed_since).max(known.lost.unwrap_or(since));
                    known.late = !known.is && since + *within <= now;
                    if !known.is && !known.late {
                        due = due.into_iter().chain([since + *within]).min();
                    }
                }
                waited_for.extend(confirmations.iter().map(|(rule, _)| *rule));
                asked.state = self.state(&confirmations, asked.state);
                next = next.into_iter().chain(due).min();
            }
            self.asked[slot] = Some(asked);
        }
        self.heard.retain(|heard| waited_for.contains(&heard.rule));
        next
    }

    fn hear(&mut self, rule: usize, is: bool, now: Timestamp) -> &mut ConfirmationHeard {
        let position = self.heard.iter().position(|heard| heard.rule == rule).unwrap_or_else(|| {
            self.heard.push(ConfirmationHeard { rule, is: false, lost: None, late: false });
            self.heard.len() - 1
        });
        let heard = &mut self.heard[position];
        if std::mem::replace(&mut heard.is, is) && !is {
            heard.lost = Some(now);
        }
        heard
    }

    /// Engaged if every confirmation is given; unconfirmed once the time of one has passed.
    fn state(
        &self,
        confirmations: &[(usize, Timestamp)],
        before: CountermeasureState,
    ) -> CountermeasureState {
        let mut heard = self.heard.iter().filter(|it| confirmations.iter().any(|(rule, _)| *rule == it.rule));
        if heard.clone().all(|it| it.is) {
            CountermeasureState::Engaged
        } else if before == CountermeasureState::Unconfirmed || heard.any(|it| it.late) {
            CountermeasureState::Unconfirmed
        } else {
            CountermeasureState::Requested
        }
    }

    /// The confirmations of a kind of request: those of each rule that makes it, with the time since when.
    /// Without a known rule, those of the rules with the same request, or else that of the first rule of the
    /// kind.
    fn confirmations(&self, model: &Model, kind: RequestKind) -> Vec<(usize, Timestamp)> {
        let rules = &model.driving.countermeasures;
        let confirmed = |&index: &usize| rules[index].confirmation.is_some();
        let mut found: Vec<(usize, Timestamp)> = Vec::new();
        let mut add = |index: usize, since: Timestamp| match found.iter_mut().find(|it| it.0 == index) {
            Some(known) => known.1 = known.1.min(since),
            None => found.push((index, since)),
        };
        let of_kind = |held: &&HeldRequest| held.request.kind() == kind;
        for held in self.held.iter().filter(of_kind) {
            let asks_the_same = |&index: &usize| rules[index].request == held.request;
            match held.by {
                RequestOrigin::Rule(index, _) => {
                    Some(index).filter(confirmed).into_iter().for_each(|it| add(it, held.since))
                }
                RequestOrigin::Past => {
                    let alike = (0..rules.len()).filter(asks_the_same);
                    alike.filter(confirmed).for_each(|index| add(index, held.since));
                }
                RequestOrigin::Operator => {}
            }
        }
        if found.is_empty() {
            let first = (0..rules.len()).filter(confirmed).find(|&index| rules[index].request.kind() == kind);
            found.extend(first.map(|index| (index, Timestamp::ZERO)));
        }
        found
    }

    /// The fault of the present requests.
    pub(crate) fn trouble(&self, model: &Model) -> Option<Text> {
        // A request without a reader is an ERROR of its own.
        let unconfirmed = |asked: &&ActiveRequest| {
            asked.state == CountermeasureState::Unconfirmed
                && self.unreached(model, asked.request.kind()).is_none()
        };
        let wrong = self.asked.iter().flatten().filter(unconfirmed).map(|asked| {
            let kind = asked.request.kind();
            let name = kind.said();
            match kind.output().and_then(|output| self.unsent.get(&output)) {
                Some(news) => {
                    let error = news.error.as_deref().unwrap_or_default();
                    say!(
                        "{name} cannot be sent on {topic}: {error}",
                        "{name} nicht zu senden auf {topic}: {error}",
                        name,
                        topic = &*news.topic,
                        error
                    )
                }
                None => self.unconfirmed(model, kind),
            }
        });
        wrong.reduce(|all, next| say!("{all}; {next}", "{all}; {next}", all, next))
    }

    /// Names the missing confirmation if there are several.
    fn unconfirmed(&self, model: &Model, kind: RequestKind) -> Text {
        let confirmations = self.confirmations(model, kind);
        let heard = |rule| self.heard.iter().find(|heard| heard.rule == rule);
        let mut missing = confirmations.iter().filter(|(rule, _)| heard(*rule).is_none_or(|it| !it.is));
        let late = missing.clone().find(|(rule, _)| heard(*rule).is_some_and(|it| it.late));
        let rule = late.or_else(|| missing.next()).map(|(rule, _)| &model.driving.countermeasures[*rule]);
        let name = kind.said();
        let Some(Confirmation { by, within }) = rule.and_then(|rule| rule.confirmation.as_ref()) else {
            return say!("{name} is not confirmed", "{name} nicht bestätigt", name);
        };
        let within = within.as_millis().to_string();
        let who = match by {
            _ if confirmations.len() == 1 => Text::default(),
            ConfirmedBy::Signal(index) => {
                let signal = &*model.signals[*index].name;
                say!(" by the signal {signal}", " vom Signal {signal}", signal)
            }
            ConfirmedBy::Status(status) => {
                say!(" by the status {status}", " vom Status {status}", status = &**status)
            }
        };
        say!(
            "{name} is not confirmed{who} within {within} ms",
            "{name} nach {within} ms{who} nicht bestätigt",
            name,
            who,
            within
        )
    }

    /// Takes over the start times of requests, and the outputs that cannot be sent.
    pub(crate) fn keep(&mut self, old: &Countermeasures, before: &Model, model: &Model) {
        (self.asked, self.arrives, self.knows_all) = (old.asked, old.arrives, old.knows_all);
        self.last_stop = old.last_stop;
        self.heard = old.heard.iter().filter_map(|heard| heard.kept(before, model)).collect();
        self.unsent.clone_from(&old.unsent);
        self.unheard.clone_from(&old.unheard);
        self.other_voices.clone_from(&old.other_voices);
    }
}

fn is_ok(net: &Net, names: &Names, status: &str) -> bool {
    let module = names.find(status).and_then(|route| names.routes[route as usize].module(0));
    module.is_some_and(|id| {
        let own = &net.modules[id.0 as usize].own;
        own.received().is_some() && !own.silent() && net.modules[id.0 as usize].node.facts.own == State::Ok
    })
}
