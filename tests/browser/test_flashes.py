"""Nothing flashes more than three times a second (WCAG 2.3.1), however the vehicle's states change."""

import pytest
from playwright.sync_api import expect

from operating import expect_standing, log_in, touch_context
from one_server import server, vehicle  # noqa: F401

pytestmark = pytest.mark.timed

FLASHES_MAX = 3
NAME = "velodyne_packet_alive"

# The colour of each large part in each frame: its background, and what covers it.
WATCH = """() => {
  const rgb = color => color.match(/[\\d.]+/g).map(Number);
  const linear = c => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const over = (paper, [r, g, b, own = 1], alpha) => paper.map((c, i) => c + ([r, g, b][i] - c) * own * alpha);
  const shown = it => {
    const above = it.parentElement ? shown(it.parentElement) : [255, 255, 255];
    return over(above, rgb(getComputedStyle(it).backgroundColor), 1);
  };
  const frames = (window.frames_ = []);
  const look = () => {
    const parts = {};
    for (const it of document.querySelectorAll('#tile-sensors, #tile-localization, aside, #instruction, .panel:popover-open .summary')) {
      const [r, g, b] = shown(it).map(linear);
      const red = r / (r + g + b + 1e-9) >= 0.8 ? 1 : 0;
      parts[it.id || it.className || it.tagName] = [0.2126 * r + 0.7152 * g + 0.0722 * b, red, it.dataset.state ?? ''];
    }
    frames.push([performance.now(), parts]);
    window.looking = requestAnimationFrame(look);
  };
  look();
}"""


def flashes(changes):
    """The most pairs of opposing changes within a second, of a tenth of the lightness and more, or
    into and out of a saturated red."""
    turns, way, last = [], 0, None
    for at, (light, red, _) in changes:
        if last is None:
            last = (light, red)
            continue
        darker = min(light, last[0])
        differs = abs(light - last[0]) >= 0.1 and darker < 0.8 or red != last[1]
        if not differs:
            continue
        now = 1 if (red, light) > (last[1], last[0]) else -1
        if now != way:
            turns.append(at)
        way, last = now, (light, red)
    counts = [sum(1 for other in turns if at <= other < at + 1000) for at in turns]
    return max(counts, default=0) // 2


@pytest.mark.parametrize("palette", ["day", "night"])
@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_states_that_come_and_go_do_not_flash(server, vehicle, chromium, palette, motion):
    context = touch_context(chromium, reduced_motion=motion)
    context.add_cookies([{"name": "palette", "value": palette, "url": server.url}])
    page = context.new_page()
    log_in(page, server)
    expect_standing(page)
    page.locator("#tile-sensors").tap()
    expect(page.locator("#panel-sensors")).to_be_visible()
    page.evaluate(WATCH)
    for turn in range(48):
        vehicle.set(NAME, (2, 0, 1, 0, 2, 1)[turn % 6])
        page.wait_for_timeout(90)
    vehicle.set(NAME, 0)
    expect(page.locator("#tile-sensors")).to_have_attribute("data-state", "ok", timeout=20_000)
    frames = page.evaluate("() => { cancelAnimationFrame(window.looking); return window.frames_; }")
    names = set().union(*(parts for _, parts in frames))
    assert {"tile-sensors", "summary"} <= names, names
    states = [parts["tile-sensors"][2] for _, parts in frames]
    changed = sum(1 for one, other in zip(states, states[1:]) if one != other)
    assert changed > 5, f"only {changed} changes were shown"
    for name in names:
        seen = [(at, parts[name]) for at, parts in frames if name in parts]
        assert flashes(seen) <= FLASHES_MAX, f"{name}: {flashes(seen)} in a second"
    context.close()
