"""What `telltale replay` prints of bags of a robot that never heard of Telltale, in every form in which rosbag2 stores them."""

import datetime
import json
import os
import re
import shutil
import sqlite3
import subprocess
import urllib.error
import urllib.parse
import urllib.request
from contextlib import suppress
from types import SimpleNamespace

import numpy
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from playwright.sync_api import TimeoutError, expect
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from operating import log_in
from programs import TELLTALE, shown, until
from sizes import FAULTS, SIZES
from test_replay_pages import actions, answer
from vehicle import Client

POWER, ODOMETRY = "robo_msgs/msg/Power", "nav_msgs/msg/Odometry"
STATUS, DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/DiagnosticArray"
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg("string pack\nfloat32[] cells\nfloat64 volts\n", POWER))
TOPICS = {"/diagnostics": DIAGNOSTICS, "/odom": ODOMETRY, "/power": POWER, "/chatter": "std_msgs/msg/String"}
BEGIN_NS = 1_790_000_000 * 10**9
CONFIG = """
vehicle: { stages: STAGES }
groups:
  - id: base
    modules:
      - { id: motor, status: motor }
      - { id: odometry, monitor: { frequency: { topic: /odom, type: nav_msgs/msg/Odometry, window: 1s, error_below: 10 } } }
      - { id: power, monitor: { value: { topic: /power, type: robo_msgs/msg/Power, field: volts, error_below: 22 } } }
  - id: planning
    depends_on: [base]
    modules: [{ id: planner, status: planner }]
"""


def cdr(type_name, *values):
    return bytes(STORE.serialize_cdr(STORE.types[type_name](*values), type_name))


def header(second):
    return STORE.types["std_msgs/msg/Header"](STORE.types["builtin_interfaces/msg/Time"](1_790_000_000 + int(second), 0), "base_link")


def diagnostics(second):
    level = lambda begin, end: 2 if begin <= second < end else 0
    told = [("motor", level(3, 6), "too hot"), ("planner", level(3.5, 5), "no path")]
    return cdr(DIAGNOSTICS, header(second), [STORE.types[STATUS](state, name, text, "", []) for name, state, text in told])


def odometry(second):
    make = lambda name, *values: STORE.types[f"geometry_msgs/msg/{name}"](*values)
    vector, zeros = make("Vector3", 1.0, 0.0, 0.0), numpy.zeros(36)
    pose = make("PoseWithCovariance", make("Pose", make("Point", 0.0, 0.0, 0.0), make("Quaternion", 0.0, 0.0, 0.0, 1.0)), zeros)
    return cdr(ODOMETRY, header(second), "wheels", pose, make("TwistWithCovariance", make("Twist", vector, vector), zeros))


def power(second):
    return cdr(POWER, "main", numpy.full(3, 3.7, numpy.float32), 24.0 if second < 9 else 21.5)


def messages():
    """The motor is too hot from 3 s to 6 s, the rate of the odometry falls at 7 s, the voltage at 9 s, and all end at 10 s."""
    said = []
    for tick in range(1000):
        second = tick / 100
        if tick % 10 == 0:
            said.append(("/diagnostics", second, diagnostics(second)))
        if tick % (5 if second < 7 else 25) == 1:
            said.append(("/odom", second, odometry(second)))
        if tick % 20 == 2:
            said.append(("/power", second, power(second)))
    return said + [("/chatter", 10 + tick / 2, cdr("std_msgs/msg/String", "still here")) for tick in range(10)]


MESSAGES = messages()


def bag(path, said=MESSAGES, plugin=StoragePlugin.MCAP, compression=None):
    """Written by the library rosbags."""
    writer = BagWriter(path, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {topic: writer.add_connection(topic, type_name, typestore=STORE) for topic, type_name in TOPICS.items()}
        for topic, second, data in said:
            writer.write(connections[topic], BEGIN_NS + round(second * 1e9), data)
    return path


def of_lz4(path, source):
    """The same messages in small chunks of LZ4, by the library of MCAP."""
    with open(path, "wb") as file, open(source, "rb") as read:
        writer = McapWriter(file, compression=CompressionType.LZ4, chunk_size=20_000)
        writer.start("ros2")
        known = {}
        for schema, channel, message in make_reader(read).iter_messages():
            if channel.topic not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            times = {"log_time": message.log_time, "publish_time": message.publish_time}
            writer.add_message(known[channel.topic], data=message.data, **times)
        writer.finish()
    return path


def replay(recording, *options, exits=0):
    """What is printed, and what is said on standard error."""
    done = subprocess.run([TELLTALE, "replay", recording, *map(str, options)], capture_output=True, text=True, timeout=120)
    assert done.returncode == exits, (done.returncode, done.stdout, done.stderr)
    assert "panicked" not in done.stderr
    return done.stdout, done.stderr


def lines(printed):
    return [json.loads(line) for line in printed.splitlines()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def config(folder):
    path = folder / "robot.yaml"
    path.write_text(CONFIG.replace("STAGES", "none"))
    return path


@pytest.fixture(scope="module")
def plain(folder):
    """A folder with metadata.yaml and one MCAP file without compression."""
    return bag(folder / "plain")


def file_of(path):
    return next(file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))


@pytest.fixture(scope="module")
def expected(plain, config):
    printed, said = replay(plain, "--config", config, "--json")
    assert said == ""
    return printed


def test_a_foreign_bag_is_judged_by_its_statuses_rates_and_fields(expected):
    told = [it for it in lines(expected) if it["t_s"] >= 2]
    of = lambda node: [(it["t_s"], it["shown"]) for it in told if it["node"] == node]
    assert of("base/motor") == [(3, "error"), (6, "ok"), (11.9, "unknown")]
    # Fifteen messages of the last second are gone at 7.66 s; the last two volts come at 9.02 s.
    assert of("base/odometry") == [(7.66, "error")] and of("base/power") == [(9.02, "error")]
    planner = [it for it in told if it["node"] == "planning/planner"]
    masked = [(it["t_s"], it["own"], it["roots"]) for it in planner if it["shown"] == "ignore"]
    motor, odometry = ["base/motor"], ["base/odometry"]
    # Both are silent at the end of the bag, which other topics show.
    silent = (11.9, "unknown", odometry + ["base/power"])
    assert masked == [(3, "ok", motor), (3.5, "error", motor), (5, "ok", motor), (7.66, "ok", odometry), silent]
    assert all(it["reason"] == {"kind": "masked", "by": it["roots"]} for it in planner if it["shown"] == "ignore")
    assert [(it["t_s"], it["reason"]) for it in planner if it["shown"] == "ok"] == [(6, None)]
    assert told[0]["at"] == "2026-09-21T14:13:23.000Z"


def halves(folder):
    """Two files with one metadata.yaml, as rosbag2 splits a bag."""
    whole = folder / "split"
    parts = [bag(folder / f"split_{number}", half) for number, half in enumerate((MESSAGES[:1000], MESSAGES[1000:]))]
    whole.mkdir()
    names = [shutil.copy(file_of(part), whole / f"split_{number}.mcap").name for number, part in enumerate(parts)]
    # A name with a folder is how old versions wrote it.
    listed = (parts[0] / "metadata.yaml").read_text().replace("- split_0.mcap", f"- {names[0]}\n  - split/{names[1]}")
    assert "split/split_1.mcap" in listed
    (whole / "metadata.yaml").write_text(listed)
    return whole


def without_metadata(folder):
    path = shutil.copytree(halves(folder), folder / "no_metadata")
    (path / "metadata.yaml").unlink()
    return path


FORMS = {
    "one file": lambda folder, plain: file_of(plain),
    "zstd": lambda folder, plain: bag(folder / "zstd", compression=CompressionMode.STORAGE),
    "zstd by message": lambda folder, plain: bag(folder / "by_message", compression=CompressionMode.MESSAGE),
    "lz4": lambda folder, plain: of_lz4(folder / "lz4.mcap", file_of(plain)),
    "split": lambda folder, plain: halves(folder),
    "split without metadata": lambda folder, plain: without_metadata(folder),
    "sqlite3": lambda folder, plain: bag(folder / "sqlite3", plugin=StoragePlugin.SQLITE3),
    "sqlite3 file": lambda folder, plain: file_of(bag(folder / "database", plugin=StoragePlugin.SQLITE3)),
    "sqlite3 by message": lambda folder, plain: bag(
        folder / "rows", plugin=StoragePlugin.SQLITE3, compression=CompressionMode.MESSAGE
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_of_a_bag_give_the_same_lines(form, tmp_path, plain, config, expected):
    printed, said = replay(FORMS[form](tmp_path, plain), "--config", config, "--json")
    assert (printed, said) == (expected, "")


def test_a_file_of_a_split_bag_that_is_gone_is_a_gap(tmp_path, config):
    path = halves(tmp_path)
    listed = (path / "metadata.yaml").read_text()
    begin_ns, length_ns = BEGIN_NS + 4 * 10**9, 2 * 10**9
    spans = f"  files:\n    - {{ path: split_1.mcap, starting_time: {{ nanoseconds_since_epoch: {begin_ns} }}, duration: {{ nanoseconds: {length_ns} }} }}\n"
    (path / "metadata.yaml").write_text(re.sub(r"(?m)^  files:\n(    .*\n|  - .*\n)*", "", listed).rstrip("\n") + "\n" + spans)
    (path / "split_1.mcap").unlink()
    _, said = replay(path, "--config", config)
    assert f"telltale: missing {utc(begin_ns)} to {utc(begin_ns + length_ns)} (2.000 s): " in said, said


def test_a_bag_that_is_compressed_as_a_whole_says_what_to_do(tmp_path, config, expected):
    path = bag(tmp_path / "whole", compression=CompressionMode.FILE)
    packed = next(path.glob("*.zstd"))
    _, said = replay(path, "--config", config, exits=2)
    plain = packed.with_suffix("")
    assert f"zstd -d {packed} -o {plain}" in said
    # What the command makes is used in place of the other.
    shutil.copy(file_of(bag(tmp_path / "same")), plain)
    printed, said = replay(path, "--config", config, "--json")
    assert (printed, said) == (expected, "")


def test_expected_lines_are_compared(tmp_path, plain, config, expected):
    good, wrong = tmp_path / "good.jsonl", tmp_path / "wrong.jsonl"
    good.write_text(expected)
    assert replay(plain, "--config", config, "--expect", good) == ("", "")
    wrong.write_text(expected.replace('"t_s":9.02', '"t_s":9.5'))
    printed, _ = replay(plain, "--config", config, "--expect", wrong, exits=1)
    number = next(index for index, line in enumerate(expected.splitlines(), 1) if '"t_s":9.02' in line)
    assert f"line {number} is expected and does not come:\n  - " in printed and '"t_s":9.5' in printed
    assert "  + " in printed and '"t_s":9.02' in printed


def test_a_part_of_the_time_is_printed(plain, config, expected):
    part = lambda begin, end: [line for line in expected.splitlines() if begin <= json.loads(line)["t_s"] <= end]
    for begin, end, options in [
        (3.5, 6, ("--from", "3.5s", "--to", "6")),
        (7, 99, ("--from", "2026-09-21T14:13:27Z")),
        (0, 3, ("--to", "2026-09-21T14:13:23Z")),
    ]:
        printed, said = replay(plain, "--config", config, "--json", *options)
        assert part(begin, end) and printed.splitlines() == part(begin, end), options
        assert said == ""


def test_what_can_be_read_of_a_file_that_is_cut_off_is_used(tmp_path, plain, config, expected):
    cut, whole = tmp_path / "cut.mcap", of_lz4(tmp_path / "whole.mcap", file_of(plain)).read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    printed, said = replay(cut, "--config", config, "--json")
    count = len(printed.splitlines())
    assert printed.splitlines() == expected.splitlines()[:count] and 6 < count < len(expected.splitlines())
    assert "the file ends in the middle of a record" in said
    # A database too, in which pages are missing or all but the head of the file.
    whole = file_of(bag(tmp_path / "database", plugin=StoragePlugin.SQLITE3)).read_bytes()
    cut = tmp_path / "cut.db3"
    for size in (100, 5000, len(whole) // 2):
        cut.write_bytes(whole[:size])
        done = subprocess.run([TELLTALE, "replay", cut, "--config", config], capture_output=True, text=True, timeout=60)
        assert done.returncode in (0, 2) and "malformed" in done.stderr and "panicked" not in done.stderr, (size, done)


def test_odd_times_and_types_are_said_and_the_rest_is_used(tmp_path, config, expected):
    path = file_of(bag(tmp_path / "odd", plugin=StoragePlugin.SQLITE3))
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET type = 'geometry_msgs/msg/Twist' WHERE name = '/odom'")
        of_power = "topic_id = (SELECT id FROM topics WHERE name = '/power')"
        database.execute(f"UPDATE messages SET data = x'0001000002' WHERE {of_power} AND timestamp < {BEGIN_NS + 10**9}")
        database.execute(f"UPDATE messages SET timestamp = timestamp + 4000000000000000000 WHERE timestamp = {BEGIN_NS + 2 * 10**9}")
    database.close()
    printed, said = replay(path, "--config", config, "--json")
    motor = [(it["t_s"], it["shown"]) for it in lines(printed) if it["node"] == "base/motor"]
    assert motor == [(0, "ok"), (3, "error"), (6, "ok"), (11.9, "unknown")]
    assert "the messages of /odom are geometry_msgs/msg/Twist, not nav_msgs/msg/Odometry" in said
    assert said.count("a message of /power cannot be read: ") == 1 and "5 messages do not follow their type" in said
    assert "1 messages are left out: their times do not fit those around them" in said


def test_a_vehicle_begins_in_the_stage_that_is_named(plain, folder):
    shuttle = folder / "shuttle.yaml"
    shuttle.write_text(CONFIG.replace("STAGES", "shuttle").replace("depends_on: [base]", "when: { stages: [active] }"))
    planner = lambda *options: [
        (it["t_s"], it["shown"], it["reason"] and it["reason"]["kind"])
        for it in lines(replay(plain, "--config", shuttle, "--json", "--to", "4s", *options)[0])
        if it["node"] == "planning/planner"
    ]
    assert planner("--stage", "active") == [(0, "ok", None), (3.5, "error", None)]
    assert planner("--stage", "standby") == planner()
    assert {state for _, state, _ in planner()} == {"ignore"}


def test_a_bag_is_shown_in_the_display(plain, config, page):
    with shown(plain, config) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        screen = page.frame_locator("iframe[name=screen]")
        expect(screen.locator("body")).to_have_attribute("data-live", "replay")
        page.goto(f"{url}/replay/file?at={BEGIN_NS // 10**6 + 4_500}")
        expect(screen.locator("#tile-base")).to_have_attribute("data-state", "error")
        expect(screen.locator("#tile-planning")).to_have_attribute("data-reason", "masked")
        expect(page.locator(".lane[data-node='base/motor']")).to_be_visible()
        page.goto(f"{url}/replay/file?at={BEGIN_NS // 10**6 + 2_000}")
        expect(screen.locator("#tile-base")).to_have_attribute("data-state", "ok")
        expect(page.locator("#unheard")).to_have_count(0)
        # There is nothing else, and nothing acts.
        for path in ["/", "/developer"]:
            page.goto(url + path)
            page.wait_for_url(f"{url}/replay/file")
        client = Client(SimpleNamespace(url=url), name, password)
        until(lambda: answer(client.opener, client.server, "GET", "/replay/file") == 200, 60, "the replay is open")
        for path in actions(1):
            assert answer(client.opener, client.server, "POST", f"/replay/file/screen{path}") in (403, 404, 405, 409), path
            if path not in ("/login", "/logout"):
                assert answer(client.opener, client.server, "POST", path) == 404, path
        if shots := os.environ.get("REPLAY_SHOTS"):
            page.goto(f"{url}/replay/file?at={BEGIN_NS // 10**6 + 4_500}")
            expect(screen.locator("#tile-base")).to_have_attribute("data-state", "error")
            page.screenshot(path=f"{shots}/serve.png")
        # Its socket is closed before the server ends.
        page.goto("about:blank")
    _, said = replay(plain, "--serve", exits=2)
    assert "--config" in said, said
    _, said = replay(plain, "--config", config, "--serve", "--listen", "0.0.0.0:0", exits=2)
    assert "beyond this computer" in said, said


def test_the_topics_that_a_recording_does_not_have_are_named(tmp_path, plain, config, page):
    other = tmp_path / "other.yaml"
    other.write_text(config.read_text().replace("/odom", "/robot/odom"))
    with shown(plain, other) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        expect(page.locator("#unheard")).to_have_text(re.compile("has no message of them: /robot/odom$"))
        page.goto("about:blank")


def with_wrong_bit(folder, plain):
    """The bag in chunks, with a wrong bit in the chunk that holds the message of five seconds; and the times of that chunk."""
    path = of_lz4(folder / "damaged.mcap", file_of(plain))
    with open(path, "rb") as read:
        chunks = make_reader(read).get_summary().chunk_indexes
    middle = BEGIN_NS + 5 * 10**9
    chunk = next(it for it in chunks if it.message_start_time <= middle <= it.message_end_time)
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(content)
    return path, chunk.message_start_time, chunk.message_end_time


def utc(ns):
    at = datetime.datetime.fromtimestamp(ns // 10**6 / 1000, datetime.timezone.utc)
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def test_a_damaged_recording_says_on_every_screen_what_is_missing(tmp_path, plain, config, page):
    damaged, from_ns, to_ns = with_wrong_bit(tmp_path, plain)
    _, said = replay(damaged, "--config", config, "--json")
    assert f"telltale: missing {utc(from_ns)} to {utc(to_ns)} (" in said and "may differ from" in said, said
    with shown(damaged, config) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        notice, body = page.locator("#missing"), page.locator("body")
        expect(notice).to_contain_text("Damaged recording")
        assert [it.get_attribute("datetime") for it in notice.locator("time").all()] == [utc(from_ns), utc(to_ns)]
        expect(body).not_to_have_attribute("data-differing", "")
        assert page.locator(".lane .gap").count() == page.locator(".lane:not(.axis)").count() > 0
        # From there on it may differ, and each screen says so by itself.
        page.goto(f"{url}/replay/file?at={to_ns // 10**6 + 100}")
        expect(body).to_have_attribute("data-differing", "")
        screen = page.frame_locator("iframe[name=screen]").locator("body")
        for number in range(page.locator("nav a").count()):
            page.locator("nav a").nth(number).click()
            expect(page.locator("nav a").nth(number)).to_have_attribute("aria-current", "page")
            expect(screen).to_have_attribute("data-missing", re.compile("Damaged recording: missing .* may differ from what was shown"))
            assert "Damaged recording" in screen.evaluate("it => getComputedStyle(it, '::before').content")
        # Its timeline marks them, as far as it is shown.
        page.locator("nav a[href$='/developer/timeline']").click()
        lanes = page.frame_locator("iframe[name=screen]").locator("#timeline .lane[data-node]")
        expect(lanes.locator(".gap").first).to_be_attached()
        assert lanes.locator(".gap").count() == lanes.locator(".differing").count() == lanes.count() > 1
        page.locator("input[name=at]").fill(str(BEGIN_NS // 10**6 + 1000))
        expect(lanes.locator(".gap")).to_have_count(0)
        expect(body).not_to_have_attribute("data-differing", "")
        page.goto("about:blank")


def test_a_moment_that_is_not_in_the_recording_is_not_shown_as_if_it_were(plain, config, page):
    with shown(plain, config) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        from_ms, to_ms = [int(page.locator("body").get_attribute(f"data-{end}")) for end in ("from", "to")]
        beyond = page.locator("#beyond")
        for at, says, shown_ms in [(to_ms + 60_000, "It ends here", to_ms), (from_ms - 1, "It begins here", from_ms)]:
            for address in (f"/replay/file?at={at}", f"/replay/file/screen/developer/moment?at={at}"):
                page.goto(url + address)
                expect(beyond).to_contain_text(says)
                expect(beyond.locator("time")).to_have_attribute("datetime", utc(shown_ms * 10**6))
        page.goto(f"{url}/replay/file/differences?a={from_ms}&b={to_ms + 5000}")
        expect(page.locator(".beyond")).to_contain_text("It ends here")
        # It has the frame of every replay.
        frame = "() => { const { borderTopColor, borderTopWidth } = getComputedStyle(document.body, '::after'); return borderTopWidth + borderTopColor; }"
        assert page.evaluate(frame) == "6pxrgb(122, 47, 208)"
        page.goto(f"{url}/replay/file?at={to_ms}")
        expect(page.locator("output#replay-after")).to_contain_text("+")
        expect(beyond).to_have_count(0)
        page.goto("about:blank")

        client = Client(SimpleNamespace(url=url), name, password)
        until(lambda: answer(client.opener, client.server, "GET", "/replay/file") == 200, 60, "the replay is open")

        def ask(path, accept="text/html", **form):
            headers = {"Origin": url, "Accept": accept}
            request = urllib.request.Request(url + path, data=urllib.parse.urlencode(form).encode() or None, headers=headers)
            try:
                with client.opener.open(request, timeout=20) as answered:
                    return answered.status, answered.headers["Content-Type"], answered.read().decode()
            except urllib.error.HTTPError as error:
                return error.code, error.headers["Content-Type"], error.read().decode()

        for path in ("/replay/file?at=abc", "/replay/file?at=", "/replay/file/screen/developer/moment?at=soon", "/replay/file/differences?a=1", "/replay/file/differences?a=x&b=1"):
            status, kind, text = ask(path)
            assert status == 400 and kind.startswith("text/html") and "at=2026-11-25T15:44:04.5Z" in text, (path, status, text)
        # A script gets JSON, whatever it accepts.
        for form, field in [({"play": "fast"}, "play"), ({"play": "-1"}, "play"), ({"speed": "0"}, "speed"), ({"step": "far"}, "step"), ({"at_ms": "x"}, "at_ms"), ({"other": 1}, "step")]:
            status, kind, text = ask("/replay/file/state", **form)
            assert status == 422 and kind == "application/json" and field in json.loads(text)["error"], (form, status, kind, text)
        assert ask("/replay/1/state", step="next")[:2] == (404, "application/json")
        status, _, text = ask("/replay/file/state", at_ms=to_ms + 60_000)
        assert status == 200 and json.loads(text)["at_ms"] == to_ms
        # At the end another speed starts nothing. The next play has it.
        state = json.loads(ask("/replay/file/state", speed=20)[2])
        assert (state["at_ms"], state["playing"], state["speed"]) == (to_ms, False, 20.0)


# What leaves the window, or is cut in its own box.
CUT = """() => [...document.querySelectorAll(".dev-bar, .dev-bar *, .replay-notes, .replay-notes *, #states, .player, .player *, .stage, iframe")].filter(it => {
  const { left, top, right, bottom, width } = it.getBoundingClientRect();
  if (!width || it.closest(".hush, .dev-bar p, svg *")) return false;
  return left < 0 || top < 0 || right > innerWidth || bottom > innerHeight || (it.matches("button, a, p, nav") && it.scrollWidth > it.clientWidth + 1 && getComputedStyle(it).display !== "inline");
}).map(it => it.outerHTML.slice(0, 80))"""


@pytest.mark.parametrize("lang", ["en", "de"])
def test_everything_of_a_replay_is_in_sight_at_all_sizes(tmp_path, plain, config, page, lang):
    damaged, _, to_ns = with_wrong_bit(tmp_path, plain)
    with shown(damaged, config) as (url, name, password):
        page.context.add_cookies([{"name": "lang", "value": lang, "url": url}])
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        page.goto(f"{url}/replay/file?at={to_ns // 10**6 + 100}")
        expect(page.locator("body")).to_have_attribute("data-differing", "")
        expect(page.frame_locator("iframe[name=screen]").locator("#tile-base")).to_be_visible()
        box = lambda selector: page.locator(selector).first.bounding_box()
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_function("() => { const it = document.querySelector('iframe').getBoundingClientRect(); return Math.abs(it.width / it.height - 1.6) < 0.01 }")
            size = f"{width}x{height}"
            # The screen is fitted once the window has its size.
            with suppress(TimeoutError):
                page.wait_for_function(f"() => ({CUT})().length === 0 && document.querySelector('iframe').getBoundingClientRect().width >= 0.45 * innerWidth")
            assert page.evaluate(CUT) == [], size
            assert page.evaluate("() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == [width, height]
            strips, slider, screen = box("#states"), box("input[name=at]"), box("iframe")
            assert strips["y"] + strips["height"] <= slider["y"] and slider["y"] + slider["height"] <= screen["y"], size
            # The strips show the stage or a node and the times at least; the screen is large enough to be read.
            assert strips["height"] >= 80 and screen["width"] >= 0.45 * width, (size, strips, screen)
            # The slider has the axis of the strips.
            lane = box("#states .lane svg")
            assert abs(slider["x"] + 8 - lane["x"]) < 2 and abs(slider["width"] - 16 - lane["width"]) < 2, (size, slider, lane)
            # The operator's screen is that of its own display, whole.
            frame = page.frame(name="screen")
            assert frame.evaluate("() => [innerWidth, innerHeight]") == [1280, 800]
            assert frame.evaluate(FAULTS) == [], size
        page.goto("about:blank")


def test_a_replay_is_moved_by_keys(plain, config, page):
    # A slow network: keys are pressed before the last one's order has left.
    page.add_init_script("""
        const quick = window.fetch;
        window.fetch = async (address, options) => {
          if (options?.method === "POST") await new Promise((resolve) => setTimeout(resolve, 300));
          return quick(address, options);
        };
    """)
    with shown(plain, config) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        body, slider, speed = page.locator("body"), page.locator("input[name=at]"), page.locator("select[name=speed]")
        second = lambda: (int(slider.input_value()) - BEGIN_NS // 10**6) / 1000
        reaches = lambda wanted: until(lambda: abs(second() - wanted) < 0.01, 20, lambda: f"{wanted}, it is {second()}")
        page.keyboard.press("End")
        until(lambda: second() > 13, 20, second)
        page.keyboard.press("ArrowLeft")
        reaches(11.9)
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowRight")
        reaches(11.9)
        page.keyboard.press("Home")
        reaches(0)
        for key in "---++++":
            page.keyboard.press(key)
        assert speed.input_value() == "5"
        # Also while the operator's screen has the focus.
        page.frame_locator("iframe[name=screen]").locator("#tile-base").focus()
        page.frame(name="screen").evaluate("() => document.dispatchEvent(new KeyboardEvent('keydown', { key: ' ' }))")
        expect(body).to_have_attribute("data-playing", "")
        until(lambda: second() > 3, 20, second)
        page.locator("h2").first.focus()
        page.keyboard.press("Space")
        expect(body).not_to_have_attribute("data-playing", "")
        page.goto("about:blank")


def test_what_cannot_be_used_is_said(tmp_path, plain, config):
    text = tmp_path / "note.mcap"
    text.write_text("no recording")
    for recording, options, words in [
        (text, ("--config", config), "it is no recording: neither an MCAP file nor a database of rosbag2"),
        (tmp_path / "none.mcap", ("--config", config), "No such file"),
        (tmp_path, ("--config", config), "note.mcap: it is no recording"),
        (plain, (), "the recording has no configuration of its own: name one with --config"),
        (plain, ("--stage", "active"), "--config"),
        (plain, ("--config", config, "--stage", "active"), "--stage needs a configuration with `stages: shuttle`"),
        (plain, ("--config", config, "--stage", "flying"), "there is no such stage: write one of "),
        (plain, ("--config", config, "--speed", "0"), "write a number above 0"),
        (plain, ("--config", config, "--from", "soon"), "write `12s` or `2026-11-20T12:00:00Z`"),
        (plain, ("--config", config, "--fast",), "--fast"),
        (plain, ("--config", tmp_path / "none.yaml"), "none.yaml"),
        (plain, ("--config", config, "--expect", text), "line 1 is no JSON object"),
    ]:
        printed, said = replay(recording, *options, exits=2)
        assert words in said and printed == "" and said.count(str(recording)) <= 1, (options, said)
