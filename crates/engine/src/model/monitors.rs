//! The configuration of monitors: their kinds, their sources and their limits.

use std::fmt;
use std::sync::Arc;

use super::sample::FieldValue;
pub use super::watched::{
    DIAGNOSTIC_ARRAY, DIAGNOSTICS, DiagnosticsTopic, FieldKind, FieldSpec, ProbeTarget, ProcessMeasure,
    RecordedTopic, Resource, ScalarKind, StampClock, TF, TF_MESSAGE, TF_STATIC, TopicId, TopicSpec,
    ValueSource, WatchdogId, WatchdogSpec, Watched,
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

impl Bands {
    /// The longest time that is allowed, of limits in seconds.
    pub fn longest(&self) -> Span {
        let limits = [self.warning_above, self.error_above].into_iter().flatten();
        Span::from_nanos((limits.fold(0.0, f64::max) * 1e9) as u64)
    }
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

/// Limits of a `frozen` monitor; only those above are used.
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
        self.time.longest()
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

/// The monitor of a module. Most modules judge themselves, so all other monitors are stored apart.
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
    External { status: Arc<str>, class: Class },
    /// Messages per second; bands in Hz.
    Frequency { topic: TopicId, window: Span, bands: Bands },
    /// Receipt minus header stamp, the worst in the window; bands in seconds.
    Latency { topic: TopicId, window: Span, bands: Bands },
    Value {
        source: ValueSource,
        rule: ValueRule,
        /// Its messages are events: the last one counts until the next one, and before the first one this state.
        empty: Option<State>,
    },
    /// How long, and how many messages in a row, a value may stay the same.
    Frozen { source: ValueSource, limits: FrozenLimits },
    /// This many misses in a row make an ERROR; bands on the response time, in seconds.
    Watchdog { watchdog: WatchdogId, misses: u32, bands: Bands },
    /// Bands on what is measured of a [`Resource`].
    System { watchdog: WatchdogId, bands: Bands },
    /// Bands on the output rate divided by the input rate.
    RateRatio { input: TopicId, output: TopicId, window: Span, bands: Bands },
    /// Bands on `later` minus `earlier`.
    Sequence { earlier: ValueSource, later: ValueSource, max_gap: Span, bands: Bands },
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
    Constant { state: State },
    /// The number of modules in its group, other than itself and without those of nested groups.
    Count {
        wanted: u32,
        /// None at all is OK too.
        may_be_empty: bool,
        /// After the start, the time in which modules may still come.
        grace: Span,
    },
    /// The transforms along a chain of frames: whether each is there, how old the oldest is, and whether a frame has
    /// two parents. Bands on the age, in seconds.
    Tf {
        /// From the first frame downwards.
        links: Vec<TfLink>,
        bands: Bands,
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

/// A wanted transform.
#[derive(Debug, Clone, PartialEq)]
pub struct TfLink {
    pub parent: Arc<str>,
    pub child: Arc<str>,
    /// Of the topic of transforms that are sent again and again.
    pub moving: ValueSource,
    /// Of the topic of those that are sent once and hold.
    pub fixed: ValueSource,
}

/// The time that tf2 keeps: a frame has two parents while both were sent within it.
pub const TF_MEMORY: Span = Span::from_secs(10);

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

    fn about(&self) -> About<'_> {
        match self {
            ModuleMonitor::SelfState(status) => {
                About { status: Some(status), ..About::of_component("self_state", CONTENT) }
            }
            ModuleMonitor::Other(spec) => spec.about(),
        }
    }

    /// Its kind, as in the configuration.
    pub fn kind(&self) -> &'static str {
        self.about().kind
    }

    /// Its class in the paper's classification.
    pub fn class(&self) -> Class {
        self.about().class
    }

    /// Whether it judges a component, and not a data stream.
    pub fn is_of_component(&self) -> bool {
        self.about().of_component
    }

    /// Whether the monitor itself judges silence, so that the module's timeout has no effect.
    pub fn by_the_clock(&self) -> bool {
        self.about().by_the_clock
    }

    /// The status whose level is the module's report. No other module declares it.
    pub fn status(&self) -> Option<&Arc<str>> {
        self.about().status
    }

    /// The statuses that the monitor reads.
    pub fn statuses(&self) -> impl Iterator<Item = Arc<str>> {
        let keyed = self.other().map(MonitorSpec::keyed_statuses).unwrap_or_default();
        self.status().cloned().into_iter().chain(keyed)
    }

    /// The longest time by which its judgement depends on earlier inputs.
    pub(super) fn memory(&self, watched: &Watched) -> Span {
        let About { memory, probe, .. } = self.about();
        let rounds = probe.map_or(Span::ZERO, |(WatchdogId(id), rounds)| {
            let every = watched.watchdogs[id as usize].every;
            Span::from_nanos(every.as_nanos().saturating_mul(u64::from(rounds)))
        });
        memory.max(rounds)
    }

    /// Whether it judges the same sources in the same way. The indices of the sources may differ.
    pub(crate) fn means_the_same(&self, watched: &Watched, other: &ModuleMonitor, others: &Watched) -> bool {
        match (self, other) {
            (ModuleMonitor::Other(spec), ModuleMonitor::Other(other)) => {
                spec.means_the_same(watched, other, others)
            }
            _ => self == other,
        }
    }
}

/// The topics and fields that a monitor reads.
#[derive(Debug, Clone, PartialEq)]
pub struct Reads {
    /// By their ROS names, each once.
    pub topics: Vec<Box<str>>,
    /// The limits of the rate of the one topic, in Hz, if that is what it judges.
    pub rate: Option<Bands>,
}

/// The facts about a monitor that follow from its kind.
pub(crate) struct About<'a> {
    kind: &'static str,
    class: Class,
    of_component: bool,
    pub(crate) by_the_clock: bool,
    /// How far back it looks.
    memory: Span,
    /// Its probe, and how many of its rounds it looks back.
    probe: Option<(WatchdogId, u32)>,
    status: Option<&'a Arc<str>>,
}

const META: Class = Class { location: "isolated", information: "meta", flow: None };
const CONTENT: Class = Class { location: "isolated", information: "content", flow: None };

const fn contextual(information: &'static str, flow: &'static str) -> Class {
    Class { location: "contextual", information, flow: Some(flow) }
}

impl About<'_> {
    /// A kind that takes all defaults.
    fn of(kind: &'static str, class: Class) -> Self {
        let of_component = false;
        About {
            kind,
            class,
            of_component,
            by_the_clock: false,
            memory: Span::ZERO,
            probe: None,
            status: None,
        }
    }

    /// One whose technique is about a component: what it says of itself or is said of it, whether it answers, what it
    /// makes of its input. The others judge a data stream.
    fn of_component(kind: &'static str, class: Class) -> Self {
        About { of_component: true, ..About::of(kind, class) }
    }
}

/// A source of a monitor, in the order of the slots of its machine.
pub(crate) enum Source<'a> {
    Messages(&'a mut TopicId),
    Value(&'a mut ValueSource),
    Probe(&'a mut WatchdogId),
}

/// A source without the index that one configuration gives to it.
#[derive(PartialEq)]
enum Meaning<'a> {
    Topic(&'a str, &'a str, Option<&'a FieldSpec>),
    Probe(&'a WatchdogSpec),
}

impl MonitorSpec {
    pub(crate) fn about(&self) -> About<'_> {
        use MonitorSpec as Of;
        let (of, of_component) = (About::of, About::of_component);
        match self {
            Of::External { status, class } => {
                About { status: Some(status), ..of_component("external", *class) }
            }
            Of::Frequency { window, .. } => {
                About { by_the_clock: true, memory: *window, ..of("frequency", META) }
            }
            Of::Latency { window, .. } => About { memory: *window, ..of("latency", META) },
            Of::Value { empty, .. } => About { by_the_clock: empty.is_some(), ..of("value", CONTENT) },
            Of::Frozen { limits, .. } => About { memory: limits.longest(), ..of("frozen", CONTENT) },
            Of::Watchdog { watchdog, misses, .. } => About {
                by_the_clock: true,
                probe: Some((*watchdog, *misses)),
                ..of_component("watchdog", META)
            },
            Of::System { watchdog, .. } => {
                About { by_the_clock: true, probe: Some((*watchdog, 1)), ..of_component("system", META) }
            }
            Of::RateRatio { window, .. } => {
                let of = of_component("rate_ratio", contextual("meta", "sequential"));
                About { by_the_clock: true, memory: *window, ..of }
            }
            Of::Sequence { max_gap, .. } => {
                About { memory: *max_gap, ..of("sequence", contextual("content", "sequential")) }
            }
            Of::Agreement { max_age, motion_over, .. } => {
                let memory = motion_over.unwrap_or_default().max(*max_age);
                About { memory, ..of("agreement", contextual("content", "parallel")) }
            }
            Of::Constant { .. } => About { by_the_clock: true, ..of("constant", CONTENT) },
            Of::Count { .. } => About { by_the_clock: true, ..of("count", META) },
            Of::Tf { bands, .. } => {
                About { by_the_clock: true, memory: bands.longest().max(TF_MEMORY), ..of("tf", META) }
            }
            Of::Expression { max_age, class, .. } => About { memory: *max_age, ..of("expression", *class) },
        }
    }

    /// The sources whose values are judged in their own unit, with the limits of these values if there are any.
    pub fn measured(&self) -> (Vec<&ValueSource>, Option<&Bands>) {
        match self {
            MonitorSpec::Value { source, rule: ValueRule::Bands(bands), .. } => (vec![source], Some(bands)),
            MonitorSpec::Value { source, rule: ValueRule::Unless { .. }, .. } => (vec![source], None),
            MonitorSpec::Sequence { earlier: a, later: b, bands, .. }
            | MonitorSpec::Agreement { a, b, rule: AgreementRule::Number(bands), .. } => {
                (vec![a, b], Some(bands))
            }
            MonitorSpec::Agreement { .. }
            | MonitorSpec::External { .. }
            | MonitorSpec::Frequency { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Frozen { .. }
            | MonitorSpec::Tf { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::System { .. }
            | MonitorSpec::RateRatio { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. }
            | MonitorSpec::Expression { .. } => (Vec::new(), None),
        }
    }

    pub(crate) fn sources<'s>(&'s mut self) -> Vec<Source<'s>> {
        match self {
            MonitorSpec::External { .. } | MonitorSpec::Constant { .. } | MonitorSpec::Count { .. } => {
                Vec::new()
            }
            MonitorSpec::Frequency { topic, .. } | MonitorSpec::Latency { topic, .. } => {
                vec![Source::Messages(topic)]
            }
            MonitorSpec::RateRatio { input, output, .. } => {
                vec![Source::Messages(input), Source::Messages(output)]
            }
            MonitorSpec::Watchdog { watchdog, .. } | MonitorSpec::System { watchdog, .. } => {
                vec![Source::Probe(watchdog)]
            }
            MonitorSpec::Value { source, .. } | MonitorSpec::Frozen { source, .. } => {
                vec![Source::Value(source)]
            }
            MonitorSpec::Sequence { earlier: a, later: b, .. } | MonitorSpec::Agreement { a, b, .. } => {
                vec![Source::Value(a), Source::Value(b)]
            }
            MonitorSpec::Tf { links, .. } => {
                let both =
                    |link: &'s mut TfLink| [Source::Value(&mut link.moving), Source::Value(&mut link.fixed)];
                links.iter_mut().flat_map(both).collect()
            }
            MonitorSpec::Expression { inputs, .. } => {
                inputs.iter_mut().map(|(_, source)| Source::Value(source)).collect()
            }
        }
    }

    /// The statuses whose KeyValues it reads.
    pub fn keyed_statuses(&self) -> Vec<Arc<str>> {
        let status = |source| match source {
            Source::Value(ValueSource::Key { status, .. }) => Some(status.clone()),
            Source::Value(ValueSource::Field { .. }) | Source::Messages(_) | Source::Probe(_) => None,
        };
        self.clone().sources().into_iter().filter_map(status).collect()
    }

    /// The topics that it reads, each once; `None`: none.
    pub(crate) fn reads(&self, watched: &Watched) -> Option<Reads> {
        let mut bare = self.clone();
        let topic = |source| match source {
            Source::Messages(topic) | Source::Value(ValueSource::Field { topic, .. }) => Some(*topic),
            Source::Value(ValueSource::Key { .. }) | Source::Probe(_) => None,
        };
        let mut ids: Vec<TopicId> = bare.sources().into_iter().filter_map(topic).collect();
        ids.sort_unstable();
        ids.dedup();
        let topics = ids.iter().map(|&TopicId(id)| watched.topics[id as usize].topic.clone()).collect();
        let rate = match self {
            MonitorSpec::Frequency { bands, .. } => Some(*bands),
            _ => None,
        };
        (!ids.is_empty()).then_some(Reads { topics, rate })
    }

    /// Whether it judges the same sources in the same way. The indices of the sources may differ.
    pub(crate) fn means_the_same(&self, watched: &Watched, other: &MonitorSpec, others: &Watched) -> bool {
        self.meaning(watched) == other.meaning(others)
    }

    /// The monitor without indices, and the sources behind the indices.
    fn meaning<'a>(&self, watched: &'a Watched) -> (MonitorSpec, Vec<Meaning<'a>>) {
        let (mut bare, mut meaning) = (self.clone(), Vec::new());
        for source in bare.sources() {
            let (topic, field) = match source {
                Source::Messages(topic) => (topic, None),
                Source::Value(ValueSource::Field { topic, field }) => (topic, Some(field)),
                Source::Value(ValueSource::Key { .. }) => continue,
                Source::Probe(probe) => {
                    let WatchdogId(id) = std::mem::replace(probe, WatchdogId(0));
                    meaning.push(Meaning::Probe(&watched.watchdogs[id as usize]));
                    continue;
                }
            };
            let TopicId(id) = std::mem::replace(topic, TopicId(0));
            let spec = &watched.topics[id as usize];
            let field = field.map(|field| &spec.fields[std::mem::take(field) as usize]);
            meaning.push(Meaning::Topic(&spec.topic, &spec.type_name, field));
        }
        (bare, meaning)
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
