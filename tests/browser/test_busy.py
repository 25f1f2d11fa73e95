"""`telltale demo` on a computer that has much else to do: nothing shows but what somebody switched on."""

import contextlib
import os
import subprocess
import sys
import time

import pytest

from demo import DEPARTURE_S, OPERATOR, Faults, Stream, brief, healthy, masked_by, roots
from vehicle import Client, Server, own_domain

# It takes the processors away from every other test.
pytestmark = pytest.mark.alone

WORK_S = 90


@contextlib.contextmanager
def busy():
    """Twice as many programs that only calculate as there are processors."""
    work = f"import time\nend = time.monotonic() + {WORK_S}\nwhile time.monotonic() < end: pass"
    programs = [subprocess.Popen([sys.executable, "-c", work]) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait(timeout=10)


def moving(snapshot):
    return [it for it in snapshot["countermeasures"] if it["request"] != "notify"]


def test_a_busy_computer_raises_no_alarm_and_stops_no_shuttle_and_a_fault_still_shows(tmp_path):
    server = Server(tmp_path, own_domain() + 40, "demo", ["--drive"]).start()
    client = Client(server, *OPERATOR)
    stream = Stream(server, client)
    try:
        stream.wait(healthy, DEPARTURE_S, "all is well")
        with busy():
            seen = stream.wait(lambda s: s["stage"] == "active", DEPARTURE_S, "departure")
            left = time.monotonic()
            seen += stream.wait(lambda s: time.monotonic() - left > 8, 20, "eight seconds on the way")
            for snapshot in seen:
                assert not snapshot["alarms"] and not moving(snapshot) and not roots(snapshot), brief([snapshot])
            Faults(client).set("can_loss", True)
            seen = stream.wait(lambda s: masked_by(s, "execution") == ["can/bus"], 15, "the fault shows")
        assert {root for snapshot in seen for root in roots(snapshot)} == {"can/bus"}, brief(seen)
    finally:
        stream.close()
        assert server.stop() == 0
