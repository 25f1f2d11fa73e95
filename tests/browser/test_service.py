"""`serve` as a service of systemd: what it says of itself, what stops the feeding of the watchdog and what does not,
and its log."""

import contextlib
import json
import os
import signal
import socket
import time
import urllib.error
import urllib.request

import pytest
from websockets.sync.client import connect

from hang import FRAMES, SENDING, STEP, hanging
from vehicle import OPERATOR, Client, Display, free_port, peer, serving, until

WATCHDOG_S = 2


class Systemd:
    """The socket of systemd, and all lines that came to it."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.setblocking(False)
        self.lines = []

    def read(self):
        with contextlib.suppress(BlockingIOError):
            while True:
                self.lines += self.socket.recv(4096).decode().splitlines()
        return self.lines

    def has(self, line):
        return any(it.startswith(line) for it in self.read())

    def forget(self):
        self.read()
        self.lines.clear()

    def is_fed(self, times=3):
        """Again and again from now on."""
        self.forget()
        until(lambda: self.read().count("WATCHDOG=1") >= times, 20, lambda: f"the watchdog is fed: {self.lines}")
        # A busy machine may miss a check: that is why there are several in the interval of the watchdog.

    def is_starved(self):
        """For longer than systemd waits."""
        self.forget()
        deadline = time.monotonic() + 1.5 * WATCHDOG_S
        while time.monotonic() < deadline:
            assert "WATCHDOG=1" not in self.read(), self.lines
            time.sleep(0.05)


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    systemd = Systemd(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", str(WATCHDOG_S * 1_000_000))
    with contextlib.closing(systemd.socket):
        yield systemd


def test_the_watchdog_is_fed_whatever_is_wrong_with_the_vehicle_the_disk_and_the_displays(systemd, tmp_path):
    with serving(tmp_path) as server:
        until(lambda: systemd.has("READY=1"), 20, "it is ready")
        assert server.answers(), "the listener is open"
        until(lambda: systemd.has(f"STATUS=the display is on {server.url}"), 20, lambda: f"its status: {systemd.lines}")
        systemd.is_fed()
        # A display that confirms what it is shown, one that says nothing, and one that reads nothing.
        client = Client(server, *OPERATOR)
        url, headers = server.url.replace("http", "ws", 1) + "/ws", {"Cookie": client.cookie()}
        opened = lambda: connect(url, origin=server.url, additional_headers=headers, max_size=None, max_queue=1)
        with Display(server, client), opened(), opened():
            systemd.is_fed(times=20)
            # DDS that hangs is replaced again and again.
            for pid in server.children():
                os.kill(pid, signal.SIGSTOP)
            until(lambda: "dds" in json.dumps(client.snapshot()), 20, "the fault is shown")
            systemd.is_fed()
        # The disk hangs: the head of the log is written into a pipe that nobody reads.
        pipe = tmp_path / f"audit.head.{server.process.pid}"
        until(lambda: made(pipe), 5, "a pipe")
        with pytest.raises(urllib.error.HTTPError):
            client.post("/vehicle/stop", version=client.snapshot()["seq"])
        until(lambda: "has not answered" in json.dumps(client.snapshot()), 20, "the disk hangs")
        systemd.is_fed()
        with open(pipe, "rb") as reader:
            pipe.unlink()
            reader.read()
    assert "STOPPING=1" in systemd.read()


def made(pipe):
    with contextlib.suppress(FileExistsError):
        os.mkfifo(pipe)
        return True


@pytest.mark.parametrize(
    ("function", "why"),
    [(STEP, "the engine publishes nothing"), (FRAMES, "the way to the pages hangs")],
    ids=["the engine", "the frames"],
)
def test_the_watchdog_is_not_fed_while_messages_do_not_reach_the_pages(systemd, tmp_path, function, why):
    with serving(tmp_path) as server:
        systemd.is_fed(times=2)
        with hanging(server, function):
            # Frames are made where something has changed: here DDS no longer works.
            for pid in server.children():
                os.kill(pid, signal.SIGSTOP)
            until(lambda: systemd.has(f"STATUS={why}"), 20, lambda: f"the reason is said: {systemd.lines}")
            systemd.is_starved()
        systemd.is_fed(times=2)
    assert why in server.read_log()


def test_a_task_that_sends_nothing_to_the_vehicle_is_shown_and_ends_the_feeding(systemd, tmp_path):
    says = "the task that sends to the vehicle hangs"
    with serving(tmp_path) as server:
        systemd.is_fed(times=2)
        client = Client(server, *OPERATOR)
        with hanging(server, SENDING):
            until(lambda: says in json.dumps(client.snapshot()), 20, "the fault is shown")
            not_sent = "STATUS=the vehicle is not listened to, or nothing is sent to it"
            until(lambda: systemd.has(not_sent), 40, lambda: f"the reason is said: {systemd.lines}")
            systemd.is_starved()
        until(lambda: says not in json.dumps(client.snapshot()), 20, "the fault is over")
        systemd.is_fed(times=2)


def test_the_last_state_of_an_engine_that_hangs_is_told_to_no_tool(tmp_path):
    port = free_port()
    with serving(tmp_path, flags=("--metrics", f"127.0.0.1:{port}")) as server:
        topics = ("rt/diagnostics_toplevel_state=DiagnosticStatus", "rt/diagnostics_agg=DiagnosticArray")
        tools = [peer(server.domain, "sub", "--topic", topic) for topic in topics]

        def silent_s():
            times = [[line["at_ns"] for line in tool.said("topic")] for tool in tools]
            return [time.monotonic() - it[-1] / 1e9 if it else None for it in times]

        def shows_state():
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
                text = answer.read().decode()
            assert "telltale_snapshot_age_seconds" in text
            return "telltale_overall_state{" in text

        is_told = lambda: shows_state() and all(it is not None and it < 2 for it in silent_s())
        until(is_told, 30, lambda: f"it is told: {silent_s()}")
        with hanging(server):
            until(lambda: not shows_state(), 20, "the metrics show no state")
            # Both have a message a second, else.
            until(lambda: min(silent_s()) > 4, 20, lambda: f"both topics are silent: {silent_s()}")
        until(is_told, 20, lambda: f"it is told again: {silent_s()}")
        for tool in tools:
            tool.close()


def test_a_socket_that_nobody_reads_delays_nothing(systemd, tmp_path):
    with serving(tmp_path) as server:
        until(lambda: "systemd cannot be told" in server.read_log(), 60, "the socket is full")
        client = Client(server, *OPERATOR)
        with Display(server, client):
            first = client.snapshot()["at"]
            until(lambda: client.snapshot()["at"] > first, 5, "the display goes on")


def test_the_log_is_for_people_for_the_journal_or_for_programs(tmp_path, monkeypatch):
    def log_of(name, *flags):
        folder = tmp_path / name
        folder.mkdir()
        with open(folder / "serve.log", "ab") as log:
            stat = os.fstat(log.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{stat.st_dev}:{stat.st_ino}" if name == "journal" else "1:1")
        with serving(folder, flags=flags) as server:
            pass
        return server.read_log().splitlines()

    assert any(" INFO " in line and "the display is on" in line for line in log_of("people"))
    journal = log_of("journal")
    assert all(line[:3] in ("<3>", "<4>", "<6>") for line in journal), journal
    assert any(line.startswith("<6>the display is on") for line in journal), journal
    assert not any(line.startswith("<3>") for line in journal), f"a start and an end have no errors: {journal}"
    objects = [json.loads(line) for line in log_of("programs", "--log", "json")]
    assert all(set(it) == {"time", "level", "target", "message", "fields"} for it in objects), objects
    assert any(it["level"] == "info" and "the display is on" in it["message"] for it in objects), objects
