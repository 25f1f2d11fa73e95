"""Sizes, contrasts and names of all operator's pages, as the browser computes them."""

import pytest
from playwright.sync_api import expect

from accessible import violations
from sizes import check_sizes
from operating import DEMO_OPERATOR, clear, let_colours_settle, localize, log_in_by_touch, stage, touch_context, watch
from vehicle import Client, Server, own_domain

TRANSFER_BYTES_MAX = 150_000

# Relative luminance by WCAG 2, of a text on the nearest background that is not transparent.
CONTRAST = """selector => {
  // A colour that fades meanwhile counts as what it becomes.
  document.getAnimations().filter(it => it instanceof CSSTransition).forEach(it => it.finish());
  const rgb = color => color.match(/[\\d.]+/g).map(Number);
  const linear = c => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ground = it => {
    for (; it; it = it.parentElement) {
      const style = getComputedStyle(it), color = rgb(style.backgroundColor);
      const stripes = style.backgroundImage.match(/rgba?\\([^)]*\\)/g);
      if (stripes) return stripes.map(rgb);
      if (color.length < 4 || color[3] === 1) return [color];
    }
    return [[255, 255, 255]];
  };
  return [...document.querySelectorAll(selector)].filter(it => it.offsetParent !== null && it.textContent.trim()).map(it => {
    const ink = light(rgb(getComputedStyle(it).color));
    const ratio = Math.min(...ground(it).map(light).map(paper => (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05)));
    return [it.className + ': ' + it.textContent.trim().slice(0, 30), ratio];
  });
}"""


# The colour of the live mark in each state of the display, by the name of the palette's own. All at one
# moment, because the page's script sets the state anew ten times a second.
MARK = """() => {
  const root = document.documentElement, mark = document.getElementById('live'), before = document.body.dataset.live;
  const own = name => {
    const it = document.body.appendChild(document.createElement('i'));
    it.style.color = `var(${name})`;
    const color = getComputedStyle(it).color;
    it.remove();
    return color;
  };
  const names = ['--ok', '--warning', '--bad-text', '--text', '--quiet'];
  const seen = {};
  for (const palette of ['night', 'day']) {
    root.dataset.palette = palette;
    for (const live of ['live', 'stale', 'dead']) {
      document.body.dataset.live = live;
      const color = getComputedStyle(mark).color;
      seen[`${palette} ${live}`] = names.filter(name => own(name) === color);
    }
  }
  document.body.dataset.live = before;
  return seen;
}"""

# How often that changes in four seconds by which an alarm calls.
CALLS = """async () => {
  const looks = {
    tile: () => getComputedStyle(document.querySelector('#tile-can')).boxShadow,
    cause: () => getComputedStyle(document.querySelector('#causes .cause[data-waiting]')).borderLeftColor,
  };
  const last = Object.fromEntries(Object.keys(looks).map(part => [part, looks[part]()]));
  const turns = Object.fromEntries(Object.keys(looks).map(part => [part, 0]));
  const end = performance.now() + 4000;
  while (performance.now() < end) {
    await new Promise(requestAnimationFrame);
    for (const part of Object.keys(looks)) {
      const now = looks[part]();
      if (now !== last[part]) turns[part]++;
      last[part] = now;
    }
  }
  return turns;
}"""


@pytest.fixture
def demo(tmp_path):
    server = Server(tmp_path, own_domain() + 41, "demo").start()
    yield server
    assert server.stop() == 0


def check_contrasts(page, name):
    let_colours_settle(page)
    for what, ratio in page.evaluate(CONTRAST, "p, .tile span:not(.hush), .cause span:not(.hush), button, label, .checks span"):
        assert ratio >= 4.5, f"{name}: {what}: {ratio:.2f}"
    alarms = ".tile:is([data-state=error], [data-state=warning]) > span, .cause .title, .cause .help, .instruction:is([data-urgency=take_over], [data-urgency=be_ready]) *"
    for what, ratio in page.evaluate(CONTRAST, alarms):
        assert ratio >= 7, f"{name}: {what}: {ratio:.2f}"


def in_both_palettes(page, name):
    check_sizes(page, name, also=violations)
    check_contrasts(page, f"{name}, first palette")
    page.locator("[data-tool=palette]").tap()
    check_contrasts(page, f"{name}, other palette")
    found = violations(page)
    assert not found, f"{name}, other palette:\n{found}"
    page.locator("[data-tool=palette]").tap()


@pytest.mark.parametrize("lang", ["en", "de"])
def test_every_state_holds_its_sizes_its_contrasts_and_its_names(demo, chromium, trouble, lang):
    client = Client(demo, *DEMO_OPERATOR)
    context = touch_context(chromium, lang, reduced_motion="reduce")
    page = context.new_page()
    watch(page, trouble)
    page.goto(demo.url + "/login")
    in_both_palettes(page, "login")
    log_in_by_touch(page, demo, *DEMO_OPERATOR)
    stage(page, "localizing")
    in_both_palettes(page, "localizing")
    localize(page)
    in_both_palettes(page, "standby")
    client.post("/demo/fault", name="low_battery", active="true")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "warning")
    in_both_palettes(page, "warning")
    client.post("/demo/fault", name="low_battery", active="false")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "ok")
    clear(page)
    # A tap on a step that was just withdrawn is refused.
    trouble.expect("409")
    stage(page, "active", 20)
    in_both_palettes(page, "active")
    client.post("/demo/fault", name="sensor_outage", active="true")
    expect(page.locator("#tile-execution")).to_have_attribute("data-reason", "masked")
    expect(page.locator("#countermeasure[data-request]")).to_be_visible()
    in_both_palettes(page, "fault")
    # A colour that fades, as after a change of palette, does not move.
    moving = page.evaluate("() => document.getAnimations().filter(it => it instanceof CSSAnimation).map(it => it.animationName)")
    assert not moving, "reduced motion is kept"
    page.locator("#tile-planning").tap()
    expect(page.locator("#panel-planning")).to_be_visible()
    assert not violations(page), violations(page)
    page.locator("#panel-planning .close").tap()
    context.close()


def test_the_live_mark_has_the_colour_of_its_state_in_both_palettes(demo, chromium, trouble):
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    log_in_by_touch(page, demo, *DEMO_OPERATOR)
    assert page.evaluate(MARK) == {
        "night live": ["--ok"], "night stale": ["--warning"], "night dead": ["--bad-text"],
        # Amber cannot be read on a light ground.
        "day live": ["--ok"], "day stale": ["--text"], "day dead": ["--bad-text"],
    }  # fmt: skip
    context.close()


@pytest.mark.alone
def test_the_operators_page_is_small_and_flashes_slowly(demo, chromium, trouble):
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    log_in_by_touch(page, demo, *DEMO_OPERATOR)
    network = context.new_cdp_session(page)
    sizes = []
    network.on("Network.loadingFinished", lambda event: sizes.append(event["encodedDataLength"]))
    network.send("Network.enable")
    network.send("Network.setCacheDisabled", {"cacheDisabled": True})
    page.reload()
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    assert len(sizes) > 6 and sum(sizes) <= TRANSFER_BYTES_MAX, f"{sum(sizes)} bytes: {sizes}"
    client = Client(demo, *DEMO_OPERATOR)
    client.post("/demo/fault", name="can_loss", active="true")
    expect(page.locator("#tile-can[data-alarm][data-state=error]")).to_be_visible()
    expect(page.locator("#causes .cause[data-waiting]").first).to_be_visible()
    for motion, turns in (("no-preference", range(7, 10)), ("reduce", range(1))):
        page.emulate_media(reduced_motion=motion)
        seen = page.evaluate(CALLS)
        assert len(seen) == 2 and all(count in turns for count in seen.values()), f"{motion}: {seen} in 4 s"
    context.close()
