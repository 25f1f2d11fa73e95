//! The screen of `watch`: a pure function from the vehicle and its freshness to a frame. A state is a colour, a
//! word and a symbol. What is not fresh is grey and says so.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

use super::freshness::Freshness;
use super::snapshot::{Group, Vehicle};
use crate::engine::state::State;

const TILE_COLUMNS: u16 = 26;
const TILE_LINES: u16 = 4;

/// Whether colours may be used (<https://no-color.org>).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colours {
    Yes,
    No,
}

impl Colours {
    pub fn of_environment() -> Colours {
        let is_set = std::env::var_os("NO_COLOR").is_some_and(|it| !it.is_empty());
        if is_set { Colours::No } else { Colours::Yes }
    }

    fn of(self, state: State) -> Style {
        let (colour, is_loud) = match state {
            State::Ok => (Color::Green, false),
            State::Warning => (Color::Yellow, true),
            State::Error => (Color::Red, true),
            State::Unknown => (Color::Magenta, true),
            State::Ignore => (Color::DarkGray, false),
        };
        let style = if self == Colours::Yes { Style::new().fg(colour) } else { Style::new() };
        if is_loud { style.add_modifier(Modifier::BOLD) } else { style }
    }

    fn faded(self) -> Style {
        if self == Colours::Yes {
            Style::new().fg(Color::DarkGray)
        } else {
            Style::new().add_modifier(Modifier::DIM)
        }
    }
}

const fn symbol(state: State) -> &'static str {
    match state {
        State::Ok => "✓",
        State::Warning => "▲",
        State::Error => "✖",
        State::Unknown => "?",
        State::Ignore => "–",
    }
}

fn word(state: State) -> String {
    state.as_str().to_uppercase()
}

/// Draws the whole screen.
pub fn draw(
    frame: &mut Frame<'_>,
    place: &str,
    vehicle: Option<&Vehicle>,
    freshness: Freshness,
    colours: Colours,
) {
    let area = frame.area();
    let Some(vehicle) = vehicle else {
        frame.render_widget(Paragraph::new(format!("{place}  {}", freshness.words())), area);
        return;
    };
    let mut rest = area;
    for line in [connection(place, vehicle, freshness), head(vehicle, freshness, colours)] {
        put(frame, &mut rest, line);
    }
    let below = below(vehicle, freshness, colours);
    tiles(frame, &mut rest, vehicle, freshness, colours, below.len() as u16);
    list(frame, rest, below);
}

/// The line that says whether all this is the present.
fn connection(place: &str, vehicle: &Vehicle, freshness: Freshness) -> Line<'static> {
    let at = vehicle.head.at.to_string();
    match freshness {
        Freshness::Live => Line::from(format!("{place}  live, {at}  (q quits)")),
        late => {
            let words = format!(" {}  (what stands here is of {at}) ", late.words());
            Line::from(vec![
                Span::styled(words, Style::new().add_modifier(Modifier::REVERSED | Modifier::BOLD)),
                Span::raw(format!("  {place}")),
            ])
        }
    }
}

fn head(vehicle: &Vehicle, freshness: Freshness, colours: Colours) -> Line<'static> {
    let head = &vehicle.head;
    let operator = head.operator.as_ref().map_or("no operator".to_owned(), |it| format!("operator {it}"));
    let recording = if head.recording { ", an incident is recorded" } else { "" };
    let about = format!("  {}, {}, {operator}{recording}", head.stage.as_str(), head.motion.words());
    let style = if freshness.is_lost() { colours.faded() } else { Style::new() };
    Line::from(vec![state(head.overall, freshness, colours), Span::styled(about, style)])
}

/// A state; of data that are lost, the last one that is known.
fn state(state: State, freshness: Freshness, colours: Colours) -> Span<'static> {
    match freshness.is_lost() {
        true => Span::styled(format!("? was {}", word(state)), colours.faded()),
        false => Span::styled(format!("{} {}", symbol(state), word(state)), colours.of(state)),
    }
}

/// Puts a line at the top of what is left.
fn put(frame: &mut Frame<'_>, rest: &mut Rect, line: Line<'_>) {
    if rest.height > 0 {
        frame.render_widget(line, Rect { height: 1, ..*rest });
        *rest = Rect { y: rest.y + 1, height: rest.height - 1, ..*rest };
    }
}

/// Draws the tiles; in one line each where there is no room for more, and the worst first where there is not even
/// that.
fn tiles(
    frame: &mut Frame<'_>,
    rest: &mut Rect,
    vehicle: &Vehicle,
    freshness: Freshness,
    colours: Colours,
    wanted_below: u16,
) {
    let all: Vec<&Group> = vehicle.tiles().collect();
    let across = (rest.width / TILE_COLUMNS).max(1);
    let rows = (all.len() as u16).div_ceil(across);
    if rest.width >= TILE_COLUMNS && rows * TILE_LINES + wanted_below <= rest.height {
        for (index, group) in (0_u16..).zip(all) {
            let (row, column) = (index / across, index % across);
            let area = Rect {
                x: rest.x + column * TILE_COLUMNS,
                y: rest.y + row * TILE_LINES,
                width: TILE_COLUMNS,
                height: TILE_LINES,
            };
            tile(frame, area, group, freshness, colours);
        }
        let used = rows * TILE_LINES;
        *rest = Rect { y: rest.y + used, height: rest.height - used, ..*rest };
        return;
    }
    let mut all = all;
    all.sort_by_key(|group| std::cmp::Reverse(group.state));
    // Causes and requests keep the lower half.
    let room = usize::from((rest.height - wanted_below.min(rest.height / 2)).max(1));
    let hidden = if all.len() > room { all.len() - (room - 1) } else { 0 };
    for group in &all[..all.len() - hidden] {
        let mut line = Line::from(state(group.state, freshness, colours));
        line.push_span(Span::raw(format!(
            "  {}  {}/{}  {}",
            group.name,
            group.ok,
            group.counted,
            group.why()
        )));
        put(frame, rest, line);
    }
    if hidden > 0 {
        put(frame, rest, Line::from(format!("… and {hidden} more components: make the window larger")));
    }
}

fn tile(frame: &mut Frame<'_>, area: Rect, group: &Group, freshness: Freshness, colours: Colours) {
    let style = if freshness.is_lost() { colours.faded() } else { colours.of(group.state) };
    let mut first = Line::from(state(group.state, freshness, colours));
    first.push_span(Span::styled(
        format!("  {}/{}", group.ok, group.counted),
        if freshness.is_lost() { style } else { Style::new() },
    ));
    let why = Line::styled(group.why(), colours.faded());
    let block = Block::bordered().border_style(style).title(format!(" {:.20} ", group.name));
    frame.render_widget(Paragraph::new(vec![first, why]).block(block), area);
}

/// Requests, causes and alarms, the most urgent first.
fn below(vehicle: &Vehicle, freshness: Freshness, colours: Colours) -> Vec<Line<'static>> {
    let style = if freshness.is_lost() { colours.faded() } else { Style::new() };
    let mut lines = Vec::new();
    for countermeasure in &vehicle.countermeasures {
        lines.push(Line::styled(
            format!("requested: {}", countermeasure.words()),
            style.add_modifier(Modifier::BOLD),
        ));
    }
    for shelved in &vehicle.shelved {
        lines.push(Line::styled(format!("shelved: {} {}", shelved.node, shelved.words()), style));
    }
    for root in &vehicle.roots {
        let (of, message) = vehicle.says(&root.node);
        let mut line = Line::from(state(of.unwrap_or(State::Unknown), freshness, colours));
        line.push_span(Span::styled(format!("  cause: {}  {message}  ({})", root.node, root.words()), style));
        lines.push(line);
    }
    if vehicle.roots.is_empty() {
        lines.push(Line::styled("no causes", style));
    }
    let open = vehicle.open_alarms();
    if open > 0 {
        let active = vehicle.alarms.iter().filter(|alarm| alarm.active).count();
        lines.push(Line::styled(format!("alarms: {open} not acknowledged, {active} active"), style));
    }
    lines
}

/// Lists what has room, and says how much has not.
fn list(frame: &mut Frame<'_>, mut rest: Rect, lines: Vec<Line<'static>>) {
    let room = usize::from(rest.height);
    let hidden = if lines.len() > room { lines.len() - room.saturating_sub(1) } else { 0 };
    let shown = lines.len() - hidden;
    for line in lines.into_iter().take(shown) {
        put(frame, &mut rest, line);
    }
    if hidden > 0 {
        put(frame, &mut rest, Line::from(format!("… and {hidden} more lines: make the window larger")));
    }
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use ratatui::buffer::Buffer;

    use super::super::snapshot::tests::golden;
    use super::*;
    use crate::engine::time;

    fn drawn(columns: u16, lines: u16, freshness: Freshness, colours: Colours) -> (String, Buffer) {
        let mut terminal = Terminal::new(TestBackend::new(columns, lines)).unwrap();
        let vehicle = golden();
        terminal.draw(|frame| draw(frame, "http://a", Some(&vehicle), freshness, colours)).unwrap();
        let buffer = terminal.backend().buffer().clone();
        let rows = buffer.content().chunks(usize::from(columns));
        let text = rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>() + "\n").collect();
        (text, buffer)
    }

    fn colours_of(buffer: &Buffer) -> Vec<Color> {
        buffer.content().iter().map(|cell| cell.fg).filter(|it| *it != Color::Reset).collect()
    }

    #[test]
    fn a_state_is_a_colour_a_word_and_a_symbol() {
        let (text, buffer) = drawn(110, 40, Freshness::Live, Colours::Yes);
        for said in [
            "live",
            "✖ ERROR",
            "– IGNORE",
            " Sensors ",
            "waits for",
            "cause: sensors/velodyne_packet_alive  no packets",
            "active",
        ] {
            assert!(text.contains(said), "{said}\n{text}");
        }
        assert!(colours_of(&buffer).contains(&Color::Red));
        let (text, buffer) = drawn(110, 40, Freshness::Live, Colours::No);
        assert!(text.contains("✖ ERROR") && colours_of(&buffer).is_empty());
    }

    #[test]
    fn what_is_not_fresh_never_looks_live() {
        let (text, _) = drawn(110, 40, Freshness::Stale(time::Span::from_millis(1500)), Colours::Yes);
        assert!(text.contains("STALE, last data 1 s ago") && !text.contains("  live,"), "{text}");
        let lost = Freshness::Lost { since: Some(time::Span::from_secs(3)), connected: false };
        let (text, buffer) = drawn(110, 40, lost, Colours::Yes);
        assert!(text.contains("NOT CONNECTED, last data 3 s ago") && text.contains("? was ERROR"), "{text}");
        assert!(!text.contains('✖') && colours_of(&buffer).iter().all(|it| *it == Color::DarkGray));
    }

    #[test]
    fn a_small_window_says_what_it_hides_and_shows_the_worst() {
        for (columns, lines) in [(60, 8), (20, 5), (110, 4), (1, 1), (40, 3)] {
            let (text, _) = drawn(columns, lines, Freshness::Live, Colours::Yes);
            if columns >= 60 {
                assert!(text.contains("more") && text.contains("✖ ERROR"), "{columns}x{lines}\n{text}");
            }
        }
        let (text, _) = drawn(60, 8, Freshness::Live, Colours::Yes);
        assert!(text.contains("Sensors") && text.contains("more components"), "{text}");
    }
}
