"""The whole program over Zenoh, with foreign peers that speak as rmw_zenoh does: the vehicle's day, its services, and a
router that goes away. No rmw_zenoh_cpp runs here (docs/zenoh.md says how to try one)."""

import contextlib
import itertools
import json
import os
import struct
import subprocess
import sys
import signal
import time

import pytest

from programs import PYTHON, ROOT, Program, until
from test_developer import prepare
from test_ros_services import nodes_call_every_service
from test_strangers import Site
from vehicle import OPERATOR, Client, Vehicle, Writer, free_port, megabytes, serving

sys.path.insert(0, str(ROOT / "tests/dds"))
import wire  # noqa: E402

pytestmark = pytest.mark.timed

ZENOH = ("--dds", "rmw_zenoh")
RMW_ZENOH = ROOT / "tests/dds/rmw_zenoh.py"

CONFIG = """
vehicle: { stages: none }
groups:
  - id: base
    modules:
      - { id: motor, status: motor, timeout: 1s }
      - { id: node, monitor: { watchdog: { node: /peer, every: 500ms, misses: 2 } } }
      - { id: stop, monitor: { value: { topic: /pressed, type: std_msgs/msg/Bool, field: data, error_unless: false, empty: unknown } } }
"""


def router_address(patch):
    """An address that all programs of the test know."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    patch.setenv("ZENOH_CONFIG_OVERRIDE", f'connect/endpoints=["{endpoint}"]')
    return endpoint


@contextlib.contextmanager
def running_router(endpoint):
    program = Program(PYTHON, RMW_ZENOH, "router", endpoint)
    try:
        until(lambda: program.said("ready"), 20, "the router is there")
        yield program
    finally:
        program.kill()


@pytest.fixture
def router(monkeypatch):
    """Starts a router, each time at the same address."""
    endpoint = router_address(monkeypatch)
    return lambda: running_router(endpoint)


def groups(client):
    return {group["id"]: group for group in client.snapshot()["groups"] if group["id"] != "telltale"}


def states(client):
    return {name: group["state"] for name, group in groups(client).items()}


@pytest.mark.parametrize("library", ["rmw_zenoh", "pyzeros_node"])
def test_a_vehicle_is_diagnosed_and_led_over_zenoh(library, router, tmp_path):
    # What compiles at the first use does it before the time counts.
    subprocess.run([PYTHON, ROOT / f"tests/dds/{library}.py"], stdin=subprocess.DEVNULL, check=True, timeout=200)
    with router(), serving(tmp_path, flags=["--transport", "zenoh"]) as server:
        vehicle = Vehicle(server.domain, tmp_path, options=("--dds", library))
        try:
            client = prepare(server)
            vehicle.drive(True)
            until(lambda: client.snapshot()["stage"] == "active", 20, lambda: f"it drives: {client.snapshot()}")
            is_well = lambda: len(states(client)) == 8 and set(states(client).values()) == {"ok"}
            until(is_well, 20, lambda: f"eight tiles are OK: {states(client)}")
            vehicle.set("velodyne_packet_alive", 2, "no packets")
            until(lambda: states(client)["sensors"] == "error", 10, lambda: f"the fault: {states(client)}")
            until(lambda: states(client)["localization"] == "ignore", 10, lambda: f"it waits: {states(client)}")
            roots = [root["node"] for root in client.snapshot()["roots"]]
            assert roots == ["sensors/velodyne_packet_alive"], roots
            vehicle.set("velodyne_packet_alive", 0)
            until(is_well, 20, lambda: f"it recovers: {states(client)}")
            client.stop()
            heard = (tmp_path / "listener.log").read_text
            until(lambda: '"data": true' in heard(), 10, "the vehicle hears the stop")
        finally:
            vehicle.close()


def test_a_router_that_is_late_hangs_or_goes_away_is_no_publisher_that_is_gone(router, tmp_path):
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG)
    with serving(tmp_path, config=config, flags=["--transport", "zenoh"]) as server:
        client = Client(server, *OPERATOR)
        dds = lambda: [it for it in client.snapshot()["groups"] if it["id"] == "telltale"]
        until(lambda: "router" in str(dds()), 20, lambda: f"no router: {dds()}")
        with router() as first:
            pressed = Writer(server.domain, "rt/pressed", "Bool", tmp_path / "pressed.log", options=(*ZENOH, "--durability", "transient_local", "--depth", "1"))
            motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log", options=ZENOH)

            def runs():
                motor.write(statuses=[{"name": "motor", "level": 0, "message": "runs"}])
                modules = {it["id"].split("/")[-1]: it["state"] for it in groups(client)["base"]["modules"]}
                return modules

            pressed.write(bool=False)
            until(lambda: set(runs().values()) == {"ok"}, 30, lambda: f"all is OK: {runs()}")
            first.process.send_signal(signal.SIGSTOP)
            until(lambda: [it["state"] for it in dds()] == ["error"], 20, lambda: f"the router hangs: {dds()}")
            assert "is announced" not in str(groups(client)), "nothing is concluded from it"
            first.process.send_signal(signal.SIGCONT)
            until(lambda: set(runs().values()) == {"ok"}, 30, lambda: f"the router goes on: {runs()}")
            first.process.send_signal(signal.SIGKILL)
            until(lambda: "router" in str(dds()), 20, lambda: f"the router is gone: {dds()}")
            assert "is announced" not in str(groups(client)), "nothing is concluded from it"
        with router():
            pressed.write(bool=True)
            until(lambda: runs()["stop"] == "error", 30, lambda: f"it is pressed: {runs()}")
            until(lambda: runs()["motor"] == "ok", 20, lambda: f"the motor is back: {runs()}")
            # A publisher that is killed leaves at once.
            os.kill(motor.program.process.pid, signal.SIGKILL)
            modules = lambda: {it["id"].split("/")[-1]: it["state"] for it in groups(client)["base"]["modules"]}
            until(lambda: modules()["motor"] != "ok", 10, lambda: f"it is missed: {modules()}")
        pressed.kill()


def test_the_second_router_serves_where_the_first_is_dead_and_its_hanging_is_noticed_at_once(router, tmp_path, monkeypatch):
    alive = json.loads(os.environ["ZENOH_CONFIG_OVERRIDE"].partition("=")[2])
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", f"connect/endpoints={json.dumps([f'tcp/127.0.0.1:{free_port()}', *alive])}")
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG)
    with router() as second, serving(tmp_path, config=config, flags=["--transport", "zenoh"]) as server:
        client = Client(server, *OPERATOR)
        motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log", options=ZENOH)

        def module(name):
            motor.write(statuses=[{"name": "motor", "level": 0, "message": "runs"}])
            return next((it for group in client.snapshot()["groups"] for it in group["modules"] if it["id"] == name), {})

        until(lambda: module("base/motor")["state"] == "ok", 20, lambda: f"the motor is heard: {module('base/motor')}")
        second.process.send_signal(signal.SIGSTOP)
        until(lambda: module("telltale/dds").get("state") == "error", 4, lambda: f"the router hangs: {server.read_log()[-2000:]}")
        motor.kill()


def test_an_event_that_a_full_line_may_have_lost_is_not_ok(router, tmp_path):
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG)
    with router(), serving(tmp_path, config=config, flags=["--transport", "zenoh"]) as server:
        client = Client(server, *OPERATOR)
        pressed = Writer(server.domain, "rt/pressed", "Bool", tmp_path / "pressed.log", options=ZENOH)
        motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log", options=ZENOH)
        stop = lambda: next(it for it in groups(client)["base"]["modules"] if it["id"] == "base/stop")
        runs = lambda: motor.write(statuses=[{"name": "motor", "level": 0, "message": "runs"}])

        def is_let_go():
            runs()
            pressed.write(bool=False)
            return stop()["state"] == "ok"

        until(is_let_go, 30, lambda: f"it is let go: {stop()}")
        written = lambda name: len((tmp_path / name).read_text().splitlines())
        processes = [*server.children(), server.process.pid]
        for process in processes:
            os.kill(process, signal.SIGSTOP)
        until_flooded, until_pressed = written("motor.log") + 1, written("pressed.log") + 1
        motor.write(count=2000, times=300)
        until(lambda: written("motor.log") >= until_flooded, 20, "the line is full")
        pressed.write(bool=True)
        until(lambda: written("pressed.log") >= until_pressed, 10, "it is pressed")
        for process in processes:
            os.kill(process, signal.SIGCONT)

        def is_doubtful():
            runs()
            return stop()["state"] != "ok"

        until(is_doubtful, 10, lambda: f"it may be pressed: {stop()}")
        for writer in (pressed, motor):
            writer.kill()


def test_services_are_called_over_zenoh(router, tmp_path):
    with router():
        nodes_call_every_service(tmp_path, ["rmw_zenoh", "rmw_zenoh"], ["--transport", "zenoh"])


class Forger:
    """Says on Zenoh what no node says."""

    QOS = "::,10:,:,:,,"
    DIAGNOSTICS = "diagnostic_msgs::msg::dds_::DiagnosticArray_"

    def __init__(self, domain):
        self.domain, self.program = domain, Program(PYTHON, RMW_ZENOH, "forge")
        until(lambda: self.program.said("ready"), 20, "the forger is there")

    def token(self, topic="%diagnostics", type_name=DIAGNOSTICS, session="abcd", number=1, kind="MP", hash="RIHS01_x"):
        return f"@ros2_lv/{self.domain}/{session}/0/{number}/{kind}/%/%/stranger/{topic}/{type_name}/{hash}/{self.QOS}"

    def tell(self, **command):
        told = len(self.program.said("done"))
        self.program.tell(**command)
        until(lambda: len(self.program.said("done")) > told, 60, "it is said")

    def publish(self, data, attachment=None):
        key = f"{self.domain}/diagnostics/{self.DIAGNOSTICS}/RIHS01_x"
        self.tell(key=key, data=data.hex(), attachment=None if attachment is None else attachment.hex())


@pytest.fixture
def site(router, tmp_path):
    with contextlib.ExitStack() as stack:
        stack.enter_context(router())
        site = Site(stack, tmp_path, flags=["--transport", "zenoh"], options=ZENOH)
        until(site.is_heard, 20, "the vehicle is heard")
        site.forger = Forger(site.server.domain)
        stack.callback(site.forger.program.kill)
        yield site


def topics(site):
    """The first topics by their names, with the number of their publishers, and how many there are."""
    with site.client.opener.open(site.server.url + "/api/v1/topics", timeout=10) as answer:
        found = json.load(answer)
    publishers = {it["topic"]: len(it["publishers"]) for it in found["topics"]}
    return publishers, len(publishers) + found["more"]


def is_untouched(site, processes):
    """The vehicle is heard by the same processes, and nothing is concluded."""
    assert site.server.children() == processes, site.server.read_log()[-2000:]
    dds = site.module("telltale/dds")
    assert dds is None or dds["state"] == "ok", dds
    return site.is_heard()


def test_no_token_ends_the_diagnosis(site):
    processes, token = site.server.children(), site.forger.token
    good = token()
    site.forger.tell(tokens=[
        # Of too few and too many parts, of each length.
        *("/".join(good.split("/")[:parts]) for parts in range(2, 13)), good + "/backends:cpu:/more/and/more",
        # Topics that are none, as their names are on DDS "rt/", "rt//" and so on.
        *(token(topic=topic) for topic in ("%", "%%", "%%a", "%a%", "%a%%b", "a", "%" + "x" * 900, "%" + "x" * 60_000, "%\u00e4\u2028")),
        *(token(topic="%text", type_name=name) for name in ("x", "%", "a::b", "std_msgs::msg::dds_::Bool_", "\u00e4" * 600)),
        # Numbers and ids that no session has.
        *(token(number=number) for number in (-1, 2**31 - 1, 2**31, 2**32, 2**64, "x")),
        *(token(session=session) for session in ("x", "\u00e4" * 9, "0", "f" * 99)),
        # The vehicle's own publisher with another topic, type, kind and hash.
        *(vehicle.replace(*change) for vehicle in own_tokens(site) for change in (("%diagnostics", "%forged%name"), ("Array_", "_"), ("/MP/", "/MS/"), ("/MP/", "/SS/"), ("RIHS01", "A"))),
        *(token(kind=kind) for kind in ("MS", "SS", "SC", "NN", "XX", "%")),
        good.replace(f"/{site.server.domain}/", "/70000/"), good.replace("@ros2_lv", "@ros2_lv2"),
    ])
    until(lambda: topics(site)[0].get("/forged/name"), 30, "the forged tokens are found")
    text = site.writer("rt/text", "String", "text")
    site.repeat(lambda: text.write(text="here"))
    until(lambda: site.is_ok("base/rate"), 20, lambda: f"the messages are read: {site.module('base/rate')}")
    until(lambda: is_untouched(site, processes), 5, lambda: f"the vehicle is heard: {site.module('base/motor')}")
    site.forger.tell(forget=True)
    until(lambda: not topics(site)[0].get("/forged/name"), 30, "they are gone")
    until(lambda: is_untouched(site, processes), 5, lambda: f"the vehicle is heard: {site.module('base/motor')}")


def own_tokens(site):
    """The tokens of the vehicle's publishers of diagnostics."""
    site.forger.tell(find=f"@ros2_lv/{site.server.domain}/*/*/*/MP/*/*/*/%diagnostics/**")
    return site.forger.program.said("found")[-1]["found"]


def test_no_message_ends_the_diagnosis(site):
    processes = site.server.children()
    data = wire.diagnostic_array([{"name": "stranger", "level": 0, "message": "m", "hardware_id": "", "values": {"k": "v"}}])
    for length in range(len(data)):
        site.forger.publish(data[:length], struct.pack("<qqB16s", length, 0, 16, b"c" * 16))
    extremes = (-(2**63), -1, 0, 2**63 - 1)
    for number, (sequence, stamp_ns) in enumerate(itertools.product(extremes, extremes)):
        for length in (33, 32, 34, 0):
            attached = struct.pack("<qqB16sB", sequence, stamp_ns, 16, bytes([number] * 16), 0)[:length]
            site.forger.publish(data, attached)
        site.forger.publish(data, struct.pack("<qqB16s", sequence, stamp_ns, 17, b"d" * 16))
    site.forger.publish(data)
    until(lambda: is_untouched(site, processes), 5, lambda: f"the vehicle is heard: {site.module('base/motor')}")


def test_a_flood_of_tokens_delays_no_diagnosis(site):
    processes = site.server.children()
    session = "{z:020x}"
    site.forger.tell(flood=site.forger.token(topic="%flood{n}", session=session, number="{n}").replace("/0/{n}", "/{y}/{n}"), sessions=64, count=4000)
    until(lambda: topics(site)[1] >= 2000, 60, "it is found")
    ends = time.monotonic() + 3
    while time.monotonic() < ends:
        assert is_untouched(site, processes), site.module("base/motor")
        assert max(map(megabytes, processes)) < 300
        time.sleep(0.1)
    site.forger.tell(forget=True)
    text = site.writer("rt/text", "String", "text")
    site.repeat(lambda: text.write(text="here"))
    until(lambda: site.is_ok("base/rate"), 30, lambda: f"a late publisher is found: {site.module('base/rate')}")
    until(lambda: is_untouched(site, processes), 5, lambda: f"the vehicle is heard: {site.module('base/motor')}")


def test_a_publisher_that_hangs_is_unknown_until_it_goes_on(router, tmp_path):
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG)
    with router(), serving(tmp_path, config=config, flags=["--transport", "zenoh"]) as server:
        client = Client(server, *OPERATOR)
        motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log", options=ZENOH)
        modules = lambda: {it["id"].split("/")[-1]: it for it in groups(client)["base"]["modules"]}
        is_state = lambda state: modules()["motor"]["state"] == state

        def runs():
            motor.write(statuses=[{"name": "motor", "level": 0, "message": "runs"}])
            return is_state("ok")

        until(runs, 30, lambda: f"it runs: {modules()}")
        motor.program.process.send_signal(signal.SIGSTOP)
        until(lambda: is_state("unknown"), 5, lambda: f"its timeout is over: {modules()}")
        ends = time.monotonic() + 3
        while time.monotonic() < ends:
            assert is_state("unknown") and modules()["node"]["state"] == "ok", f"its node is announced: {modules()}"
            time.sleep(0.1)
        motor.program.process.send_signal(signal.SIGCONT)
        until(runs, 5, lambda: f"it goes on: {modules()}")
        motor.kill()
