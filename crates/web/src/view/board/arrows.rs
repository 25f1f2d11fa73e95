//! The lines between tiles: right angles with round corners, in the gaps, never across a tile.

use std::fmt::Write;

use super::{Board, Tile};

/// The inside of the board in pixels of the reference display. Other sizes stretch the drawing.
const BOARD: (f64, f64) = (860.0, 405.0);
/// Share of the board that the tiles take, by number of columns and rows.
pub const WIDTH: [f64; 7] = [1.0, 0.36, 0.68, 1.0, 1.0, 1.0, 1.0];
pub const HEIGHT: [f64; 8] = [1.0, 0.56, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
/// Gap between columns and rows, as a share of what the tiles take.
pub const GAP_X: [f64; 7] = [0.0, 0.0, 0.11, 0.05, 0.026, 0.024, 0.022];
pub const GAP_Y: [f64; 8] = [0.0, 0.0, 0.11, 0.08, 0.06, 0.035, 0.03, 0.025];

const CORNER: f64 = 9.0;
/// Between the end of the line and the tile; the head covers it.
const AIR: f64 = 6.0;

/// One arrow as SVG path data.
#[derive(Debug, Clone, PartialEq)]
pub struct TileArrow {
    pub from: Tile,
    pub to: Tile,
    pub line: String,
    /// Where the head touches the tile, in percent of the drawing, and the head as a path around that point, in
    /// pixels: it keeps its shape however the drawing is stretched.
    pub tip: (String, String),
    pub head: &'static str,
}

/// The size of the drawing and its arrows, in the order of `edges`.
pub fn draw(board: &Board, edges: &[(Tile, Tile)]) -> ((f64, f64), Vec<TileArrow>) {
    let plan = Plan::new(board);
    let mut routes: Vec<ArrowRoute> = edges.iter().map(|&edge| plan.route(board, edge)).collect();
    plan.spread_ends(&mut routes);
    plan.spread_parallel_lines(&mut routes);
    let arrows = routes.iter().map(|route| plan.arrow(route)).collect();
    ((plan.width, plan.height), arrows)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum TileSide {
    Left,
    Right,
    Top,
    Bottom,
}

/// An end of an arrow: a point on the side of a tile.
#[derive(Debug, Clone, Copy)]
struct ArrowEnd {
    tile: Tile,
    place: (usize, usize),
    side: TileSide,
    /// Where on the side, from 0 to 1.
    at: f64,
}

#[derive(Debug, Clone)]
struct ArrowRoute {
    start: ArrowEnd,
    end: ArrowEnd,
    /// The gap below this row in which the line runs sideways, with its height there; the first
    /// belongs to the start, the last to the end.
    rows: Vec<(usize, f64)>,
    /// The gap right of this column through which the line passes rows.
    column: Option<(usize, f64)>,
}

struct Plan {
    width: f64,
    height: f64,
    columns: usize,
    rows: usize,
    tile: (f64, f64),
    gap: (f64, f64),
}

impl Plan {
    fn new(board: &Board) -> Plan {
        let share = |table: &[f64], index: usize| table[index.min(table.len() - 1)];
        let width = BOARD.0 * share(&WIDTH, board.columns);
        let height = BOARD.1 * share(&HEIGHT, board.rows);
        let gap = (width * share(&GAP_X, board.columns), height * share(&GAP_Y, board.rows));
        let (columns, rows) = (board.columns as f64, board.rows as f64);
        let tile = ((width - gap.0 * (columns - 1.0)) / columns, (height - gap.1 * (rows - 1.0)) / rows);
        Plan { width, height, columns: board.columns, rows: board.rows, tile, gap }
    }

    fn route(&self, board: &Board, (from, to): (Tile, Tile)) -> ArrowRoute {
        let (a, b) = (board.places[from], board.places[to]);
        let end = |tile, place, side| ArrowEnd { tile, place, side, at: 0.5 };
        let route = |out: TileSide, into: TileSide, rows: Vec<usize>, column: Option<usize>| ArrowRoute {
            start: end(from, a, out),
            end: end(to, b, into),
            rows: rows.into_iter().map(|row| (row, 0.5)).collect(),
            column: column.map(|column| (column, 0.5)),
        };
        if a.1 == b.1 {
            return match b.0.wrapping_sub(a.0) {
                1 => route(TileSide::Right, TileSide::Left, vec![], None),
                usize::MAX => route(TileSide::Left, TileSide::Right, vec![], None),
                // Past the tiles between: below them, or above in the last row of several.
                _ if a.1 + 1 == self.rows && a.1 > 0 => {
                    route(TileSide::Top, TileSide::Top, vec![a.1 - 1], None)
                }
                _ => route(TileSide::Bottom, TileSide::Bottom, vec![a.1], None),
            };
        }
        let down = a.1 < b.1;
        let (out, into) =
            if down { (TileSide::Bottom, TileSide::Top) } else { (TileSide::Top, TileSide::Bottom) };
        let (first, last) = if down { (a.1, b.1 - 1) } else { (a.1 - 1, b.1) };
        if first == last {
            return route(out, into, vec![first], None);
        }
        let column = if b.0 > a.0 || b.0 + 1 == self.columns { b.0.saturating_sub(1) } else { b.0 };
        route(out, into, vec![first, last], Some(column))
    }

    /// Where several lines meet one side of a tile they stand apart, in the order of where they go.
    fn spread_ends(&self, routes: &mut [ArrowRoute]) {
        let mut ends: Vec<(Tile, TileSide, usize, usize, usize)> = Vec::new();
        for (index, route) in routes.iter().enumerate() {
            let far = |end: &ArrowEnd| end.place.0 * 16 + end.place.1;
            ends.push((route.start.tile, route.start.side, far(&route.end), index, 0));
            ends.push((route.end.tile, route.end.side, far(&route.start), index, 1));
        }
        ends.sort_unstable();
        for group in ends.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            for (position, &(_, side, _, index, end)) in group.iter().enumerate() {
                // Neighbours in one row are always joined by a straight line in the middle.
                if matches!(side, TileSide::Left | TileSide::Right) {
                    continue;
                }
                let at = (position + 1) as f64 / (group.len() + 1) as f64;
                let end = if end == 0 { &mut routes[index].start } else { &mut routes[index].end };
                end.at = at;
            }
        }
    }

    /// Lines that would lie on one another in a gap get tracks of their own.
    fn spread_parallel_lines(&self, routes: &mut [ArrowRoute]) {
        for row in 0..self.rows {
            let mut spans: Vec<(f64, f64, usize, usize)> = Vec::new();
            for (index, route) in routes.iter().enumerate() {
                for (part, _) in route.rows.iter().enumerate().filter(|(_, track)| track.0 == row) {
                    let (x1, x2) = self.span(route, part);
                    if (x1 - x2).abs() > 1.0 {
                        spans.push((x1.min(x2), x1.max(x2), index, part));
                    }
                }
            }
            spans.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let (tracks, count) = tracks(&spans);
            for (&(.., index, part), track) in spans.iter().zip(tracks) {
                routes[index].rows[part].1 = (track + 1) as f64 / (count + 1) as f64;
            }
        }
        for column in 0..self.columns {
            let members: Vec<usize> = (0..routes.len())
                .filter(|&index| routes[index].column.is_some_and(|(at, _)| at == column))
                .collect();
            for (position, &index) in members.iter().enumerate() {
                routes[index].column = Some((column, (position + 1) as f64 / (members.len() + 1) as f64));
            }
        }
    }

    /// From where to where the line runs sideways in its first or last gap between rows.
    fn span(&self, route: &ArrowRoute, part: usize) -> (f64, f64) {
        let (start, end) = (self.point(&route.start).0, self.point(&route.end).0);
        match route.column {
            None => (start, end),
            Some(column) if part == 0 => (start, self.column_x(column)),
            Some(column) => (self.column_x(column), end),
        }
    }

    fn column_x(&self, (column, at): (usize, f64)) -> f64 {
        if self.columns == 1 {
            // A single column has no gap: the free ground beside it serves.
            return self.width + 12.0 + 24.0 * at;
        }
        (column + 1) as f64 * self.tile.0 + (column as f64 + at) * self.gap.0
    }

    fn row_y(&self, (row, at): (usize, f64)) -> f64 {
        let gap = if self.rows == 1 { 48.0 } else { self.gap.1 };
        (row + 1) as f64 * self.tile.1 + row as f64 * self.gap.1 + at * gap
    }

    fn point(&self, end: &ArrowEnd) -> (f64, f64) {
        let (x, y) = (
            end.place.0 as f64 * (self.tile.0 + self.gap.0),
            end.place.1 as f64 * (self.tile.1 + self.gap.1),
        );
        match end.side {
            TileSide::Left => (x, y + self.tile.1 * end.at),
            TileSide::Right => (x + self.tile.0, y + self.tile.1 * end.at),
            TileSide::Top => (x + self.tile.0 * end.at, y),
            TileSide::Bottom => (x + self.tile.0 * end.at, y + self.tile.1),
        }
    }

    fn arrow(&self, route: &ArrowRoute) -> TileArrow {
        let (start, tip) = (self.point(&route.start), self.point(&route.end));
        let mut points = vec![start];
        if let Some(&first) = route.rows.first() {
            points.push((start.0, self.row_y(first)));
            if let (Some(column), Some(&last)) = (route.column, route.rows.last()) {
                let x = self.column_x(column);
                points.push((x, self.row_y(first)));
                points.push((x, self.row_y(last)));
                points.push((tip.0, self.row_y(last)));
            } else {
                points.push((tip.0, self.row_y(first)));
            }
        }
        let ((dx, dy), head) = match route.end.side {
            TileSide::Left => ((1.0, 0.0), "M-2 0L-14 -7.5L-14 7.5z"),
            TileSide::Right => ((-1.0, 0.0), "M2 0L14 -7.5L14 7.5z"),
            TileSide::Top => ((0.0, 1.0), "M0 -2L-7.5 -14L7.5 -14z"),
            TileSide::Bottom => ((0.0, -1.0), "M0 2L-7.5 14L7.5 14z"),
        };
        points.push((tip.0 - dx * AIR, tip.1 - dy * AIR));
        let percent = |at: f64, of: f64| format!("{:.2}", 100.0 * at / of);
        TileArrow {
            from: route.start.tile,
            to: route.end.tile,
            line: rounded(&points),
            tip: (percent(tip.0, self.width), percent(tip.1, self.height)),
            head,
        }
    }
}

/// First fit: the track of each span, sorted by its begin, and how many there are.
fn tracks(spans: &[(f64, f64, usize, usize)]) -> (Vec<usize>, usize) {
    let mut ends: Vec<f64> = Vec::new();
    let tracks = spans.iter().map(|&(begin, end, ..)| {
        let track = ends.iter().position(|&taken| taken + 8.0 < begin).unwrap_or(ends.len());
        if track == ends.len() {
            ends.push(end);
        } else {
            ends[track] = end;
        }
        track
    });
    let tracks = tracks.collect();
    (tracks, ends.len())
}

/// A line through the points with round corners.
fn rounded(points: &[(f64, f64)]) -> String {
    let mut path = String::new();
    for (index, &(x, y)) in points.iter().enumerate() {
        let corner = (index > 0).then(|| points.get(index + 1)).flatten();
        let Some(&next) = corner else {
            let command = if index == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{command}{x:.1} {y:.1}");
            continue;
        };
        let (before, after) = (points[index - 1], next);
        let length = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
        let (one, two) = (length(before, (x, y)), length((x, y), after));
        let radius = CORNER.min(one / 2.0).min(two / 2.0);
        if radius < 0.5 {
            continue;
        }
        let toward =
            |to: (f64, f64), way: f64| (x + (to.0 - x) / way * radius, y + (to.1 - y) / way * radius);
        let (from, to) = (toward(before, one), toward(after, two));
        let _ = write!(path, "L{:.1} {:.1}Q{x:.1} {y:.1} {:.1} {:.1}", from.0, from.1, to.0, to.1);
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: usize, rows: usize) -> Board {
        let places = (0..columns * rows).map(|tile| (tile % columns, tile / columns)).collect();
        Board { places, columns, rows, ..Board::default() }
    }

    /// Every number of a path, as points.
    fn points(path: &str) -> Vec<(f64, f64)> {
        let numbers: Vec<f64> = path
            .split(|letter: char| !(letter.is_ascii_digit() || letter == '.' || letter == '-'))
            .filter_map(|number| number.parse().ok())
            .collect();
        numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect()
    }

    #[test]
    fn neighbours_are_joined_by_a_straight_line() {
        let (_, arrows) = draw(&grid(4, 2), &[(0, 1)]);
        let line = points(&arrows[0].line);
        assert_eq!(line.len(), 2);
        assert!((line[0].1 - line[1].1).abs() < 0.1 && line[0].0 < line[1].0, "{line:?}");
    }

    #[test]
    fn no_line_crosses_a_tile() {
        for (columns, rows) in [(1, 1), (2, 1), (4, 1), (1, 3), (3, 3), (4, 2), (4, 3), (6, 4)] {
            let board = grid(columns, rows);
            let plan = Plan::new(&board);
            let tiles = columns * rows;
            for edge in (0..tiles * tiles).map(|pair| (pair / tiles, pair % tiles)).filter(|(a, b)| a != b) {
                let (_, arrows) = draw(&board, &[edge]);
                for pair in points(&arrows[0].line).windows(2) {
                    let middle = ((pair[0].0 + pair[1].0) / 2.0, (pair[0].1 + pair[1].1) / 2.0);
                    for place in &board.places {
                        let x = place.0 as f64 * (plan.tile.0 + plan.gap.0);
                        let y = place.1 as f64 * (plan.tile.1 + plan.gap.1);
                        let inside = middle.0 > x + 1.0
                            && middle.0 < x + plan.tile.0 - 1.0
                            && middle.1 > y + 1.0
                            && middle.1 < y + plan.tile.1 - 1.0;
                        assert!(!inside, "{columns}x{rows} {edge:?}: {middle:?} in {place:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn lines_in_one_gap_keep_apart() {
        let (_, arrows) = draw(&grid(4, 2), &[(0, 6), (1, 7)]);
        let level = |arrow: &TileArrow| points(&arrow.line)[2].1;
        assert!((level(&arrows[0]) - level(&arrows[1])).abs() > 8.0);
    }

    /// All dependencies of the paper's shuttle at once.
    #[test]
    fn the_lines_of_the_shuttle_lie_apart() {
        let (sensors, localization, perception, prediction) = (0, 1, 2, 3);
        let (can, mission, planning, execution) = (4, 5, 6, 7);
        let edges = [
            (sensors, localization),
            (can, localization),
            (sensors, perception),
            (localization, perception),
            (perception, prediction),
            (localization, planning),
            (prediction, planning),
            (mission, planning),
            (planning, execution),
            (can, execution),
        ];
        let (_, arrows) = draw(&grid(4, 2), &edges);
        let mut runs: Vec<(f64, f64, f64)> = Vec::new();
        for arrow in &arrows {
            for pair in points(&arrow.line).windows(2) {
                let ((x1, y1), (x2, y2)) = (pair[0], pair[1]);
                if (y1 - y2).abs() < 0.1 && (x1 - x2).abs() > CORNER {
                    runs.push((y1, x1.min(x2), x1.max(x2)));
                }
            }
        }
        assert_eq!(runs.len(), edges.len(), "each has one way sideways: {runs:?}");
        for (index, a) in runs.iter().enumerate() {
            for b in &runs[..index] {
                let beside = a.1 < b.2 && b.1 < a.2;
                assert!(!beside || (a.0 - b.0).abs() > 8.0, "{a:?} lies on {b:?}");
            }
        }
    }

    #[test]
    fn the_stylesheet_has_the_same_shares() {
        let css = include_str!("../../../../../static/telltale.css");
        let percent = |share: f64| format!("{}%", (share * 1000.0).round() / 10.0);
        for columns in 1..GAP_X.len() {
            let rule = format!(
                ".columns-{columns} {{ --share-x: {}; --gap-x: {}; --columns: {columns} }}",
                percent(WIDTH[columns]),
                percent(GAP_X[columns])
            );
            assert!(css.contains(&rule), "{rule}");
        }
        for rows in 1..GAP_Y.len() {
            let rule = format!(
                ".rows-{rows} {{ --share-y: {}; --gap-y: {}; --rows: {rows} }}",
                percent(HEIGHT[rows]),
                percent(GAP_Y[rows])
            );
            assert!(css.contains(&rule), "{rule}");
        }
    }
}
