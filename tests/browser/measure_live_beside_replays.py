"""Measures whether replays slow what is live: the time from a status that is written to DDS (Cyclone DDS, in this process) to the
message of `/api/v1/stream` that shows its state, with no replay, with one and with three that play at the highest speed again and
again, and with a what-if beside them. Not a test: run it on a quiet machine, with TELLTALE naming the program to measure.

    TELLTALE=target/release/telltale python measure_live_beside_replays.py [--changes 400]
"""

import argparse
import contextlib
import json
import statistics
import tempfile
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

from demo import Stream
from measure_detection import Peer, status
from vehicle import TELLTALE, Client, Server, own_domain, until

DEVELOPER = ("dora", "lantern-48-harbour")
MODULES = 200
TYPE = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
PAUSE_S = 0.05


def configuration(path):
    rows = "".join(f"      - {{ id: m{number:03}, status: m{number:03} }}\n" for number in range(MODULES))
    path.write_text(
        "vehicle: { id: v, stages: none }\ndefaults: { timeout: 60s }\ngroups:\n"
        f"  - id: a\n    modules:\n{rows}  - id: b\n    depends_on: [a]\n    modules: [{{ id: n, status: n }}]\n"
    )
    return path


class Near(Peer):
    """On the loopback interface."""

    OPTIONS = {**Peer.OPTIONS, "interface": "lo"}


class Live:
    def __init__(self, server, developer):
        self.peer = Near(server.domain)
        self.writer = self.peer.writer("rt/diagnostics", TYPE)
        self.stream = Stream(server, developer)
        self.level = 0

    def show(self, level, seconds=20):
        """Seconds until a module's state is on the stream."""
        word = "error" if level else "ok"
        began = time.monotonic()
        self.peer.write(self.writer, status("m000", level))
        while True:
            # Snapshots go on coming, whether this one changes or not.
            left = seconds - (time.monotonic() - began)
            snapshot = json.loads(self.stream.socket.recv(timeout=max(left, 0)))
            if snapshot["groups"][0]["modules"][0]["state"] == word:
                return time.monotonic() - began

    def times(self, count):
        took = []
        for number in range(count):
            took.append(self.show(2 if number % 2 else 0) * 1000)
            # A change of a phase that no beat of the server has.
            time.sleep(PAUSE_S + (number * 7 % 20) / 1000)
        return took


def keep(client, number, ended):
    """Plays it from its beginning to its end, again and again."""
    played = 0
    while not ended.is_set():
        client.post(f"/replay/{number}/state", play=1000)
        played += 1
    print(f"  played {played} times", flush=True)


def keep_asking(client, number, text, ended):
    done = 0
    address = f"/incidents/{number}/what-if"
    while not ended.is_set():
        client.post(address, **text)
        progress = lambda: json.loads(client.get(address))["progress"]
        until(lambda: progress() in ("done", "wrong"), 120, progress)
        done += 1
    print(f"  {done} what-ifs", flush=True)


class Reader(Client):
    def get(self, path):
        headers = {"Accept": "application/json"}
        request = urllib.request.Request(self.server.url + path, headers=headers)
        with self.opener.open(request, timeout=30) as answer:
            return answer.read()


def main():
    asked = argparse.ArgumentParser()
    asked.add_argument("--changes", type=int, default=400)
    asked = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        folder = Path(folder)
        config = configuration(folder / "v.yaml")
        server = Server(folder, own_domain(), config=config)
        server.add_user(*DEVELOPER, role="developer")
        server.start()
        stack.callback(server.stop)
        developers = [Reader(server, *DEVELOPER) for _ in range(4)]
        live = Live(server, developers[0])
        stack.callback(live.stream.close)
        # Nobody reads before discovery has found the writer.
        until(lambda: tried(live), 20, "the status is heard")
        incidents = lambda: [it for it in json.loads(developers[0].get("/api/v1/incidents")) if it["recording"]["finished"]]
        live.times(20)
        live.show(0)
        number = until(incidents, 90, "an incident is recorded")[0]["id"]
        for client in developers[1:]:
            until(lambda: opened(client, number), 60, "the replay is open")
        print(f"{TELLTALE}, {MODULES} modules, {asked.changes} changes; milliseconds from the writer to /api/v1/stream")
        for name, replays, what_if in [("live alone", 0, False), ("1 replay", 1, False), ("3 replays and a what-if", 3, True)] * 2:
            ended = threading.Event()
            threads = [threading.Thread(target=keep, args=(it, number, ended)) for it in developers[1 : 1 + replays]]
            if what_if:
                text = {"name": config.name, "text": config.read_text().replace("depends_on: [a]", "")}
                threads.append(threading.Thread(target=keep_asking, args=(developers[0], number, text, ended)))
            for thread in threads:
                thread.start()
            took = live.times(asked.changes)
            ended.set()
            for thread in threads:
                thread.join()
            cuts = statistics.quantiles(took, n=100, method="inclusive")
            print(f"{name}: p50 {cuts[49]:.2f}, p99 {cuts[98]:.2f}, longest {max(took):.2f}", flush=True)


def tried(live):
    with contextlib.suppress(TimeoutError):
        return live.show(2, 0.5)
    return None


def opened(client, number):
    with contextlib.suppress(urllib.error.HTTPError):
        return client.get(f"/replay/{number}")
    return None


if __name__ == "__main__":
    main()
