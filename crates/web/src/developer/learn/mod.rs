//! The page of learned dependencies: what the history proposes, each with its evidence, and the patch for the
//! configuration. Nothing of it is in force by itself.

mod run;

use std::collections::BTreeSet;
use std::slice::from_ref;

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
use crate::view::{View, html};
use crate::{AppState, unlocked};
use telltale_engine::model::{Model, ModuleId, NodeId};
use telltale_learn::{Direction, Doubt, EPISODES, Edge, Episodes, Silence, modules_of};
use telltale_record::summary::Summary;
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

/// The first of several, and how many more there are.
type Few<T> = (Vec<T>, usize);

fn few<I: IntoIterator, T>(all: I, most: usize, of: impl FnMut(I::Item) -> T) -> Few<T> {
    let mut all = all.into_iter();
    (all.by_ref().take(most).map(of).collect(), all.count())
}

/// What the past says of one cause.
struct EvidenceRow {
    sentence: String,
    chance: String,
    noticed: String,
    why: String,
    /// For and against it, each with its word.
    instants: [(&'static str, Few<Instant>); 2],
}

struct Proposal {
    kind: &'static str,
    word: &'static str,
    node: NodeLink,
    on: Vec<NodeLink>,
    /// The rest of a narrowed dependency.
    remains: Vec<NodeLink>,
    evidence: Few<EvidenceRow>,
}

/// A module that is silent in some states.
struct SilenceHtml {
    module: NodeLink,
    when: String,
    /// Each value with its sentence and its counterexamples.
    values: Vec<(String, String, Few<Instant>)>,
}

struct PatchHtml {
    patch: String,
    left: Vec<String>,
    checked: Result<Option<String>, String>,
    /// The address of a what-if with it.
    what_if: Option<String>,
}

/// What was learned.
struct Found {
    summary: String,
    proposals: Few<Proposal>,
    undecided: Few<[NodeLink; 2]>,
    silences: Few<SilenceHtml>,
    /// The graph has something to show.
    has_edges: bool,
    patch: Option<PatchHtml>,
}

struct Shown {
    at: String,
    /// The configuration is another one now.
    is_old: bool,
    /// Or why nothing is learned.
    found: Result<Found, String>,
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
    let PageRequest { published, context, query, session, .. } = &request;
    let may_run = session.role == Role::Developer;
    if may_run && query.get("run") == "yes" {
        unlocked(published)?;
        run::start(&app).await?;
        return Ok(Redirect::to(PATH).into_response());
    }
    let running = run::running(&app);
    let Progress { is_running, last } = app.learning.progress();
    let shown = last.filter(|_| !is_running).map(|last| Shown {
        at: wall_time(last.at_ms),
        is_old: running.as_ref().is_none_or(|running| *running != last.texts),
        found: found(context.lang, &last, may_run),
    });
    let mut dev = DevFrame::new(&View::new(published, context.lang, false), context, Page::Learn, RENEW_MS);
    dev.fixed = !is_running;
    let page = html(&LearnHtml {
        frame: super::frame(context),
        dev,
        it: LearnWords::of(context.lang),
        may_run,
        is_there: app.settings.learner.is_some() && app.settings.history.is_some() && running.is_some(),
        is_running,
        shown,
    });
    Ok(Html(page).into_response())
}

fn found(lang: Lang, outcome: &Outcome, may_run: bool) -> Result<Found, String> {
    let it = LearnWords::of(lang);
    let learned = outcome.result.as_ref().map_err(|why| match why {
        NotLearned::Nothing => it.nothing.to_owned(),
        NotLearned::TooMuch => it.too_much.to_owned(),
        NotLearned::Bad(why) => format!("{}: {}", it.failed, clean(why, 4 * MESSAGE)),
    })?;
    let found = &learned.proposals;
    let writer = Writer { lang, model: &learned.model, incidents: &outcome.incidents };
    let add = found.add.iter().map(|index| (None, from_ref(&found.learned[*index])));
    let doubted = found.doubted.iter().map(|doubt| (Some(doubt), &doubt.edges[..]));
    let proposals = few(add.chain(doubted), PROPOSALS, |(doubt, edges)| writer.proposal(doubt, edges));
    let tried = tried(&proposals.0, &outcome.incidents).filter(|_| may_run);
    Ok(Found {
        summary: lang.learned_in_all(found.learned.len(), learned.failed, learned.model.modules.len()),
        proposals,
        undecided: few(&found.undecided, PROPOSALS, |(one, other)| {
            [*one, *other].map(|it| writer.module(it))
        }),
        silences: few(&found.silences, PROPOSALS, |it| writer.silence(it)),
        has_edges: !found.add.is_empty(),
        patch: learned.patched.as_ref().map(|patched| PatchHtml {
            patch: clean_lines(&patched.patch),
            left: patched.left.iter().map(|name| clean(name, 2 * NAME)).collect(),
            checked: match &patched.checked {
                Ok(warnings) => Ok(warnings.as_deref().map(clean_lines)),
                Err(problems) => Err(clean_lines(problems)),
            },
            what_if: tried
                .filter(|_| !patched.patch.is_empty())
                .map(|id| format!("/incidents/{id}/what-if?from=proposed")),
        }),
    })
}

/// The newest incident that can be run and that a proposal names; else the newest one.
fn tried(proposals: &[Proposal], incidents: &[Summary]) -> Option<u64> {
    let instants = proposals.iter().flat_map(|it| &it.evidence.0).flat_map(|it| &it.instants);
    let named: BTreeSet<u64> =
        instants.flat_map(|(_, it)| &it.0).filter_map(|instant| instant.incident).collect();
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

    /// A doubted dependency with its evidence, or one that its only edge adds.
    fn proposal(&self, doubt: Option<&Doubt>, edges: &[Edge]) -> Proposal {
        let words = LearnWords::of(self.lang);
        let (node, on, remains) = match doubt {
            Some(Doubt { node, index, remains, .. }) => {
                let on = self.model.depends_on(*node).get(*index).map_or(&[][..], |it| it.on.nodes());
                (*node, on.to_vec(), &remains[..])
            }
            None => (NodeId::Module(edges[0].dependent), vec![NodeId::Module(edges[0].cause)], &[][..]),
        };
        let (kind, word) = match (doubt, remains) {
            (None, _) => ("add", words.add),
            (_, []) => ("remove", words.remove),
            _ => ("narrow", words.narrow),
        };
        let dependents = modules_of(self.model, node).len();
        Proposal {
            kind,
            word,
            node: self.node(node),
            on: on.iter().map(|it| self.node(*it)).collect(),
            remains: remains.iter().map(|it| self.module(*it)).collect(),
            evidence: few(edges, MODULES, |edge| self.evidence(edge, dependents)),
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
    fn instants(&self, nodes: &[&str], all: &[i64]) -> Few<Instant> {
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
        few(all.iter().rev(), INSTANTS, instant)
    }
}
