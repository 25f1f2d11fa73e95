"""Programs beside a test, each in a process of its own: peers of other DDS libraries, forgers of packets, and those commands
of Telltale that run on. `vehicle.py` has the server."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from stall import MACHINE

ROOT = Path(__file__).resolve().parents[2]
TELLTALE = os.environ.get("TELLTALE", str(ROOT / "target/debug/telltale"))
PYTHON = sys.executable
ENDS_S = 10


def until(condition, seconds, what):
    """Waits for a condition, at most so long while the machine runs; returns what it returned."""
    deadline = time.monotonic() + seconds - MACHINE.total_s
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < deadline + MACHINE.total_s, f"not within {seconds} s: {what() if callable(what) else what}"
        time.sleep(0.02)


class Program:
    """Runs until it ends or is closed. What it says goes to the file `log`, or each line to `hear` as it comes; by itself
    that keeps them in `lines`."""

    def __init__(self, *words, log=None, hear=None):
        self.lines = []
        self.hear = hear or self.lines.append
        self.log = open(log, "ab") if log else None
        output = {"stdout": self.log or subprocess.PIPE, "stderr": self.log}
        self.process = subprocess.Popen(list(map(str, words)), stdin=subprocess.PIPE, text=True, bufsize=1, **output)
        self.reading = None if log else threading.Thread(target=self.read, daemon=True)
        if self.reading:
            self.reading.start()

    def read(self):
        for line in self.process.stdout:
            self.hear(line)

    def say(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def tell(self, **command):
        self.say(json.dumps(command))

    def said(self, key):
        """The lines so far that are JSON objects with this key."""
        return [said for said in map(json.loads, list(self.lines)) if key in said]

    def ends(self, seconds=ENDS_S):
        """Waits for its end, and returns its exit code."""
        code = self.process.wait(timeout=seconds)
        if self.reading:
            self.reading.join(seconds)
        for file in filter(None, (self.log, self.process.stdout)):
            file.close()
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        return code

    def kill(self):
        self.process.kill()
        return self.ends()

    def close(self, number=signal.SIGTERM, seconds=ENDS_S):
        """Asks it to end, and returns its exit code."""
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.send_signal(number)
        return self.ends(seconds)


def peer(domain, *words, by=(), **more):
    """`tests/dds/peer.py`, started by another command where `by` says so."""
    return Program(*by, PYTHON, ROOT / "tests/dds/peer.py", "--domain", domain, *words, **more)


def forger(domain, *words, **more):
    """`tests/dds/rtps.py`, which forges packets."""
    return Program(PYTHON, ROOT / "tests/dds/rtps.py", "--domain", domain, *words, **more)


@contextlib.contextmanager
def simulation(domain, config, *flags, log):
    """`telltale sim`, until the end of the block."""
    words = ["sim", "--config", config, "--interface", "127.0.0.1", "--domain", domain]
    program = Program(TELLTALE, *words, *flags, log=log)
    try:
        yield program
    finally:
        program.close(seconds=20)


@contextlib.contextmanager
def shown(recording, config):
    """`telltale replay --serve`: the address of the display that shows the recording, and a user with a password."""
    program = Program(TELLTALE, "replay", recording, "--config", config, "--serve", "--listen", "127.0.0.1:0")
    try:
        until(lambda: len(program.lines) >= 2 or program.process.poll() is not None, 60, lambda: f"it is shown: {program.lines}")
        where, who = program.lines[:2]
        yield (re.search(r"http://127\.0\.0\.1:\d+", where).group(), *re.findall("`(.*?)`", who))
    finally:
        code = program.close(signal.SIGINT, seconds=20)
    assert code == 0, program.lines
