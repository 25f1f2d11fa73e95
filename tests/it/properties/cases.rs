//! Random vehicles and random histories, made from a list of numbers so that a failing case
//! shrinks to a small one.

use std::sync::Arc;

use telltale::engine::input::{
    AlarmRef, Input, NodeOf, OperatorAction, Place, StatusArray, WriterId, WriterList,
};
use telltale::engine::model::countermeasure::{Confirmation, ConfirmedBy, Request, Rule};
use telltale::engine::model::filter::Filter;
use telltale::engine::model::wording::{Advice, ByStage, Urgency, Wording};
use telltale::engine::model::{
    Combine, CountsAs, Dependency, DependsOn, Driving, Expected, FieldSource, GroupId, GroupSpec, Limits,
    Match, Model, ModuleId, ModuleMonitor, ModuleSpec, NodeId, Other, Parts, Policy, SignalSource,
    SignalSpec, Stage, StageModel, When, Within,
};
use telltale::engine::state::State;
use telltale::engine::text::Text;
use telltale::engine::time::{Span, Timestamp};

use super::monitors;

/// Decides by the given numbers; when they are used up, every choice is the first one.
pub struct Choices<'a>(std::slice::Iter<'a, u32>);

impl<'a> Choices<'a> {
    pub fn new(numbers: &'a [u32]) -> Choices<'a> {
        Choices(numbers.iter())
    }

    pub fn below(&mut self, bound: usize) -> usize {
        self.0.next().map_or(0, |&number| number as usize % bound.max(1))
    }

    pub fn one_in(&mut self, bound: usize) -> bool {
        self.below(bound) == bound - 1
    }

    pub fn is_empty(&self) -> bool {
        self.0.len() == 0
    }
}

/// Nodes that publish statuses; the last is announced late.
pub const WRITERS: [&str; 3] = ["/w1", "/w2", "/w3"];

pub const SIGNALS: [&str; 2] = ["active", "doors"];

/// A vehicle of a few groups and modules with random relations.
pub fn parts(choices: &mut Choices<'_>) -> Parts {
    let mut parts = empty(choices);
    let groups = 1 + choices.below(6);
    for index in 0..groups {
        let parent = (index > 0 && choices.one_in(3)).then(|| GroupId(choices.below(index) as u32));
        let around = parent.map_or(String::new(), |id| format!("{}/", parts.groups[id.0 as usize].path));
        parts.groups.push(GroupSpec {
            parent,
            combine: if choices.one_in(3) { Combine::Any } else { Combine::Worst },
            when: when(choices),
            filters: if choices.one_in(2) {
                let filter = Filter::Namespace(format!("/d{}", choices.below(2)).into());
                vec![Match {
                    except: choices.one_in(3).then(|| Filter::Contains("2".into())).into_iter().collect(),
                    policy: choices.one_in(2).then(|| policy(choices)),
                    ..Match::from(filter)
                }]
            } else {
                Vec::new()
            },
            may_be_empty: choices.one_in(4),
            ..GroupSpec::new(&format!("{around}g{index}"), Text::plain(&format!("G{index}")))
        });
    }
    for index in 0..choices.below(9) {
        let group = GroupId(choices.below(groups) as u32);
        let path = parts.groups[group.0 as usize].path.clone();
        parts.modules.push(ModuleSpec {
            id: format!("{path}/m{index}").into(),
            name: None,
            help: help(choices).map(Arc::new),
            group,
            policy: policy(choices),
            when: when(choices).map(Box::new),
            depends_on: Vec::new(),
            monitor: ModuleMonitor::SelfState(format!("s{}", choices.below(9)).into()),
            expected: choices.one_in(4).then(Expected::default),
        });
    }
    for _ in 0..choices.below(10) {
        add_dependency(&mut parts, choices);
    }
    for _ in 0..choices.below(4) {
        let rule = rule(&parts, choices);
        parts.driving.countermeasures.push(rule);
    }
    parts
}

fn rule(parts: &Parts, choices: &mut Choices<'_>) -> Rule {
    let stages: Vec<Stage> = Stage::ALL.into_iter().filter(|_| choices.one_in(2)).collect();
    let by = match choices.below(3) {
        0 => None,
        1 => Some(ConfirmedBy::Signal(1)),
        _ => Some(ConfirmedBy::Status(format!("s{}", choices.below(9)).into())),
    };
    Rule {
        request: match choices.below(4) {
            0 => Request::Notify,
            1 => Request::ManeuverStop,
            _ => Request::Decelerate { mps2: 1.0 + choices.below(3) as f64 },
        },
        nodes: (0..1 + choices.below(3)).map(|_| any_node(parts, choices)).collect(),
        state: [State::Error, State::Warning][choices.below(2)],
        stages: if stages.is_empty() { vec![Stage::Active] } else { stages },
        confirmation: by.map(|by| Confirmation { by, within: Span::from_millis(100) }),
    }
}

fn empty(choices: &mut Choices<'_>) -> Parts {
    let signal = |name: &str| {
        let topic = format!("/{name}").into();
        let field = FieldSource { topic, type_name: "std_msgs/msg/Bool".into(), field: "data".into() };
        SignalSpec::new(name, SignalSource::Field(field))
    };
    let stages = if choices.one_in(4) { StageModel::None } else { StageModel::Shuttle };
    Parts {
        vehicle_name: Text::plain("V"),
        signals: SIGNALS.map(signal).to_vec(),
        driving: Driving {
            localized_after: Span::from_millis(50 * choices.below(3) as u64),
            ..Driving::default()
        },
        discovered: policy(choices),
        other: Other::ALL[choices.below(3)],
        limits: Limits { discovered_modules: choices.below(5), ..Limits::default() },
        ..Parts::empty("v", stages)
    }
}

fn when(choices: &mut Choices<'_>) -> Option<When> {
    if !choices.one_in(3) {
        return None;
    }
    let mut when = When::default();
    if choices.one_in(2) {
        when.stages = Stage::ALL.into_iter().filter(|_| choices.one_in(2)).collect();
    }
    if choices.one_in(2) {
        when.signals.push((choices.below(SIGNALS.len()), choices.one_in(2)));
    }
    when.posed = choices.one_in(4).then(|| choices.one_in(2));
    Some(when)
}

fn policy(choices: &mut Choices<'_>) -> Policy {
    let mut span = |one_in: usize| {
        if choices.one_in(one_in) { Span::from_millis(choices.below(5) as u64 * 50) } else { Span::ZERO }
    };
    let (raise_after, clear_after, latch) = (span(4), span(4), span(5));
    let timeout = Span::from_millis(200 + 100 * choices.below(3) as u64);
    let later = Span::from_nanos(timeout.as_nanos() + Span::from_millis(150).as_nanos());
    Policy {
        forget_after: choices.one_in(3).then_some(later),
        timeout,
        stale: [State::Unknown, State::Warning, State::Error][choices.below(3)],
        raise_after,
        clear_after,
        latch: Some(latch).filter(|latch| !latch.is_zero()),
        no_publisher: State::Unknown,
        writers: choices.one_in(6).then(|| Arc::from([WRITERS[choices.below(2)].into()])),
        counts_as: [CountsAs::Reported, CountsAs::Reported, CountsAs::WarningOk, CountsAs::WarningError]
            [choices.below(4)],
    }
}

/// Advice that never asks for less when it gets worse; an UNKNOWN may ask for more than an ERROR.
fn help(choices: &mut Choices<'_>) -> Option<Wording<Advice>> {
    if !choices.one_in(3) {
        return None;
    }
    let mut urgency = || [None, Some(Urgency::BeReady), Some(Urgency::TakeOver)][choices.below(3)];
    let (warning, error, unknown) = (urgency(), urgency(), urgency());
    let of = |urgency| ByStage::Always(Advice { text: Text::plain("Do it."), urgency });
    Some(Wording {
        warning: of(warning),
        error: of(warning.max(error)),
        unknown: of(unknown),
        ..Wording::default()
    })
}

fn any_node(parts: &Parts, choices: &mut Choices<'_>) -> NodeId {
    let index = choices.below(parts.groups.len() + parts.modules.len());
    match index.checked_sub(parts.groups.len()) {
        Some(module) => NodeId::Module(ModuleId(module as u32)),
        None => NodeId::Group(GroupId(index as u32)),
    }
}

/// Adds a dependency, unless it would close a cycle.
fn add_dependency(parts: &mut Parts, choices: &mut Choices<'_>) {
    let from = any_node(parts, choices);
    let on = if choices.one_in(4) {
        DependsOn::AnyOf((0..1 + choices.below(3)).map(|_| any_node(parts, choices)).collect())
    } else {
        DependsOn::Node(any_node(parts, choices))
    };
    let dependency = Dependency { on, masks_unknown: choices.one_in(4), within: within(choices) };
    let list = |parts: &mut Parts| match from {
        NodeId::Group(id) => std::mem::take(&mut parts.groups[id.0 as usize].depends_on),
        NodeId::Module(id) => std::mem::take(&mut parts.modules[id.0 as usize].depends_on),
    };
    let put = |parts: &mut Parts, list: Vec<Dependency>| match from {
        NodeId::Group(id) => parts.groups[id.0 as usize].depends_on = list,
        NodeId::Module(id) => parts.modules[id.0 as usize].depends_on = list,
    };
    let mut depends_on = list(parts);
    depends_on.push(dependency);
    put(parts, depends_on.clone());
    if Model::new(parts.clone()).is_err() {
        depends_on.pop();
        put(parts, depends_on);
    }
}

/// Mostly a limit about as long as the steps of a history.
fn within(choices: &mut Choices<'_>) -> Within {
    match choices.below(6) {
        5 => Within::Always,
        length => Within::Limit(Span::from_millis([0, 50, 100, 180, 500][length])),
    }
}

pub fn model(choices: &mut Choices<'_>) -> Arc<Model> {
    model_that(choices, |_| {})
}

/// With this done to its parts.
pub fn model_that(choices: &mut Choices<'_>, change: impl FnOnce(&mut Parts)) -> Arc<Model> {
    let mut parts = parts(choices);
    monitors::watch(&mut parts, choices);
    change(&mut parts);
    Arc::new(Model::new(parts).expect("dependencies that close a cycle were left out"))
}

/// Events with their times, which never go back.
pub fn history(choices: &mut Choices<'_>) -> Vec<(Timestamp, Input)> {
    let mut inputs = Vec::new();
    let mut millis = 0;
    while !choices.is_empty() && inputs.len() < 60 {
        millis += [0, 0, 10, 50, 50, 130, 400][choices.below(7)];
        inputs.push((Timestamp::from_millis(millis), input(choices)));
    }
    inputs
}

fn input(choices: &mut Choices<'_>) -> Input {
    match choices.below(13) {
        12 => Input::Writers(Arc::new(writers(choices))),
        0 => Input::Tick,
        1 => Input::Signal { name: SIGNALS[choices.below(SIGNALS.len())].into(), value: choices.one_in(2) },
        2 => Input::Operator(action(choices)),
        8..12 => monitors::input(choices),
        _ => {
            let mut array = StatusArray::default();
            for _ in 0..1 + choices.below(4) {
                let name = match choices.below(12) {
                    known @ 0..9 => format!("s{known}"),
                    9 => format!("/d0/{}", ["x", "y"][choices.below(2)]),
                    10 => format!("/d1/{}", choices.below(4)),
                    _ => format!("stray{}", choices.below(3)),
                };
                array.push_status(choices.below(4) as u8, &name, ["", "a", "b"][choices.below(3)], "");
                if choices.one_in(2) {
                    array.push_value("k", ["0.5", "1", "2", "4", "nan"][choices.below(5)]);
                }
            }
            Input::Diagnostics(array.said_by(writer(choices.below(WRITERS.len() + 2))))
        }
    }
}

/// The id of a writer; 0 and 1 say nothing of themselves.
pub fn writer(number: usize) -> WriterId {
    let mut id = WriterId::default();
    id.0[0] = number.saturating_sub(1) as u8;
    id
}

fn writers(choices: &mut Choices<'_>) -> WriterList {
    let mut list = WriterList { complete: choices.one_in(2), ..WriterList::default() };
    for (index, name) in WRITERS.iter().enumerate() {
        let node = match choices.below(4) {
            0 => continue,
            1 => NodeOf::Pending,
            2 if index == 2 => NodeOf::Unannounced,
            _ => NodeOf::Named((*name).into()),
        };
        list.writers.insert(writer(index + 2), node);
    }
    list.as_of = Timestamp::from_millis(choices.below(40) as u64 * 50);
    list
}

fn action(choices: &mut Choices<'_>) -> OperatorAction {
    let (display_live, storage_ok) = (!choices.one_in(8), !choices.one_in(8));
    match choices.below(14) {
        0..3 => OperatorAction::Login { name: "anna".into() },
        3 => OperatorAction::Logout,
        4 => OperatorAction::Shutdown,
        5 => OperatorAction::Reset { module: format!("g0/m{}", choices.below(3)).into() },
        6 | 7 => OperatorAction::Localize {
            place: match choices.below(4) {
                0 => Place::Stop("nowhere".into()),
                far => Place::Pose { x_m: [0.0, 9e9, f64::NAN][far - 1], y_m: 1.0, yaw_deg: 90.0 },
            },
        },
        8 => OperatorAction::AskClearance { display_live, storage_ok },
        9 => OperatorAction::Clear { display_live, storage_ok },
        10 => OperatorAction::RequestStop,
        11 => OperatorAction::Withdraw,
        12 => OperatorAction::Release { display_live, storage_ok },
        _ => OperatorAction::Acknowledge {
            alarm: match choices.below(4) {
                0 => AlarmRef::Number(choices.below(4) as u64),
                1 => AlarmRef::Over { last: choices.below(6) as u64 },
                2 => AlarmRef::Node("g0".into()),
                _ => AlarmRef::Node(format!("g0/m{}", choices.below(3)).into()),
            },
        },
    }
}
