//! The graph of a configuration, for `telltale check`: as SVG, groups as boxes with their dependencies to the
//! left, and for Graphviz.

use std::fmt::Write as _;

use crate::engine::model::{
    Combine, Dependency, GroupId, Model, ModuleId, ModuleSpec, NodeId, POSED_SIGNAL, When,
};
use crate::picture::graph::{self, Arrow, GroupBox, Label, Row, Style};

const STYLESHEET: &str = include_str!("graph.css");
const STYLE: Style = Style {
    margin: 24.0,
    box_width: 206.0,
    column_gap: 92.0,
    box_gap: 26.0,
    arrow_height: 14.0,
    padding: 16.0,
    header_height: 26.0,
    name_at: (8.0, 18.0),
    name_letter: 7.4,
    row_letter: 7.4,
    arrows_max: usize::MAX,
};
const WIDTH_MIN: f64 = 640.0;
const LEGEND_HEIGHT: f64 = 74.0;

/// The whole graph as SVG. The same model makes the same bytes.
pub fn svg(model: &Model) -> String {
    let boxes: Vec<GroupBox> = groups(model, None).map(|id| group_box(model, id)).collect();
    let drawing = graph::draw(&STYLE, &boxes, &arrows(model));
    let (width, height) = (drawing.width.max(WIDTH_MIN), drawing.height + LEGEND_HEIGHT);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\">\n\
         <style>\n{STYLESHEET}</style>\n<rect class=\"page\" width=\"100%\" height=\"100%\"/>\n{}{}</svg>\n",
        drawing.svg,
        legend(drawing.height)
    )
}

/// All nodes with what they depend on: groups, then modules.
fn dependencies(model: &Model) -> impl Iterator<Item = (NodeId, &[Dependency])> {
    model.nodes().map(|node| (node, model.depends_on(node)))
}

fn arrows(model: &Model) -> Vec<Arrow> {
    let mut arrows = Vec::new();
    for (from, depends_on) in dependencies(model) {
        for dependency in depends_on {
            let any = if dependency.is_any_of() { " any" } else { "" };
            let unknown = if dependency.masks_unknown { " unknown" } else { "" };
            arrows.extend(dependency.targets().iter().map(|&on| Arrow {
                on,
                from,
                class: format!("arrow{any}{unknown}"),
                title: format!("{} depends on {}", model.node_name(from), model.node_name(on)),
                attributes: Vec::new(),
            }));
        }
    }
    arrows
}

fn groups(model: &Model, parent: Option<GroupId>) -> impl Iterator<Item = GroupId> {
    let groups = (0..).map(GroupId).zip(&model.groups);
    groups.filter(move |(_, group)| group.parent == parent).map(|(id, _)| id)
}

fn group_box(model: &Model, id: GroupId) -> GroupBox {
    let group = &model.groups[id.0 as usize];
    let name = if group.parent.is_some() { last(&group.path) } else { &*group.path };
    let modules = model.modules.iter().zip((0..).map(ModuleId)).filter(|(module, _)| module.group == id);
    let row = |(module, id): (&ModuleSpec, ModuleId)| {
        let when = module.when.as_ref().map(|when| format!(", {}", when_note(model, when)));
        let star = if when.is_some() { "*" } else { "" };
        let title = format!("{}{}", module.id, when.unwrap_or_default());
        let text = format!("{}{star}", last(&module.id));
        Row { id: Some(id), label: Label { text, title, ..Label::default() } }
    };
    GroupBox {
        id,
        label: Label {
            text: name.to_owned(),
            title: format!("{} \u{2013} {}", group.path, group.name.en),
            ..Label::default()
        },
        notes: notes(model, id),
        toggle: None,
        rows: modules.map(row).collect(),
        inner: groups(model, Some(id)).map(|inner| group_box(model, inner)).collect(),
    }
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

fn legend(y: f64) -> String {
    let lines = [
        ("arrow", "an arrow leads from what fails to what it masks"),
        ("arrow any", "only if every member of the redundancy set fails"),
        ("arrow unknown", "UNKNOWN masks too"),
    ];
    let (x, end) = (STYLE.margin, STYLE.margin + 40.0);
    let mut out = String::new();
    for (index, (class, words)) in lines.iter().enumerate() {
        let y = y + 12.0 + 18.0 * index as f64;
        let (line_end, text_x, text_y) = (end - 6.0, end + 10.0, y + 4.0);
        let _ = writeln!(
            out,
            "<g class=\"{class}\"><path class=\"edge\" d=\"M{x:.1} {y:.1}H{line_end:.1}\"/>\
             <path class=\"head\" d=\"M{end:.1} {y:.1}l-8 -4v8z\"/></g>\
             <text class=\"legend\" x=\"{text_x:.1}\" y=\"{text_y:.1}\">{words}</text>"
        );
    }
    out
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// The graph for Graphviz: an arrow from each node to what it depends on.
pub fn dot(model: &Model) -> String {
    let mut out =
        format!("digraph \"{}\" {{\n  compound=true; rankdir=RL; node [shape=box];\n", model.vehicle_id);
    for index in (0..model.groups.len()).filter(|&index| model.groups[index].parent.is_none()) {
        dot_group(&mut out, model, GroupId(index as u32), 1);
    }
    for (node, depends_on) in dependencies(model) {
        dot_edges(&mut out, model, node, depends_on);
    }
    out.push_str("}\n");
    out
}

fn dot_group(out: &mut String, model: &Model, id: GroupId, depth: usize) {
    let group = &model.groups[id.0 as usize];
    let pad = "  ".repeat(depth);
    let _ = writeln!(out, "{pad}subgraph \"cluster {}\" {{", group.path);
    let _ = writeln!(out, "{pad}  label={}; \"{}\" [shape=point];", quoted(&group.name.en), group.path);
    for module in model.modules.iter().filter(|module| module.group == id) {
        let name = module.id.rsplit('/').next().unwrap_or(&module.id);
        let _ = writeln!(out, "{pad}  \"{}\" [label={}];", module.id, quoted(name));
    }
    for (index, inner) in model.groups.iter().enumerate() {
        if inner.parent == Some(id) {
            dot_group(out, model, GroupId(index as u32), depth + 1);
        }
    }
    let _ = writeln!(out, "{pad}}}");
}

fn dot_edges(out: &mut String, model: &Model, from: NodeId, depends_on: &[Dependency]) {
    let cluster = |node: NodeId, end: &str| match node {
        NodeId::Group(_) => format!(" {end}=\"cluster {}\"", model.node_name(node)),
        NodeId::Module(_) => String::new(),
    };
    for dependency in depends_on {
        let style = if dependency.is_any_of() { "dashed" } else { "solid" };
        for &to in dependency.targets() {
            let (tail, head) = (cluster(from, "ltail"), cluster(to, "lhead"));
            let (from, to) = (model.node_name(from), model.node_name(to));
            let _ = writeln!(out, "  \"{from}\" -> \"{to}\" [style={style}{tail}{head}];");
        }
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}

#[cfg(test)]
mod tests;
