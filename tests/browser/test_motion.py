"""The motion in words and numbers: a shuttle that drives, is stopped, and falls silent."""

import re

import pytest
from playwright.sync_api import expect

from operating import watch
from vehicle import Client, Server, own_domain

# The simulation lives in real time.
pytestmark = pytest.mark.timed

DEPARTURE_MS = 40_000
# Notes every text of the motion with its time, and whether anything speaks it.
NOTE = """() => {
  window.said = [];
  const note = () => {
    const it = document.getElementById("motion");
    window.said.push([performance.now(), it.textContent.trim(), it.dataset.moving, Boolean(it.closest("[aria-live], [role=status]"))]);
  };
  note();
  const header = document.querySelector("header.bar");
  new MutationObserver(note).observe(header, { subtree: true, childList: true, characterData: true, attributes: true });
}"""


@pytest.fixture
def shuttle(tmp_path):
    server = Server(tmp_path, own_domain() + 40, "demo", ["--drive"]).start()
    yield server
    server.stop()


def test_words_and_numbers_say_what_the_shuttle_does(chromium, shuttle, trouble):
    client = Client(shuttle, "operator", "246810")
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB")
    context.add_cookies(client.browser_cookies())
    page = context.new_page()
    watch(page, trouble)
    page.goto(shuttle.url + "/")
    motion = page.locator("#motion")
    expect(motion).to_have_attribute("data-moving", "no", timeout=DEPARTURE_MS)
    page.evaluate(NOTE)
    fast = re.compile(r"^Driving · (1[0-9]|2[0-9])\skm/h · to Main Station$")
    expect(motion).to_have_text(fast, timeout=DEPARTURE_MS)
    way = page.locator("#step .way")
    expect(way).to_have_text(re.compile(r"^About \d+\sm to go$"))
    assert client.snapshot()["motion"]["destination"] == "station"
    # A stop is said as long as the vehicle moves, and no longer.
    client.stop()
    expect(motion).to_have_text(re.compile(r"^Stopping · \d+\skm/h$"))
    expect(motion).to_have_text("Standing · next: Main Station")
    expect(way).to_have_count(0)
    # Without the bus nobody knows whether it stands.
    client.post("/demo/fault", name="can_loss", active="true")
    expect(motion).to_have_text("Speed unknown")
    expect(motion).to_have_attribute("data-moving", "unknown")
    page.locator("[data-tool=language]").click()
    expect(motion).to_have_text("Geschwindigkeit unbekannt")
    said = page.evaluate("() => window.said")
    for _, text, moving, speaks in said:
        assert text.startswith(("Driving", "Stopping", "Slowing down")) == (moving == "yes"), (text, moving)
        assert ("km/h" in text) == (moving == "yes") and not speaks, (text, moving)
    changes = [at for (at, text, *_), (_, before, *_) in zip(said[1:], said) if text != before]
    busiest = max(sum(at <= other < at + 1000 for other in changes) for at in changes)
    assert busiest <= 8, f"{busiest} texts in a second"
    context.close()
