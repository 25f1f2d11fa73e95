"""The paper's six scenarios and every fault of both simulations, live over DDS or Zenoh: the replay of each incident gives the same
changes as the live page. The changes of the page stand in history.db; the replay is read as text, and in its pages at each of these instants."""

import contextlib
import datetime
import json
import re
import sqlite3
import subprocess
import threading
import urllib.error

import pytest
from websockets.exceptions import ConnectionClosed

from demo import Stream, brief, masked_by, roots, state
from programs import ROOT, TELLTALE, simulation, until
from test_developer import DEVELOPER
from test_zenoh import router_address, running_router
from vehicle import OPERATOR, Client, Server, own_domain

# The simulations live in real time, and three vehicles at once leave little for others.
pytestmark = pytest.mark.alone

# As `engine/state.rs` numbers them, on the disk too.
STATES = ["ignore", "ok", "warning", "unknown", "error"]
SHUTTLE, ROBOT = ROOT / "config/shuttle.yaml", ROOT / "config/robot.yaml"
# History and recording read the wall clock at different instants, and it may be slewed meanwhile.
CLOCKS_MS = 100
LIDAR, PLANNER = "sensors/velodyne_packet_alive", "planning/planner_submitted"


def fails(name, cause, *waiting):
    return lambda s: state(s, name) == "error" and cause in roots(s) and all(masked_by(s, it) == [cause] for it in waiting)


def is_root(cause):
    return lambda s: cause in roots(s)


# Faults with the seconds of the simulation for which they last, and what has to be shown, in this order. The shuttle leaves its stop
# after 10 s. What it does about a fault is not released, so it stands from the first one on, and is active all the same.
STORIES = {
    "shuttle": {
        "config": SHUTTLE.read_text(),
        "faults": [
            ("planner_stall", 3, 7), ("planner_stall", 18, 22), ("localization_jump", 26, 30), ("sensor_outage", 34, 39),
            ("costmap_delay", 43, 47), ("can_loss", 51, 55), ("low_battery", 59, 63), ("camera_crash", 67, 82),
        ],
        "shown": [
            ("scenario 4", lambda s: s["stage"] == "standby" and state(s, "planning") == "ignore" and not roots(s)),
            ("scenario 5", lambda s: s["stage"] == "active" and state(s, "planning") == "ok"),
            ("scenario 6", fails("planning", PLANNER, "execution")),
            ("scenario 3", fails("localization", "localization/tf_quality", "perception")),
            ("scenario 2, at first", lambda s: state(s, "localization") == "error" and state(s, "sensors") != "error"),
            ("scenario 2", fails("sensors", LIDAR, "localization", "perception")),
            ("costmap_delay", fails("perception", "perception/costmap_delay", "prediction")),
            ("can_loss", fails("can", "can/bus", "localization")),
            ("low_battery", lambda s: state(s, "can") == "warning"),
            ("camera_crash", fails("sensors", "sensors/camera_driver", "sensors/camera_front")),
        ],
    },
    # Scenario 1: nobody knows the dependencies.
    "alone": {
        "transport": "zenoh",
        "config": re.sub(r"^ +depends_on: .*\n", "", SHUTTLE.read_text(), flags=re.MULTILINE),
        "faults": [("sensor_outage", 18, 24)],
        "shown": [
            ("scenario 1", lambda s: [state(s, it) for it in ("sensors", "localization", "perception")] == ["error"] * 3),
        ],
    },
    "robot": {
        "config": ROBOT.read_text(),
        "faults": [
            ("docking_failed", 5, 9), ("lidar_outage", 14, 18), ("wheel_slip", 22, 26), ("localization_lost", 30, 34),
            ("navigation_stall", 38, 50), ("controller_crash", 54, 66), ("battery_low", 70, 73),
        ],
        "shown": [
            ("docking_failed", is_root("docking/charging")),
            ("lidar_outage", fails("lidars", "lidars/front", "localization", "navigation")),
            ("wheel_slip", fails("base", "base/wheel_slip", "localization", "navigation")),
            ("localization_lost", fails("localization", "localization/certainty", "navigation")),
            ("navigation_stall", is_root("navigation/commands")),
            ("controller_crash", is_root("navigation/controller")),
            ("battery_low", lambda s: state(s, "battery") == "warning"),
        ],
    },
}


class Live:
    """A server and the simulation of a vehicle, with all snapshots since the start."""

    def __init__(self, folder, domain, name, story, open_until):
        self.name, self.seen = name, []
        config = folder / f"{name}.yaml"
        config.write_text(story["config"])
        transport = ["--transport", story.get("transport", "dds")]
        self.server = Server(folder, domain, config=config, flags=transport)
        self.server.add_user(*OPERATOR)
        self.server.add_user(*DEVELOPER, role="developer")
        self.server.start()
        open_until.callback(self.stop)
        self.operator = Client(self.server, *OPERATOR)
        self.developer = Client(self.server, *DEVELOPER)
        self.stream = Stream(self.server, self.developer)
        open_until.callback(self.stream.close)
        threading.Thread(target=self.follow, daemon=True).start()
        flags = [*transport, "--robot" if name == "robot" else "--drive"]
        for fault, begin, end in story["faults"]:
            flags += ["--fault", f"{fault}@{begin}..{end}"]
        open_until.enter_context(simulation(domain, config, *flags, log=folder / "sim.log"))
        if name == "shuttle":
            until(self.is_localized, 10, lambda: brief(self.seen[-1:]))

    def is_localized(self):
        """The operator says where it stands, as soon as somebody listens to that."""
        with contextlib.suppress(urllib.error.HTTPError):
            self.operator.post("/vehicle/localize", version=self.operator.snapshot()["seq"], stop="depot")
            return True

    def follow(self):
        with contextlib.suppress(ConnectionClosed, OSError):
            for message in self.stream.socket:
                self.seen.append(json.loads(message))

    def stop(self):
        assert self.server.stop() == 0

    def get(self, path):
        with self.developer.opener.open(self.server.url + path, timeout=30) as answer:
            return answer.read()

    def incidents(self):
        return json.loads(self.get("/api/v1/incidents?count=200"))

    def history(self):
        """Every change of a node that was shown."""
        columns = "at_ms, node.name, state, own, cause.name"
        tables = "records JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS cause ON cause.id = other"
        with contextlib.closing(sqlite3.connect(self.server.folder / "history.db")) as database:
            rows = database.execute(f"SELECT {columns} FROM {tables} WHERE kind = 1 ORDER BY records.id").fetchall()
        return [(at, name, STATES[shown], STATES[own], cause) for at, name, shown, own, cause in rows]


@pytest.fixture(scope="module")
def vehicles(tmp_path_factory):
    """All of them side by side, each in a domain of its own."""
    with contextlib.ExitStack() as stack, pytest.MonkeyPatch.context() as patch:
        stack.enter_context(running_router(router_address(patch)))
        yield {
            name: Live(tmp_path_factory.mktemp(name), own_domain() + 42 + number, name, story, stack)
            for number, (name, story) in enumerate(STORIES.items())
        }


def as_text(path):
    words = [TELLTALE, "replay", str(path), "--json"]
    done = subprocess.run(words, text=True, capture_output=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    ms = lambda at: round(datetime.datetime.fromisoformat(at).timestamp() * 1000)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    by = lambda reason: reason["by"][0] if reason and reason["kind"] == "masked" else None
    # Those of the first instant are what was there before.
    return [(ms(it["at"]), it["node"], it["shown"], it["own"], by(it["reason"])) for it in lines if it["t_s"] > 0]


def same(live, again):
    """The changes that were shown live while the recording lasted; they are those of the replay, one for one."""
    what = lambda changes: [change[1:] for change in changes]
    starts = range(len(live) - len(again) + 1)
    begin = next((at for at in starts if what(live[at : at + len(again)]) == what(again) and near(live[at], again[0])), None)
    assert begin is not None, (again, [it for it in live if again[0][0] - 1000 < it[0] < again[-1][0] + 1000])
    found = live[begin : begin + len(again)]
    assert all(map(near, found, again)), list(zip(found, again))
    return begin, begin + len(again)


def near(one, other):
    return abs(one[0] - other[0]) <= CLOCKS_MS


def in_pages(vehicle, number, changes, live):
    """Goes to each instant of these changes: every page shows what was shown live then."""

    def order(**orders):
        return json.loads(vehicle.developer.post(f"/replay/{number}/state", **orders))

    def opened():
        try:
            return vehicle.get(f"/replay/{number}")
        except urllib.error.HTTPError as error:
            assert error.code == 503, error.read()

    until(opened, 60, f"the replay of {number} is open")
    screen = f"/replay/{number}/screen"
    first = order(at_ms=0)["from_ms"]
    shown = {}
    for _, node, *what in live:
        shown[node] = what
    instants = sorted({change[0] for change in changes})
    for at_ms in instants:
        for change in changes:
            if change[0] == at_ms:
                shown[change[1]] = list(change[2:])
        # A millisecond has many instants: those before the next change show all of this one.
        if any(at_ms < other <= at_ms + 2 for other in instants):
            continue
        place = order(at_ms=at_ms + 1)["at_ms"]
        assert place == max(at_ms + 1, first), (place, at_ms)
        snapshot = lambda: json.loads(vehicle.get(f"{screen}/api/v1/snapshot"))
        at = lambda: round(datetime.datetime.fromisoformat(snapshot()["at"]).timestamp() * 1000)
        until(lambda: abs(at() - place) <= 1, 10, lambda: (at(), place))
        found = {}
        for group in snapshot()["groups"]:
            found[group["id"]] = group["state"]
            found |= {module["id"]: module["state"] for module in group["modules"]}
        wrong = {node: (what[0], found[node]) for node, what in shown.items() if node in found and found[node] != what[0]}
        assert not wrong, (number, at_ms, wrong)
        # The operator's tiles and the developer's rows say the same.
        page = vehicle.get(f"{screen}/").decode()
        assert 'data-live="replay"' in page
        tiles = re.findall(r'id="tile-([\w-]+)"[^>]*? data-state="(\w+)"', page)
        assert tiles and all(found[name] == said for name, said in tiles), (number, at_ms, tiles, found)
        rows = re.findall(r'<tr data-row data-state="(\w+)"[^>]* data-module="([^"]+)"', vehicle.get(f"{screen}/developer").decode())
        # Telltale's own modules stand in no group.
        known = {node: what[0] for node, what in shown.items()} | found
        assert rows and all(known[name] == said for said, name in rows), (number, at_ms, rows, known)
    return len(instants)


@pytest.mark.parametrize("name", STORIES)
def test_every_incident_is_replayed_as_it_was_shown(vehicles, name, tmp_path):
    vehicle, place = vehicles[name], 0
    for what, holds in STORIES[name]["shown"]:
        found = lambda: next((at for at in range(place, len(vehicle.seen)) if holds(vehicle.seen[at])), None)
        until(lambda: found() is not None, 60, lambda: f"{what}: {brief(vehicle.seen[place::40])}")
        place = found()
    is_masked = lambda group: group["reason"] and group["reason"]["kind"] == "masked"
    assert name != "alone" or not any(is_masked(group) for s in vehicle.seen for group in s["groups"])
    finished = lambda: vehicle.incidents() and all(it["recording"]["finished"] for it in vehicle.incidents())
    until(finished, 90, vehicle.incidents)
    covered, live = set(), vehicle.history()
    for number in sorted(it["id"] for it in vehicle.incidents()):
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(vehicle.get(f"/incidents/{number}.mcap"))
        again = as_text(path)
        begin, end = same(live, again)
        covered |= set(range(begin, end))
        print(name, number, len(again), "changes,", in_pages(vehicle, number, again, live[:begin]), "instants in the pages")
    assert covered
