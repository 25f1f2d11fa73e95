//! Numbers of an incident as lines over the time of its strips, with the limits of their monitors.

use std::fmt::Write as _;

use super::content::broken;
use crate::texts::{IncidentWords, NAME, clean};
use telltale_record::story::{Series, Story};

/// The box in which a line is drawn.
const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 40.0;
/// Above and below the line.
const MARGIN: f64 = 3.0;

pub(crate) struct Plot {
    pub name: String,
    /// The name as HTML, with places where its line may break.
    pub broken: String,
    /// The least and the greatest number, and the limits.
    pub range: String,
    /// The paths of an SVG.
    pub lines: String,
}

pub(super) fn plots(it: &IncidentWords, story: &Story) -> Vec<Plot> {
    story.series.iter().map(|series| plot(it, series, (story.from_ms, story.to_ms))).collect()
}

fn plot(it: &IncidentWords, series: &Series, span: (i64, i64)) -> Plot {
    let name = match &*series.node {
        "" => it.vehicle_speed.to_owned(),
        node => format!("{node} {}", series.key),
    };
    drawn(&name, series, span)
}

/// Numbers as a picture of a span of time, in milliseconds since 1970.
pub fn drawn(name: &str, series: &Series, span: (i64, i64)) -> Plot {
    drawn_within(name, series, &[], &[], span)
}

/// The same within a band: at each point the least and the greatest number, which the points are means of. The numbers of
/// `also` lie in the picture, too.
pub fn drawn_within(
    name: &str,
    series: &Series,
    band: &[Option<(f64, f64)>],
    also: &[f64],
    (from_ms, to_ms): (i64, i64),
) -> Plot {
    let ends = band.iter().flatten().flat_map(|&(least, most)| [least, most]);
    let numbers = || series.points.iter().filter_map(|(_, number)| *number).chain(ends.clone());
    let (least, most) =
        (numbers().fold(f64::INFINITY, f64::min), numbers().fold(f64::NEG_INFINITY, f64::max));
    let limits = || series.limits.iter().map(|limit| limit.value).chain(also.iter().copied());
    let (low, high) = (limits().fold(least, f64::min), limits().fold(most, f64::max));
    let y = |number: f64| {
        let part = if high > low { (number - low) / (high - low) } else { 0.5 };
        HEIGHT - MARGIN - part * (HEIGHT - 2.0 * MARGIN)
    };
    let x = |at_ms: i64| WIDTH * (at_ms - from_ms) as f64 / (to_ms - from_ms).max(1) as f64;
    let mut lines = String::new();
    for limit in &series.limits {
        let class = if limit.name.starts_with("error") { "limit-error" } else { "limit-warning" };
        let _ = write!(lines, "<path class=\"limit {class}\" d=\"M0 {y:.1}H{WIDTH}\"/>", y = y(limit.value));
    }
    let points: Vec<(i64, Option<(f64, f64)>)> =
        series.points.iter().map(|&(at_ms, _)| at_ms).zip(band.iter().copied()).collect();
    for known in points.split(|(_, band)| band.is_none()).filter(|known| !known.is_empty()) {
        let edge =
            |&(at_ms, band): &(i64, Option<(f64, f64)>)| band.map(|(least, most)| (at_ms, least, most));
        let mut area = String::new();
        for (at_ms, _, most) in known.iter().filter_map(edge) {
            let _ = write!(area, "{}{:.1} {:.1}", if area.is_empty() { 'M' } else { 'L' }, x(at_ms), y(most));
        }
        for (at_ms, least, _) in known.iter().rev().filter_map(edge) {
            let _ = write!(area, "L{:.1} {:.1}", x(at_ms), y(least));
        }
        let _ = write!(lines, "<path class=\"band\" d=\"{area}Z\"/>");
    }
    let mut path = String::new();
    let mut is_drawn = false;
    for &(at_ms, number) in &series.points {
        if let Some(number) = number {
            let _ = write!(path, "{}{:.1} {:.1}", if is_drawn { 'L' } else { 'M' }, x(at_ms), y(number));
        }
        is_drawn = number.is_some();
    }
    let _ = write!(lines, "<path d=\"{path}\"/>");
    let mut range = format!("{} … {}", rounded(least), rounded(most));
    for limit in &series.limits {
        let _ = write!(range, ", {} {}", limit.name, rounded(limit.value));
    }
    Plot { broken: broken(name), name: clean(name, 2 * NAME), range, lines }
}

/// Three digits, or all before the point.
fn rounded(number: f64) -> String {
    let digits = if number == 0.0 { 0 } else { (2 - number.abs().log10().floor() as i32).clamp(0, 6) };
    let text = format!("{number:.*}", digits as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texts::Lang;
    use telltale_record::story::Limit;

    #[test]
    fn a_line_has_gaps_and_its_limits_lie_in_the_picture() {
        let points = vec![(0, Some(1.0)), (250, Some(3.0)), (500, None), (750, Some(2.0)), (1000, Some(2.0))];
        let limits = vec![Limit { name: "error_above".into(), value: 5.0 }];
        let series = Series { node: "can/<battery>".into(), key: "value".into(), points, limits };
        let story = Story { from_ms: 0, to_ms: 1000, series: vec![series], ..Story::default() };
        let plots = plots(IncidentWords::of(Lang::En), &story);
        let Plot { name, broken, range, lines } = &plots[0];
        assert_eq!((&**name, &**range), ("can/<battery> value", "1 … 3, error_above 5"));
        assert!(broken.contains("&lt;battery&gt;"), "{broken}");
        assert!(lines.contains("class=\"limit limit-error\" d=\"M0 3.0H1000\""), "{lines}");
        assert!(lines.ends_with("d=\"M0.0 37.0L250.0 20.0M750.0 28.5L1000.0 28.5\"/>"), "{lines}");
    }

    #[test]
    fn numbers_are_short() {
        let short =
            [(0.0, "0"), (0.012_345, "0.0123"), (9.876_54, "9.88"), (20.0, "20"), (12_345.6, "12346")];
        for (number, text) in short {
            assert_eq!(rounded(number), text);
        }
    }
}
