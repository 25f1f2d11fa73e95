//! The configuration of monitors: their kinds, their sources and their limits.

use std::fmt;
use std::sync::Arc;

use super::sample::FieldValue;
pub use super::watched::{
    DiagnosticsTopic, FieldKind, FieldSpec, ProbeTarget, ProcessMeasure, RecordedTopic, Resource, ScalarKind,
    StampClock, TopicId, TopicSpec, ValueSource, WatchdogId, WatchdogSpec, Watched,
};
use crate::state::State;
use crate::time::Span;

/// Limits. A value below or above a limit counts, an equal value does not; ERROR is judged before WARNING.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bands {
    pub warning_below: Option<f64>,
    pub error_below: Option<f64>,
    pub warning_above: Option<f64>,
    pub error_above: Option<f64>,
    /// The state of a value that is no number, and of a stamp that lies in the future; `None`: UNKNOWN.
    pub unmeasurable: Option<State>,
}

/// The rule for a single value.
#[derive(Debug, Clone, PartialEq)]
pub enum ValueRule {
    Bands(Bands),
    /// Every other value is bad; numbers, booleans and texts are compared as such.
    Unless {
        error: Option<FieldValue>,
        warning: Option<FieldValue>,
    },
}

impl Default for ValueRule {
    fn default() -> ValueRule {
        ValueRule::Bands(Bands::default())
    }
}

/// Limits of what repeats itself; only those above are set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrozenLimits {
    /// From the first of the equal messages to the last, in seconds.
    pub time: Bands,
    /// The equal messages in a row without the first.
    pub repeats: Bands,
}

impl FrozenLimits {
    /// The longest time that is allowed.
    pub fn longest(&self) -> Span {
        let limits = [self.time.warning_above, self.time.error_above].into_iter().flatten();
        Span::from_nanos((limits.fold(0.0, f64::max) * 1e9) as u64)
    }
}

/// The rule for two sources.
#[derive(Debug, Clone, PartialEq)]
pub enum AgreementRule {
    /// By the absolute difference.
    Number(Bands),
    /// By the distance in metres and the angle in degrees.
    Pose { translation: Bands, rotation_deg: Bands },
    /// Lists of positions: by the difference of their lengths, and by the largest distance of any
    /// position of one list to the nearest of the other, in metres.
    Positions { count: Bands, nearest: Bands },
}

impl Default for AgreementRule {
    fn default() -> AgreementRule {
        AgreementRule::Number(Bands::default())
    }
}

/// What judges a module. Most modules judge themselves, so all other monitors are stored apart.
#[derive(Debug, Clone, PartialEq)]
pub enum ModuleMonitor {
    /// The level in the status of exactly this name.
    SelfState(Arc<str>),
    Other(Box<MonitorSpec>),
}

/// A monitor that is not the module itself.
#[derive(Debug, Clone, PartialEq)]
pub enum MonitorSpec {
    /// The level in the status of a domain-specific module elsewhere, which has a class of its own.
    External {
        status: Arc<str>,
        class: Class,
    },
    /// Messages per second; bands in Hz.
    Frequency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Receipt minus header stamp, the worst in the window; bands in seconds.
    Latency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    Value {
        source: ValueSource,
        rule: ValueRule,
    },
    /// How long, and how many messages in a row, a value may stay the same.
    Frozen {
        source: ValueSource,
        limits: FrozenLimits,
    },
    /// This many misses in a row make an ERROR; bands on the response time, in seconds.
    Watchdog {
        watchdog: WatchdogId,
        misses: u32,
        bands: Bands,
    },
    /// Bands on what is measured of a [`Resource`].
    System {
        watchdog: WatchdogId,
        bands: Bands,
    },
    /// Bands on the output rate divided by the input rate.
    RateRatio {
        input: TopicId,
        output: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Bands on `later` minus `earlier`.
    Sequence {
        earlier: ValueSource,
        later: ValueSource,
        max_gap: Span,
        bands: Bands,
    },
    Agreement {
        a: ValueSource,
        b: ValueSource,
        /// An older value is no longer compared.
        max_age: Span,
        /// Compares the motion over this time instead of the positions.
        motion_over: Option<Span>,
        rule: AgreementRule,
    },
    /// Always this state.
    Constant {
        state: State,
    },
    /// The number of modules in its group, beside itself and without those of nested groups.
    Count {
        wanted: u32,
        /// None at all is OK too.
        may_be_empty: bool,
        /// After the start, the time in which modules may still come.
        grace: Span,
    },
    Expression {
        /// By the names that the conditions use.
        inputs: Vec<(Box<str>, ValueSource)>,
        max_age: Span,
        warning: Option<Condition>,
        error: Option<Condition>,
        class: Class,
    },
}

impl From<MonitorSpec> for ModuleMonitor {
    fn from(spec: MonitorSpec) -> ModuleMonitor {
        ModuleMonitor::Other(Box::new(spec))
    }
}

impl ModuleMonitor {
    /// The monitor, unless the module judges itself.
    pub fn other(&self) -> Option<&MonitorSpec> {
        match self {
            ModuleMonitor::SelfState(_) => None,
            ModuleMonitor::Other(spec) => Some(spec),
        }
    }

    /// The status whose level is the module's report. No other module declares it.
    pub fn status(&self) -> Option<&Arc<str>> {
        match self {
            ModuleMonitor::SelfState(status) => Some(status),
            ModuleMonitor::Other(spec) => spec.status(),
        }
    }
}

impl MonitorSpec {
    /// The status whose level is the module's report.
    pub fn status(&self) -> Option<&Arc<str>> {
        match self {
            MonitorSpec::External { status, .. } => Some(status),
            MonitorSpec::Frequency { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Frozen { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::System { .. }
            | MonitorSpec::RateRatio { .. }
            | MonitorSpec::Sequence { .. }
            | MonitorSpec::Agreement { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. }
            | MonitorSpec::Expression { .. } => None,
        }
    }
}

/// A condition over values in the order of the inputs. The configuration knows its language; conditions with
/// equal texts are equal.
#[derive(Clone)]
pub struct Condition {
    pub text: Arc<str>,
    evaluate: Arc<Evaluate>,
    /// The type that the condition assumes for each input, if it does.
    kinds: Arc<[Option<ScalarKind>]>,
}

type Evaluate = dyn Fn(&[FieldValue]) -> Result<bool, Box<str>> + Send + Sync;

impl Condition {
    pub fn new(
        text: &str,
        evaluate: impl Fn(&[FieldValue]) -> Result<bool, Box<str>> + Send + Sync + 'static,
    ) -> Condition {
        Condition { text: text.into(), evaluate: Arc::new(evaluate), kinds: Arc::from([]) }
    }

    /// The same condition with the assumed types of its inputs, in order.
    pub fn taking(self, kinds: impl Into<Arc<[Option<ScalarKind>]>>) -> Condition {
        Condition { kinds: kinds.into(), ..self }
    }

    /// The type that the condition assumes for an input.
    pub fn takes(&self, input: usize) -> Option<ScalarKind> {
        self.kinds.get(input).copied().flatten()
    }

    /// # Errors
    ///
    /// The reason why the condition has no answer for these values.
    pub fn holds(&self, values: &[FieldValue]) -> Result<bool, Box<str>> {
        (self.evaluate)(values)
    }
}

impl fmt::Debug for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Condition").field(&self.text).finish()
    }
}

impl PartialEq for Condition {
    fn eq(&self, other: &Condition) -> bool {
        self.text == other.text
    }
}

/// The class of a diagnosis in the paper's classification (Sec. III-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Class {
    /// `isolated` or `contextual`.
    pub location: &'static str,
    /// `content` or `meta`.
    pub information: &'static str,
    /// `sequential` or `parallel`, for a diagnosis of data flow.
    pub flow: Option<&'static str>,
}

impl Class {
    /// The column of the paper's taxonomy (Fig. 3), from 0: isolated meta, isolated content, contextual meta,
    /// contextual content sequential and parallel. `None` for a class that the taxonomy does not have.
    pub fn column(self) -> Option<usize> {
        match (self.location, self.information, self.flow) {
            ("isolated", "meta", None) => Some(0),
            ("isolated", "content", None) => Some(1),
            // A contextual meta diagnosis has one column, with and without data flow.
            ("contextual", "meta", _) => Some(2),
            ("contextual", "content", Some("sequential")) => Some(3),
            ("contextual", "content", Some("parallel")) => Some(4),
            _ => None,
        }
    }
}
