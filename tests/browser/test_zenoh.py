"""The whole program over Zenoh, with foreign peers that speak as rmw_zenoh does: the vehicle's day, its services, and a
router that goes away. No rmw_zenoh_cpp runs here (docs/zenoh.md says how to try one)."""

import contextlib
import os
import signal
import time

import pytest

from programs import PYTHON, ROOT, Program, until
from test_developer import prepare
from test_ros_services import nodes_call_every_service
from vehicle import OPERATOR, Client, Vehicle, Writer, free_port, serving

pytestmark = pytest.mark.timed

ZENOH = ("--dds", "rmw_zenoh")

CONFIG = """
vehicle: { stages: none }
groups:
  - id: base
    modules:
      - { id: motor, status: motor, timeout: 1s }
      - { id: node, monitor: { watchdog: { node: /peer, every: 500ms, misses: 2 } } }
      - { id: stop, monitor: { value: { topic: /pressed, type: std_msgs/msg/Bool, field: data, error_unless: false, empty: unknown } } }
"""


@pytest.fixture
def router(monkeypatch):
    """The command by which a router is started, at the address that all programs of the test know."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", f'connect/endpoints=["{endpoint}"]')

    @contextlib.contextmanager
    def running():
        program = Program(PYTHON, ROOT / "tests/dds/rmw_zenoh.py", endpoint)
        try:
            until(lambda: program.said("ready"), 20, "the router is there")
            yield program
        finally:
            program.kill()

    return running


def groups(client):
    return {group["id"]: group for group in client.snapshot()["groups"] if group["id"] != "telltale"}


def states(client):
    return {name: group["state"] for name, group in groups(client).items()}


def test_a_vehicle_is_diagnosed_and_led_over_zenoh(router, tmp_path):
    with router(), serving(tmp_path, flags=["--transport", "zenoh"]) as server:
        vehicle = Vehicle(server.domain, tmp_path, options=ZENOH)
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


def test_services_are_called_over_zenoh(router, tmp_path):
    with router():
        nodes_call_every_service(tmp_path, ["rmw_zenoh", "rmw_zenoh"], ["--transport", "zenoh"])
