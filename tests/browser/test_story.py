"""The whole story by touch, at the simulated shuttle: log in, localize, clear, drive, a fault and
what the vehicle does about it, arrive, log out."""

import re
import signal

import pytest
from playwright.sync_api import expect

from operating import (
    DEMO_OPERATOR,
    acknowledge_all,
    arrive,
    clear,
    localize,
    log_in_by_touch,
    release,
    stage,
    step,
    touch_context,
    watch,
)
from vehicle import Client, Server, own_domain

# The simulation lives in real time. A computer that is busy with other tests makes faults of its own, and each is heard.
pytestmark = pytest.mark.alone


@pytest.fixture
def demo(tmp_path):
    server = Server(tmp_path, own_domain() + 40, "demo").start()
    yield server
    assert server.stop() == 0


@pytest.fixture
def display(chromium, trouble, demo):
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    log_in_by_touch(page, demo, *DEMO_OPERATOR)
    yield page
    context.close()


# What the instruction asks for in each frame.
NOTE_URGENCY = """() => {
  window.urgencies = [];
  const look = () => {
    const { urgency } = document.getElementById("instruction").dataset;
    if (window.urgencies.at(-1) !== urgency) window.urgencies.push(urgency);
    requestAnimationFrame(look);
  };
  look();
}"""


# What the banner of the deceleration and the line of the next step have said: a vehicle is soon slow enough to be held.
NOTE_WORDS = """() => {
  window.words = new Set();
  const look = () => {
    for (const text of document.querySelectorAll("#countermeasure[data-request=decelerate], #step .next")) {
      window.words.add(text.textContent);
    }
    requestAnimationFrame(look);
  };
  look();
}"""


def has_said(page, words):
    page.wait_for_function("words => [...window.words].some((it) => it.includes(words))", arg=words)


def sounded(page):
    return int(page.locator("body").get_attribute("data-sounded") or 0)


def test_the_story_by_touch_alone(demo, display, trouble):
    page = display
    client = Client(demo, *DEMO_OPERATOR)
    expect(page.locator("[data-tool=sound]")).to_have_attribute("data-sound", "on")
    localize(page)
    expect(page.locator("#countermeasure")).not_to_have_attribute("data-request", re.compile("."))
    # A localization without a fault is no incident. A recording would last for ten seconds more.
    assert page.locator("body").get_attribute("data-recorder") == "ready"
    page.evaluate(NOTE_URGENCY)
    clear(page)
    stage(page, "active", 20)
    expect(page.locator("#causes .calm")).to_be_visible()
    before = sounded(page)
    # Components that matter from now on, and still have time to report, alarm nobody.
    assert set(page.evaluate("() => window.urgencies")) <= {"act", "none"}

    # A vehicle that stands has nothing to respond to; from here it slows down for seconds.
    expect(page.locator("#motion")).to_contain_text(re.compile(r"\b[1-9]\d\skm/h"))
    page.evaluate(NOTE_WORDS)
    client.post("/demo/fault", name="localization_jump", active="true")
    expect(page.locator("#tile-localization")).to_have_attribute("data-state", "error", timeout=15_000)
    banner = page.locator("#countermeasure[data-request=decelerate]")
    expect(banner).to_be_visible()
    expect(banner).to_have_attribute("data-state", "engaged")
    has_said(page, "Slowing down")
    has_said(page, "The vehicle responds")
    expect(page.locator("#causes [data-node]").first).to_have_attribute("data-waiting", "")
    assert sounded(page) == before + 1, "one sound for one fault, none for what it masks"
    page.locator("#tile-perception").tap()
    expect(page.locator("#panel-perception")).to_be_visible()
    for part in (banner, page.locator("#top .stage"), page.locator("#causes")):
        expect(part).to_be_visible()
    page.locator("#panel-perception .close").tap()

    client.post("/demo/fault", name="localization_jump", active="false")
    expect(page.locator("#tile-localization")).to_have_attribute("data-state", "ok", timeout=20_000)
    expect(page.locator("#instruction[data-urgency=act] strong")).to_contain_text("Cause gone. Continue?")
    # Each resulting alarm is acknowledged by itself. That moves nothing.
    acknowledge_all(page)
    expect(banner).to_be_visible()
    departures = int(page.locator("body").get_attribute("data-departures") or 0)
    release(page)
    expect(banner).to_have_count(0)
    assert int(page.locator("body").get_attribute("data-departures")) > departures, "a tone before it moves"
    assert sounded(page) == before + 1, client.snapshot()["alarms"]

    expect(step(page, "logout")).to_have_count(0)
    # Four taps on STOP are a stop: it never changes into something else under the finger.
    place = step(page, "stop").bounding_box()
    for _ in range(4):
        step(page, "stop").tap()
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    expect(step(page, "stop")).to_have_attribute("aria-pressed", "true")
    assert step(page, "stop").bounding_box() == place
    release(page)
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_have_count(0)
    assert step(page, "stop").bounding_box() == place
    arrive(page)
    # Nobody logs out while it still rolls.
    expect(page.locator("#motion")).to_have_attribute("data-moving", "no")
    # A tap right after a change does not count.
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    step(page, "logout").tap()
    expect(page).to_have_url(re.compile("/login"))
    expect(page.locator(".known button")).to_have_text(["operator"])
    expect(page.locator(".digits")).to_be_visible()
    # A tap on a step that was just withdrawn is refused.
    trouble.expect("409")


def test_a_refused_clearance_lists_every_check_and_a_double_tap_clears_nothing(demo, display, trouble):
    page = display
    client = Client(demo, *DEMO_OPERATOR)
    localize(page)
    client.post("/demo/fault", name="low_battery", active="true")
    client.post("/demo/fault", name="costmap_delay", active="true")
    checks = page.locator("#step .checks li:not(.holds)")
    expect(checks.filter(has_text="Perception: error")).to_be_visible()
    expect(checks.filter(has_text="Acknowledge first: Battery is low")).to_be_visible()
    refused = page.locator("#step button[name=clearance]")
    expect(refused).to_have_attribute("aria-disabled", "true")
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    refused.tap(force=True)
    expect(page.locator("#actions[data-refused] .checks")).to_be_visible()
    expect(page.locator("#notice")).to_be_hidden()
    # The sheet is up to date as soon as it opens.
    sheet = page.locator("#sheet-checks")
    sheet.evaluate("sheet => sheet.showPopover()")
    assert page.locator("#all-checks li:not(.holds)").count() >= 2
    sheet.evaluate("sheet => sheet.hidePopover()")
    expect(page.locator("#causes button[name=acknowledge]").first).to_be_visible()

    client.post("/demo/fault", name="costmap_delay", active="false")
    client.post("/demo/fault", name="low_battery", active="false")
    ready = page.locator("#actions button[name=clearance]:not([aria-disabled])")
    acknowledge_all(page)
    expect(ready).to_be_visible(timeout=40_000)
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    box, posted = ready.bounding_box(), []
    page.on("request", lambda request: request.method == "POST" and posted.append(request.url))
    # A finger that trembles taps twice within 60 ms.
    for _ in range(2):
        page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.wait_for_timeout(60)
    expect(step(page, "confirm")).to_be_visible()
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    assert posted == [demo.url + "/vehicle/clearance"], posted
    stage(page, "standby")
    trouble.expect("409")


def test_a_confirmation_that_is_not_given_in_time_is_gone(demo, display, trouble):
    page = display
    localize(page)
    expect(page.locator("#actions button[name=clearance]:not([aria-disabled])")).to_be_visible(timeout=40_000)
    step(page, "clearance").tap()
    expect(page.locator("#confirm .left")).to_have_text(re.compile("^(10|9|8)$"))
    expect(page.locator("#confirm")).to_be_hidden(timeout=15_000)
    stage(page, "standby")


def test_a_tap_while_the_server_hangs_is_not_kept_for_later(demo, display, trouble):
    page = display
    stage(page, "localizing")
    demo.pause()
    # The display still counts as live: the tap is sent, and waits at the server.
    step(page, "localize").first.tap()
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    # A tap counts for 4 s after the last heartbeat that the page had.
    page.wait_for_function("() => performance.now() - telltale.live.lastBeat > 4_200")
    demo.send(signal.SIGCONT)
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    # What the server was asked later is done and shown, so it has read the tap.
    Client(demo, *DEMO_OPERATOR).post("/demo/fault", name="low_battery", active="true")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "warning")
    stage(page, "localizing")
    expect(page.locator("#step .turning")).to_have_count(0)
    trouble.expect("409", "Failed to load resource", "WebSocket", "ERR_")


def test_a_second_display_shows_the_same_and_holds_no_token(demo, display, chromium, trouble):
    page = display
    context = touch_context(chromium)
    other = context.new_page()
    watch(other, trouble)
    log_in_by_touch(other, demo, *DEMO_OPERATOR)
    localize(page)
    stage(other, "standby")
    expect(page.locator("#actions button[name=clearance]:not([aria-disabled])")).to_be_visible(timeout=40_000)
    step(page, "clearance").tap()
    expect(step(page, "confirm")).to_be_visible()
    expect(other.locator("#confirm")).to_be_hidden()
    step(page, "confirm").tap()
    for each in (page, other):
        expect(each.locator("body")).to_have_attribute("data-stage", re.compile("cleared|active"))
    context.close()


def test_a_position_is_given_again_at_a_stop(demo, display, trouble):
    page = display
    localize(page)
    step(page, "stops").tap()
    expect(page.locator("#sheet-stops")).to_be_visible()
    page.locator("#sheet-stops button[name=localize]").first.tap()
    expect(page.locator("#sheet-stops")).to_be_hidden()
    expect(page.locator("#actions button[name=clearance]:not([aria-disabled])")).to_be_visible(timeout=40_000)


def test_the_work_is_ended_in_two_steps_and_not_while_driving(display, trouble):
    page = display
    stage(page, "localizing")
    shutdown, sheet = page.locator("button[name=shutdown]"), page.locator("#sheet-shutdown")
    shutdown.tap()
    expect(sheet).to_be_visible()
    expect(sheet).to_contain_text("The vehicle is locked and you are logged out.")
    sheet.locator("[name=stay]").tap()
    expect(sheet).to_be_hidden()
    stage(page, "localizing")
    localize(page)
    clear(page)
    stage(page, "active", 20)
    expect(shutdown).to_have_count(0)
    # A tap on a step that was just withdrawn is refused.
    trouble.expect("409")


def test_the_work_is_ended_where_the_vehicle_stands(display, trouble):
    page = display
    stage(page, "localizing")
    confirm = page.locator("button[name=confirm_shutdown]")
    # A tap while a busy machine lets the display grow stale is not sent, says so, and is made again.
    for _ in range(5):
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        if not confirm.is_visible():
            page.locator("button[name=shutdown]").tap()
        confirm.tap()
        page.wait_for_function("() => location.pathname === '/login' || !document.getElementById('notice').hidden")
        if "/login" in page.url:
            return
        page.locator("#notice [name=dismiss]").evaluate("button => button.click()")
    page.wait_for_url("**/login")
