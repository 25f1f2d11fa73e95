//! Telltale's publications: their topics and rates.

use telltale_engine::model::output::{LogLevel, Output, Publication, TreeForm};
use telltale_engine::time;

/// All publications. `None`: the configuration switches it off.
#[derive(Debug, Clone, PartialEq)]
pub struct Publishing {
    pub diagnostics_agg: Option<Periodic>,
    /// Of both topics of the aggregated diagnosis.
    pub tree: TreeForm,
    pub toplevel_state: Option<Periodic>,
    pub rosout: Option<Rosout>,
    pub initialpose: Option<Box<str>>,
    pub stage: Option<Box<str>>,
    pub clearance: Option<Box<str>>,
    /// Sent while a deceleration is in force.
    pub deceleration_request: Option<Periodic>,
    pub maneuver_stop_request: Option<Box<str>>,
    pub hold: Option<Box<str>>,
}

/// The lines of the log that are published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rosout {
    pub topic: Box<str>,
    pub level: LogLevel,
}

/// A topic that is published periodically.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Periodic {
    pub topic: Box<str>,
    pub period: time::Span,
    /// Whether it is published beside another publisher of the same.
    pub beside_others: bool,
}

impl Default for Publishing {
    fn default() -> Publishing {
        let periodic = |topic: &str, millis| {
            let period = time::Span::from_millis(millis);
            Periodic { topic: topic.into(), period, beside_others: false }
        };
        Publishing {
            tree: TreeForm::default(),
            diagnostics_agg: Some(periodic("/diagnostics_agg", 1000)),
            toplevel_state: Some(periodic("/diagnostics_toplevel_state", 1000)),
            rosout: Some(Rosout { topic: "/rosout".into(), level: LogLevel::Warning }),
            initialpose: Some("/initialpose".into()),
            stage: Some("/telltale/stage".into()),
            clearance: Some("/telltale/clearance".into()),
            deceleration_request: Some(periodic("/telltale/deceleration_request", 50)),
            maneuver_stop_request: Some("/telltale/maneuver_stop_request".into()),
            hold: Some("/telltale/hold".into()),
        }
    }
}

impl Publishing {
    /// The topics of all publications.
    pub fn topics(&self) -> Vec<Box<str>> {
        Publication::ALL.into_iter().filter_map(|it| Some(self.topic(it)?.0.into())).collect()
    }

    /// Requests that the vehicle can never receive.
    pub fn switched_off(&self) -> Vec<Output> {
        let requests = [
            (Output::Deceleration, self.deceleration_request.is_none()),
            (Output::ManeuverStop, self.maneuver_stop_request.is_none()),
        ];
        requests.into_iter().filter(|(_, off)| *off).map(|(output, _)| output).collect()
    }

    /// Whether it is published beside another publisher of the same. Outputs to the vehicle always are.
    pub fn beside_others(&self, publication: Publication) -> bool {
        let periodic = match publication {
            Publication::DiagnosticsAgg => &self.diagnostics_agg,
            Publication::TopLevelState => &self.toplevel_state,
            Publication::Rosout | Publication::Vehicle(_) => return true,
        };
        periodic.as_ref().is_some_and(|it| it.beside_others)
    }

    /// The least severity of the published lines of the log.
    pub fn log_level(&self) -> LogLevel {
        self.rosout.as_ref().map_or(LogLevel::default(), |it| it.level)
    }

    /// The topic, and its period if it is periodic. `None`: the configuration switches it off.
    pub fn topic(&self, publication: Publication) -> Option<(&str, Option<time::Span>)> {
        fn periodic(it: &Option<Periodic>) -> Option<(&str, Option<time::Span>)> {
            it.as_ref().map(|it| (&*it.topic, Some(it.period)))
        }
        fn once(topic: &Option<Box<str>>) -> Option<(&str, Option<time::Span>)> {
            topic.as_deref().map(|topic| (topic, None))
        }
        match publication {
            Publication::DiagnosticsAgg => periodic(&self.diagnostics_agg),
            Publication::TopLevelState => periodic(&self.toplevel_state),
            Publication::Rosout => self.rosout.as_ref().map(|it| (&*it.topic, None)),
            Publication::Vehicle(Output::Pose) => once(&self.initialpose),
            Publication::Vehicle(Output::Stage) => once(&self.stage),
            Publication::Vehicle(Output::Clearance) => once(&self.clearance),
            Publication::Vehicle(Output::Deceleration) => periodic(&self.deceleration_request),
            Publication::Vehicle(Output::ManeuverStop) => once(&self.maneuver_stop_request),
            Publication::Vehicle(Output::Hold) => once(&self.hold),
        }
    }
}
