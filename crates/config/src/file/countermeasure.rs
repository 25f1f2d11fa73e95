//! Countermeasures in the file: the request, when it is made, and how it is confirmed.

use super::forms::{self, default_span};
use crate::decode::{All, FromNode, Spanned};
use crate::fields::Fields;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::{MPS2, MPS2_MAX, MPS2_MIN, Request, RequestKind};
use telltale_engine::state::State;
use telltale_engine::time;
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::schema::{default, least, most, needs_one, not_empty, words};
use telltale_yaml::{Log, Node, Problem, Span, key, map};

const WITHIN: time::Span = time::Span::from_secs(1);
const WITHIN_MAX: time::Span = time::Span::from_secs(60);

#[derive(Debug)]
pub(crate) struct RawRule {
    pub request: Option<Request>,
    pub when: Option<RawWhen>,
    pub confirmation: Option<(RawConfirmedBy, time::Span)>,
}

#[derive(Debug)]
pub(crate) struct RawWhen {
    pub span: Span,
    pub groups: Vec<Spanned<String>>,
    pub modules: Vec<Spanned<String>>,
    pub state: Option<State>,
    pub stages: Vec<Stage>,
}

#[derive(Debug)]
pub(crate) enum RawConfirmedBy {
    Signal(Spanned<String>),
    Status(String),
}

impl FromNode for RawRule {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("countermeasure", "a countermeasure")
            .about("When one of the nodes shows the state in one of the stages, the request is made.")
            .rules(|| vec![("required", vec!["request", "when"].into())]);
        let mut fields = Fields::of(node, doc, log)?;
        let kind = fields.node(key("request").form(|_| words(RequestKind::ALL.map(RequestKind::as_str))));
        fields.needs("request", "`request: decelerate`, `maneuver_stop` or `notify`");
        let mps2: Option<Spanned<f64>> = fields.optional(
            key("mps2")
                .about("Strength of a deceleration in m/s².")
                .rules(|| vec![least(MPS2_MIN), most(MPS2_MAX), default(MPS2)]),
        );
        let request = kind.and_then(|node| request(node, mps2, fields.log));
        let when = fields.required("when");
        let by =
            fields.optional(key("confirmed_by").about("How the vehicle says that it does what was asked."));
        let within: Option<Spanned<time::Span>> = fields.optional(
            key("within")
                .about("Later than this after the request it counts as not confirmed; up to 1m.")
                .rules(|| vec![default_span(WITHIN)]),
        );
        if let Some(within) = within {
            if within.value.is_zero() || within.value > WITHIN_MAX {
                let problem = Problem::at(within.span, "`within` is not between 0 and 1m");
                fields.log.push(problem.help("for example `1s`"));
            }
            if fields.key_span("confirmed_by").is_none() {
                let problem = Problem::at(within.span, "`within` without `confirmed_by`");
                fields.log.push(problem.help("add `confirmed_by: { signal: NAME }`, or remove `within`"));
            }
        }
        if let (Some(Request::Notify), Some(span)) = (request, fields.key_span("confirmed_by")) {
            let problem = Problem::at(span, "a notice is shown here; nobody else has to confirm it");
            fields.log.push(problem.help("remove `confirmed_by`"));
        }
        let within = within.map_or(WITHIN, |within| within.value);
        Some(RawRule { request, when, confirmation: by.map(|by| (by, within)) })
    }
}

fn request(node: &Node, mps2: Option<Spanned<f64>>, log: &mut Log) -> Option<Request> {
    if scalar(node) == Some("record") {
        let problem =
            Problem::at(node.span, "a countermeasure asks the vehicle or the operator; recording is neither");
        log.push(problem.help("remove this countermeasure"));
        return None;
    }
    let strength = mps2.map_or(MPS2, |mps2| mps2.value);
    let choices = [
        ("decelerate", Request::Decelerate { mps2: strength }),
        ("maneuver_stop", Request::ManeuverStop),
        ("notify", Request::Notify),
    ];
    let request = word(node, log, "request", &choices)?;
    match (request, mps2) {
        (Request::Decelerate { .. }, Some(mps2)) if !(MPS2_MIN..=MPS2_MAX).contains(&mps2.value) => {
            let problem = Problem::at(
                mps2.span,
                format!("{} m/s² is not between {MPS2_MIN} and {MPS2_MAX}", mps2.value),
            );
            log.push(problem.help(format!("the default is {MPS2}")));
        }
        (Request::ManeuverStop | Request::Notify, Some(mps2)) => {
            let problem = Problem::at(mps2.span, "only `decelerate` has a strength");
            log.push(problem.help("remove `mps2`"));
        }
        _ => {}
    }
    Some(request)
}

impl FromNode for RawWhen {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc =
            map("rule_when", "the `when` of a countermeasure").about("Groups or modules, one at least.");
        let mut fields = Fields::of(node, doc, log)?;
        let mut names = |name| match fields.optional::<All<_>>(key(name).form(forms::nodes)) {
            Some(All(names)) => Some(names),
            // A list that cannot be read is not an empty list; the log has the reason.
            None => fields.key_span(name).is_none().then(Vec::new),
        };
        let (groups, modules) = (names("groups"), names("modules"));
        let states = [State::Warning, State::Unknown, State::Error].map(|state| (state.as_str(), state));
        let state = key("state").about(
            "This state or a worse one: `warning` < `unknown` < `error`. `error` by default; `warning` for `notify`.",
        );
        let state = fields.choice(state, "state", &states);
        let stages = key("stages").rules(|| {
            let default = default(vec![Stage::Active.as_str()]);
            not_empty().into_iter().chain([default]).collect()
        });
        let stages: Option<Spanned<All<Stage>>> = fields.optional(stages);
        if let Some(empty) = stages.as_ref().filter(|stages| stages.value.0.is_empty()) {
            let problem = Problem::at(empty.span, "without a stage this would never be asked for");
            fields.log.push(problem.help("name the stages, or remove `stages`: then it is `[active]`"));
        }
        let stages = stages.map_or_else(|| vec![Stage::Active], |stages| stages.value.0);
        Some(RawWhen { span: node.span, groups: groups?, modules: modules?, state, stages })
    }
}

impl FromNode for RawConfirmedBy {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc =
            map("confirmation", "a confirmation").rules(|| vec![needs_one(&[&["signal"], &["status"]])]);
        let mut fields = Fields::of(node, doc, log)?;
        let signal = fields.optional(key("signal").about("The signal that is true then."));
        let status = fields.optional(key("status").about("The status that is OK then."));
        if fields.key_span("signal").is_some() == fields.key_span("status").is_some() {
            let problem = Problem::at(node.span, "a confirmation needs either `signal` or `status`");
            fields.log.push(problem.help("for example `confirmed_by: { signal: braking }`"));
        }
        signal.map(RawConfirmedBy::Signal).or(status.map(RawConfirmedBy::Status))
    }
}
