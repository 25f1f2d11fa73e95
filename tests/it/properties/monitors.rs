//! Random monitors and inputs with the expected result, computed slowly from the whole history, with no
//! state between instants. Poses and motions have no second implementation here; they are only compared
//! between batchings and over a reload.

use std::sync::Arc;

use telltale::engine::input::Input;
use telltale::engine::model::monitors::{
    AgreementRule, Bands, Class, Condition, FieldKind, FieldSpec, FrozenLimits, ProbeTarget, TfLink, TopicId,
    TopicSpec, ValueRule, ValueSource, WatchdogId, WatchdogSpec, Watched,
};
use telltale::engine::model::motion::{SpeedSource, WatchedField};
use telltale::engine::model::sample::{
    FieldValue, Fingerprint, Pose, Position, Positions, Probe, ProbeOutcome, PublisherReport, Sample,
    Transform,
};
use telltale::engine::model::{Model, ModuleId, MonitorSpec, Parts};
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

use super::cases::Choices;

const TOPICS: usize = 3;

fn topic(index: usize) -> Arc<TopicSpec> {
    Arc::new(TopicSpec {
        topic: format!("/t{index}").into(),
        type_name: "test/msg/Both".into(),
        stamp: true,
        fields: vec![
            FieldSpec::new("x", FieldKind::Scalar),
            FieldSpec::new("pose", FieldKind::Pose),
            FieldSpec::new("objects", FieldKind::Positions),
            FieldSpec::new("", FieldKind::Content),
            FieldSpec::transforms_of("c"),
        ],
    })
}

fn watchdog() -> Arc<WatchdogSpec> {
    let target = ProbeTarget::Icmp { host: "lidar".into() };
    Arc::new(WatchdogSpec { target, every: Span::from_millis(100) })
}

/// Gives some modules a monitor instead of a status.
pub fn watch(parts: &mut Parts, choices: &mut Choices<'_>) {
    parts.watched = Watched {
        topics: (0..TOPICS).map(topic).collect(),
        watchdogs: vec![watchdog()],
        ..Watched::default()
    };
    let value = WatchedField { topic: TopicId(0), field: 0 };
    let timeout = Span::from_millis(300);
    parts.driving.speed = Some(SpeedSource { value, timeout, standing_below_mps: 1.0 });
    for module in &mut parts.modules {
        if choices.one_in(2) {
            module.monitor = monitor(choices).into();
        }
        if choices.one_in(3) {
            module.policy.no_publisher = State::Error;
        }
    }
}

fn monitor(choices: &mut Choices<'_>) -> MonitorSpec {
    let window = Span::from_millis(100 + 100 * choices.below(4) as u64);
    let any_topic = |choices: &mut Choices<'_>| TopicId(choices.below(TOPICS) as u32);
    let number = |choices: &mut Choices<'_>| match choices.below(4) {
        3 => {
            ValueSource::Key { status: format!("s{}", choices.below(9)).into(), key: "k".into(), unit: None }
        }
        topic => ValueSource::Field { topic: TopicId(topic as u32), field: 0 },
    };
    match choices.below(10) {
        9 => {
            let source =
                |choices: &mut Choices<'_>| ValueSource::Field { topic: any_topic(choices), field: 4 };
            let (moving, fixed) = (source(choices), source(choices));
            let links = vec![TfLink { parent: "p".into(), child: "c".into(), moving, fixed }];
            let above = Bands { warning_below: None, error_below: None, ..bands(choices, 0.1) };
            MonitorSpec::Tf { links, bands: above }
        }
        0 => MonitorSpec::Frequency { topic: any_topic(choices), window, bands: bands(choices, 10.0) },
        1 => MonitorSpec::Latency { topic: any_topic(choices), window, bands: bands(choices, 0.1) },
        2 => match (number(choices), bands(choices, 1.0)) {
            (source, bands) if bands.warning_below.is_some() && bands.error_below.is_some() => {
                let above = Bands { warning_below: None, error_below: None, ..bands };
                let repeats = Bands { error_above: bands.error_below, ..Bands::default() };
                let source = match source {
                    ValueSource::Field { topic, .. } => ValueSource::Field { topic, field: 3 },
                    key => key,
                };
                MonitorSpec::Frozen { source, limits: FrozenLimits { time: above, repeats } }
            }
            (source, bands) => MonitorSpec::Value { source, rule: ValueRule::Bands(bands), empty: None },
        },
        3 => MonitorSpec::Watchdog {
            watchdog: WatchdogId(0),
            misses: choices.below(3) as u32,
            bands: bands(choices, 0.01),
        },
        4 => MonitorSpec::RateRatio {
            input: any_topic(choices),
            output: any_topic(choices),
            window,
            bands: bands(choices, 0.5),
        },
        5 => MonitorSpec::Sequence {
            earlier: number(choices),
            later: number(choices),
            max_gap: window,
            bands: bands(choices, 1.0),
        },
        6 if choices.one_in(2) => {
            let pose = |choices: &mut Choices<'_>| ValueSource::Field { topic: any_topic(choices), field: 1 };
            let rule =
                AgreementRule::Pose { translation: bands(choices, 1.0), rotation_deg: bands(choices, 30.0) };
            let motion_over = choices.one_in(2).then_some(window);
            MonitorSpec::Agreement { a: pose(choices), b: pose(choices), max_age: window, motion_over, rule }
        }
        6 => MonitorSpec::Agreement {
            a: number(choices),
            b: number(choices),
            max_age: window,
            motion_over: None,
            rule: AgreementRule::Number(bands(choices, 1.0)),
        },
        7 => {
            let list = |choices: &mut Choices<'_>| ValueSource::Field { topic: any_topic(choices), field: 2 };
            let rule = AgreementRule::Positions { count: bands(choices, 1.0), nearest: bands(choices, 1.0) };
            let (a, b) = (list(choices), list(choices));
            MonitorSpec::Agreement { a, b, max_age: window, motion_over: None, rule }
        }
        _ => MonitorSpec::Expression {
            inputs: vec![("x".into(), number(choices)), ("y".into(), number(choices))],
            max_age: window,
            warning: Some(sum_above(1.0)),
            error: choices.one_in(2).then(|| sum_above(3.0)),
            class: Class { location: "contextual", information: "content", flow: None },
        },
    }
}

fn sum_above(limit: f64) -> Condition {
    Condition::new(&format!("x + y > {limit}"), move |values| match values {
        [FieldValue::Number(x), FieldValue::Number(y)] => Ok(x + y > limit),
        _ => Err("no such overload".into()),
    })
}

fn bands(choices: &mut Choices<'_>, scale: f64) -> Bands {
    let mut limit = || choices.one_in(2).then(|| scale * choices.below(4) as f64);
    Bands {
        warning_below: limit(),
        error_below: limit(),
        warning_above: limit(),
        error_above: limit(),
        unmeasurable: None,
    }
}

/// Something that a monitor may look at, now and then of another configuration.
pub fn input(choices: &mut Choices<'_>) -> Input {
    let source = topic(choices.below(TOPICS));
    match choices.below(10) {
        0 => Input::Topic(PublisherReport {
            source,
            publishers: choices.below(2) as u32,
            other_type: choices.one_in(4).then(|| "other/msg/Type".into()),
            transient_local: choices.one_in(2),
            best_effort: choices.one_in(4),
            anew: choices.one_in(8),
        }),
        1 => Input::Probe(Probe {
            source: watchdog(),
            outcome: match choices.below(3) {
                0 => ProbeOutcome::Answered { after: Span::from_millis(choices.below(20) as u64) },
                1 => ProbeOutcome::Missed("refused".into()),
                _ => ProbeOutcome::Impossible("no permission".into()),
            },
        }),
        2 => Input::Sample(Sample::of(source, [].into())),
        _ => {
            let wall = 1_000_000_000_000_000_000;
            let age_ms = [0, 50, 100, 150, 200, 300, -60, 4_000_000][choices.below(8)];
            let number = FieldValue::Number([0.0, 0.5, 1.0, 2.0, 4.0, f64::NAN][choices.below(6)]);
            let content = match age_ms {
                -60 => FieldValue::Unreadable("the message ends early".into()),
                age_ms => FieldValue::Content(Fingerprint(u64::from(age_ms > 100))),
            };
            let values = [number, pose(choices), positions(choices), content, transforms(choices, wall)];
            let stamp_ns = (!choices.one_in(8)).then_some(wall - age_ms * 1_000_000);
            let values = values.into();
            Input::Sample(Sample { stamp_ns, received_wall_ns: wall, ..Sample::of(source, values) })
        }
    }
}

fn pose(choices: &mut Choices<'_>) -> FieldValue {
    if choices.one_in(6) {
        return FieldValue::Unreadable("the message ends early".into());
    }
    let half = (choices.below(4) as f64 * 20.0).to_radians() / 2.0;
    let x_m = choices.below(4) as f64;
    FieldValue::Pose(Pose { x_m, qz: half.sin(), qw: half.cos(), ..Pose::default() })
}

fn transforms(choices: &mut Choices<'_>, wall: i64) -> FieldValue {
    let parents: &[&str] = match choices.below(6) {
        0 => return FieldValue::Absent,
        1 => &["q"],
        2 => &["p", "q"],
        _ => &["p"],
    };
    let stamp_ns = (!choices.one_in(8)).then(|| wall - 50_000_000 * choices.below(4) as i64);
    let of = |parent: &&str| Transform { parent: (*parent).into(), stamp_ns };
    FieldValue::Transforms(parents.iter().map(of).collect())
}

fn positions(choices: &mut Choices<'_>) -> FieldValue {
    let taken: Box<[Position]> = (0..choices.below(3))
        .map(|_| Position { x_m: [0.0, 1.0, 3.0, f64::NAN][choices.below(4)], y_m: 0.0 })
        .collect();
    let more = if choices.one_in(6) { 300 } else { 0 };
    FieldValue::Positions(Arc::new(Positions { count: taken.len() as u32 + more, taken }))
}

/// When a module became relevant, and how much had been received by then.
#[derive(Debug, Clone, Copy)]
pub struct Since {
    pub at: Timestamp,
    pub inputs: usize,
}

/// The window of a module's monitor.
#[derive(Debug, Clone, Copy, Default)]
pub struct Window {
    /// Its present beginning, while the module is relevant.
    pub since: Option<Since>,
    /// How much had been received when it began last.
    pub last_begin: usize,
    /// While the module is blocked: since when, and whether it was well at that instant.
    pub blocked: Option<(Timestamp, bool)>,
    /// It recovered and was well: from then on nothing before makes it worse than this, for one window.
    pub recovery: Option<(Since, State)>,
}

/// All received messages with their times.
pub struct History<'a> {
    pub model: &'a Model,
    pub seen: &'a [(Timestamp, Input)],
    pub now: Timestamp,
}

impl History<'_> {
    /// What a module's monitor says now, if there is a second opinion.
    pub fn verdict(&self, id: ModuleId, of_module: &mut Window) -> Option<Option<State>> {
        if let Some((since, best)) = of_module.recovery
            && let Some(span) = self.window_of(id)
        {
            let judged = self.rate(id, of_module.since);
            if self.now >= since.at + span {
                of_module.recovery = None;
            } else if judged.is_some_and(|state| state > best) {
                (of_module.since, of_module.recovery) = (Some(since), None);
            }
        }
        let since = of_module.since;
        let spec = &self.model.modules[id.0 as usize];
        let no_publisher = spec.policy.no_publisher;
        let blind = |topics: &[TopicId]| {
            let all = topics.iter().filter_map(|&topic| self.news(topic)).filter(|news| news.publishers == 0);
            let all: Vec<bool> = all.map(|news| news.other_type.is_some()).collect();
            if all.contains(&true) { Some(State::Unknown) } else { all.first().map(|_| no_publisher) }
        };
        // Nothing is over because nobody can say so any more.
        let beside = |topics: &[TopicId], judged: Option<State>| match blind(topics) {
            Some(blind) => judged.max(Some(blind)),
            None if topics.iter().any(|&topic| self.is_speechless(topic)) => {
                judged.map(|state| state.max(State::Unknown))
            }
            None => judged,
        };
        // By the clock, a publisher is missing until it is found.
        let by_the_clock = |topics: &[TopicId]| {
            let unheard =
                |&topic: &TopicId| self.news(topic).is_none() && self.samples(topic).next().is_none();
            blind(topics).or_else(|| topics.iter().any(unheard).then_some(no_publisher)).unwrap_or(State::Ok)
        };
        let state = match spec.monitor.other()? {
            MonitorSpec::Frequency { topic, window, bands } => {
                let blind = by_the_clock(&[*topic]);
                let wrong_type = self.wrong_type(*topic);
                // The bands judge 0 Hz where nobody is.
                let beside =
                    |state: State| if wrong_type || state == State::Ok { state.max(blind) } else { state };
                self.frequency(*topic, *window, bands, since).map(beside)
            }
            MonitorSpec::RateRatio { input, output, window, bands } => {
                let blind = by_the_clock(&[*input, *output]);
                self.rate_ratio(*input, *output, *window, bands, since).map(|state| state.max(blind))
            }
            MonitorSpec::Latency { topic, window, bands } => {
                let later = History { seen: &self.seen[of_module.last_begin..], ..*self };
                beside(&[*topic], later.latency(*topic, *window, bands))
            }
            MonitorSpec::Value { source, rule: ValueRule::Bands(bands), .. } => {
                let value =
                    self.last(source).map(|(_, value)| value.map_or(State::Unknown, |it| judge(bands, it)));
                beside(&topics(&[source]), value)
            }
            MonitorSpec::Agreement { a, b, max_age, rule: AgreementRule::Number(bands), .. } => {
                let both = self.young(&[a, b], *max_age, |it| judge(bands, (it[0] - it[1]).abs()));
                beside(&topics(&[a, b]), both)
            }
            MonitorSpec::Expression { inputs, max_age, error, .. } => {
                let sources: Vec<&ValueSource> = inputs.iter().map(|(_, source)| source).collect();
                let holds = |values: &[f64]| match values[0] + values[1] {
                    sum if sum > 3.0 && error.is_some() => State::Error,
                    sum if sum > 1.0 => State::Warning,
                    _ => State::Ok,
                };
                beside(&topics(&sources), self.young(&sources, *max_age, holds))
            }
            _ => return None,
        };
        Some(state)
    }

    fn window_of(&self, id: ModuleId) -> Option<Span> {
        match self.model.modules[id.0 as usize].monitor.other()? {
            MonitorSpec::Frequency { window, .. } | MonitorSpec::RateRatio { window, .. } => Some(*window),
            _ => None,
        }
    }

    /// What the messages alone say of a rate.
    pub fn rate(&self, id: ModuleId, since: Option<Since>) -> Option<State> {
        match self.model.modules[id.0 as usize].monitor.other()? {
            MonitorSpec::Frequency { topic, window, bands } => self.frequency(*topic, *window, bands, since),
            MonitorSpec::RateRatio { input, output, window, bands } => {
                self.rate_ratio(*input, *output, *window, bands, since)
            }
            _ => None,
        }
    }

    fn frequency(&self, topic: TopicId, window: Span, bands: &Bands, since: Option<Since>) -> Option<State> {
        let since = since?;
        let rate = self.count(topic, window, since) as f64 * 1e9 / window.as_nanos() as f64;
        if self.now >= since.at + window {
            return Some(judge(bands, rate));
        }
        let above = Bands { warning_below: None, error_below: None, ..*bands };
        Some(judge(&above, rate)).filter(|&state| state != State::Ok)
    }

    fn rate_ratio(
        &self,
        input: TopicId,
        output: TopicId,
        window: Span,
        bands: &Bands,
        since: Option<Since>,
    ) -> Option<State> {
        let since = since.filter(|&since| self.now >= since.at + window)?;
        let (inputs, outputs) = (self.count(input, window, since), self.count(output, window, since));
        Some(if inputs == 0 { State::Unknown } else { judge(bands, outputs as f64 / inputs as f64) })
    }

    /// The last message, if the window is empty.
    fn latency(&self, topic: TopicId, window: Span, bands: &Bands) -> Option<State> {
        let last = self.samples(topic).last()?.0;
        let at = self.now.min(Timestamp::from_nanos((last + window).as_nanos() - 1));
        let judged =
            self.samples(topic).filter(|(received, _)| *received + window > at).map(|(_, sample)| {
                let age = sample.stamp_ns.map(|stamp| sample.received_wall_ns - stamp);
                match age {
                    Some(age @ 0..3_600_000_000_001) => judge(bands, age as f64 / 1e9),
                    _ => State::Unknown,
                }
            });
        judged.max()
    }

    /// All values; UNKNOWN unless each is there, young enough and finite.
    fn young(
        &self,
        sources: &[&ValueSource],
        max_age: Span,
        then: impl Fn(&[f64]) -> State,
    ) -> Option<State> {
        let all: Vec<_> = sources.iter().map(|source| self.last(source)).collect();
        all.iter().any(Option::is_some).then(|| {
            let young = |(received, value): (Timestamp, Option<f64>)| {
                value.filter(|value| value.is_finite() && self.now.since(received) <= max_age)
            };
            let values: Option<Vec<f64>> = all.into_iter().map(|last| last.and_then(young)).collect();
            values.map_or(State::Unknown, |values| then(&values))
        })
    }

    fn last(&self, source: &ValueSource) -> Option<(Timestamp, Option<f64>)> {
        match source {
            ValueSource::Field { topic, field } => {
                let (at, sample) = self.samples(*topic).last()?;
                let FieldValue::Number(number) = sample.values[*field as usize] else {
                    return Some((at, None));
                };
                Some((at, Some(number)))
            }
            ValueSource::Key { status, key, .. } => self.seen.iter().rev().find_map(|(at, input)| {
                let Input::Diagnostics(array) = input else { return None };
                let mut named: Vec<_> = array.iter().filter(|it| it.name() == &**status).collect();
                named.sort_by_key(|it| std::cmp::Reverse(it.state()));
                let said = named.first()?;
                if said.state() == State::Unknown {
                    return Some((*at, None));
                }
                let mut values = said.values();
                let text = values.find(|(known, _)| *known == &**key).map(|(_, text)| text);
                Some((*at, text.map(|text| text.parse().expect("only numbers are said"))))
            }),
        }
    }

    fn samples(&self, topic: TopicId) -> impl Iterator<Item = (Timestamp, &Sample)> {
        let spec = &self.model.watched.topics[topic.0 as usize];
        self.seen.iter().filter_map(move |(at, input)| match input {
            Input::Sample(sample)
                if sample.source == *spec && sample.values.len() == sample.source.fields.len() =>
            {
                Some((*at, sample))
            }
            _ => None,
        })
    }

    fn count(&self, topic: TopicId, window: Span, since: Since) -> usize {
        let later = History { seen: &self.seen[since.inputs..], ..*self };
        later.samples(topic).filter(|(at, _)| *at + window > self.now).count()
    }

    fn news(&self, topic: TopicId) -> Option<&PublisherReport> {
        let spec = &self.model.watched.topics[topic.0 as usize];
        self.seen.iter().rev().find_map(|(_, input)| match input {
            Input::Topic(news) if news.source == *spec => Some(news),
            _ => None,
        })
    }

    /// Its publishers left, and since they are there again nothing came.
    fn is_speechless(&self, topic: TopicId) -> bool {
        let spec = &self.model.watched.topics[topic.0 as usize];
        let said = self.seen.iter().rev().find_map(|(_, input)| match input {
            Input::Sample(sample)
                if sample.source == *spec && sample.values.len() == sample.source.fields.len() =>
            {
                Some(false)
            }
            Input::Topic(news) if news.source == *spec && news.publishers == 0 => Some(true),
            _ => None,
        });
        said == Some(true)
    }

    fn wrong_type(&self, topic: TopicId) -> bool {
        self.news(topic).is_some_and(|news| news.publishers == 0 && news.other_type.is_some())
    }
}

fn topics(sources: &[&ValueSource]) -> Vec<TopicId> {
    let topic = |source: &&ValueSource| match source {
        ValueSource::Field { topic, .. } => Some(*topic),
        ValueSource::Key { .. } => None,
    };
    sources.iter().filter_map(topic).collect()
}

fn judge(bands: &Bands, value: f64) -> State {
    let beyond = |below: Option<f64>, above: Option<f64>| {
        below.is_some_and(|limit| value < limit) || above.is_some_and(|limit| value > limit)
    };
    if !value.is_finite() {
        State::Unknown
    } else if beyond(bands.error_below, bands.error_above) {
        State::Error
    } else if beyond(bands.warning_below, bands.warning_above) {
        State::Warning
    } else {
        State::Ok
    }
}
