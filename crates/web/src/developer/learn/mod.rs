//! The page of learned dependencies: what the history proposes, each with its evidence, and the patch for the
//! configuration. Nothing of it is in force by itself.

mod run;

use std::collections::BTreeSet;

use askama::Template;
use axum::extract::State;
use axum::response::{Html, IntoResponse as _, Redirect, Response};

pub use self::run::{Learned, Learner, Learning, NotLearned, Outcome, Patched, Progress};
use super::page_query::address;
use super::request::PageRequest;
use super::{DevFrame, NodeLink, Page, why_address};
use crate::incidents::wall_time;
use crate::texts::{HttpError, Lang, LearnWords, MESSAGE, NAME, clean, clean_lines};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use crate::{AppState, unlocked};
use telltale_engine::model::{DependsOn, Model, ModuleId, NodeId};
use telltale_learn::{Direction, Doubt, EPISODES, Edge, Episodes, Silence, modules_of};
use telltale_record::summary::Summary;
use telltale_runtime::Published;
use telltale_store::Role;

const PATH: &str = "/developer/learn";
/// The page asks again until the history is evaluated.
const RENEW_MS: u32 = 500;
/// Proposals of each kind.
const PROPOSALS: usize = 60;
/// Modules that are named of one.
const MODULES: usize = 12;
/// Instants of each kind of one proposal.
const INSTANTS: usize = 6;
/// Around such an instant, in seconds.
const SPAN_S: i64 = 120;
/// A smaller probability is not told exactly.
const P_LEAST: f64 = 1e-9;

/// When a cause failed.
struct Instant {
    at: String,
    timeline: String,
    incident: Option<u64>,
}

struct Instants {
    all: Vec<Instant>,
    more: usize,
}

/// What the past says of one cause.
struct EvidenceRow {
    sentence: String,
    chance: String,
    noticed: String,
    why: String,
    /// For and against it, each with its word.
    instants: [(&'static str, Instants); 2],
}

struct Proposal {
    kind: &'static str,
    word: &'static str,
    node: NodeLink,
    on: Vec<NodeLink>,
    /// The rest of a narrowed dependency.
    remains: Vec<NodeLink>,
    evidence: Vec<EvidenceRow>,
    more: usize,
}

/// A module that is silent in some states.
struct SilenceHtml {
    module: NodeLink,
    when: String,
    /// Each value with its sentence and its counterexamples.
    values: Vec<(String, String, Instants)>,
}

struct PatchHtml {
    patch: String,
    left: Vec<String>,
    warnings: Option<String>,
    problems: Option<String>,
    /// The address of a what-if with it.
    what_if: Option<String>,
}

struct Shown {
    at: String,
    /// The configuration is another one now.
    is_old: bool,
    /// Why nothing is learned.
    trouble: String,
    summary: String,
    proposals: Vec<Proposal>,
    more: usize,
    undecided: Vec<(NodeLink, NodeLink)>,
    more_undecided: usize,
    silences: Vec<SilenceHtml>,
    more_silences: usize,
    /// The graph has something to show.
    has_edges: bool,
    patch: Option<PatchHtml>,
}

#[derive(Template)]
#[template(path = "developer/learn.html")]
struct LearnHtml {
    frame: PageFrame,
    dev: DevFrame,
    it: &'static LearnWords,
    may_run: bool,
    /// There is a history and a configuration.
    is_there: bool,
    is_running: bool,
    shown: Option<Shown>,
}

/// `GET /developer/learn`; with `run=yes` a developer has the history evaluated.
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Result<Response, HttpError> {
    let may_run = request.session.role == Role::Developer;
    if may_run && request.query.get("run") == "yes" {
        unlocked(&request.published)?;
        run::start(&app).await?;
        return Ok(Redirect::to(PATH).into_response());
    }
    let running = run::running(&app);
    let Progress { is_running, last } = app.learning.progress();
    let is_old = |it: &Outcome| running.as_ref().is_none_or(|running| *running != it.texts);
    let now = Now {
        is_there: app.settings.learner.is_some() && app.settings.history.is_some() && running.is_some(),
        is_running,
        last: last.as_deref().map(|it| (it, is_old(it))),
    };
    Ok(Html(page(&request.published, &request.context, may_run, &now)).into_response())
}

/// What there is to show.
#[derive(Debug, Default)]
pub struct Now<'a> {
    pub is_there: bool,
    pub is_running: bool,
    /// The last evaluation, and whether it is for another configuration.
    pub last: Option<(&'a Outcome, bool)>,
}

pub fn page(published: &Published, context: &PageContext, may_run: bool, now: &Now<'_>) -> String {
    let view = &View::new(published, context.lang, false);
    let it = LearnWords::of(context.lang);
    let mut dev = DevFrame::new(view, context, Page::Learn, RENEW_MS);
    dev.fixed = !now.is_running;
    let shown = now.last.filter(|_| !now.is_running);
    html(&LearnHtml {
        frame: super::frame(context),
        dev,
        it,
        may_run,
        is_there: now.is_there,
        is_running: now.is_running,
        shown: shown.map(|(outcome, is_old)| shown_of(context.lang, outcome, is_old, may_run)),
    })
}

fn shown_of(lang: Lang, outcome: &Outcome, is_old: bool, may_run: bool) -> Shown {
    let it = LearnWords::of(lang);
    let mut shown = Shown {
        at: wall_time(outcome.at_ms),
        is_old,
        trouble: String::new(),
        summary: String::new(),
        proposals: Vec::new(),
        more: 0,
        undecided: Vec::new(),
        more_undecided: 0,
        silences: Vec::new(),
        more_silences: 0,
        has_edges: false,
        patch: None,
    };
    let learned = match &outcome.result {
        Ok(learned) => learned,
        Err(why) => {
            shown.trouble = match why {
                NotLearned::Nothing => it.nothing.to_owned(),
                NotLearned::TooMuch => it.too_much.to_owned(),
                NotLearned::Bad(why) => format!("{}: {}", it.failed, clean(why, 4 * MESSAGE)),
            };
            return shown;
        }
    };
    let found = &learned.proposals;
    let writer = Writer { lang, model: &learned.model, incidents: &outcome.incidents };
    shown.summary = lang.learned_in_all(found.learned.len(), learned.failed, learned.model.modules.len());
    let add = found.add.iter().take(PROPOSALS).map(|index| writer.added(&found.learned[*index]));
    let doubted = found.doubted.iter().take(PROPOSALS).map(|it| writer.doubted(it));
    shown.proposals = add.chain(doubted).collect();
    shown.more = found.add.len() + found.doubted.len() - shown.proposals.len();
    let pair = |(one, other): &(ModuleId, ModuleId)| (writer.module(*one), writer.module(*other));
    shown.undecided = found.undecided.iter().take(PROPOSALS).map(pair).collect();
    shown.more_undecided = found.undecided.len() - shown.undecided.len();
    shown.silences = found.silences.iter().take(PROPOSALS).map(|it| writer.silence(it)).collect();
    shown.more_silences = found.silences.len() - shown.silences.len();
    shown.has_edges = !found.add.is_empty();
    let tried = tried(&shown.proposals, &outcome.incidents);
    shown.patch = learned.patched.as_ref().map(|patched| PatchHtml {
        patch: clean_lines(&patched.patch),
        left: patched.left.iter().map(|name| clean(name, 2 * NAME)).collect(),
        warnings: patched.checked.as_ref().ok().and_then(Option::as_deref).map(clean_lines),
        problems: patched.checked.as_ref().err().map(|text| clean_lines(text)),
        what_if: tried
            .filter(|_| may_run && !patched.patch.is_empty())
            .map(|id| format!("/incidents/{id}/what-if?from=proposed")),
    });
    shown
}

/// The newest incident that can be run and that a proposal names; else the newest one.
fn tried(proposals: &[Proposal], incidents: &[Summary]) -> Option<u64> {
    let instants = proposals.iter().flat_map(|it| &it.evidence).flat_map(|it| &it.instants);
    let named: BTreeSet<u64> =
        instants.flat_map(|(_, it)| &it.all).filter_map(|instant| instant.incident).collect();
    let runs = || incidents.iter().filter(|it| it.recording.finished && !it.recording.gone).map(|it| it.id);
    runs().find(|id| named.contains(id)).or_else(|| runs().next())
}

struct Writer<'a> {
    lang: Lang,
    model: &'a Model,
    incidents: &'a [Summary],
}

impl Writer<'_> {
    fn node(&self, node: NodeId) -> NodeLink {
        let name = self.model.node_name(node);
        NodeLink { name: clean(name, 2 * NAME), address: why_address(name) }
    }

    fn module(&self, id: ModuleId) -> NodeLink {
        self.node(NodeId::Module(id))
    }

    fn added(&self, edge: &Edge) -> Proposal {
        let words = LearnWords::of(self.lang);
        Proposal {
            kind: "add",
            word: words.add,
            node: self.module(edge.dependent),
            on: vec![self.module(edge.cause)],
            remains: Vec::new(),
            evidence: vec![self.evidence(edge, 1)],
            more: 0,
        }
    }

    fn doubted(&self, doubt: &Doubt) -> Proposal {
        let words = LearnWords::of(self.lang);
        let all = match doubt.node {
            NodeId::Group(id) => &self.model.groups[id.0 as usize].depends_on,
            NodeId::Module(id) => &self.model.modules[id.0 as usize].depends_on,
        };
        let on = all.get(doubt.index).map_or(&[][..], |it| DependsOn::nodes(&it.on));
        let (kind, word) = match doubt.remains[..] {
            [] => ("remove", words.remove),
            _ => ("narrow", words.narrow),
        };
        let dependents = modules_of(self.model, doubt.node).len();
        Proposal {
            kind,
            word,
            node: self.node(doubt.node),
            on: on.iter().map(|it| self.node(*it)).collect(),
            remains: doubt.remains.iter().map(|it| self.module(*it)).collect(),
            evidence: doubt.edges.iter().take(MODULES).map(|edge| self.evidence(edge, dependents)).collect(),
            more: doubt.edges.len().saturating_sub(MODULES),
        }
    }

    fn silence(&self, silence: &Silence) -> SilenceHtml {
        let name = self.model.node_name(NodeId::Module(silence.module));
        let known = silence.episodes.iter().enumerate().filter(|(_, it)| it.count() >= EPISODES);
        let of_value = |(value, it): (usize, &Episodes)| {
            let (low, high) = it.silent_share();
            let [low, high] = [low, high].map(|share| format!("{:.0}", share * 100.0));
            let sentence = self.lang.silent_times(it.silent.len(), it.count(), &low, &high);
            let value_name = clean(&silence.value(self.model, value), 2 * NAME);
            (value_name, sentence, self.instants(&[name], silence.against(value)))
        };
        SilenceHtml {
            module: self.module(silence.module),
            when: clean(&silence.when(self.model), MESSAGE),
            values: known.map(of_value).collect(),
        }
    }

    /// Against as many dependents.
    fn evidence(&self, edge: &Edge, dependents: usize) -> EvidenceRow {
        let Edge { cause, dependent, evidence, direction } = edge;
        let (lang, words) = (self.lang, LearnWords::of(self.lang));
        let names = [cause, dependent].map(|it| self.model.node_name(NodeId::Module(*it)));
        let [cause, dependent] = names.map(|name| clean(name, 2 * NAME));
        let (part, whole, (_, low, high)) = (evidence.examples.len(), evidence.failures(), evidence.share());
        let [low, high] = [low, high].map(|share| format!("{:.0}", share * 100.0));
        // The words say which one is earlier.
        let seconds = |ms: i64| lang.quantity(&format!("{:.1}", ms.abs() as f64 / 1000.0), 1.0, "");
        let (first, last) = (evidence.delays_ms.iter().min(), evidence.delays_ms.iter().max());
        let mut row = EvidenceRow {
            sentence: lang.without_effect(dependents > 1, &cause, &dependent, part, whole, &high),
            chance: String::new(),
            noticed: String::new(),
            why: String::new(),
            instants: [
                (words.examples, self.instants(&names, &evidence.examples)),
                (words.counterexamples, self.instants(&names, &evidence.counterexamples)),
            ],
        };
        if let (Some(direction), Some(first), Some(last)) = (*direction, first, last) {
            let earlier = match direction {
                Direction::Earlier(ms) => seconds(ms),
                _ => String::new(),
            };
            row.sentence = lang.failed_together(part, whole, &low, &high);
            let p =
                if evidence.p < P_LEAST { format!("< {P_LEAST:e}") } else { format!("= {:.0e}", evidence.p) };
            // It is not broken over two lines.
            let p = p.replace(' ', "\u{a0}").replace('-', "\u{2011}");
            row.chance = lang.than_by_chance(&format!("{:.0}", evidence.lift()), &p);
            row.noticed = lang.noticed(*first < 0, *last >= 0, &seconds(*first), &seconds(*last));
            row.why = lang.direction(direction, &cause, &dependent, &earlier);
        }
        row
    }

    /// The newest of them.
    fn instants(&self, nodes: &[&str], all: &[i64]) -> Instants {
        let instant = |at_ms: &i64| {
            let (until, at) = ((at_ms + SPAN_S * 500).to_string(), at_ms.to_string());
            let span = SPAN_S.to_string();
            let nodes = nodes.iter().map(|node| ("node", *node));
            let fields = nodes.chain([("span", &*span), ("until", &*until), ("at", &*at)]);
            Instant {
                at: wall_time(*at_ms),
                timeline: format!("/developer/timeline{}", address(fields)),
                incident: self.incidents.iter().find(|it| it.lasts_at(*at_ms)).map(|it| it.id),
            }
        };
        Instants {
            all: all.iter().rev().take(INSTANTS).map(instant).collect(),
            more: all.len().saturating_sub(INSTANTS),
        }
    }
}
