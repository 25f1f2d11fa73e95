"""Packets that are lost, and vehicles with many participants: everything that publishes is heard again, and nobody who
publishes is called gone."""

import contextlib
import json
import os
import signal
import subprocess
import threading
import time

import pytest

from programs import PYTHON, ROOT, peer, until
from vehicle import OPERATOR, Client, Writer, own_domain, serving

pytestmark = pytest.mark.timed

# `TELLTALE_LOST="5 50" ... pytest -k loss-` loses other parts of the packets, in percent.
LOST = [int(it) for it in os.environ.get("TELLTALE_LOST", "30 100").split()]
LOST_FOR_S = 15
BACK_S = 20
CROWD = 100
# Longer than the lease of Cyclone DDS: what the library loses, it has lost by then.
CROWD_FOR_S = 20
# As by default: one announcement that is lost ends a lease of 10 s. The peers of Fast DDS know no multicast.
PUBLISHERS = {
    "cyclone": (3, ["--multicast", "--announce-s", "8"]),
    "fastdds": (2, ["--dds", "fastdds", "--announce-s", "3"]),
}
CONTROL = {"cyclone": ["--multicast"], "fastdds": []}
ALONE = "TELLTALE_TEST_ALONE"


def run_alone(name):
    """Runs a test of this file in a network of its own."""
    this = [PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"{__file__}::{name}"]
    environment = {**os.environ, ALONE: "1"}
    done = subprocess.run(["sh", ROOT / "tests/dds/alone.sh", *this], capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


class Speaking:
    """Publishers, each a participant in a process of its own, that say five times a second that they are well."""

    def __init__(self, folder, names, options):
        self.folder, self.options = folder, options
        self.writers = {name: self.writer(name) for name in names}
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.speak)
        self.thread.start()

    def writer(self, name):
        return Writer(own_domain(), "rt/diagnostics", "DiagnosticArray", self.folder / f"{name}.log", options=self.options)

    def speak(self):
        while not self.ended.wait(0.2):
            for name in self.writers:
                try:
                    self.writers[name].write(statuses=[{"level": 0, "name": name, "message": "well"}])
                except BrokenPipeError:
                    self.start_again(name)

    def start_again(self, name):
        """Fast DDS 2.9 may abort when one reader follows another (docs/dds-library.md): that is its own fault, and a vehicle
        starts such a node again. No other end is let pass."""
        code, log = self.writers[name].ends(), (self.folder / f"{name}.log").read_text()
        assert code == -signal.SIGABRT and "OutputTrafficManager" in log, f"{name} ended with {code}: {log[-1000:]}"
        print(f"{name} aborted, and is started again")
        self.writers[name] = self.writer(name)

    def close(self):
        self.ended.set()
        self.thread.join(timeout=10)
        for writer in self.writers.values():
            writer.close()


class Control:
    """A reader of another library beside the server."""

    def __init__(self, options):
        self.heard = {}
        self.close = peer(own_domain(), *options, "sub", hear=self.hear).close

    def hear(self, line):
        for status in json.loads(line).get("value", {}).get("statuses", []):
            self.heard[status["name"]] = time.monotonic()

    def misses(self, names):
        return [name for name in names if time.monotonic() - self.heard.get(name, 0) > 2]


def configuration(folder, names):
    modules = "".join(f"      - {{ id: m{number}, status: '{name}', timeout: 3s }}\n" for number, name in enumerate(names))
    path = folder / "loss.yaml"
    path.write_text(f"vehicle: {{ stages: none }}\nrecording: false\ngroups:\n  - id: heard\n    modules:\n{modules}")
    return path


def unheard(client, names):
    modules = {it["id"]: it["state"] for group in client.snapshot()["groups"] for it in group["modules"]}
    return [name for number, name in enumerate(names) if modules[f"heard/m{number}"] != "ok"]


def losing(percent):
    """Loses this part of all packets for a while."""
    chance = f"{percent / 100}"
    rule = ["-i", "lo", "-p", "udp", "-m", "statistic", "--mode", "random", "--probability", chance, "-j", "DROP"]
    subprocess.run(["iptables", "-A", "INPUT", *rule], check=True)
    time.sleep(LOST_FOR_S)
    subprocess.run(["iptables", "-F", "INPUT"], check=True)


def down(seconds):
    """The only interface is down."""
    subprocess.run(["ip", "link", "set", "lo", "down"], check=True)
    time.sleep(seconds)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    subprocess.run(["ip", "route", "add", "224.0.0.0/4", "dev", "lo"], check=True)


def stopped(server, seconds):
    """The whole server is stopped, with its DDS processes."""
    processes = [server.process.pid, *server.children()]
    for pid in processes:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    for pid in processes:
        os.kill(pid, signal.SIGCONT)


FAULTS = {
    **{f"loss-{percent}-{vendor}": (vendor, lambda _, percent=percent: losing(percent)) for percent in LOST for vendor in PUBLISHERS},
    "down-3": ("cyclone", lambda _: down(3)),
    "down-14": ("cyclone", lambda _: down(14)),
    "stopped-3": ("cyclone", lambda server: stopped(server, 3)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_all_are_heard_again_after(fault, tmp_path):
    if ALONE not in os.environ:
        return run_alone(f"test_all_are_heard_again_after[{fault}]")
    vendor, strike = FAULTS[fault]
    count, options = PUBLISHERS[vendor]
    names = [f"{vendor} {number}" for number in range(count)]
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.closing(Speaking(tmp_path, names, options)))
        control = stack.enter_context(contextlib.closing(Control(CONTROL[vendor])))
        server = stack.enter_context(serving(tmp_path, config=configuration(tmp_path, names)))
        client = Client(server, *OPERATOR)

        def all_are_heard(seconds, when):
            until(lambda: not control.misses(names), seconds, lambda: f"another library hears all {when}: {control.misses(names)}")
            started = time.monotonic()
            until(
                lambda: not unheard(client, names), seconds,
                lambda: f"all are heard {when}: {unheard(client, names)}\n{server.read_log()[-2000:]}",
            )
            print(f"{fault}: heard {when} {time.monotonic() - started:.1f} s after another library")

        all_are_heard(30, "before")
        strike(server)
        all_are_heard(BACK_S, "again")
        # Nor are they lost later, when the lease has ended.
        time.sleep(12)
        assert not unheard(client, names), server.read_log()[-2000:]


def test_of_many_participants_none_is_lost(tmp_path):
    if ALONE not in os.environ:
        return run_alone("test_of_many_participants_none_is_lost")
    names = [f"crowd {number}" for number in range(CROWD)]
    words = [*PUBLISHERS["cyclone"][1], "--depth", "10", "crowd", "--participants", CROWD]
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(serving(tmp_path, config=configuration(tmp_path, names)))
        client = Client(server, *OPERATOR)
        stack.callback(peer(own_domain(), *words).kill)
        until(lambda: not unheard(client, names), 90, lambda: f"all are heard: {unheard(client, names)}")
        worst, ends = 0, time.monotonic() + CROWD_FOR_S
        while time.monotonic() < ends:
            worst = max(worst, len(unheard(client, names)))
            time.sleep(0.5)
        assert not unheard(client, names), f"{worst} at worst:\n{server.read_log()[-2000:]}"
