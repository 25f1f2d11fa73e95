"""STOP is on the page as long as the vehicle moves, and answers the finger by its look, also on a frozen display."""

import contextlib
import re
import signal
import struct

import pytest
from playwright.sync_api import expect

from operating import expect_standing, log_in, step
from sizes import SMALL, check_sizes
from vehicle import CONFIG, Vehicle, Writer, serving

pytestmark = pytest.mark.timed

ANSWERS_MS = 200
MOTION = "motion: { speed: { topic: /speed, type: geometry_msgs/msg/TwistStamped, field: twist.linear.x, timeout: 1s }, standing_below: 0.1 }"
# Notes in each frame whether the vehicle moves, in which stage, and whether STOP is there and can be touched.
NOTE = """() => {
  window.seen = [];
  const note = () => {
    const stop = document.querySelector("#step button[name=stop]"), box = stop?.getBoundingClientRect();
    const over = box && document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    const moving = document.getElementById("motion").dataset.moving;
    window.seen.push([document.body.dataset.stage, moving, Boolean(over && stop.contains(over)), box?.left]);
    requestAnimationFrame(note);
  };
  note();
}"""
# Touches STOP, and gives its words and its look two frames later, with the time that this took.
TOUCH = """() => new Promise(done => {
  const stop = document.querySelector("#step button[name=stop]"), look = () => getComputedStyle(stop).backgroundColor;
  const before = look(), at = performance.now();
  stop.click();
  requestAnimationFrame(() => requestAnimationFrame(() => done({
    ms: performance.now() - at,
    changed: look() !== before,
    said: [...stop.querySelectorAll(".told")].filter(it => it.checkVisibility()).map(it => it.textContent.trim()).join(),
  })));
})"""


class Rolling(Vehicle):
    """A vehicle that says how fast it is."""

    def __init__(self, domain, folder):
        self.mps = 0.0
        self.wheels = Writer(domain, "rt/speed", "TwistStamped", folder / "speed.log")
        super().__init__(domain, folder)

    def publish(self):
        body = struct.pack("<iiI1s3x6d", 0, 0, 1, b"\0", self.mps, 0, 0, 0, 0, 0)
        self.wheels.write(raw=(b"\0\1\0\0" + body).hex())
        super().publish()

    def close(self):
        super().close()
        self.wheels.close()


@pytest.fixture
def rolling(tmp_path):
    config = tmp_path / "rolling.yaml"
    config.write_text(CONFIG.read_text() + "\n" + MOTION + "\n")
    with serving(tmp_path, config=config) as server, contextlib.closing(Rolling(server.domain, tmp_path)) as vehicle:
        yield server, vehicle


def test_stop_stays_while_an_arriving_vehicle_still_rolls(rolling, page):
    (server, vehicle), moving, stop = rolling, page.locator("#motion"), step(page, "stop")
    vehicle.mps = 0.28
    log_in(page, server)
    expect(page.locator("body")).to_have_attribute("data-stage", "localizing")
    expect(stop).to_be_visible()
    check_sizes(page, "localizing")
    vehicle.mps = 0.0
    expect_standing(page)
    expect(moving).to_have_attribute("data-moving", "no")
    expect(stop).to_have_count(0)
    page.evaluate(NOTE)
    vehicle.mps = 3.0
    vehicle.drive(True)
    expect(moving).to_have_text(re.compile(r"11\skm/h"))
    expect(stop).to_be_visible()
    place = stop.bounding_box()
    # At 11 km/h it would have been no arrival.
    vehicle.mps = 0.28
    expect(moving).to_have_text(re.compile(r"\b1\skm/h"))
    vehicle.drive(False)
    expect(page.locator("body")).to_have_attribute("data-stage", "standby")
    expect(moving).to_have_text(re.compile(r"1\skm/h"))
    check_sizes(page, "standby")
    expect(step(page, "clearance")).to_be_visible()
    assert stop.bounding_box() == place
    # It works there, and is latched until the vehicle stands.
    stop.click()
    expect(stop).to_have_attribute("aria-pressed", "true")
    expect(stop.locator(".told:visible")).to_have_text(re.compile(r"^asked \d\d:\d\d$"))
    expect(page.locator("#countermeasure")).to_have_attribute("data-request", "maneuver_stop")
    vehicle.mps = 0.0
    expect(moving).to_have_attribute("data-moving", "no")
    expect(stop).to_have_count(0)
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_have_count(0)
    seen = page.evaluate("() => window.seen")
    assert {stage for stage, moves, *_ in seen if moves == "yes"} >= {"active", "standby"}
    missing = [it for it in seen if it[1] == "yes" and it[0] != "localizing" and not it[2]]
    assert not missing, f"no STOP in {len(missing)} of {len(seen)} frames: {missing[:3]}"


# Whether STOP is in the window and takes a touch at its corners and in its middle.
UNCOVERED = """() => {
  const stop = document.querySelector("#step button[name=stop]"), { left, right, top, bottom } = stop.getBoundingClientRect();
  const points = [left + 12, (left + right) / 2, right - 12].flatMap(x => [top + 12, (top + bottom) / 2, bottom - 12].map(y => [x, y]));
  return bottom <= innerHeight && points.every(([x, y]) => stop.contains(document.elementFromPoint(x, y)));
}"""
# What the button says: on its way, not arrived, and requested.
SAID = {"en": ("Sending", "Not arrived", "asked"), "de": ("Wird gesendet", "Nicht angekommen", "gedrückt")}


@pytest.mark.parametrize("frozen, lang", [(False, "en"), (True, "en"), (True, "de")], ids=["just_stopped", "frozen", "frozen_de"])
def test_stop_answers_the_finger_although_the_server_does_not(server, driving, trouble, frozen, lang):
    page, stop, (sending, missed, asked) = driving, step(driving, "stop"), SAID[lang]
    told = stop.locator(".told:visible")
    if lang == "de":
        page.locator("[data-tool=language]").click()
        expect(stop).to_contain_text("Fahrzeug anhalten")
    server.send(signal.SIGSTOP)
    try:
        if frozen:
            expect(page.locator("body")).to_have_attribute("data-live", "dead")
            for width, height in SMALL:
                page.set_viewport_size({"width": width, "height": height})
                assert page.evaluate(UNCOVERED), f"{width}x{height}: something lies over STOP"
            page.set_viewport_size({"width": 1280, "height": 800})
        touched = page.evaluate(TOUCH)
        assert touched["changed"] and touched["said"] == sending and touched["ms"] < ANSWERS_MS, touched
        expect(told).to_have_text(missed, timeout=2_000)
        expect(page.locator("#notice .said span:visible")).to_be_visible()
        check_sizes(page, "not arrived")
    finally:
        server.send(signal.SIGCONT)
    expect(stop).to_have_attribute("aria-pressed", "true")
    expect(told).to_have_text(re.compile(rf"^{asked} \d\d:\d\d$"))
    trouble.expect("WebSocket", "ERR_", "409", "readyz")


def test_a_stop_on_a_live_display_is_latched_with_its_time_and_named_first(driving, vehicle):
    page, stop = driving, step(driving, "stop")
    vehicle.set("velodyne_packet_alive", 2, "no packets")
    touched = page.evaluate(TOUCH)
    assert touched["changed"] and touched["ms"] < ANSWERS_MS, touched
    expect(stop).to_have_attribute("aria-pressed", "true")
    expect(stop.locator(".told:visible")).to_have_text(re.compile(r"^asked \d\d:\d\d$"))
    expect(page.locator("#countermeasure")).to_have_text(re.compile(r"^STOP pressed \d\d:\d\d\. "))
