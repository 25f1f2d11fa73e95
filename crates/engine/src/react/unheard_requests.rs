//! Requests without a receiver: the configuration switches the output off, or it has no matching reader. Such a
//! request must not look like one that was sent.

use super::held::Countermeasures;
use crate::Engine;
use crate::input::ListenerReport;
use crate::model::countermeasure::RequestKind;
use crate::model::output::Output;
use crate::model::{Model, StageModel};
use crate::snapshot::Unreached;
use crate::text::Text;
use crate::text::say;

/// Requests to the vehicle.
const REQUESTS: [RequestKind; 2] = [RequestKind::ManeuverStop, RequestKind::Decelerate];

impl Countermeasures {
    pub(crate) fn take_listeners(&mut self, news: &ListenerReport) {
        match news.heard {
            true => self.listened.insert(news.output),
            false => self.listened.remove(&news.output),
        };
        match news.heard {
            true => self.unheard.remove(&news.output),
            false => self.unheard.insert(news.output, news.topic.clone()),
        };
    }

    /// The reason why requests of a kind have no receiver; `None` if they have one, or if that is not known.
    pub(crate) fn unreached(&self, model: &Model, kind: RequestKind) -> Option<Unreached> {
        let output = kind.output()?;
        if model.driving.unpublished.contains(&output) {
            return Some(Unreached::Unpublished);
        }
        self.unheard.contains_key(&output).then_some(Unreached::Unheard)
    }

    fn said_unheard(&self, model: &Model, kind: RequestKind) -> Option<Text> {
        let name = kind.said();
        match self.unreached(model, kind)? {
            Unreached::Unheard => {
                let topic = self.unheard.get(&kind.output()?)?;
                Some(say!("nobody listens to {topic}", "niemand hört auf {topic}", topic = &**topic))
            }
            Unreached::Unpublished => {
                Some(say!("{name} is not published", "{name} wird nicht gesendet", name))
            }
        }
    }
}

impl Engine {
    pub(crate) fn take_listeners(&mut self, news: &ListenerReport) {
        self.countermeasures.take_listeners(news);
        self.vehicle_changed = true;
    }

    /// The outputs without a receiver, for the snapshot.
    pub(crate) fn unreached(&self) -> Vec<(Output, Unreached)> {
        let of =
            |kind: RequestKind| Some((kind.output()?, self.countermeasures.unreached(&self.model, kind)?));
        REQUESTS.into_iter().filter_map(of).collect()
    }

    /// Possible requests without a receiver. An output that the configuration switches off does not count here;
    /// `check` warns of it.
    pub(crate) fn possible_requests_without_reader(&self) -> impl Iterator<Item = RequestKind> {
        let unheard = |kind| self.countermeasures.unreached(&self.model, kind) == Some(Unreached::Unheard);
        let by_rule =
            |kind| self.model.driving.countermeasures.iter().any(|rule| rule.request.kind() == kind);
        // The operator may request a stop on every vehicle with stages.
        let by_operator =
            |kind| kind == RequestKind::ManeuverStop && self.model.stages == StageModel::Shuttle;
        REQUESTS.into_iter().filter(move |&kind| unheard(kind) && (by_rule(kind) || by_operator(kind)))
    }

    /// The requests in force without a receiver. Without a request in force it is no fault: the page offers no
    /// stop, and there is no clearance.
    pub(crate) fn unheard(&self) -> Option<Text> {
        let asked = REQUESTS.into_iter().filter(|kind| self.countermeasures.strongest(*kind).is_some());
        let said = asked.filter_map(|kind| self.countermeasures.said_unheard(&self.model, kind));
        said.reduce(|all, next| say!("{all}; {next}", "{all}; {next}", all, next))
    }
}
