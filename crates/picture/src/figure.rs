//! Draws figures: panels of strips over an axis of time, as in Fig. 6 of the paper. The same panels make the
//! same bytes.
//!
//! States differ by colour and by pattern or word, so nobody needs to see the colours.

use std::fmt::Write as _;

use super::bars::{BAR_HEIGHT, Bar, OWN_HEIGHT, patterns, word};
use super::strips::{Axis, Look, Segment, Strip, class};
use super::svg::{end, escaped};
use telltale_engine::time::Timestamp;

const STYLE: &str = include_str!("figure.css");

const MARGIN: f64 = 16.0;
const LABEL_WIDTH: f64 = 158.0;
const PLOT_WIDTH: f64 = 320.0;
const PANEL_GAP: f64 = 28.0;
const TITLE_HEIGHT: f64 = 46.0;
const STRIP_STEP: f64 = 28.0;
const AXIS_HEIGHT: f64 = 44.0;
const LEGEND_STEP: f64 = 24.0;
/// The greatest width of a letter in a bar.
const LETTER_WIDTH: f64 = 7.9;
/// Longer labels lose their beginning; the tooltip has the full name.
const LABEL_LETTERS: usize = 24;

/// Some strips over one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    pub title: String,
    pub from: Timestamp,
    pub to: Timestamp,
    /// The zero of the axis, and the event there.
    pub zero: Option<(Timestamp, String)>,
    pub strips: Vec<Strip>,
    /// From the strip of the symptom to the strip of its cause.
    pub moved: Vec<MovedAlarm>,
}

/// An alarm that moved, by positions of strips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MovedAlarm {
    pub at: Timestamp,
    pub symptom: usize,
    pub cause: usize,
}

impl MovedAlarm {
    /// From the strip of the symptom, or of the innermost shown group around it, to the strip of the cause.
    pub fn between(at: Timestamp, symptom: &str, cause: &str, strips: &[Strip]) -> Option<MovedAlarm> {
        let nearest = |name: &str| {
            let contains = |strip: &Strip| {
                name.strip_prefix(&strip.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            let found = strips.iter().enumerate().filter(|(_, strip)| contains(strip));
            found.max_by_key(|(_, strip)| strip.name.len()).map(|(index, _)| index)
        };
        let (symptom, cause) = (nearest(symptom)?, nearest(cause)?);
        (symptom != cause).then_some(MovedAlarm { at, symptom, cause })
    }
}

/// One figure of all panels, two in a row, with a letter each if there are several.
pub fn draw(panels: &[Panel]) -> String {
    let columns = panels.len().clamp(1, 2);
    let panel_width = LABEL_WIDTH + PLOT_WIDTH;
    let width = MARGIN * 2.0 + panel_width * columns as f64 + PANEL_GAP * (columns - 1) as f64;
    let rows: Vec<&[Panel]> = panels.chunks(columns).collect();
    let row_height = |row: &[Panel]| row.iter().map(height).fold(0.0, f64::max);
    let legend = legend(panels, width);
    let total = MARGIN * 2.0 + rows.iter().map(|row| row_height(row)).sum::<f64>() + legend.height;

    let mut out = String::new();
    let _ = writeln!(
        out,
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0} {total:.0}" width="{width:.0}" height="{total:.0}" role="img">"#
    );
    let _ = writeln!(
        out,
        "<style>\n{STYLE}</style>\n{}<rect class=\"page\" width=\"100%\" height=\"100%\"/>",
        patterns("", paint)
    );
    let mut y = MARGIN;
    for (index, panel) in panels.iter().enumerate() {
        let column = index % columns;
        let x = MARGIN + (panel_width + PANEL_GAP) * column as f64;
        let letter = (panels.len() > 1).then(|| char::from(b'a' + (index % 26) as u8));
        PanelPainter { out: &mut out, panel, x, y }.draw(letter);
        if column + 1 == columns || index + 1 == panels.len() {
            y += row_height(rows[index / columns]);
        }
    }
    let _ = writeln!(out, "<g transform=\"translate(0 {y:.1})\">\n{}</g>\n</svg>", legend.svg);
    out
}

fn paint(name: &str) -> String {
    let fill = match name {
        "warning-a" => "#f2b632",
        "warning-b" => "#d99a12",
        "masked-a" => "#e7eaee",
        "idle-a" => "#f6f8fa",
        "unknown-a" => "#dccff2",
        "unknown-b" => return "stroke=\"#9277c7\" stroke-width=\"1\"".to_owned(),
        _ => "#8c959f",
    };
    format!("fill=\"{fill}\"")
}

fn height(panel: &Panel) -> f64 {
    TITLE_HEIGHT + STRIP_STEP * panel.strips.len() as f64 + AXIS_HEIGHT
}

struct PanelPainter<'a> {
    out: &'a mut String,
    panel: &'a Panel,
    x: f64,
    y: f64,
}

impl PanelPainter<'_> {
    fn draw(&mut self, letter: Option<char>) {
        let letter = letter.map_or(String::new(), |letter| format!("({letter}) "));
        let title = escaped(&format!("{letter}{}", self.panel.title));
        let (x, y) = (self.x, self.y + 14.0);
        let _ = writeln!(self.out, "<g>\n<text class=\"title\" x=\"{x:.1}\" y=\"{y:.1}\">{title}</text>");
        self.draw_axis();
        for (index, strip) in self.panel.strips.iter().enumerate() {
            self.strip(strip, self.strip_y(index));
        }
        self.zero();
        // Drawn after the line at zero, which would cross them out.
        for (index, strip) in self.panel.strips.iter().enumerate() {
            strip.segments.iter().for_each(|segment| self.segment_word(segment, self.strip_y(index)));
        }
        for arrow in &self.panel.moved {
            self.arrow(arrow.at, arrow.symptom, arrow.cause);
        }
        self.out.push_str("</g>\n");
    }

    fn strip_y(&self, index: usize) -> f64 {
        self.y + TITLE_HEIGHT + STRIP_STEP * index as f64
    }

    fn bottom(&self) -> f64 {
        self.strip_y(self.panel.strips.len())
    }

    fn axis(&self) -> Axis {
        let Panel { from, to, .. } = *self.panel;
        Axis { from, to, left: self.x + LABEL_WIDTH, width: PLOT_WIDTH }
    }

    fn strip(&mut self, strip: &Strip, y: f64) {
        let (class, indent) = if strip.inner { ("inner", 12.0) } else { ("label", 0.0) };
        let (x, text_y) = (self.x + indent, y + 15.5);
        let label = escaped(&end(&strip.label, LABEL_LETTERS));
        let _ = writeln!(self.out, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{text_y:.1}\">{label}</text>");
        for segment in &strip.segments {
            self.segment(strip, segment, y);
        }
    }

    fn segment(&mut self, strip: &Strip, segment: &Segment, y: f64) {
        let (left, right) = (self.axis().x(segment.from), self.axis().x(segment.to));
        let bar = Bar {
            x: &format!("{left:.1}"),
            width: &format!("{:.1}", right - left),
            y,
            class: class(segment.look),
            pattern: None,
            title: &self.words(strip, segment),
            own: segment.own_fault(),
        };
        bar.draw(self.out, "");
        self.out.push('\n');
    }

    fn segment_word(&mut self, segment: &Segment, y: f64) {
        let free = segment.own_fault().map_or(BAR_HEIGHT, |_| BAR_HEIGHT - OWN_HEIGHT);
        let ends = (self.axis().x(segment.from), self.axis().x(segment.to));
        self.out.push_str(&fitting_word(segment.look, ends, y, free));
    }

    /// The tooltip of a segment.
    fn words(&self, strip: &Strip, segment: &Segment) -> String {
        let zero = self.panel.zero.as_ref().map_or(Timestamp::ZERO, |(zero, _)| *zero);
        let (from, to) = (relative(segment.from, zero), relative(segment.to, zero));
        let mut words = format!("{}: {} from {from} s to {to} s", strip.name, long_word(segment.look));
        match (&segment.cause, segment.look) {
            (Some(cause), Look::Attributed) => {
                let _ = write!(words, ", owed to {cause}");
            }
            (Some(cause), _) => {
                let _ = write!(words, ", waits for {cause}");
            }
            _ => {}
        }
        if let Some(own) = segment.own {
            let _ = write!(words, ", reports {own} itself");
        }
        if let Some(said) = &segment.said {
            let _ = write!(words, ": {}", said.words());
        }
        words
    }

    fn draw_axis(&mut self) {
        let (left, right) = (self.x + LABEL_WIDTH, self.x + LABEL_WIDTH + PLOT_WIDTH);
        let (top, bottom) = (self.strip_y(0) - 4.0, self.bottom());
        let zero = self.panel.zero.as_ref().map_or(Timestamp::ZERO, |(zero, _)| *zero);
        for tick in self.axis().ticks(zero) {
            let (x, text_y) = (self.axis().x(tick), bottom + 15.0);
            let text = relative(tick, zero);
            let _ = writeln!(
                self.out,
                "<path class=\"grid\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/><text class=\"tick\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"{text_y:.1}\">{text}</text>"
            );
        }
        let (middle, title_y) = (left.midpoint(right), bottom + 31.0);
        let _ = writeln!(self.out, "<path class=\"axis\" d=\"M{left:.1} {bottom:.1}H{right:.1}\"/>");
        let _ = writeln!(
            self.out,
            "<text class=\"axis-title\" text-anchor=\"middle\" x=\"{middle:.1}\" y=\"{title_y:.1}\">time in s</text>"
        );
    }

    fn zero(&mut self) {
        let Some((at, event)) = &self.panel.zero else { return };
        if !(self.panel.from..=self.panel.to).contains(at) {
            return;
        }
        let (x, top, bottom) = (self.axis().x(*at), self.strip_y(0) - 6.0, self.bottom());
        let (tip, left, right, text_y) = (top + 1.0, x - 4.5, x + 4.5, top - 9.0);
        let event = escaped(event);
        let _ = writeln!(self.out, "<path class=\"zero\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/>");
        let _ = writeln!(
            self.out,
            "<path class=\"mark\" d=\"M{left:.1} {:.1}H{right:.1}L{x:.1} {tip:.1}Z\"/>",
            top - 7.0
        );
        let _ = writeln!(
            self.out,
            "<text class=\"event\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"{text_y:.1}\">{event}</text>"
        );
    }

    fn arrow(&mut self, at: Timestamp, symptom: usize, cause: usize) {
        let x = self.axis().x(at);
        let (from, to) = (self.strip_y(symptom), self.strip_y(cause));
        let down = to > from;
        let start = from + BAR_HEIGHT / 2.0;
        let end = if down { to } else { to + BAR_HEIGHT };
        let back = if down { end - 7.0 } else { end + 7.0 };
        let (left, right) = (x - 4.5, x + 4.5);
        let _ = writeln!(
            self.out,
            "<circle class=\"moved-head\" cx=\"{x:.1}\" cy=\"{start:.1}\" r=\"3\"/><path class=\"moved\" d=\"M{x:.1} {start:.1}V{back:.1}\"/><path class=\"moved-head\" d=\"M{left:.1} {back:.1}H{right:.1}L{x:.1} {end:.1}Z\"/>"
        );
    }
}

/// The state in a bar: its word, a letter or nothing, depending on the room.
fn fitting_word(look: Look, (left, right): (f64, f64), y: f64, height: f64) -> String {
    let width = |text: &str| text.chars().count() as f64 * LETTER_WIDTH;
    let fits = |text: &&str| width(text) + 4.0 <= right - left;
    let Some(text) = [short_word(look), letter(look)].into_iter().find(fits).filter(|text| !text.is_empty())
    else {
        return String::new();
    };
    let (x, text_y) = (left.midpoint(right), y + height / 2.0 + 3.9);
    let text_svg = word(class(look), &format!("{x:.1}"), text_y, text);
    if !matches!(look, Look::Masked | Look::NotRelevant | Look::Unknown | Look::NotKnown) {
        return text_svg;
    }
    let (plate, top, width) = (x - width(text) / 2.0, y + height / 2.0 - 6.0, width(text));
    format!(
        "<rect class=\"plate\" x=\"{plate:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"12\" rx=\"2\"/>{text_svg}"
    )
}

fn short_word(look: Look) -> &'static str {
    match look {
        Look::Ok => "OK",
        Look::Warning => "WARNING",
        Look::Error | Look::Attributed => "ERROR",
        Look::Masked | Look::NotRelevant => "IGNORE",
        Look::Unknown => "UNKNOWN",
        Look::True => "true",
        Look::False => "false",
        Look::NotKnown => "unknown",
    }
}

fn letter(look: Look) -> &'static str {
    match look {
        Look::Warning => "W",
        Look::Error | Look::Attributed => "E",
        Look::Masked | Look::NotRelevant => "I",
        Look::Unknown | Look::NotKnown => "?",
        Look::Ok | Look::True | Look::False => "",
    }
}

fn long_word(look: Look) -> &'static str {
    match look {
        Look::Ok => "OK",
        Look::Warning => "WARNING",
        Look::Error => "ERROR",
        Look::Attributed => "ERROR, owed to the cause that showed itself later",
        Look::Masked => "IGNORE, because what it depends on fails",
        Look::NotRelevant => "IGNORE, because the vehicle's state makes it pointless",
        Look::Unknown => "UNKNOWN",
        Look::True => "signal is true",
        Look::False => "signal is false",
        Look::NotKnown => "signal is unknown",
    }
}

struct Legend {
    svg: String,
    height: f64,
}

/// Explains all states and marks, also those that the figure does not contain; the arrow only if there is
/// one.
fn legend(panels: &[Panel], width: f64) -> Legend {
    let mut entries: Vec<(String, String)> = Look::ALL
        .into_iter()
        .map(|look| {
            let mut bar = format!("<rect class=\"bar bar-{}\" width=\"34\" height=\"14\"/>", class(look));
            bar += &fitting_word(look, (0.0, 34.0), 0.0, 14.0);
            (bar, long_word(look).to_owned())
        })
        .collect();
    let bar = "<rect class=\"bar bar-masked\" width=\"34\" height=\"14\"/><rect class=\"own own-error\" y=\"9\" width=\"34\" height=\"5\"/>";
    entries.push((bar.into(), "the bar is what it shows, a line at its foot what it reports itself".into()));
    let mark = "<path class=\"mark\" d=\"M12.5 0H21.5L17 7Z\"/><path class=\"zero\" d=\"M17 7V16\"/>";
    entries.push((mark.into(), "what is named above it happens here".into()));
    if panels.iter().any(|panel| !panel.moved.is_empty()) {
        let arrow = "<circle class=\"moved-head\" cx=\"17\" cy=\"14\" r=\"3\"/><path class=\"moved\" d=\"M17 14V6\"/><path class=\"moved-head\" d=\"M12.5 6H21.5L17 0Z\"/>";
        entries.push((arrow.into(), "the alarm moves from the symptom to its cause".into()));
    }
    let columns = if width > 700.0 { 2 } else { 1 };
    let column_width = (width - MARGIN * 2.0) / columns as f64;
    let per_column = entries.len().div_ceil(columns);
    let mut svg = String::new();
    for (index, (bar, words)) in entries.iter().enumerate() {
        let (x, y) = (
            MARGIN + column_width * (index / per_column) as f64,
            10.0 + LEGEND_STEP * (index % per_column) as f64,
        );
        let _ = writeln!(
            svg,
            "<g transform=\"translate({x:.1} {y:.1})\">{bar}<text x=\"44\" y=\"11.5\">{words}</text></g>"
        );
    }
    Legend { svg, height: LEGEND_STEP * per_column as f64 + 10.0 }
}

/// Seconds after `zero`, with a minus sign before it.
fn relative(at: Timestamp, zero: Timestamp) -> String {
    let (sign, nanos) = match at >= zero {
        true => ("", at.since(zero).as_nanos()),
        false => ("\u{2212}", zero.since(at).as_nanos()),
    };
    let text = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
    format!("{sign}{}", text.trim_end_matches('0').trim_end_matches('.'))
}
