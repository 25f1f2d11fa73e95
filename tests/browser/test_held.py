"""A held vehicle stays held when the server is killed, or ends as systemd asks it, and is started again: over DDS, with the simulated shuttle as a
process of its own. Virtual time tries the other requests and ends (`src/cli/running/demo/tests/held.rs`)."""

import contextlib
import json
import re
import sqlite3
import time

import pytest
from playwright.sync_api import expect

from programs import ROOT, peer, simulation, until
from vehicle import OPERATOR, Client, own_domain, serving

# The simulation lives in real time.
pytestmark = pytest.mark.timed

SHUTTLE = ROOT / "config/shuttle.yaml"
# It leaves its stop after 20 s, and has its full speed of 7 m/s seven seconds later.
STALL = "planner_stall@29..32"
AWAY_S = 5
BRAKES_S = 20
# The wheels are read with a little noise.
NOISE_MPS = 0.05


class Speed:
    """What the wheels say, with the time at which it came."""

    def __init__(self, domain):
        self.said = []
        self.close = peer(domain, "sub", "--topic", "rt/can/speed=TwistStamped", hear=self.hear).close

    def hear(self, line):
        value = json.loads(line).get("value")
        if value:
            self.said.append((time.monotonic(), value["linear"][0]))

    def now(self):
        return self.said[-1][1] if self.said else 0

    def since(self, at):
        return [mps for heard, mps in self.said if heard >= at]


def goes_on(client, speed):
    """A busy machine may be late enough for a fault of its own, which is released too."""
    client.release()
    return speed.now() > 1


def requests_on_disk(server):
    database = sqlite3.connect(f"file:{server.folder}/telltale.db?mode=ro", uri=True)
    try:
        return [request for request, in database.execute("SELECT request FROM countermeasures")]
    finally:
        database.close()


@pytest.mark.parametrize("end", ["kill", "stop"])
def test_a_shuttle_held_by_a_deceleration_alone_stays_held_when_the_server_ends(end, tmp_path, page, trouble):
    domain = own_domain()
    with serving(tmp_path, config=SHUTTLE) as server, contextlib.closing(Speed(domain)) as speed:
        client = Client(server, *OPERATOR)
        moving = lambda: [it for it in client.snapshot()["countermeasures"] if it["request"] != "notify"]
        with simulation(domain, SHUTTLE, "--drive", "--fault", STALL, log=tmp_path / "sim.log"):
            until(lambda: "decelerate" in [it["request"] for it in moving()], 60, lambda: f"it is slowed down: {moving()}")
            until(lambda: "decelerate" in requests_on_disk(server), 5, "the request is stored")
            getattr(server, end)()
            killed = time.monotonic()
            until(lambda: time.monotonic() >= killed + AWAY_S, 2 * AWAY_S, "it is away")
            assert speed.since(killed + AWAY_S / 2)[-1] < speed.since(killed)[0], "it brakes although nobody asks any more"
            server.start()
            # Whatever the page knows of the components, it says what holds the vehicle, since when and why.
            page.context.add_cookies(client.browser_cookies())
            page.goto(server.url + "/")
            held = page.locator("#countermeasure[data-request=decelerate]")
            expect(held).to_contain_text(re.compile(r"since \d\d:\d\d\. \S"))
            until(lambda: speed.now() < NOISE_MPS, BRAKES_S, lambda: f"it stands: {speed.now()} m/s")
            stood = time.monotonic()
            until(lambda: time.monotonic() >= stood + 2 * AWAY_S, 4 * AWAY_S, "time passes")
            after = speed.since(killed + 1)
            grew = max(later - min(after[: at + 1]) for at, later in enumerate(after))
            assert grew < 2 * NOISE_MPS, f"{grew} m/s faster without a release"
            expect(page.locator("#instruction strong")).to_have_text("Stopped. Cause gone. Continue?")
            expect(held).to_contain_text(re.compile(r"^Held since \d\d:\d\d\."))
            until(lambda: goes_on(client, speed), 3 * BRAKES_S, lambda: f"it goes on: {speed.now()} m/s, {moving()}")
    trouble.expect("WebSocket", "ERR_", "readyz")
