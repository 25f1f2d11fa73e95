"""`telltale demo --drive` from the outside: every fault of the data shows as it should, through real
DDS and the real monitors, read as a program reads it."""

import datetime
import json
import re
import signal
import subprocess
import time

import pytest
from mcap.reader import make_reader

from demo import (
    A_LEG_S,
    DEPARTURE_S,
    OPERATOR,
    Faults,
    Stream,
    acknowledge_all,
    brief,
    group,
    healthy,
    masked_by,
    roots,
    state,
    wait_for_a_stop,
)
from vehicle import TELLTALE, Client, Server, own_domain, until

# The simulation lives in real time.
pytestmark = pytest.mark.timed


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    server = Server(tmp_path_factory.mktemp("demo"), own_domain() + 40, "demo", ["--drive"]).start()
    yield server
    assert server.stop() == 0


@pytest.fixture(scope="module")
def client(demo):
    return Client(demo, *OPERATOR)


@pytest.fixture
def stream(demo, client):
    stream = Stream(demo, client)
    yield stream
    stream.close()


def test_a_demo_that_was_put_to_sleep_wakes_up_whole(demo, client, stream):
    stream.wait(healthy, A_LEG_S, "all is well")
    demo.pause()
    demo.send(signal.SIGCONT)
    woken = time.monotonic()
    # Its statuses would be silent for longer than their timeout of 2 s by then.
    stream.wait(lambda s: time.monotonic() - woken > 4 and healthy(s), 20, "all is well again")
    # If nothing was heard for long enough in the middle of a drive, the shuttle was asked to slow down.
    acknowledge_all(client)
    client.release()
    stream.wait(lambda s: not s["countermeasures"], 10, "countermeasures are released")


@pytest.fixture
def faults(client, stream):
    """Faults that a failed test leaves are ended, or the next tests would fail."""
    faults = Faults(client)
    yield faults
    for name in list(faults.active):
        faults.over(name, stream)


def test_a_stalled_planner_matters_only_while_driving(client, stream, faults):
    wait_for_a_stop(stream, client)
    faults.set("planner_stall", True)
    seen = stream.wait(lambda s: s["stage"] == "active", DEPARTURE_S, "departure")
    for snapshot in seen[:-1]:
        assert state(snapshot, "planning") == "ignore" and not roots(snapshot), brief([snapshot])
    seen = stream.wait(lambda s: state(s, "planning") == "error", 10, "Planning in ERROR")
    assert roots(seen[-1]) == ["planning/planner_submitted"]
    assert masked_by(seen[-1], "execution") == ["planning/planner_submitted"]
    measure = stream.wait(lambda s: s["countermeasures"], 5, "a countermeasure")[-1]["countermeasures"][0]
    assert (measure["request"], measure["mps2"]) == ("decelerate", 1.0), measure
    faults.over("planner_stall", stream)
    stream.wait(lambda s: s["stage"] == "active" and healthy(s), 20, "all is well while driving")
    stream.wait(lambda s: not s["countermeasures"], 10, "the countermeasure is released")


def test_in_a_sensor_outage_localization_shows_it_first_and_then_waits_for_the_cause(stream, faults):
    cause = "sensors/velodyne_packet_alive"
    stream.wait(healthy, A_LEG_S, "all is well")
    faults.set("sensor_outage", True)
    seen = stream.wait(lambda s: state(s, "sensors") == "error", 15, "Sensors in ERROR")
    states = [(state(snapshot, "sensors"), state(snapshot, "localization")) for snapshot in seen]
    assert ("ok", "error") in states, states
    assert ("warning", "error") in states, states
    last = stream.wait(lambda s: masked_by(s, "localization") == [cause], 5, "Localization waits")[-1]
    assert roots(last) == [cause]
    assert group(last, "localization")["own"] == "error"
    seen = faults.over("sensor_outage", stream)
    after = [snapshot for snapshot in seen if state(snapshot, "sensors") != "error"]
    assert not any(root for snapshot in after for root in roots(snapshot)), brief(after)


@pytest.mark.parametrize(
    "fault, group_name, shown, cause, waits",
    [
        ("localization_jump", "localization", "error", "localization/tf_quality", ["perception", "prediction"]),
        ("costmap_delay", "perception", "error", "perception/costmap_delay", ["prediction"]),
        ("can_loss", "can", "error", "can/bus", ["localization", "perception", "prediction"]),
        ("low_battery", "can", "warning", None, []),
        ("camera_crash", "sensors", "error", "sensors/camera_driver", ["sensors/camera_front"]),
    ],
)
def test_a_fault_shows_at_its_group_and_what_depends_on_it_waits(stream, faults, fault, group_name, shown, cause, waits):
    stream.wait(healthy, A_LEG_S, "all is well")
    faults.set(fault, True)
    seen = stream.wait(
        lambda s: state(s, group_name) == shown and all(masked_by(s, name) == [cause] for name in waits),
        15,
        f"{group_name} in {shown}, {waits} wait",
    )
    assert roots(seen[-1]) == ([cause] if cause else [])
    seen = faults.over(fault, stream)
    assert {root for snapshot in seen for root in roots(snapshot)} <= {cause}, brief(seen)


def test_developers_see_the_nodes_of_the_shuttle_as_they_come_and_go(demo, stream, faults):
    developer = Client(demo, "developer", "demo-developer")

    def nodes():
        with developer.opener.open(demo.url + "/developer/topics", timeout=10) as answer:
            page = answer.read().decode()
        return set(re.findall(r"/\w+_driver\b|/simulated_machine\b|/telltale\b", page))

    stream.wait(healthy, A_LEG_S, "all is well")
    everybody = {"/camera_driver", "/imu_driver", "/gnss_driver", "/simulated_machine"}
    until(lambda: everybody <= nodes(), 10, nodes)
    faults.set("camera_crash", True)
    until(lambda: everybody - nodes() == {"/camera_driver"}, 10, nodes)
    faults.over("camera_crash", stream)
    until(lambda: everybody <= nodes(), 10, nodes)


def recorded(path):
    """The changes of nodes in a recording, as they were shown: those of the first instant are what was there before."""
    with open(path, "rb") as file:
        texts = [
            message.data[8 : 7 + int.from_bytes(message.data[4:8], "little")]
            for _, _, message in make_reader(file).iter_messages(topics=["/telltale/transitions"], log_time_order=False)
        ]
    changes = [change for change in map(json.loads, texts) if change["kind"] == "shown"]
    first = changes[0]["at_ms"]
    return [(it["at_ms"], it["node"], it["shown"], it["own"]) for it in changes if it["at_ms"] != first]


def replayed(path):
    words = [TELLTALE, "replay", str(path), "--json", "--from", "1970-01-01T00:00:00Z"]
    done = subprocess.run(words, text=True, capture_output=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    ms = lambda at: round(datetime.datetime.fromisoformat(at).timestamp() * 1000)
    changes = map(json.loads, done.stdout.splitlines())
    return [(ms(it["at"]), it["node"], it["shown"], it["own"]) for it in changes]


def test_every_incident_is_replayed_as_it_was_shown(demo, tmp_path):
    """The faults above were recorded: the engine that takes a recording shows the same changes at the same times."""
    developer = Client(demo, "developer", "demo-developer")

    def get(path):
        with developer.opener.open(demo.url + path, timeout=30) as answer:
            return answer.read()

    incidents = lambda: [it for it in json.loads(get("/api/v1/incidents?count=200"))]
    until(lambda: all(it["recording"]["finished"] for it in incidents()), 90, incidents)
    assert len(incidents()) > 0
    series = []
    for number in (it["id"] for it in incidents()):
        # A long recording takes a while to be replayed.
        told = lambda: json.loads(get(f"/api/v1/incidents/{number}"))["story"]
        story = until(lambda: (it := told()) and not it["series_pending"] and it, 60, told)
        assert story["left_out"] == [], story["left_out"]
        series += story["series"]
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(get(f"/incidents/{number}.mcap"))
        shown = recorded(path)
        again = replayed(path)
        assert again[-len(shown) :] == shown, number
        assert len(again) - len(shown) <= 100, "those of the first instant alone"
    # Numbers over time: the shuttle drove, and what failed has its limits.
    speeds = [number for it in series if it["key"] == "speed_kmh" for _, number in it["points"] if number is not None]
    assert max(speeds) > 5, speeds
    assert any(it["limits"] and it["node"] for it in series), [(it["node"], it["key"]) for it in series]
