//! Draws a graph: groups as boxes in columns, each right of what it depends on, modules as rows in them,
//! dependencies as arrows.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;

use super::layers::{Item, Layers};
use super::svg::{Attributes, attributes, beginning, escaped};
use telltale_engine::model::{GroupId, ModuleId, NodeId};

const ROW_HEIGHT: f64 = 22.0;
const ROW_GAP: f64 = 4.0;
const NOTE_HEIGHT: f64 = 15.0;
const NOTE_LETTER: f64 = 5.7;
/// Between two groups in one box, and below the last row.
const INNER_GAP: f64 = 6.0;
const FOOT: f64 = 4.0;
/// What the count of a box and the button that opens it take beside its name.
const TOGGLE_WIDTH: f64 = 68.0;
/// An arrow's line ends below its head.
const HEAD_COVERS: f64 = 6.0;
/// How far an arrow within one box swings out to the left.
const DETOUR: f64 = 10.0;
/// Boxes further inside look like those at this depth.
const DEPTH_MAX: usize = 3;

/// Sizes in pixels.
#[derive(Debug, Clone, Copy)]
pub struct Style {
    pub margin: f64,
    pub box_width: f64,
    pub column_gap: f64,
    pub box_gap: f64,
    /// The height that an arrow takes where it passes a column.
    pub arrow_height: f64,
    /// Between the side of a box and its rows.
    pub padding: f64,
    /// The height of a box without content, and where its name begins.
    pub header_height: f64,
    pub name_at: (f64, f64),
    /// The greatest width of a letter in the name of a box, and of one in a row.
    pub name_letter: f64,
    pub row_letter: f64,
    /// Arrows that are drawn: the last ones.
    pub arrows_max: usize,
}

/// The text of a box or row, and what a page does with it.
#[derive(Debug, Clone, Default)]
pub struct Label {
    /// Cut where it does not fit.
    pub text: String,
    /// The tooltip.
    pub title: String,
    pub attributes: Attributes,
    /// Attributes of the link around it.
    pub link: Option<Attributes>,
}

/// A group, with what is drawn inside.
#[derive(Debug, Clone)]
pub struct GroupBox {
    pub id: GroupId,
    pub label: Label,
    /// Lines of small text below the name.
    pub notes: Vec<String>,
    /// Stands at the right of the name.
    pub toggle: Option<Toggle>,
    pub rows: Vec<Row>,
    pub inner: Vec<GroupBox>,
}

/// The button that opens and closes a box, with a short text before it.
#[derive(Debug, Clone)]
pub struct Toggle {
    pub count: String,
    pub is_open: bool,
    pub link: Attributes,
}

/// A module, or a line that stands for several.
#[derive(Debug, Clone)]
pub struct Row {
    pub id: Option<ModuleId>,
    pub label: Label,
}

/// An arrow to `from`, which depends, from `on`.
#[derive(Debug, Clone)]
pub struct Arrow {
    pub on: NodeId,
    pub from: NodeId,
    pub class: String,
    pub title: String,
    pub attributes: Attributes,
}

/// The content of an `svg` element of this size.
#[derive(Debug, Clone)]
pub struct Drawing {
    pub svg: String,
    pub width: f64,
    pub height: f64,
}

/// Draws the boxes, and the arrows between what is drawn. The same input makes the same bytes.
pub fn draw(style: &Style, boxes: &[GroupBox], arrows: &[Arrow]) -> Drawing {
    let mut tops = HashMap::new();
    for top in boxes {
        find_tops(top, top.id, &mut tops);
    }
    let top = |node: &NodeId| tops.get(node).copied();
    let arrows: Vec<_> =
        arrows.iter().filter_map(|arrow| Some((arrow, (top(&arrow.on)?, top(&arrow.from)?)))).collect();
    // Arrows between the same two boxes take one way.
    let ways: Vec<(GroupId, GroupId)> =
        arrows.iter().map(|(_, way)| *way).collect::<BTreeSet<_>>().into_iter().collect();
    let heights: Vec<(GroupId, f64)> = boxes.iter().map(|top| (top.id, style.height(top))).collect();
    let layers = Layers::of(&heights, &ways, style.box_gap, style.arrow_height);
    let by_id: HashMap<GroupId, &GroupBox> = boxes.iter().map(|top| (top.id, top)).collect();
    let mut painter =
        GraphPainter { style, boxes: String::new(), rows: String::new(), anchors: HashMap::default() };
    for (column, items) in layers.columns.iter().enumerate() {
        for (item, top) in items {
            if let Item::Box(id) = item {
                painter.group(by_id[id], style.column_x(column), style.margin + top, style.box_width, 0);
            }
        }
    }
    let mut lines = String::new();
    for (arrow, way) in arrows.iter().skip(arrows.len().saturating_sub(style.arrows_max)) {
        let index = ways.binary_search(way).expect("every arrow has its way");
        painter.arrow(&mut lines, arrow, way.0 == way.1, &layers.waypoints(index, style.margin));
    }
    let columns = layers.columns.len().max(1);
    Drawing {
        svg: painter.boxes + &painter.rows + &lines,
        width: style.column_x(columns) - style.column_gap + style.margin,
        height: style.margin * 2.0 + layers.height,
    }
}

/// Notes for a box and all that is in it in which box at the top it is drawn.
fn find_tops(group: &GroupBox, top: GroupId, tops: &mut HashMap<NodeId, GroupId>) {
    tops.insert(NodeId::Group(group.id), top);
    tops.extend(group.rows.iter().filter_map(|row| Some((NodeId::Module(row.id?), top))));
    for inner in &group.inner {
        find_tops(inner, top, tops);
    }
}

impl Style {
    fn column_x(&self, column: usize) -> f64 {
        self.margin + column as f64 * (self.box_width + self.column_gap)
    }

    fn height(&self, group: &GroupBox) -> f64 {
        if group.toggle.as_ref().is_some_and(|toggle| !toggle.is_open) {
            return self.header_height;
        }
        let notes = NOTE_HEIGHT * group.notes.len() as f64;
        let rows = (ROW_HEIGHT + ROW_GAP) * group.rows.len() as f64;
        let inner: f64 = group.inner.iter().map(|inner| self.height(inner) + INNER_GAP).sum();
        self.header_height + notes + rows + inner + FOOT
    }
}

/// Where arrows reach a box or row.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    left: f64,
    right: f64,
    y: f64,
}

struct GraphPainter<'s> {
    style: &'s Style,
    boxes: String,
    rows: String,
    anchors: HashMap<NodeId, Anchor>,
}

impl GraphPainter<'_> {
    fn group(&mut self, group: &GroupBox, x: f64, y: f64, width: f64, depth: usize) {
        let style = self.style;
        let (height, shown_depth) = (style.height(group), depth.min(DEPTH_MAX));
        let toggle_width = group.toggle.as_ref().map_or(0.0, |_| TOGGLE_WIDTH);
        let name = beginning(&group.label.text, width - 16.0 - toggle_width, style.name_letter);
        let (name_x, name_y) = style.name_at;
        let name = format!("<text class=\"name\" x=\"{name_x}\" y=\"{name_y}\">{}</text>", escaped(&name));
        let _ = write!(
            self.boxes,
            "<g class=\"box depth-{shown_depth}\" transform=\"translate({x:.1} {y:.1})\"{}>{}\
             <rect class=\"plate\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"7\"/>\
             <rect class=\"mark\" width=\"6\" height=\"{height:.1}\" rx=\"3\"/>{}",
            attributes(&group.label.attributes),
            title(&group.label.title),
            linked(group.label.link.as_ref(), &name)
        );
        if let Some(toggle) = &group.toggle {
            let (count_x, button_x, sign_x) = (width - 34.0, width - 28.0, width - 22.0);
            let upright = if toggle.is_open { "" } else { "m-5 -5v10" };
            let _ = write!(
                self.boxes,
                "<text class=\"count\" x=\"{count_x:.1}\" y=\"{name_y}\">{}</text>\
                 <a class=\"toggle\"{}><rect x=\"{button_x:.1}\" y=\"6\" width=\"22\" height=\"22\" rx=\"5\"/>\
                 <path d=\"M{sign_x:.1} 17h10{upright}\"/></a>",
                escaped(&toggle.count),
                attributes(&toggle.link)
            );
        }
        let mut top = style.header_height;
        for note in &group.notes {
            let (note_y, fitting) = (top + 7.0, beginning(note, width - 16.0, NOTE_LETTER));
            let _ = write!(
                self.boxes,
                "<text class=\"note\" x=\"{name_x}\" y=\"{note_y:.1}\">{}{}</text>",
                title(note),
                escaped(&fitting)
            );
            top += NOTE_HEIGHT;
        }
        self.boxes.push_str("</g>\n");
        self.anchor(NodeId::Group(group.id), x, width, y + style.header_height / 2.0);
        top += y;
        for row in &group.rows {
            self.row(row, x + style.padding, top, width - style.padding * 2.0);
            top += ROW_HEIGHT + ROW_GAP;
        }
        for inner in &group.inner {
            self.group(inner, x + style.padding, top, width - style.padding * 2.0, depth + 1);
            top += style.height(inner) + INNER_GAP;
        }
    }

    fn row(&mut self, row: &Row, x: f64, y: f64, width: f64) {
        let label = &row.label;
        let text = beginning(&label.text, width - 16.0, self.style.row_letter);
        let content = format!(
            "<g class=\"node\" transform=\"translate({x:.1} {y:.1})\"{}>{}\
             <rect width=\"{width:.1}\" height=\"{ROW_HEIGHT}\" rx=\"4\"/>\
             <text x=\"9\" y=\"15.5\">{}</text></g>",
            attributes(&label.attributes),
            title(&label.title),
            escaped(&text)
        );
        let _ = writeln!(self.rows, "{}", linked(label.link.as_ref(), &content));
        if let Some(id) = row.id {
            self.anchor(NodeId::Module(id), x, width, y + ROW_HEIGHT / 2.0);
        }
    }

    fn anchor(&mut self, node: NodeId, left: f64, width: f64, y: f64) {
        self.anchors.insert(node, Anchor { left, right: left + width, y });
    }

    /// An arrow between two boxes goes through the waypoints, one within a box beside its rows.
    fn arrow(&self, out: &mut String, arrow: &Arrow, within: bool, waypoints: &[(usize, f64)]) {
        let (start, end) = (self.anchors[&arrow.on], self.anchors[&arrow.from]);
        let (tip, tip_y) = (end.left, end.y);
        let line_end = tip - HEAD_COVERS;
        let line = if within {
            let (x, y, out_x) = (start.left, start.y, start.left.min(tip) - DETOUR);
            format!("M{x:.1} {y:.1}C{out_x:.1} {y:.1} {out_x:.1} {tip_y:.1} {line_end:.1} {tip_y:.1}")
        } else {
            let columns = waypoints.iter().flat_map(|&(column, y)| {
                let x = self.style.column_x(column);
                [(x, y), (x + self.style.box_width, y)]
            });
            bent((start.right, start.y), columns.chain([(line_end, tip_y)]))
        };
        let _ = writeln!(
            out,
            "<g class=\"{}\"{}>{}<path class=\"edge\" d=\"{line}\"/>\
             <path class=\"head\" d=\"M{tip:.1} {tip_y:.1}l-8 -4v8z\"/></g>",
            escaped(&arrow.class),
            attributes(&arrow.attributes),
            title(&arrow.title)
        );
    }
}

/// A smooth line that is level at each of its points.
fn bent((mut x, mut y): (f64, f64), points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut line = format!("M{x:.1} {y:.1}");
    for (to_x, to_y) in points {
        let half = ((to_x - x) / 2.0).abs();
        let (leaving, arriving) = (x + half, to_x - half);
        let _ = write!(line, "C{leaving:.1} {y:.1} {arriving:.1} {to_y:.1} {to_x:.1} {to_y:.1}");
        (x, y) = (to_x, to_y);
    }
    line
}

fn title(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("<title>{}</title>", escaped(text)) }
}

fn linked(link: Option<&Attributes>, content: &str) -> String {
    link.map_or_else(|| content.to_owned(), |link| format!("<a{}>{content}</a>", attributes(link)))
}
