#!/usr/bin/env python3
"""The whole program under load, faults and attacks for a given time: does it grow, does it stay quick?

    soak.py SECONDS

A foreign DDS peer publishes the diagnostics of a shuttle, another one a load of them; publishers come
and go, statuses fail, the mission starts and ends. Meanwhile programs and displays connect, read, stop
reading and leave, people log in rightly and wrongly, the configuration is read again, other programs
open the database, strangers hold connections open and forge DDS packets. The operator requests a stop
every second; while the DDS process is being replaced it is answered that nobody hears it.

A line each twentieth of the time has, summed over the program and its child processes:
    rss_mb, fds, threads      what they hold
    lost                      messages that never arrived
    late, worst_ms            stops that took longer than a second, and the longest of this span
    gap_ms                    the longest silence of a stream that is read
The last line compares the second quarter of the time with the last one. The exit code is 1 where memory
has grown by more than a tenth and 8 MB, descriptors or threads by more than ten, where a stop was late,
a stream was silent for two seconds, or the program did not end in three seconds.
"""

import asyncio
import base64
import os
import random
import signal
import socket
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "browser"))

import websockets  # noqa: E402
from programs import TELLTALE, forger, peer, until  # noqa: E402
from stall import MACHINE  # noqa: E402
from vehicle import OPERATOR, Client, Server, Vehicle, own_domain  # noqa: E402

DEVELOPER = ("dora", "a long enough phrase of dora")
LATE_S = 1.0
SILENT_S = 2.0
ENDS_S = 3.0
SAMPLES = 20


class Soak:
    """What all activities share."""

    def __init__(self, seconds, folder):
        self.seconds, self.folder = seconds, folder
        self.server = Server(folder, own_domain(), flags=["--dds-memory", "300"])
        self.server.add_user(*OPERATOR)
        self.server.add_user(*DEVELOPER, role="developer")
        self.server.start()
        self.vehicle = Vehicle(self.server.domain, folder)
        self.ended = threading.Event()
        self.lock = threading.Lock()
        self.stops, self.gaps, self.faults = [], [], []
        self.late = self.answered = 0

    def fault(self, what):
        with self.lock:
            self.faults.append(what)
        print(f"! {what}", flush=True)

    def every(self, seconds, what):
        """Does it again and again in a thread of its own. What it raises is told and goes on."""

        def run():
            while not self.ended.wait(random.uniform(0.5, 1.5) * seconds):
                try:
                    what()
                except Exception as error:  # noqa: BLE001: a soak goes on
                    if not self.ended.is_set():
                        self.fault(f"{what.__name__}: {type(error).__name__}: {error}")

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        return thread

    # The operator's actions.

    def stop_vehicle(self):
        started = time.monotonic()
        for _ in range(5):
            shown = self.operator.snapshot()
            if shown["stage"] != "active":
                return
            try:
                self.operator.post("/vehicle/stop", version=shown["seq"])
                break
            except urllib.error.HTTPError as error:
                if error.code == 503:
                    break
                # The stage changed between the look and the tap.
                if error.code != 409:
                    raise
        else:
            raise AssertionError("a stop is refused again and again")
        took = time.monotonic() - started
        with self.lock:
            self.stops.append(took)
            self.answered += 1
            self.late += took > LATE_S

    # The vehicle's statuses and faults.

    def fail_something(self):
        name = random.choice(list(self.vehicle.statuses))
        self.vehicle.set(name, random.choice([0, 0, 1, 2, 2, 3]), f"said at {time.time():.0f}")

    def heal_all(self):
        for name in list(self.vehicle.statuses):
            self.vehicle.statuses[name] = (0, "fine")
        self.vehicle.publish()

    def mission_ends(self):
        self.vehicle.drive(False)
        self.ended.wait(5)
        self.vehicle.drive(True)

    def publisher_comes_and_goes(self):
        publisher = self.peer("load", "--statuses", 200, "--rate", 20, "--seconds", 3)
        if random.random() < 0.5:
            time.sleep(random.uniform(0, 4))
            publisher.kill()
        else:
            publisher.ends(60)

    def forged_packets(self):
        attack = random.choice(["heartbeat", "builtin", "gap", "fuzz"])
        words = [attack, "--seconds", 5, "--seed", random.randrange(10**6)]
        forger(self.server.domain, *words, log=self.folder / "peers.log").ends(60)

    def peer(self, *words):
        return peer(self.server.domain, *words, log=self.folder / "peers.log")

    # Other clients and attackers.

    def wrong_login(self):
        try:
            Client(self.server, random.choice(["anna", "nobody", "x" * 200]), "wrong secret")
        except (AssertionError, urllib.error.HTTPError):
            pass

    def developer_looks(self):
        name, secret = DEVELOPER
        self.looker.post("/login", name=name, secret=secret)
        for path in ("/developer", "/developer/graph", "/developer/masking", "/developer/topics", "/developer/timeline"):
            with self.looker.opener.open(self.server.url + path, timeout=20) as answer:
                answer.read()
        self.looker.post("/logout")

    def read_again(self):
        self.server.send(signal.SIGHUP)

    def other_program_at_the_database(self):
        with sqlite3.connect(self.folder / "telltale.db", timeout=10) as connection:
            connection.execute("SELECT count(*) FROM audit").fetchone()
        connection.close()

    def user_comes_and_goes(self):
        name = f"guest{random.randrange(10**6)}"
        self.server.add_user(name, f"a phrase of {name} that is long", role="authority")
        subprocess.run(
            [TELLTALE, "user", "remove", name, "--data", str(self.folder)],
            input="yes\n", text=True, capture_output=True, timeout=30, check=True,
        )

    def unfinished_logins(self):
        held = []
        for _ in range(64):
            connection = socket.create_connection(("127.0.0.1", self.server.port), timeout=5)
            connection.sendall(
                f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{self.server.port}\r\nOrigin: {self.server.url}\r\n"
                "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 50\r\n\r\nname=".encode()
            )
            held.append(connection)
        self.ended.wait(5)
        for connection in held:
            connection.close()

    def empty_frames(self):
        """A stream that sends empty fragments of a message and never reads."""
        with self.raw_stream() as connection:
            until_s = time.monotonic() + 5
            first, more = b"\x01\x80" + bytes(4), b"\x00\x80" + bytes(4)
            try:
                connection.sendall(first)
                while time.monotonic() < until_s and not self.ended.is_set():
                    connection.sendall(more * 500)
            except OSError:
                pass

    def silent_reader(self):
        """A stream that is never read, and is left without a word."""
        with self.raw_stream():
            self.ended.wait(random.uniform(1, 10))

    def raw_stream(self):
        connection = socket.create_connection(("127.0.0.1", self.server.port), timeout=5)
        key = base64.b64encode(os.urandom(16)).decode()
        connection.sendall(
            f"GET /api/v1/stream HTTP/1.1\r\nHost: 127.0.0.1:{self.server.port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            f"Origin: {self.server.url}\r\nCookie: {self.developer.cookie()}\r\n\r\n".encode()
        )
        return connection

    def streams(self, number):
        """Programs that read what the vehicle says, and connect again every now and then."""

        async def read(number):
            while not self.ended.is_set():
                headers = {"Cookie": self.developer.cookie()}
                url = self.server.url.replace("http", "ws") + "/api/v1/stream"
                async with websockets.connect(url, additional_headers=headers, origin=self.server.url, max_size=None) as stream:
                    leaves = time.monotonic() + random.uniform(20, 60)
                    heard = time.monotonic()
                    while time.monotonic() < leaves and not self.ended.is_set():
                        await asyncio.wait_for(stream.recv(), 20)
                        now = time.monotonic()
                        with self.lock:
                            self.gaps.append(now - heard)
                        if now - heard >= SILENT_S:
                            still = f"the machine stood still for {MACHINE.worst_s:.1f} s at most so far"
                            print(f"  stream {number} was silent for {now - heard:.1f} s until {time.strftime('%X')}; {still}", flush=True)
                        heard = now

        async def all_of_them():
            async def again(number):
                while not self.ended.is_set():
                    try:
                        await read(number)
                    except Exception as error:  # noqa: BLE001
                        if not self.ended.is_set():
                            self.fault(f"stream: {type(error).__name__}: {error}")
                            await asyncio.sleep(1)

            await asyncio.gather(*(again(it) for it in range(number)))

        thread = threading.Thread(target=lambda: asyncio.run(all_of_them()), daemon=True)
        thread.start()

    # The measurements.

    def processes(self):
        """The program and what it started, as process numbers."""
        found, look = [], [self.server.process.pid]
        while look:
            pid = look.pop()
            found.append(pid)
            for task in Path(f"/proc/{pid}/task").glob("*/children"):
                try:
                    look += [int(child) for child in task.read_text().split()]
                except OSError:
                    pass
        return found

    def measure(self):
        rss = fds = threads = 0
        for pid in self.processes():
            try:
                status = Path(f"/proc/{pid}/status").read_text()
                fds += len(os.listdir(f"/proc/{pid}/fd"))
            except OSError:
                continue
            values = dict(line.split(":", 1) for line in status.splitlines())
            rss += int(values.get("VmRSS", "0").split()[0]) / 1024
            threads += int(values["Threads"])
        return rss, fds, threads

    def lost(self):
        return self.operator.snapshot()["counters"]["lost"]

    def run(self):
        self.operator = Client(self.server, *OPERATOR)
        self.developer, self.looker = (Client(self.server, *DEVELOPER) for _ in range(2))
        self.vehicle.drive(True)
        until(lambda: self.operator.snapshot()["stage"] == "active", 20, "the vehicle drives")
        self.operator.stop()
        load = self.peer("load", "--statuses", "300", "--rate", 50, "--seconds", self.seconds)
        self.streams(10)
        for seconds, what in (
            (1, self.stop_vehicle),
            (0.5, self.fail_something),
            (20, self.heal_all),
            (45, self.mission_ends),
            (15, self.publisher_comes_and_goes),
            (3, self.wrong_login),
            (10, self.developer_looks),
            (30, self.read_again),
            (7, self.other_program_at_the_database),
            (60, self.user_comes_and_goes),
            (20, self.unfinished_logins),
            (15, self.empty_frames),
            (4, self.silent_reader),
            (50, self.forged_packets),
        ):
            self.every(seconds, what)
        rows = []
        started = time.monotonic()
        print(f"{'s':>6} {'rss_mb':>8} {'fds':>5} {'threads':>8} {'lost':>8} {'late':>5} {'worst_ms':>9} {'gap_ms':>7}", flush=True)
        for number in range(1, SAMPLES + 1):
            self.ended.wait(max(0, started + self.seconds * number / SAMPLES - time.monotonic()))
            if self.server.process.poll() is not None:
                self.fault(f"the program ended with {self.server.process.returncode}")
                break
            with self.lock:
                stops, self.stops = self.stops, []
                gaps, self.gaps = self.gaps, []
            rss, fds, threads = self.measure()
            rows.append((rss, fds, threads))
            if max(gaps, default=SILENT_S) >= SILENT_S:
                self.fault(f"a stream was silent for {max(gaps, default=0):.1f} s")
            print(
                f"{time.monotonic() - started:6.0f} {rss:8.1f} {fds:5} {threads:8} {self.lost():8} {self.late:5}"
                f" {1000 * max(stops, default=0):9.0f} {1000 * max(gaps, default=0):7.0f}",
                flush=True,
            )
        self.ended.set()
        ended = time.monotonic()
        self.server.process.terminate()
        try:
            code = self.server.process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            self.server.process.kill()
            code = None
        took = time.monotonic() - ended
        if code != 0 or took > ENDS_S:
            self.fault(f"the end took {took:.1f} s, exit code {code}")
        load.kill()
        self.vehicle.close()
        return self.judge(rows)

    def judge(self, rows):
        quarter = max(1, len(rows) // 4)
        before, after = rows[quarter : 2 * quarter], rows[-quarter:]
        grown = []
        for index, (name, slack) in enumerate((("rss_mb", 8), ("fds", 10), ("threads", 10))):
            first, last = (statistics.median(row[index] for row in part) for part in (before, after))
            print(f"{name}: {first:.1f} in the second quarter, {last:.1f} in the last")
            if last > first + max(slack, first / 10 if name == "rss_mb" else 0):
                grown.append(name)
        print(f"stops: {self.answered} answered, {self.late} later than {LATE_S:.0f} s; faults: {len(self.faults)}")
        if grown:
            print(f"grown: {', '.join(grown)}")
        return 1 if grown or self.late or self.faults else 0


def main():
    if len(sys.argv) != 2 or not sys.argv[1].isdigit():
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory(prefix="telltale-soak-") as folder:
        sys.exit(Soak(int(sys.argv[1]), Path(folder)).run())


if __name__ == "__main__":
    main()
