//! Why a node shows what it shows: each step from what was reported, as a list.

use askama::Template;

use crate::engine::model::NodeId;
use crate::engine::state::State;
use crate::engine::why::WhyStep;

use super::clean::{MESSAGE, NAME, clean};
use super::pages::Frame;
use super::{Lang, PageContext, View, html};

/// Nodes named in one step; a group may have thousands of members.
const NAMED: usize = 20;

/// A sentence, and the nodes that it is about.
struct Step {
    text: String,
    nodes: Vec<String>,
    more: Option<String>,
}

#[derive(Template)]
#[template(path = "developer/why.html")]
struct WhyHtml {
    frame: Frame,
    node: String,
    state: &'static str,
    message: String,
    steps: Vec<Step>,
    paths: Vec<Vec<String>>,
}

pub fn page(view: &View<'_>, node: NodeId, context: &PageContext) -> String {
    let snapshot = view.snapshot;
    let name = |node: NodeId| clean(snapshot.node_name(node), 2 * NAME);
    let (message, paths) = match node {
        NodeId::Module(id) => (clean(&snapshot.module(id).1.report.message, MESSAGE), Vec::new()),
        NodeId::Group(id) => {
            let paths = snapshot.group(id).1.paths.iter().take(NAMED);
            (String::new(), paths.map(|path| path.iter().map(|&node| name(node)).collect()).collect())
        }
    };
    let steps = snapshot.why(node).into_iter().map(|step| {
        let (text, nodes) = say(view, &step);
        let more = nodes.len().saturating_sub(NAMED);
        Step {
            text,
            nodes: nodes.into_iter().take(NAMED).map(name).collect(),
            more: (more > 0).then(|| view.lang.and_more(more)),
        }
    });
    html(&WhyHtml {
        frame: Frame::new(context.lang, context.palette),
        node: name(node),
        state: snapshot.shown(node).0.as_str(),
        message,
        steps: steps.collect(),
        paths,
    })
}

fn say(view: &View<'_>, step: &WhyStep) -> (String, Vec<NodeId>) {
    let lang = view.lang;
    let state = |state: State| lang.state(state).to_owned();
    let text = |en: &str, de: &str| match lang {
        Lang::En => en.to_owned(),
        Lang::De => de.to_owned(),
    };
    match step {
        WhyStep::NeverReported => (text("It has never reported.", "Es hat sich nie gemeldet."), Vec::new()),
        WhyStep::Reported(is) => (format!("{}: {}", text("It reports", "Es meldet"), state(*is)), Vec::new()),
        WhyStep::Silent(is) => {
            let silent = text(
                "Nothing came for its timeout; it counts as",
                "Nichts kam innerhalb der Frist; es gilt als",
            );
            (format!("{silent}: {}", state(*is)), Vec::new())
        }
        WhyStep::Debounced(is) => {
            let still = text(
                "The change is too fresh; it still counts as",
                "Der Wechsel ist zu frisch; es gilt noch als",
            );
            (format!("{still}: {}", state(*is)), Vec::new())
        }
        WhyStep::Latched => (
            text("An error is held until it is reset.", "Ein Fehler wird bis zum Zurücksetzen festgehalten."),
            Vec::new(),
        ),
        WhyStep::Grace => {
            (text("It is given time to report.", "Es hat noch Zeit, sich zu melden."), Vec::new())
        }
        WhyStep::Members { own, responsible } => {
            let members =
                text("Its members make it, by themselves,", "Seine Teile ergeben, für sich genommen,");
            (format!("{members} {}", state(*own)), responsible.clone())
        }
        WhyStep::NotRelevant(because) => {
            let out = text("It does not matter now", "Es ist jetzt nicht wichtig");
            (format!("{out}: {}", lang.not_relevant(because)), Vec::new())
        }
        WhyStep::Waits { holder, on } => {
            let needs = text("needs what fails or waits itself", "braucht, was ausfällt oder selbst wartet");
            (format!("{} {needs}", clean(view.snapshot.node_name(*holder), 2 * NAME)), vec![*on])
        }
        WhyStep::Masked { by } => {
            (text("It is put aside because of", "Es wird zurückgestellt wegen"), by.clone())
        }
        WhyStep::Shown(is) => (format!("{}: {}", text("It shows", "Es zeigt"), state(*is)), Vec::new()),
    }
}
