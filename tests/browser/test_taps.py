"""Simultaneous taps: a stop waits for nothing, and a tap that is not sent says so."""

import re
import signal

import pytest
from playwright.sync_api import expect

from hang import hanging
from operating import expect_tile, step
from sizes import SIZES, SMALL, check_elsewhere, faults

pytestmark = pytest.mark.timed


@pytest.fixture
def driving(driving, vehicle):
    """A vehicle that drives and has just come to an alarm."""
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    expect_tile(driving, "sensors", "error")
    return driving


def hold(page, address):
    """Requests to this address get no answer before `let_go`."""
    held = []
    page.route(address, lambda route: held.append(route))
    return held


IS_IN_SIGHT = """selector => {
  const it = document.querySelector(selector), { left, right, top, bottom } = it.getBoundingClientRect();
  return it.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2));
}"""


def let_go(held):
    while held:
        held.pop().continue_()


def test_a_stop_goes_out_while_another_tap_is_not_answered(driving, trouble):
    page, notice = driving, driving.locator("#notice")
    acknowledge = page.locator("#causes button[name=acknowledge]").first
    expect(acknowledge).to_be_visible()
    held = hold(page, "**/acknowledge")
    acknowledge.click()
    acknowledge.click()
    expect(notice.locator("span:visible").first).to_have_text("Not sent: the server has not answered the last tap yet.")
    assert len(held) == 1
    with page.expect_response("**/vehicle/stop") as stopped:
        step(page, "stop").click()
    assert stopped.value.status == 200 and len(held) == 1
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    # It comes too late by then, or its subject has changed.
    let_go(held)
    trouble.expect("409", "WebSocket", "ERR_")


def test_a_stop_is_sent_right_after_what_it_stood_beside_was_done(driving, trouble):
    page, stops = driving, []
    page.on("request", lambda request: request.url.endswith("/vehicle/stop") and stops.append(request))
    page.locator("#actions").evaluate("bar => void (bar.dataset.quiet = '')")
    box = step(page, "stop").bounding_box()
    page.mouse.click(box["x"] + 20, box["y"] + 20)
    expect(step(page, "release")).to_be_visible()
    assert len(stops) == 1


def test_a_stop_is_sent_by_a_dead_display_until_it_is_answered(server, driving, trouble):
    page, stop = driving, step(driving, "stop")
    server.send(signal.SIGSTOP)
    try:
        expect(page.locator("body")).to_have_attribute("data-live", "dead")
        expect(page.locator("#causes")).to_be_hidden()
        expect(stop).to_be_visible()
        stop.click()
        said = page.locator("#notice .said span:visible")
        expect(said).to_have_text("The stop has not arrived and is sent again. Take over.")
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate(IS_IN_SIGHT, "#notice .said"), f"{width}x{height}"
            assert not faults(page), f"{width}x{height}: {faults(page)}"
    finally:
        server.send(signal.SIGCONT)
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    expect(page.locator("#notice")).to_be_hidden()
    trouble.expect("WebSocket", "ERR_", "409", "readyz")


def test_no_notice_lies_over_stop(driving, trouble):
    page, notice = driving, driving.locator("#notice")
    held = hold(page, "**/acknowledge")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for _ in range(2):
            page.locator("#causes button[name=acknowledge]").first.evaluate("button => button.click()")
        expect(notice).to_be_visible()
        assert page.evaluate(IS_IN_SIGHT, "#notice .said"), f"{width}x{height}"
        assert not faults(page), f"{width}x{height}: {faults(page)}"
        notice.locator("[name=dismiss]").click()
    let_go(held)
    trouble.expect("409", "WebSocket", "ERR_")


def test_a_double_tap_on_continue_releases_nothing(driving):
    page, confirm = driving, step(driving, "confirm")
    step(page, "stop").click()
    expect(step(page, "release")).to_be_visible()
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    for width, height in SIZES + SMALL:
        page.set_viewport_size({"width": width, "height": height})
        box, stop = step(page, "release").bounding_box(), step(page, "stop").bounding_box()
        step(page, "release").click()
        expect(confirm).to_be_visible()
        for name, button in (("Drive", confirm.bounding_box()), ("STOP", stop)):
            check_elsewhere(name, button, box, f"{width}x{height}")
        assert step(page, "stop").bounding_box() == stop, f"{width}x{height}"
        assert (width, height) in SMALL or not faults(page), f"{width}x{height}: {faults(page)}"
        step(page, "cancel").click(force=True, timeout=5_000)
        expect(confirm).to_be_hidden()
        expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()


# Taps where "Continue driving" has just appeared, as soon as it has, and while the bar takes no second tap.
TAP_AT_ONCE = """() => {
  const bar = document.getElementById("actions");
  const look = (_, observer) => {
    const button = bar.querySelector("#step [name=release]");
    if (!button || !("quiet" in bar.dataset)) return;
    observer.disconnect();
    const { left, top, width, height } = button.getBoundingClientRect();
    const [clientX, clientY] = [left + width / 2, top + height / 2];
    document.elementFromPoint(clientX, clientY).dispatchEvent(new MouseEvent("click", { bubbles: true, clientX, clientY }));
  };
  new MutationObserver(look).observe(bar, { attributes: true, childList: true, subtree: true });
}"""


def test_two_quick_taps_are_one_and_the_second_says_so(driving, trouble):
    page, notice, posted = driving, driving.locator("#notice"), []
    page.on("request", lambda request: request.method == "POST" and posted.append(request.url))
    page.evaluate(TAP_AT_ONCE)
    step(page, "stop").click()
    why = re.compile("Only the first tap counted.|Not sent: the button has just changed.")
    expect(notice.locator("span:visible").first).to_have_text(why)
    expect(notice).to_be_hidden()
    expect(step(page, "release")).to_be_visible()
    expect(step(page, "confirm")).to_be_hidden()
    assert [url.rsplit("/", 1)[1] for url in posted] == ["stop"], posted


def test_a_stop_is_sent_while_the_engine_hangs_until_it_is_done(server, driving, trouble):
    page, stop = driving, step(driving, "stop")
    with hanging(server):
        # The display is still live.
        stop.click()
        said = page.locator("#notice .said span:visible")
        expect(said).to_have_text("The stop has not arrived and is sent again. Take over.")
        expect(page.locator("body")).to_have_attribute("data-live", "dead")
        assert server.answers(), "the server is up"
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            with page.expect_request("**/vehicle/stop"):
                expect(said).to_be_visible()
            assert page.evaluate(IS_IN_SIGHT, "#notice .said"), f"{width}x{height}"
            assert not faults(page), f"{width}x{height}: {faults(page)}"
        expect(page.locator("body")).to_have_attribute("data-unanswered", "")
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    expect(stop).to_have_attribute("aria-pressed", "true")
    expect(page.locator("body")).not_to_have_attribute("data-unanswered", "")
    expect(page.locator("#notice")).to_be_hidden()
    trouble.expect("WebSocket", "ERR_", "408", "readyz")
