"""The wall clock is set by an hour, forward and back, while an incident is recorded."""

import itertools
import json
import subprocess
import sys
from datetime import datetime

import pytest
from mcap.records import Message
from mcap.stream_reader import StreamReader
from playwright.sync_api import expect

from clock import Hand
from operating import log_in
from vehicle import OPERATOR, ROOT, TELLTALE, Client, Server, Writer, own_domain, until

DEVELOPER = ("dora", "a long password")
HOUR_S = 3600
CONFIG = """
vehicle: { stages: shuttle }
recording: { before: 5s, after: 3s, topics: [{ topic: '/foreign/*' }] }
groups: [{ id: base, modules: [{ id: motor, status: motor }] }]
"""


@pytest.fixture
def stepped(tmp_path):
    """A server and the hand of its clock."""
    config = tmp_path / "shuttle.yaml"
    config.write_text(CONFIG)
    server, hand = Server(tmp_path, own_domain(), config=config), Hand(tmp_path)
    server.add_user(*OPERATOR)
    server.add_user(*DEVELOPER, role="developer")
    with hand.held():
        server.start()
    yield server, hand
    assert server.stop() == 0


def log_times(file):
    """The times of all messages, in the order of the file."""
    with open(file, "rb") as source:
        return [it.log_time for it in StreamReader(source).records if isinstance(it, Message)]


def test_a_clock_that_is_set_by_an_hour_costs_nothing(stepped, page, tmp_path):
    server, hand = stepped
    log_in(page, server)
    live = lambda: expect(page.locator("body")).to_have_attribute("data-live", "live")
    live()
    developer = Client(server, *DEVELOPER)
    ask = lambda path: json.load(developer.opener.open(server.url + path, timeout=10))
    finished = lambda number: {it["id"]: it for it in ask("/api/v1/incidents")}.get(number, {}).get("recording", {}).get("finished")
    motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log")
    state = lambda: next((it["state"] for group in ask("/api/v1/snapshot")["groups"] for it in group["modules"] if it["id"] == "base/motor"), None)
    numbers = []
    try:
        # Each fault comes after a step, and is seen, shown and recorded.
        for turn, ahead_s in enumerate((0, HOUR_S, 0)):
            hand.set(ahead_s)
            begun = ask("/api/v1/snapshot")["at"]
            until(lambda: ask("/api/v1/snapshot")["at"] != begun, 10, "the snapshots go on")
            for level, expected in ((0, "ok"), (2, "error")):
                def shows():
                    motor.write(statuses=[{"level": level, "name": "motor", "message": f"turn {turn}"}])
                    return state() == expected
                until(shows, 30, lambda: f"turn {turn}: the motor shows {state()}")
            number = json.loads(developer.post("/api/v1/mark", note=f"turn {turn}"))["incident"]
            numbers.append(number)
            live()
    finally:
        motor.close()
    for number in set(numbers):
        until(lambda: finished(number), 60, lambda: ask("/api/v1/incidents"))
    live()
    steps, said = [], set()
    for number in sorted(set(numbers)):
        incident = ask(f"/api/v1/incidents/{number}")
        assert incident["recording"]["missing"] == 0, incident["recording"]
        # By one clock, however it was set meanwhile.
        since, until_ = (datetime.fromisoformat(incident[key]) for key in ("since", "until"))
        assert 0 < (until_ - since).total_seconds() < 120, (since, until_)
        moments = incident["story"]["moments"]
        steps += [round(it["by_ms"] / 1000 / HOUR_S) for it in moments if it["kind"] == "clock_set"]
        file = tmp_path / "incident.mcap"
        file.write_bytes(developer.opener.open(f"{server.url}/incidents/{number}.mcap", timeout=10).read())
        times = log_times(file)
        # Inputs of several threads are taken in turn, a moment after they came.
        back = max(before - after for before, after in itertools.pairwise(times))
        assert back < 1e9, f"incident {number}: a time lies {back / 1e9:.3f} s behind the one before it"
        assert max(times) - min(times) < 120e9, f"incident {number}: {min(times)} to {max(times)}"
        read = subprocess.run([sys.executable, ROOT / "tests/record/readers.py", file], capture_output=True, text=True, timeout=120)
        assert read.returncode == 0, read.stderr
        messages = [it for it in json.loads(read.stdout)["mcap_ros2"] if it[0] == "/diagnostics"]
        said |= {it[3]["status"][0]["message"] for it in messages}
        replayed = subprocess.run([TELLTALE, "replay", file], capture_output=True, text=True, timeout=120)
        assert replayed.returncode == 0 and "base/motor" in replayed.stdout, replayed.stdout + replayed.stderr
    assert steps == [1, -1], steps
    assert said == {"turn 0", "turn 1", "turn 2"}, said
    verified = subprocess.run([TELLTALE, "incident", "verify", "--data", server.folder], capture_output=True, text=True, timeout=60)
    assert verified.returncode == 0, verified.stdout + verified.stderr
