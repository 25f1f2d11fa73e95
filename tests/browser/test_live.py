"""A display that cannot lie: it says by itself when the server is not there."""

import signal

from playwright.sync_api import expect

from test_operator import expect_standing, log_in

WATCH = """() => {
  window.liveLog = [];
  new MutationObserver(() => window.liveLog.push([performance.now(), document.body.dataset.live]))
    .observe(document.body, { attributes: true, attributeFilter: ["data-live"] });
  return performance.now();
}"""


def reached(page, value, since_ms):
    """When the mark had this value first, in seconds after `since_ms`."""
    page.wait_for_function("value => window.liveLog.some(([, live]) => live === value)", arg=value)
    times = page.evaluate("value => window.liveLog.filter(([, live]) => live === value)", value)
    return (times[0][0] - since_ms) / 1000


def test_a_server_that_hangs_makes_the_page_stale_then_dead_and_live_again(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    stopped_ms = page.evaluate(WATCH)
    server.send(signal.SIGSTOP)
    stale_s = reached(page, "stale", stopped_ms)
    assert 0.5 < stale_s < 1.6, f"stale after {stale_s:.2f} s"
    dead_s = reached(page, "dead", stopped_ms)
    assert 1.5 < dead_s < 2.6, f"dead after {dead_s:.2f} s"
    expect(page.get_by_text("take over").first).to_be_visible()
    continued_ms = page.evaluate(WATCH)
    server.send(signal.SIGCONT)
    live_s = reached(page, "live", continued_ms)
    assert live_s < 2, f"live after {live_s:.2f} s"
    expect_standing(page)
    expect(page.get_by_text("take over").filter(visible=True)).to_have_count(0)


def test_a_server_that_was_killed_is_found_again_without_a_new_login(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    page.evaluate(WATCH)
    server.kill()
    reached(page, "dead", 0)
    started_ms = page.evaluate(WATCH)
    server.start()
    answers_ms = page.evaluate("() => performance.now()")
    live_s = reached(page, "live", answers_ms)
    assert live_s < 2, f"live {live_s:.2f} s after the server answered, {answers_ms - started_ms:.0f} ms to start"
    expect_standing(page)
    trouble.expect("WebSocket", "ERR_CONNECTION_REFUSED", "htmx:ws:error")
