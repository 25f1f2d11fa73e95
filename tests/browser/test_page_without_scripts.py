"""If the page's own scripts do not run, everything about the vehicle is covered after a time. STOP stays."""

import pytest
from playwright.sync_api import expect

from one_server import server, vehicle  # noqa: F401
from sizes import SIZES
from vehicle import OPERATOR, Client, until

# What may still be visible in place of the vehicle.
BRIGHT = """() => [...document.querySelectorAll(".bar *, .instruction, .instruction *, .tile, .tile *, .cause, .actions *, .panel *")]
  .filter(it => !it.closest("[name=stop], .lost") && it.checkVisibility({ checkVisibilityCSS: true })).map(it => it.outerHTML.slice(0, 80))"""
SETTLED = "() => !document.getAnimations().some(it => it.playState === 'running')"

# These tests only look, so one server and one vehicle serve them all.


@pytest.fixture(scope="module")
def session(server, vehicle):
    """Of an operator whose vehicle drives, brakes for a stop and has a fault."""
    client = Client(server, *OPERATOR)
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    client.stop()
    sensors = lambda: next(group for group in client.snapshot()["groups"] if group["id"] == "sensors")
    until(lambda: sensors()["state"] == "error", 10, sensors)
    return client.browser_cookies()


@pytest.mark.parametrize("without", ["any script", "updates.js", "live.js", "hidden_panels.js", "htmx.min.js"])
def test_a_page_whose_scripts_do_not_run_is_covered(server, session, chromium, without):
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, java_script_enabled=without != "any script")
    context.add_cookies(session)
    page = context.new_page()
    page.route(f"**/{without}", lambda route: route.abort())
    page.goto(server.url + "/")
    expect(page.locator("#tile-sensors")).to_have_attribute("data-state", "error")
    expect(page.locator(".frozen b").filter(visible=True)).to_have_text(["Display frozen.", "Take over."], timeout=10_000)
    page.locator("#tile-sensors").click(force=True)
    until(lambda: page.evaluate(SETTLED), 5, "no colour fades any more")
    assert page.evaluate(BRIGHT) == []
    expect(page.locator("#step button[name=stop]")).to_be_visible()
    context.close()


@pytest.mark.parametrize("width, height", SIZES)
def test_before_any_script_runs_stop_and_what_to_do_are_in_sight(server, session, chromium, width, height):
    context = chromium.new_context(viewport={"width": width, "height": height}, java_script_enabled=False)
    context.add_cookies(session)
    page = context.new_page()
    page.goto(server.url + "/")
    for part in ("#motion strong", "#instruction strong", "#step button[name=stop]", "#causes .title"):
        box = page.locator(part).first.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width and box["y"] + box["height"] <= height, (part, box)
    expect(page.locator("#step button[name=stop]")).to_be_visible()
    context.close()
