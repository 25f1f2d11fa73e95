"""Live regions speak only when the meaning changes, not once a second."""

import pytest
from playwright.sync_api import expect

from operating import expect_standing, expect_tile, log_in
from vehicle import OPERATOR, Client

# Some seconds pass, so that a clock would show.
pytestmark = pytest.mark.timed

# The text of each live region, whenever it changes. A region that is replaced by its equal has not changed.
LISTEN = """() => {
  const regions = '[aria-live]:not([aria-live=off]), [role=status], [role=alert], [role=log]';
  const said = () => [...document.querySelectorAll(regions)].map(it => it.textContent.replace(/\\s+/g, ' ').trim());
  let before = said().join('|');
  window.changes = [];
  new MutationObserver(() => {
    const now = said().join('|');
    if (now !== before) window.changes.push(now);
    before = now;
  }).observe(document.body, { subtree: true, childList: true, characterData: true });
}"""
HEARTBEATS_S = 5


def changes(page):
    """All changes of live regions during some seconds in which the page lives."""
    clock = page.locator("#clock")
    before = clock.text_content()
    page.evaluate("() => void (window.changes.length = 0)")
    page.wait_for_timeout(HEARTBEATS_S * 1000)
    assert clock.text_content() != before, "the page lives"
    return page.evaluate("() => window.changes")


def test_live_regions_are_silent_while_nothing_changes_its_meaning(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    page.evaluate(LISTEN)
    assert changes(page) == [], "a quiet vehicle"
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    vehicle.set("can: battery", 1, "18 %")
    del vehicle.statuses["mission: server"]
    expect_tile(page, "sensors", "error")
    expect_tile(page, "mission", "unknown")
    expect(page.locator("#said")).to_contain_text("LiDAR data missing")
    expect(page.locator("#said")).to_contain_text("Mission")
    assert page.evaluate("() => window.changes"), "the changes are counted"
    page.locator("#tile-mission").click()
    expect(page.locator("#panel-mission")).to_be_visible()
    assert changes(page) == [], "a vehicle with an error, a warning and a silent module"


def test_live_regions_of_a_developers_page_do_not_tell_the_time(server, vehicle, page, trouble):
    server.add_user("dora", "lantern-48-harbour", role="developer")
    Client(server, *OPERATOR)
    page.context.add_cookies(Client(server, "dora", "lantern-48-harbour").browser_cookies())
    page.goto(server.url + "/developer")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    page.evaluate(LISTEN)
    assert changes(page) == []
