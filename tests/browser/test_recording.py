"""What a running server records of foreign DDS publishers, as the programs of others read it: every message, with its
bytes, its number and its stamp, and up to the last second before a kill."""

import hashlib
import json
import os
import random
import subprocess
import sys
import threading
import time

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from stall import MACHINE
from vehicle import ROOT, TELLTALE, Client, Writer, serving, until

DEVELOPER = ("dora", "a long password")
CONFIG = """
vehicle: { stages: none }
recording: { before: 5s, after: 3s, topics: [{ topic: '/foreign/*' }] }
groups: [{ id: base, modules: [{ id: motor, status: motor }] }]
"""
TEXTS = 300
BURST = 30
ARRAYS = 100


class Publisher(Writer):
    """Knows what it wrote and when."""

    def __init__(self, server, folder, topic, type_name, vendor):
        self.path = folder / f"{vendor}{topic.replace('/', '-')}.log"
        super().__init__(server.domain, f"rt{topic}", type_name, self.path, options=["--dds", vendor])
        self.topic = topic
        self.write(wait_matched=1, timeout=20)
        until(lambda: self.said("matched"), 25, lambda: self.path.read_text())

    def said(self, key):
        lines = (json.loads(line) for line in self.path.read_text().splitlines() if line.startswith("{"))
        return [line[key] for line in lines if key in line]

    def stamps(self, count):
        """When each message was written, once all are."""
        until(lambda: len(self.said("stamp_ns")) == count, 30, lambda: self.path.read_text()[-500:])
        return self.said("stamp_ns")


def listed(ask):
    """The incidents that the server knows: a mark is answered before its incident is on the disk."""
    return {it["id"]: it["recording"] for it in ask("/api/v1/incidents?count=200")}


def finished(ask):
    return {number for number, recording in listed(ask).items() if recording["finished"]}


def text_bytes(text):
    """The encapsulation and the CDR of a `std_msgs/msg/String`, with the zeros up to a multiple of four."""
    data = b"\x00\x01\x00\x00" + (len(text) + 1).to_bytes(4, "little") + text.encode() + b"\x00"
    return data + bytes(-len(data) % 4)


def digests(text):
    """Of a message with the zeros at its end and without: whether they belong to it is the sender's choice."""
    whole = text_bytes(text)
    end = 8 + len(text) + 1
    return {hashlib.sha256(whole[:size]).hexdigest() for size in range(end, len(whole) + 1)}


@pytest.fixture
def recorded(tmp_path):
    config = tmp_path / "robot.yaml"
    config.write_text(CONFIG)
    with serving(tmp_path, config=config) as server:
        server.add_user(*DEVELOPER, role="developer")
        yield server


def test_a_recording_has_every_message_of_foreign_publishers(recorded, tmp_path):
    server = recorded
    developer = Client(server, *DEVELOPER)
    ask = lambda path: json.load(developer.opener.open(server.url + path, timeout=10))
    texts = {vendor: Publisher(server, tmp_path, f"/foreign/{vendor}", "String", vendor) for vendor in ("cyclone", "fastdds")}
    status = Publisher(server, tmp_path, "/diagnostics", "DiagnosticArray", "cyclone")
    try:
        # No more at a time than every reader keeps.
        for begin in range(0, TEXTS, BURST):
            for vendor, publisher in texts.items():
                for number in range(begin, begin + BURST):
                    publisher.write(text=f"{vendor} {number}")
                publisher.stamps(begin + BURST)
        for number in range(ARRAYS):
            status.write(statuses=[{"level": 0, "name": "motor", "message": f"turn {number}"}])
        stamps = {it.topic: it.stamps(TEXTS) for it in texts.values()} | {status.topic: status.stamps(ARRAYS)}
        number = json.loads(developer.post("/api/v1/mark", note="all of it"))["incident"]
        until(lambda: number in finished(ask), 60, lambda: ask("/api/v1/incidents"))
    finally:
        for publisher in (*texts.values(), status):
            publisher.close()
    file = tmp_path / "incident.mcap"
    file.write_bytes(developer.opener.open(f"{server.url}/incidents/{number}.mcap", timeout=10).read())
    read = subprocess.run([sys.executable, ROOT / "tests/record/readers.py", file], capture_output=True, text=True, timeout=120)
    assert read.returncode == 0, read.stderr
    read = json.loads(read.stdout)
    assert sorted(read["schema"]) == ["/telltale/journal", "/telltale/keyframe", "/telltale/transitions"]
    of = lambda messages, topic: [it for it in messages if it[0] == topic]
    for topic, written in stamps.items():
        raw = of(read["mcap"]["messages"], topic)
        # The clock on the wire has steps of a quarter of a nanosecond.
        apart = [abs(stamp - it[3]) for stamp, it in zip(written, raw, strict=True)]
        assert max(apart) <= 1, (topic, apart)
        sequences = [it[4] for it in raw]
        assert sequences == list(range(sequences[0], sequences[0] + len(raw))), topic
        decoded, rosbags = of(read["mcap_ros2"], topic), of(read["rosbags"]["messages"], topic)
        assert [it[2] for it in decoded] == [it[3] for it in raw] and [it[3] for it in rosbags] == [it[5] for it in raw]
        assert [it[3] for it in decoded] == [it[4] for it in rosbags]
    for vendor, publisher in texts.items():
        said = [f"{vendor} {number}" for number in range(TEXTS)]
        assert [it[3]["data"] for it in of(read["mcap_ros2"], publisher.topic)] == said
        assert all(it[5] in digests(text) for text, it in zip(said, of(read["mcap"]["messages"], publisher.topic)))
    # Its own outputs, too.
    names = [it["name"] for it in of(read["mcap_ros2"], "/diagnostics_agg")[-1][3]["status"]]
    assert {"/vehicle", "/vehicle/base/motor"} <= set(names), names
    messages = [it[3]["status"][0]["message"] for it in of(read["mcap_ros2"], "/diagnostics")]
    assert messages == [f"turn {number}" for number in range(ARRAYS)]
    verified = subprocess.run([TELLTALE, "incident", "verify", str(number), "--data", server.folder], capture_output=True, text=True)
    assert verified.returncode == 0, verified.stdout + verified.stderr


class Talking(threading.Thread):
    """Publishes a text fifty times a second, until it is told to end."""

    def __init__(self, publisher):
        super().__init__(daemon=True)
        self.publisher, self.over = publisher, threading.Event()
        self.start()

    def run(self):
        while not self.over.wait(0.02):
            self.publisher.write(text="here")

    def end(self):
        self.over.set()
        self.join(timeout=10)


def last_message_ns(file):
    """When the last message was recorded that can be read in a file that may end anywhere."""
    last = 0
    with open(file, "rb") as source:
        try:
            for record in StreamReader(source).records:
                if isinstance(record, Message):
                    last = max(last, record.log_time)
        except (McapError, EOFError):
            # The end was cut off.
            pass
    return last


ROUNDS = int(os.environ.get("TELLTALE_CRASH_ROUNDS", "20")) // 3
# What is written may be a second old; a busy machine is later.
READABLE_NS = int(2e9)


def transitions(path):
    with open(path, "rb") as file:
        return [
            json.loads(message.data[8 : 7 + int.from_bytes(message.data[4:8], "little")])
            for _, _, message in make_reader(file).iter_messages(topics=["/telltale/transitions"], log_time_order=False)
        ]


def test_a_recording_is_readable_up_to_the_last_second_before_a_kill(recorded, tmp_path):
    server, rounds = recorded, ROUNDS
    talking = Talking(Publisher(server, tmp_path, "/foreign/cyclone", "String", "cyclone"))
    chance = random.Random(7)
    killed = []
    try:
        for _ in range(rounds):
            client = Client(server, *DEVELOPER)
            ask = lambda path: json.load(client.opener.open(server.url + path, timeout=10))
            until(lambda: ask("/api/v1/snapshot")["counters"], 10, "it answers")
            stalled_s = MACHINE.total_s
            number = json.loads(client.post("/api/v1/mark", note="before a kill"))["incident"]
            file = server.folder / "incidents" / f"incident-{number}.mcap"
            until(lambda: number in listed(ask), 10, "the recording has begun")
            moment = time.monotonic() + chance.uniform(0, 2)
            until(lambda: time.monotonic() > moment, 5, "its moment has come")
            at_ns = time.time_ns()
            # What was confirmed is there after all.
            assert json.loads(client.post("/api/v1/mark", note=f"killed {number}"))["incident"] == number
            server.kill()
            age_ns = at_ns - last_message_ns(file) - int((MACHINE.total_s - stalled_s) * 1e9)
            assert age_ns < READABLE_NS, f"{file}: its last message came {age_ns / 1e9:.2f} s before the kill"
            killed.append(number)
            server.start()
        client = Client(server, *DEVELOPER)
        ask = lambda path: json.load(client.opener.open(server.url + path, timeout=10))
        until(lambda: set(killed) <= finished(ask), 30, lambda: ask("/api/v1/incidents"))
        assert all(ask(f"/api/v1/incidents/{number}")["recording"]["interrupted"] for number in killed)
        for number in killed:
            whole = tmp_path / "whole.mcap"
            whole.write_bytes(client.opener.open(f"{server.url}/incidents/{number}.mcap", timeout=10).read())
            read = subprocess.run([sys.executable, ROOT / "tests/record/readers.py", whole], capture_output=True, text=True, timeout=120)
            assert read.returncode == 0, read.stderr
            marks = [it["note"] for it in transitions(whole) if it["kind"] == "trigger" and it["of"] == "mark"]
            assert marks == ["before a kill", f"killed {number}"], number
            story = ask(f"/api/v1/incidents/{number}")["story"]
            assert story["interrupted_ms"] == story["to_ms"], story
            assert story["moments"][-1]["kind"] == "interrupted" and story["to_ms"] == story["moments"][-1]["at_ms"], story["moments"]
    finally:
        talking.end()
        talking.publisher.close()
    verified = subprocess.run([TELLTALE, "incident", "verify", "--data", server.folder], capture_output=True, text=True)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    for number in killed:
        (line,) = [it for it in verified.stdout.splitlines() if f"incident-{number}.mcap" in it]
        assert "nothing proves it before that" in line, "it had no hash when the server was killed"
