"""Measures a replay of an hour of `/diagnostics` (10 arrays a second of 40 statuses, made here): how long `telltale replay` takes,
and how long from a request for a moment to the snapshot of that moment. Not a test: TELLTALE names the program to measure.

    TELLTALE=target/release/telltale python measure_replay_speed.py [--seeks 100]
"""

import argparse
import json
import random
import subprocess
import tempfile
import time
from datetime import datetime, timezone
from pathlib import Path
from types import SimpleNamespace

from programs import TELLTALE, shown
from test_replay import BEGIN_NS, DIAGNOSTICS, STATUS, STORE, bag, cdr, header
from vehicle import Client

SECONDS, RATE_HZ, STATUSES = 3600, 10, 40
CONFIG = "vehicle: { stages: none }\ngroups:\n  - id: robot\n    match: [{ contains: part }]\n"


def hour():
    """Each minute, the fourth part fails for five seconds."""
    status = STORE.types[STATUS]
    for tick in range(SECONDS * RATE_HZ):
        second = tick / RATE_HZ
        bad = lambda number: 2 if number == 3 and second % 60 >= 55 else 0
        statuses = [status(bad(number), f"robot: part_{number}", "fine", "", []) for number in range(STATUSES)]
        yield "/diagnostics", second, cdr(DIAGNOSTICS, header(second), statuses)


def measure_speed(words):
    begin = time.monotonic()
    lines = subprocess.run(words, check=True, capture_output=True, text=True).stdout.count("\n")
    took = time.monotonic() - begin
    print(f"an hour in {took:.2f} s, {SECONDS / took:,.0f} times real time, {lines} changes printed")


def measure_seeks(recorded, config, number):
    with shown(recorded, config) as (url, name, secret):
        client = Client(SimpleNamespace(url=url), name, secret)
        client.opener.open(url + "/replay/file", timeout=10).close()
        times = sorted(seek(client, second) for second in random.Random(1).choices(range(SECONDS), k=number))
        median, p95 = times[number // 2], times[number * 95 // 100]
        print(f"{number} seeks: median {median:.0f} ms, p95 {p95:.0f} ms, worst {times[-1]:.0f} ms")


def seek(client, second):
    moment = BEGIN_NS // 10**9 + second
    at = datetime.fromtimestamp(moment, timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.000Z")
    begin = time.monotonic()
    client.post("/replay/file/state", at_ms=moment * 1000)
    while snapshot(client)["at"] != at:
        assert time.monotonic() < begin + 10, f"{at} is not shown within 10 s"
    return (time.monotonic() - begin) * 1000


def snapshot(client):
    with client.opener.open(client.server.url + "/replay/file/screen/api/v1/snapshot", timeout=10) as answer:
        return json.load(answer)


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--seeks", type=int, default=100)
    options = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "config.yaml")
        config.write_text(CONFIG)
        recorded = bag(Path(folder, "hour"), hour())
        measure_speed([TELLTALE, "replay", recorded, "--config", config])
        measure_seeks(recorded, config, options.seeks)


main()
