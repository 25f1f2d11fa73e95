"""What strangers announce on DDS takes nothing from others: no data, no type and no place in a recording."""

import contextlib
import json
import sys
import threading
import time
import urllib.error
import urllib.request

import pytest
from mcap.reader import make_reader

from vehicle import ROOT, Client, Writer, own_domain, serving, until

sys.path.insert(0, str(ROOT / "tests/dds"))
import rtps  # noqa: E402

DEVELOPER = ("dora", "a long password")
CONFIG = """
vehicle: { stages: none }
recording: { before: 5s, after: 1s, topics: [{ topic: '/*' }] }
groups:
  - id: base
    modules:
      - { id: motor, status: motor, timeout: 2s, stale: error }
      - { id: rate, monitor: { frequency: { topic: /text, window: 1s, error_below: 5 } } }
"""
# Names that no ROS topic has, as they stand on the wire.
ODD_NAMES = ["rt//", "rt/", "rt", "rt/a/", "rt//a", "rt/a//b", "rt///", "rt/" + "x" * 900]
FORGED = 600


class Site:
    """A server, and a vehicle that says ten times a second that it is well; `options` are those of its programs."""

    def __init__(self, stack, folder, flags=(), options=()):
        config = folder / "robot.yaml"
        config.write_text(CONFIG)
        self.folder = folder
        self.stack = stack
        self.options = options
        self.server = stack.enter_context(serving(folder, config=config, flags=flags))
        self.server.add_user(*DEVELOPER, role="developer")
        self.client = Client(self.server, *DEVELOPER)
        self.motor = self.writer("rt/diagnostics", "DiagnosticArray", "motor")
        self.repeat(lambda: self.motor.write(statuses=[{"level": 0, "name": "motor", "message": f"at {time.monotonic():.2f}"}]))

    def writer(self, topic, type_name, name):
        writer = Writer(own_domain(), topic, type_name, self.folder / f"{name}.log", options=self.options)
        return self.stack.enter_context(contextlib.closing(writer))

    def repeat(self, write):
        ended = threading.Event()

        def run():
            while not ended.wait(0.1):
                write()
        thread = threading.Thread(target=run)
        thread.start()
        self.stack.callback(thread.join)
        self.stack.callback(ended.set)

    def module(self, name):
        groups = self.client.snapshot()["groups"]
        return next((it for group in groups for it in group["modules"] if it["id"] == name), None)

    def is_ok(self, name):
        module = self.module(name)
        return module is not None and module["state"] == "ok"

    def is_ready(self):
        try:
            return urllib.request.urlopen(self.server.url + "/readyz", timeout=5).status == 200
        except urllib.error.HTTPError:
            return False

    def is_heard(self):
        """Now, and not only by what was heard before."""
        message = (self.module("base/motor") or {}).get("message", "")
        return self.is_ok("base/motor") and message.startswith("at ") and time.monotonic() - float(message.split()[1]) < 1

    def topics(self):
        """All that is known of DDS, as the developer's page shows it."""
        return self.client.opener.open(self.server.url + "/developer/topics", timeout=10).read().decode()


@pytest.fixture
def site(tmp_path):
    with contextlib.ExitStack() as stack:
        site = Site(stack, tmp_path)
        until(site.is_heard, 20, "the vehicle is heard")
        yield site


def test_no_name_of_a_topic_ends_the_diagnosis(site):
    for number, name in enumerate(ODD_NAMES):
        site.writer(name, "String", f"odd {number}")
    until(lambda: "//a" in site.topics(), 30, "the names are found")
    # The topics to record are looked for once a second.
    ends = time.monotonic() + 5
    while time.monotonic() < ends:
        time.sleep(0.2)
        dds = site.module("telltale/dds")
        assert dds is None or dds["state"] == "ok", dds
    until(site.is_heard, 5, lambda: f"the vehicle is heard: {site.module('base/motor')}\n{site.server.read_log()[-2000:]}")
    assert site.is_ready()


def test_a_type_that_nobody_sends_blinds_no_monitor(site):
    site.writer("rt/text", "Bool", "stranger")
    until(lambda: "std_msgs/msg/Bool" in site.topics(), 30, "the stranger is found")
    text = site.writer("rt/text", "String", "text")
    site.repeat(lambda: text.write(text="here"))
    until(lambda: site.is_ok("base/rate"), 20, lambda: f"the messages are read: {site.module('base/rate')}")
    # Nor does one that is announced later.
    site.writer("rt/text", "DiagnosticStatus", "later")
    until(lambda: "DiagnosticStatus" in site.topics(), 30, "the later stranger is found")
    ends = time.monotonic() + 3
    while time.monotonic() < ends:
        assert site.is_ok("base/rate"), site.module("base/rate")
        time.sleep(0.1)


def test_forged_names_take_no_place_in_a_recording(site):
    attacker = rtps.Attacker(own_domain(), 7)
    announce = lambda: attacker.send(attacker.announcement(attacker.prefix), offsets=(10,))
    announce()
    for number in range(FORGED):
        entity = (number + 1).to_bytes(3, "big") + b"\3"
        # Before the name of the camera in every order.
        name, type_name = f"rt/a{number:05}", "std_msgs::msg::dds_::String_"
        attacker.send(attacker.endpoint(attacker.prefix, entity, name, type_name, number + 1), offsets=(10,))
        if number % 100 == 0:
            announce()
            time.sleep(0.25)
    until(lambda: "/a00" in site.topics(), 20, "forged names are found")
    site.repeat(announce)
    camera = site.writer("rt/zz_camera", "String", "camera")
    site.repeat(lambda: camera.write(text="picture"))
    until(lambda: is_recorded(site), 90, lambda: f"the camera is recorded:\n{site.server.read_log()[-2000:]}")
    until(site.is_heard, 5, "the vehicle is heard")


def is_recorded(site):
    """Whether a mark that is made now has messages of the camera."""
    number = json.loads(site.client.post("/api/v1/mark", note="camera"))["incident"]
    until(lambda: is_finished(site, number), 60, "the recording of the mark has ended")
    with open(site.folder / f"incidents/incident-{number}.mcap", "rb") as file:
        return any(channel.topic == "/zz_camera" for _, channel, _ in make_reader(file).iter_messages())


def is_finished(site, number):
    with site.client.opener.open(site.server.url + "/api/v1/incidents?count=200", timeout=10) as answer:
        return any(it["id"] == number and it["recording"]["finished"] for it in json.load(answer))
