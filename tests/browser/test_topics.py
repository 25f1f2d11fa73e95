"""The page of topics: the measured and the wanted rate, and a monitor for a topic that nobody watches."""

import contextlib
import json
import re
import subprocess
import threading
import textwrap

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter
from programs import TELLTALE
from test_accessible import OVER
from test_developer import DEVELOPER, visit
from vehicle import Client, Server, Writer, own_domain, until

CONFIG = """vehicle: { id: robot-1, stages: none }
groups:
  - id: sensors
    modules:
      - { id: slow, monitor: { frequency: { topic: /slow, type: std_msgs/msg/Bool, window: 2s, warning_below: 200, error_below: 100 } } }
      - { id: heard, monitor: { frequency: { topic: /well, type: std_msgs/msg/Bool, window: 2s, error_below: 0.5 } } }
      - { id: value, monitor: { value: { topic: /well, type: std_msgs/msg/Bool, field: data, error_unless: true } } }
      - { id: over, monitor: { value: { topic: /over, type: std_msgs/msg/Bool, field: data, error_unless: true } } }
"""
TOPICS = ("well", "slow", "unread")


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """A robot whose topics come ten times a second."""
    folder = tmp_path_factory.mktemp("topics")
    config = folder / "config.yaml"
    config.write_text(CONFIG)
    server = Server(folder, own_domain(), config=config)
    server.add_user(*DEVELOPER, role="developer")
    server.start()
    ended = threading.Event()
    with contextlib.ExitStack() as ending:
        ending.callback(server.stop)
        writers = [Writer(server.domain, f"rt/{name}", "Bool", folder / f"{name}.log") for name in TOPICS]
        for writer in writers:
            ending.callback(writer.close)

        def publish():
            while not ended.wait(0.1):
                for writer in writers:
                    writer.write(bool=True)

        thread = threading.Thread(target=publish, daemon=True)
        thread.start()
        ending.callback(thread.join, 10)
        ending.callback(ended.set)
        yield server


@pytest.fixture
def topics(robot, page):
    enter(page, robot, *DEVELOPER)
    visit(page, robot, "/developer/topics")
    return page


def cell(page, name, head):
    heads = page.locator("#topics thead th").all_inner_texts()
    return page.locator(f'#topics [data-topic="/{name}"]').locator("th, td").nth(heads.index(head))


MEASURED = re.compile(r"^[1-9][\d.]* Hz$")


def test_what_is_too_slow_stands_first_beside_what_is_wanted(robot, topics, trouble):
    page = topics
    row = lambda name: page.locator(f'#topics [data-topic="/{name}"]')
    expect(page.locator("#topics tbody tr").first).to_have_attribute("data-topic", "/slow")
    expect(row("slow")).to_have_attribute("data-pace", "too_slow")
    expect(row("slow").locator("th")).to_contain_text("too slow")
    expect(cell(page, "slow", "Wanted")).to_have_text("≥ 200 Hz")
    expect(cell(page, "slow", "Rate")).to_have_text(MEASURED)
    expect(cell(page, "slow", "Jitter")).to_have_text(re.compile(r"^[\d.]+ ms$"))
    expect(row("well")).not_to_have_attribute("data-pace", re.compile("."))
    expect(cell(page, "well", "Wanted")).to_have_text("≥ 0.5 Hz")
    # What adds a monitor makes no row higher, and a type is whole below its package.
    expect(cell(page, "slow", "Type")).to_have_text("std_msgs/msg/Bool")
    high = lambda part: part.bounding_box()["height"]
    assert high(row("unread").locator(".monitors")) < 2.5 * high(row("unread").locator("[data-draft]"))
    top = lambda part: part.bounding_box()["y"]
    assert abs(top(row("slow").locator("[data-draft]")) - top(row("slow").locator(".monitors a:not([data-draft])"))) < 5
    # Nobody reads it, so nothing is known of its rate.
    expect(cell(page, "unread", "Rate")).to_have_text("")
    expect(cell(page, "unread", "Wanted")).to_have_text("")
    assert violations(page) == ""
    expect(cell(page, "well", "Monitors").get_by_role("link", name="sensors/")).to_have_text(["sensors/heard", "sensors/value"])
    cell(page, "well", "Monitors").get_by_role("link", name="sensors/value").click()
    page.wait_for_url("**/developer/why?node=sensors%2Fvalue")


def test_a_topic_that_stopped_has_no_jitter(robot, topics, trouble, tmp_path):
    page = topics
    cells = page.locator('#topics [data-topic="/over"] .number')
    with contextlib.closing(Writer(robot.domain, "rt/over", "Bool", tmp_path / "over.log")) as writer:

        def is_measured():
            writer.write(bool=True)
            return "ms" in "".join(cells.all_text_contents())

        until(is_measured, 30, lambda: cells.all_text_contents())
        expect(cells.first).to_have_text("0.0 Hz", timeout=30_000)
        assert "ms" not in "".join(cells.all_text_contents()), cells.all_text_contents()


def test_programs_are_told_the_same(robot):
    client = Client(robot, *DEVELOPER)

    def told(name):
        with client.opener.open(f"{robot.url}/api/v1/topics?q=/{name}", timeout=10) as answer:
            return next(iter(json.load(answer)["topics"]), {})

    measured = lambda it: it.get("jitter_ms") is not None and it["too_slow"] and it
    slow = until(lambda: measured(told("slow")), 30, lambda: told("slow"))
    well, unread = told("well"), told("unread")
    assert (slow["wanted_min_hz"], slow["wanted_max_hz"], slow["too_slow"]) == (200, None, True), slow
    assert slow["monitors"] == ["sensors/slow"] and well["monitors"] == ["sensors/heard", "sensors/value"]
    assert 0 < slow["rate_hz"] < 200 and slow["jitter_ms"] >= 0 and not well["too_slow"]
    assert (unread["rate_hz"], unread["jitter_ms"], unread["wanted_min_hz"], unread["too_slow"]) == (None, None, None, False)


def test_a_monitor_is_two_clicks_away_and_means_what_it_says(robot, topics, trouble, tmp_path):
    page = topics
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    expect(cell(page, "well", "Rate")).to_have_text(MEASURED)
    drafts = {}
    for name in ("unread", "well"):
        page.locator(f'[data-topic="/{name}"] [data-draft]').click()
        button = page.locator(f'[data-topic="/{name}"] + [data-aside] [data-copy]')
        button.click()
        expect(button).to_have_text("Copied")
        drafts[name] = page.evaluate("() => navigator.clipboard.readText()")
    assert violations(page) == ""
    # On a phone nothing of them has to be scrolled sideways.
    size = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate(OVER) == 0
    page.set_viewport_size(size)
    # The page renews itself, and they stay.
    at = page.locator("#dev").get_attribute("data-at")
    expect(page.locator("#dev")).not_to_have_attribute("data-at", at)
    expect(page.locator("[data-aside]")).to_have_count(2)
    # The measured rate gives the limits.
    assert "error_below: 0.1" in drafts["unread"] and "warning_below: " in drafts["well"], drafts
    config = tmp_path / "with.yaml"
    indented = textwrap.indent("".join(drafts.values()), "      ")
    config.write_text(CONFIG + indented)
    checked = subprocess.run([TELLTALE, "check", "-q", str(config)], capture_output=True, text=True, timeout=60)
    assert checked.returncode == 0, f"{checked.stdout}{checked.stderr}{config.read_text()}"
    # They are no rows of the table, and go as they came.
    page.locator('[data-topic="/well"] [data-draft]').click()
    expect(page.locator("[data-aside]")).to_have_count(1)
