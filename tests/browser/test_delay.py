"""The display on a slow connection: a late state is never shown as live."""

import time

import pytest
from playwright.sync_api import expect

from delay import Delay
from operating import enter, expect_standing, log_in, watch
from test_server_gone import SOCKETS
from test_developer import DEVELOPER
from vehicle import serving

pytestmark = pytest.mark.timed


@pytest.fixture
def way():
    way = Delay()
    yield way
    way.close()


@pytest.fixture
def server(tmp_path, way):
    with serving(tmp_path, flags=["--origin", way.url]) as server:
        way.to = server.port
        yield server


def live(page):
    return page.locator("body").get_attribute("data-live")


def expect_live(page, seconds=15):
    expect(page.locator("body")).to_have_attribute("data-live", "live", timeout=seconds * 1000)


@pytest.fixture
def developer(server, way, chromium, trouble):
    """A page of a developer's."""
    server.add_user(*DEVELOPER, role="developer")
    context = chromium.new_context()
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


def test_a_delay_that_grows_slowly_is_seen(server, vehicle, way, page, developer, trouble):
    # The wall clock that the page sees is wrong and runs backwards.
    for each in (page, developer):
        each.add_init_script("const start = Date.now(); Date.now = () => start - 4 * performance.now();")
    log_in(page, way)
    expect_standing(page)
    enter(developer, way, *DEVELOPER)
    developer.goto(way.url + "/developer")
    page.goto(way.url + "/")
    for each in (page, developer):
        expect_live(each)
    seen, began = [], time.monotonic()
    while (late_s := 0.5 * (time.monotonic() - began)) < 3.5:
        way.seconds = late_s
        page.wait_for_timeout(50)
        seen += [(late_s, live(page), "operator"), (late_s, live(developer), "developer")]
    assert "live" not in [state for late_s, state, _ in seen if late_s > 1.4], seen
    assert {state for late_s, state, _ in seen if late_s > 2.5} == {"dead"}, seen
    # It stays so while the delay lasts, even if the page connects again.
    ends = time.monotonic() + 9
    while time.monotonic() < ends:
        page.wait_for_timeout(100)
        assert (live(page), live(developer)) == ("dead", "dead")
    way.seconds = 0
    for each in (page, developer):
        expect_live(each)


def test_a_socket_that_opens_slowly_is_waited_for(server, vehicle, way, page, developer, trouble):
    for each in (page, developer):
        each.add_init_script(SOCKETS)
        # The server answers requests, as when a browser holds a socket back.
        each.route("**/readyz", lambda route: route.fulfill(body="ready"))
    log_in(page, way)
    expect_standing(page)
    enter(developer, way, *DEVELOPER)
    developer.goto(way.url + "/developer")
    for each in (page, developer):
        expect_live(each)
    way.seconds = 4.5
    for each in (page, developer):
        each.evaluate("() => window.sockets.at(-1).close()")
    for each in (page, developer):
        each.wait_for_function("() => window.sockets.length === 2 && window.sockets[1].readyState === WebSocket.OPEN")
    way.seconds = 0
    for each in (page, developer):
        expect_live(each)


def test_a_page_that_was_opened_on_a_slow_way_is_not_live(server, vehicle, way, page, trouble):
    log_in(page, way)
    expect_standing(page)
    way.seconds = 3.3
    page.goto(way.url + "/", timeout=60_000)
    page.evaluate("""() => {
      window.said = new Set();
      window.beats = 0;
      new MutationObserver(() => window.said.add(document.body.dataset.live))
        .observe(document.body, { attributes: true, attributeFilter: ["data-live"] });
      new MutationObserver(() => window.beats++)
        .observe(document.querySelector("#live .pulse"), { attributes: true, attributeFilter: ["data-phase"] });
    }""")
    # Four seconds of heartbeats, each as late as the others.
    page.wait_for_function("() => window.beats > 16")
    assert "live" not in page.evaluate("() => [...window.said]") and live(page) == "dead"
    way.seconds = 0
    expect_live(page)
