//! Draws the graph of a configuration: groups as boxes, with their dependencies to the left.

use std::collections::HashMap;
use std::fmt::Write as _;

use crate::config::describe::words::node_name;
use crate::engine::model::{
    Combine, Dependency, DependsOn, GroupId, Model, ModuleId, NodeId, POSED_SIGNAL, When,
};
use crate::picture::layers::{Item, Layers};

const STYLE: &str = include_str!("graph.css");

const MARGIN: f64 = 24.0;
const BOX_WIDTH: f64 = 206.0;
const COLUMN_GAP: f64 = 92.0;
const BOX_GAP: f64 = 26.0;
/// Room for a line that passes a column.
const LANE: f64 = 14.0;
const PAD: f64 = 16.0;
const ROW: f64 = 22.0;
const ROW_GAP: f64 = 5.0;
const HEADER: f64 = 26.0;
const NOTE: f64 = 15.0;
const LEGEND: f64 = 74.0;
/// What a letter takes at most, by the size of the font.
const NAME_LETTER: f64 = 7.4;
const NOTE_LETTER: f64 = 5.7;

/// The whole graph as SVG. The same model makes the same bytes.
pub fn draw(model: &Model) -> String {
    let edges = edges(model);
    let tiles: Vec<(GroupId, f64)> = tops(model).map(|id| (id, group_height(model, id))).collect();
    let between: Vec<(GroupId, GroupId)> =
        edges.iter().map(|edge| (tile(model, edge.on), tile(model, edge.from))).collect();
    let layers = Layers::of(&tiles, &between, BOX_GAP, LANE);
    let width = MARGIN * 2.0 + layers.columns.len().max(1) as f64 * (BOX_WIDTH + COLUMN_GAP) - COLUMN_GAP;
    let height = MARGIN * 2.0 + layers.height + LEGEND;
    let mut drawing = Drawing { model, out: String::new(), anchors: HashMap::new() };
    for (column, items) in layers.columns.iter().enumerate() {
        for (item, top) in items {
            if let Item::Tile(id) = item {
                drawing.group(*id, column_x(column), MARGIN + top, BOX_WIDTH, 0);
            }
        }
    }
    let mut lines = String::new();
    for (index, edge) in edges.iter().enumerate() {
        drawing.edge(&mut lines, edge, &layers.lanes(index, MARGIN));
    }
    let width = width.max(640.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\">\n\
         <style>\n{STYLE}</style>\n<rect class=\"page\" width=\"100%\" height=\"100%\"/>\n{}{lines}{}</svg>\n",
        drawing.out,
        legend(height - LEGEND)
    )
}

/// All nodes with what they depend on: groups, then modules.
pub(super) fn dependencies(model: &Model) -> impl Iterator<Item = (NodeId, &[Dependency])> {
    let groups = (0..).map(GroupId).zip(&model.groups);
    let groups = groups.map(|(id, group)| (NodeId::Group(id), &*group.depends_on));
    let modules = (0..).map(ModuleId).zip(&model.modules);
    groups.chain(modules.map(|(id, module)| (NodeId::Module(id), &*module.depends_on)))
}

/// What a dependency names, and whether that is a redundancy set.
pub(super) fn targets(dependency: &Dependency) -> (&[NodeId], bool) {
    match &dependency.on {
        DependsOn::Node(node) => (std::slice::from_ref(node), false),
        DependsOn::AnyOf(members) => (members, true),
    }
}

fn column_x(column: usize) -> f64 {
    MARGIN + column as f64 * (BOX_WIDTH + COLUMN_GAP)
}

/// `from` waits when `on` fails.
struct Edge {
    from: NodeId,
    on: NodeId,
    any_of: bool,
    masks_unknown: bool,
}

fn edges(model: &Model) -> Vec<Edge> {
    let mut edges = Vec::new();
    for (from, depends_on) in dependencies(model) {
        for dependency in depends_on {
            let (targets, any_of) = targets(dependency);
            let masks_unknown = dependency.masks_unknown;
            edges.extend(targets.iter().map(|&on| Edge { from, on, any_of, masks_unknown }));
        }
    }
    edges
}

fn tops(model: &Model) -> impl Iterator<Item = GroupId> {
    (0..).map(GroupId).zip(&model.groups).filter(|(_, group)| group.parent.is_none()).map(|(id, _)| id)
}

fn tile(model: &Model, node: NodeId) -> GroupId {
    let mut id = match node {
        NodeId::Group(id) => id,
        NodeId::Module(id) => model.modules[id.0 as usize].group,
    };
    while let Some(parent) = model.groups[id.0 as usize].parent {
        id = parent;
    }
    id
}

fn inner_groups(model: &Model, id: GroupId) -> impl Iterator<Item = GroupId> {
    (0..).map(GroupId).zip(&model.groups).filter(move |(_, group)| group.parent == Some(id)).map(|(id, _)| id)
}

fn modules(model: &Model, id: GroupId) -> impl Iterator<Item = ModuleId> {
    (0..).map(ModuleId).zip(&model.modules).filter(move |(_, module)| module.group == id).map(|(id, _)| id)
}

fn notes(model: &Model, id: GroupId) -> Vec<String> {
    let group = &model.groups[id.0 as usize];
    let when = group.when.as_ref().map(|when| when_note(model, when));
    let any = (group.combine == Combine::Any).then(|| "the best member counts".to_owned());
    let filters = match group.filters.len() {
        0 => None,
        1 => Some("takes statuses with 1 filter".to_owned()),
        count => Some(format!("takes statuses with {count} filters")),
    };
    when.into_iter().chain(any).chain(filters).collect()
}

fn when_note(model: &Model, when: &When) -> String {
    let stages: Vec<&str> = when.stages.iter().map(|stage| stage.as_str()).collect();
    let stages = (!stages.is_empty()).then(|| format!("in {}", stages.join(", ")));
    let signals =
        when.signals.iter().map(|&(index, value)| format!("when {} is {value}", model.signals[index].name));
    let posed = when.posed.map(|value| format!("when {POSED_SIGNAL} is {value}"));
    stages.into_iter().chain(signals).chain(posed).collect::<Vec<_>>().join(", ")
}

fn group_height(model: &Model, id: GroupId) -> f64 {
    let rows = modules(model, id).count() as f64 * (ROW + ROW_GAP);
    let inner: f64 = inner_groups(model, id).map(|id| group_height(model, id) + ROW_GAP).sum();
    HEADER + NOTE * notes(model, id).len() as f64 + rows + inner + 8.0
}

struct Drawing<'m> {
    model: &'m Model,
    out: String,
    /// Left edge, right edge and height of each node.
    anchors: HashMap<NodeId, (f64, f64, f64)>,
}

impl Drawing<'_> {
    fn group(&mut self, id: GroupId, x: f64, y: f64, width: f64, depth: usize) {
        let group = &self.model.groups[id.0 as usize];
        let height = group_height(self.model, id);
        let class = if depth == 0 { "group" } else { "nested" };
        let name = if depth == 0 { &*group.path } else { last(&group.path) };
        let name = escaped(&fitted(name, width - 16.0, NAME_LETTER));
        let _ = writeln!(
            self.out,
            "<g><title>{} \u{2013} {}</title><rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"5\"/>\
             <text class=\"name\" x=\"{:.1}\" y=\"{:.1}\">{name}</text></g>",
            escaped(&group.path),
            escaped(&group.name.en),
            x + 8.0,
            y + 18.0
        );
        self.anchors.insert(NodeId::Group(id), (x, x + width, y + 13.0));
        let mut top = y + HEADER;
        for note in notes(self.model, id) {
            let fit = escaped(&fitted(&note, width - 16.0, NOTE_LETTER));
            let (note_x, note_y) = (x + 8.0, top + 7.0);
            let _ = writeln!(
                self.out,
                "<text class=\"note\" x=\"{note_x:.1}\" y=\"{note_y:.1}\"><title>{}</title>{fit}</text>",
                escaped(&note)
            );
            top += NOTE;
        }
        for module in modules(self.model, id).collect::<Vec<_>>() {
            self.module(module, x + PAD, top, width - PAD * 2.0);
            top += ROW + ROW_GAP;
        }
        for inner in inner_groups(self.model, id).collect::<Vec<_>>() {
            self.group(inner, x + PAD, top, width - PAD * 2.0, depth + 1);
            top += group_height(self.model, inner) + ROW_GAP;
        }
    }

    fn module(&mut self, id: ModuleId, x: f64, y: f64, width: f64) {
        let module = &self.model.modules[id.0 as usize];
        let when = module.when.as_ref().map(|when| format!(", {}", when_note(self.model, when)));
        let star = if when.is_some() { "*" } else { "" };
        let name = escaped(&fitted(&format!("{}{star}", last(&module.id)), width - 14.0, NAME_LETTER));
        let _ = writeln!(
            self.out,
            "<g><title>{}{}</title><rect class=\"module\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{ROW}\" rx=\"3\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{name}</text></g>",
            escaped(&module.id),
            escaped(&when.unwrap_or_default()),
            x + 7.0,
            y + 15.5
        );
        self.anchors.insert(NodeId::Module(id), (x, x + width, y + ROW / 2.0));
    }

    /// From what fails to what waits for it, through the lanes between.
    fn edge(&self, out: &mut String, edge: &Edge, lanes: &[(usize, f64)]) {
        let (from_left, from_right, from_y) = self.anchors[&edge.on];
        let (to_left, _, to_y) = self.anchors[&edge.from];
        let mut line = String::new();
        if tile(self.model, edge.on) == tile(self.model, edge.from) {
            let out_x = from_left.min(to_left) - 11.0;
            let _ = write!(
                line,
                "M{from_left:.1} {from_y:.1}C{out_x:.1} {from_y:.1} {out_x:.1} {to_y:.1} {:.1} {to_y:.1}",
                to_left - 6.0
            );
        } else {
            let _ = write!(line, "M{from_right:.1} {from_y:.1}");
            let (mut x, mut y) = (from_right, from_y);
            let mut bend = |line: &mut String, to_x: f64, to_y: f64| {
                let half = ((to_x - x) / 2.0).abs().max(30.0);
                let _ =
                    write!(line, "C{:.1} {y:.1} {:.1} {to_y:.1} {to_x:.1} {to_y:.1}", x + half, to_x - half);
                (x, y) = (to_x, to_y);
            };
            for &(column, lane_y) in lanes {
                let lane_x = column_x(column);
                bend(&mut line, lane_x, lane_y);
                bend(&mut line, lane_x + BOX_WIDTH, lane_y);
            }
            bend(&mut line, to_left - 6.0, to_y);
        }
        let any = if edge.any_of { " any" } else { "" };
        let (unknown, head) = if edge.masks_unknown { (" unknown", "head-unknown") } else { ("", "head") };
        let (on, from) = (node_name(self.model, edge.on), node_name(self.model, edge.from));
        let _ = writeln!(
            out,
            "<g><title>{} depends on {}</title><path class=\"edge{any}{unknown}\" d=\"{line}\"/>\
             <path class=\"{head}\" d=\"M{to_left:.1} {to_y:.1}l-8 -4v8z\"/></g>",
            escaped(from),
            escaped(on)
        );
    }
}

fn legend(y: f64) -> String {
    let lines = [
        ("edge", "head", "an arrow leads from what fails to what it masks"),
        ("edge any", "head", "only if every member of the redundancy set fails"),
        ("edge unknown", "head-unknown", "UNKNOWN masks too"),
    ];
    let mut out = String::new();
    for (index, (class, head, words)) in lines.iter().enumerate() {
        let y = y + 12.0 + 18.0 * index as f64;
        let (x, end) = (MARGIN, MARGIN + 40.0);
        let (text_x, text_y) = (end + 10.0, y + 4.0);
        let _ = writeln!(
            out,
            "<path class=\"{class}\" d=\"M{x:.1} {y:.1}H{:.1}\"/><path class=\"{head}\" d=\"M{end:.1} {y:.1}l-8 -4v8z\"/>\
             <text class=\"legend\" x=\"{text_x:.1}\" y=\"{text_y:.1}\">{words}</text>",
            end - 6.0
        );
    }
    out
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

fn fitted(text: &str, width: f64, letter: f64) -> String {
    let most = (width / letter).max(4.0) as usize;
    if text.chars().count() <= most {
        return text.to_owned();
    }
    let kept: String = text.chars().take(most - 1).collect();
    format!("{kept}\u{2026}")
}

fn escaped(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests;
