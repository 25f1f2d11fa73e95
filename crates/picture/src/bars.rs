//! Draws strips of states: a bar for each segment, with patterns beside the colours.

use std::fmt::Write as _;

use super::svg::escaped;
use telltale_engine::state::State;

pub const BAR_HEIGHT: f64 = 22.0;
/// The line at the foot of a bar: what a node reports behind an IGNORE.
pub const OWN_HEIGHT: f64 = 5.0;

/// The paints of the patterns, two for each.
const PAINTS: [&str; 8] =
    ["warning-a", "warning-b", "masked-a", "masked-b", "idle-a", "idle-b", "unknown-a", "unknown-b"];

const PATTERNS: &str = r##"<defs>
<pattern id="{id}warning" width="9" height="9" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><rect width="9" height="9" {warning-a}/><rect width="2" height="9" {warning-b}/></pattern>
<pattern id="{id}masked" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(-45)"><rect width="6" height="6" {masked-a}/><rect width="1.5" height="6" {masked-b}/></pattern>
<pattern id="{id}not-relevant" width="7" height="7" patternUnits="userSpaceOnUse"><rect width="7" height="7" {idle-a}/><circle cx="3.5" cy="3.5" r="1.1" {idle-b}/></pattern>
<pattern id="{id}unknown" width="8" height="8" patternUnits="userSpaceOnUse"><rect width="8" height="8" {unknown-a}/><path d="M0 0L8 8M8 0L0 8" {unknown-b}/></pattern>
</defs>
"##;

/// The patterns of states as `defs`: `id` stands before their names, `paint` says the attributes of a paint.
pub fn patterns(id: &str, paint: impl Fn(&'static str) -> String) -> String {
    let named = PATTERNS.replace("{id}", id);
    PAINTS.iter().fold(named, |text, name| text.replace(&format!("{{{name}}}"), &paint(name)))
}

/// One segment. Lengths along the strip are as SVG writes them: `12.5`, `3.40%`.
#[derive(Debug, Clone, Copy)]
pub struct Bar<'a> {
    pub x: &'a str,
    pub width: &'a str,
    pub y: f64,
    pub class: &'a str,
    /// The pattern that fills it, where the stylesheet does not.
    pub pattern: Option<&'a str>,
    /// The tooltip.
    pub title: &'a str,
    /// What the node reports behind an IGNORE.
    pub own: Option<State>,
}

impl Bar<'_> {
    /// The bar with `inside` drawn over it.
    pub fn draw(&self, out: &mut String, inside: &str) {
        let Bar { x, width, y, class, .. } = self;
        let fill = self.pattern.map(|pattern| format!(" fill=\"url(#{pattern})\"")).unwrap_or_default();
        let _ = write!(
            out,
            "<g><title>{}</title><rect class=\"bar bar-{class}\"{fill} x=\"{x}\" y=\"{y:.1}\" width=\"{width}\" height=\"{BAR_HEIGHT}\"/>",
            escaped(self.title)
        );
        if let Some(own) = self.own {
            let own_y = y + BAR_HEIGHT - OWN_HEIGHT;
            let _ = write!(
                out,
                "<rect class=\"own own-{own}\" x=\"{x}\" y=\"{own_y:.1}\" width=\"{width}\" height=\"{OWN_HEIGHT}\"/>"
            );
        }
        let _ = write!(out, "{inside}</g>");
    }
}

/// A word in the middle of a bar.
pub fn word(class: &str, x: &str, y: f64, text: &str) -> String {
    format!("<text class=\"word word-{class}\" x=\"{x}\" y=\"{y:.1}\">{}</text>", escaped(text))
}
