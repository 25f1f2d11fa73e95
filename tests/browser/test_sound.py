"""The page calls for each root cause once, repeats until somebody acknowledges, and tells by itself that it is dead."""

import contextlib
import re
import signal

import pytest
from playwright.sync_api import expect

from operating import acknowledge_all, expect_standing, expect_tile, log_in, touch_context, watch
from stall import stalled
from vehicle import CONFIG, Vehicle, serving, until

# The repetition is in real time.
pytestmark = pytest.mark.timed

NAME = "velodyne_packet_alive"

@pytest.fixture
def page(chromium, trouble):
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


# When each attribute of the sounds changed, in seconds. What the vehicle lacked while it started does not count.
NOTE = """() => {
  for (const what of ['sounded', 'repeats', 'tones']) delete document.body.dataset[what];
  window.noted = [];
  const look = records => { for (const { attributeName: name } of records)
    window.noted.push([performance.now() / 1000, name.slice(5), document.body.getAttribute(name)]) };
  new MutationObserver(look).observe(document.body, { attributes: true,
    attributeFilter: ['data-sounded', 'data-repeats', 'data-tones', 'data-live'] });
}"""


def count(page, what):
    return int(page.locator("body").get_attribute(f"data-{what}") or 0)


def times(page, what):
    return page.evaluate("what => window.noted.filter(([, name]) => name === what).map(([at]) => at)", what)


def aloud(page, server):
    """An operator at a page that may sound."""
    log_in(page, server)
    expect_standing(page)
    expect(page.locator("[data-tool=sound]")).to_have_attribute("data-sound", "on")
    page.evaluate(NOTE)
    return page


def test_a_fault_sounds_every_five_seconds_until_it_is_acknowledged(server, vehicle, page, trouble):
    aloud(page, server)
    with stalled(page) as stall:
        vehicle.set(NAME, 2, "Only 2.0 scans per second")
        until(lambda: count(page, "repeats") == 2, 30, "it repeats")
    assert count(page, "sounded") == 1, "one call for one root cause, none for what it masks"
    [called] = times(page, "sounded")
    first, second = times(page, "repeats")
    for before, after in ((called, first), (first, second)):
        assert 4.9 < after - before < 5.3 + stall(), f"{after - before:.2f} s apart; the page stood still for {stall():.2f} s"
    acknowledge_all(page)
    expect(page.locator("#causes")).to_have_attribute("data-alarms", "")
    repeats = count(page, "repeats")
    # The fault is there still. Longer than from one repetition to the next:
    page.wait_for_timeout(6_000)
    assert (count(page, "sounded"), count(page, "repeats")) == (1, repeats)
    expect_tile(page, "sensors", "error")
    # It ends and comes back: a new alarm calls anew.
    vehicle.set(NAME, 0)
    expect_tile(page, "sensors", "ok")
    vehicle.set(NAME, 2, "Only 2.0 scans per second")
    until(lambda: count(page, "sounded") == 2, 20, "it calls")


def test_sound_off_is_silent_and_says_so_and_sound_on_tells_what_is_open(server, vehicle, page, trouble):
    aloud(page, server)
    tool = page.locator("[data-tool=sound]")
    tool.click()
    expect(tool).to_have_attribute("data-sound", "off")
    expect(tool.get_by_text("Sound off").filter(visible=True)).to_be_visible()
    vehicle.set(NAME, 2, "Only 2.0 scans per second")
    expect_tile(page, "sensors", "error")
    page.wait_for_timeout(1_000)
    assert (count(page, "sounded"), count(page, "repeats")) == (0, 0)
    tool.click()
    until(lambda: count(page, "sounded") == 1, 5, "what nobody has acknowledged calls")


# What the instruction asks for, whatever the server says: what sounds follows from the page alone.
INSTRUCT = """urgency => {
  const set = () => {
    const it = document.getElementById('instruction') ?? document.body.appendChild(document.createElement('section'));
    it.id = 'instruction';
    if (it.dataset.urgency !== urgency) it.dataset.urgency = urgency;
  };
  clearInterval(window.instructing);
  window.instructing = setInterval(set, 10);
  set();
}"""


def test_the_instruction_decides_which_pattern_sounds(server, vehicle, page, trouble):
    aloud(page, server)
    body = page.locator("body")
    page.evaluate(INSTRUCT, "be_ready")
    vehicle.set(NAME, 2, "Only 2.0 scans per second")
    expect(body).to_have_attribute("data-tones", "fault")
    # Worse sounds at once, and is no new root cause.
    page.evaluate(INSTRUCT, "take_over")
    expect(body).to_have_attribute("data-tones", "take_over", timeout=4_000)
    assert count(page, "sounded") == 1
    page.evaluate(INSTRUCT, "act")
    expect(body).to_have_attribute("data-tones", "fault")
    page.evaluate("() => clearInterval(window.instructing)")


def test_a_dead_display_sounds_without_a_server_until_it_is_live_again(server, vehicle, page, trouble):
    aloud(page, server)
    body = page.locator("body")
    server.pause()
    expect(body).to_have_attribute("data-live", "dead")
    expect(body).to_have_attribute("data-tones", "dead")
    until(lambda: count(page, "repeats") == 2, 30, "it repeats with the server stopped")
    at = times(page, "repeats")
    assert 4.9 < at[1] - at[0], f"{at[1] - at[0]:.2f} s apart"
    server.send(signal.SIGCONT)
    expect(body).to_have_attribute("data-live", "live")
    expect_standing(page)
    # All is well again: nothing repeats.
    repeats = count(page, "repeats")
    page.wait_for_timeout(6_000)
    assert (count(page, "sounded"), count(page, "repeats")) == (0, repeats)
    trouble.expect("WebSocket", "ERR_", "htmx:ws:error")


# Listens at the output of the page.
LISTEN = """() => {
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (to, ...more) {
    if (to instanceof AudioDestinationNode) {
      window.analyser ??= Object.assign(this.context.createAnalyser(), { fftSize: 32768 });
      connect.call(this, window.analyser);
    }
    return connect.call(this, to, ...more);
  };
}"""
LOUDEST = """ms => {
  for (const end = performance.now() + ms; performance.now() < end; );
  const samples = new Float32Array(window.analyser.fftSize);
  window.analyser.getFloatTimeDomainData(samples);
  return Math.max(...samples.map(Math.abs));
}"""


def test_a_page_whose_scripts_hang_sounds_all_the_same(server, vehicle, page, trouble):
    page.add_init_script(f"({LISTEN})()")
    aloud(page, server)
    page.wait_for_function("() => window.analyser")
    assert page.evaluate(LOUDEST, 500) < 0.01, "a page that is live is silent"
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    # Its tone begins 2.5 s after it was put off last, and lasts for 1.8 s.
    assert page.evaluate(LOUDEST, 3_400) > 0.1
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    until(lambda: page.evaluate(LOUDEST, 0) < 0.01, 10, "it is silent again")


def test_the_situations_of_the_paper_call_once_for_each_fault(server, vehicle, page, trouble):
    """Scenarios 2 to 6."""
    aloud(page, server)
    stage = lambda name: expect(page.locator("body")).to_have_attribute("data-stage", name)
    expected = 0

    def injected(calls):
        nonlocal expected
        expected += calls
        # A further call would come within the time in which its cause shows itself.
        page.wait_for_timeout(1_500)
        assert count(page, "sounded") == expected

    def planner_says(state):
        groups = page.request.get(f"{server.url}/api/v1/snapshot").json()["groups"]
        modules = [module for group in groups for module in group["modules"]]
        return any(it["id"] == "planning/planner_submitted" and it["own"] == state for it in modules)

    # 4: the planner fails while it does not matter.
    vehicle.set("planner_submitted", 2, "no plan was submitted")
    until(lambda: planner_says("error"), 20, "the failure is heard")
    injected(0)
    # It would matter once the vehicle drives, which is another topic.
    vehicle.set("planner_submitted", 0)
    until(lambda: planner_says("ok"), 20, "it works again")
    # 5: the vehicle becomes active.
    vehicle.drive(True)
    stage("active")
    injected(0)
    # 2: Localization notices a sensor outage before the sensor's own diagnosis does.
    vehicle.set("localization: tf_quality", 2, "jump")
    expect_tile(page, "localization", "error")
    vehicle.set("perception: costmap_delay", 2, "late")
    vehicle.set(NAME, 2, "Only 2.0 scans per second")
    expect_tile(page, "localization", "ignore", "masked")
    injected(1)
    # A symptom that outlives its cause would be a fault of its own.
    for name in ("perception: costmap_delay", "localization: tf_quality", NAME):
        vehicle.set(name, 0)
    expect_tile(page, "execution", "ok")
    # 3: Localization fails by itself, and what depends on it notices.
    vehicle.set("localization: tf_quality", 2, "jump")
    vehicle.set("perception: costmap_delay", 2, "late")
    vehicle.set("planner_submitted", 2, "no plan was submitted")
    expect_tile(page, "localization", "error")
    injected(1)
    for name in ("planner_submitted", "perception: costmap_delay", "localization: tf_quality"):
        vehicle.set(name, 0)
    expect_tile(page, "execution", "ok")
    # 6: the planner fails while the vehicle drives.
    vehicle.set("planner_submitted", 2, "no plan was submitted")
    expect_tile(page, "planning", "error")
    injected(1)
    assert page.locator("body").get_attribute("data-tones") != "dead"


def test_without_dependencies_each_component_calls_for_itself(page, trouble, tmp_path):
    """Scenario 1 of the paper: each affected component is a root cause of its own, and calls once."""
    config = tmp_path / "independent.yaml"
    config.write_text(re.sub(r"\n *depends_on: .*", "", CONFIG.read_text()))
    with serving(tmp_path, config=config) as server, contextlib.closing(Vehicle(server.domain, tmp_path)) as vehicle:
        aloud(page, server)
        vehicle.drive(True)
        expect(page.locator("body")).to_have_attribute("data-stage", "active")
        components = {"sensors": NAME, "localization": "localization: tf_quality", "perception": "perception: costmap_delay"}
        for calls, (component, status) in enumerate(components.items(), 1):
            vehicle.set(status, 2, "failed")
            expect_tile(page, component, "error")
            until(lambda: count(page, "sounded") == calls, 5, lambda: f"{count(page, 'sounded')} calls")
        expect_tile(page, "planning", "ok")
        # Another call would come within this time.
        page.wait_for_timeout(1_500)
        assert count(page, "sounded") == len(components)


# The page's audio, for the test.
AUDIO = """() => {
  const Real = AudioContext;
  window.AudioContext = class extends Real { constructor() { super(); window.audio = this; } };
}"""


def test_the_button_of_the_sound_does_not_move_what_a_finger_is_on(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    page.context.add_init_script(f"({AUDIO})()")
    # A page on which nothing was touched may not sound yet.
    page.reload()
    expect_standing(page)
    sound, mark = page.locator("[data-tool=sound]"), page.locator("button[name=mark]")
    expect(sound).to_have_attribute("data-sound", "off")
    box = mark.bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.wait_for_function("() => window.audio?.state === 'running'")
    expect(sound).to_have_attribute("data-sound", "off")
    assert mark.bounding_box() == box
    page.mouse.up()
    expect(page.locator(".mark .if-marked").first).to_be_visible()
    expect(sound).to_have_attribute("data-sound", "on")
    assert mark.bounding_box()["x"] != box["x"]
