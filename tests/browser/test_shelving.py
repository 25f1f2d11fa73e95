"""Shelving: a developer silences a module for maintenance, and every page says so."""

import contextlib
import re
import threading

import pytest
from playwright.sync_api import expect

from operating import enter, watch
from sizes import check_sizes
from vehicle import OPERATOR, Client, Writer, own_domain, serving

DEVELOPER = ("dora", "correct horse battery")
READER = ("auro", "correct horse battery")

CONFIG = """
vehicle: { id: amr, name: AMR, stages: none }
motion: { speed: { topic: /odom, type: nav_msgs/msg/Odometry, field: twist.twist.linear.x, timeout: 10s } }
defaults: { timeout: 5s }
groups:
  - { id: base, name: Base, modules: [{ id: imu, status: imu, name: IMU disturbed }, { id: fan, status: fan }] }
  - { id: nav, name: Navigation, depends_on: [base], modules: [{ id: planner, status: planner }] }
"""


class Machine:
    """Publishes its statuses and its speed."""

    def __init__(self, domain, folder):
        self.levels, self.mps = {"imu": 0, "fan": 0, "planner": 0}, 0.0
        self.diagnostics = Writer(domain, "rt/diagnostics", "DiagnosticArray", folder / "diagnostics.log")
        self.odometry = Writer(domain, "rt/odom", "nav_msgs::msg::dds_::Odometry_", folder / "odometry.log")
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.ended.wait(0.1):
            statuses = [
                {"level": level, "name": name, "message": "said", "hardware_id": "", "values": {}}
                for name, level in self.levels.items()
            ]
            self.diagnostics.write(statuses=statuses)
            self.odometry.write(message="Odometry", fields={"twist": {"twist": {"linear": {"x": self.mps}}}})

    def close(self):
        self.ended.set()
        self.thread.join(timeout=10)
        self.diagnostics.close()
        self.odometry.close()


@pytest.fixture
def server(tmp_path):
    config = tmp_path / "machine.yaml"
    config.write_text(CONFIG)
    with serving(tmp_path, config=config) as server:
        server.add_user(*DEVELOPER, role="developer")
        server.add_user(*READER, role="authority")
        yield server


@pytest.fixture
def machine(server, tmp_path):
    with contextlib.closing(Machine(own_domain(), tmp_path)) as machine:
        yield machine


def other_page(page, trouble, server, user, path):
    context = page.context.browser.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB")
    context.add_cookies(Client(server, *user).browser_cookies())
    other = context.new_page()
    watch(other, trouble)
    other.goto(server.url + path)
    return other


def test_what_is_shelved_calls_nobody_and_every_page_says_so(server, machine, page, trouble):
    enter(page, server, *OPERATOR)
    tile, causes = page.locator("#tile-base"), page.locator("#causes")
    expect(tile).to_have_attribute("data-state", "ok")
    expect(page.locator("#motion")).to_have_attribute("data-moving", "no")
    machine.levels["imu"] = 2
    expect(causes.locator("[data-node='base/imu']")).to_be_visible()
    expect(causes).not_to_have_attribute("data-alarms", "")
    expect(page.locator("#instruction")).to_have_attribute("data-urgency", "act")

    dev = other_page(page, trouble, server, DEVELOPER, "/developer/why?node=base%2Fimu")
    dev.locator("#shelve select").select_option("60")
    dev.locator("#shelve button").click()
    told = re.compile(r"Shelved base/imu until \d\d:\d\d:\d\d by dora")
    expect(dev.locator("#shelved")).to_have_text(told)

    # It calls nobody, and does not disappear.
    shelved = causes.locator("[data-shelved='base/imu']")
    expect(shelved).to_be_visible()
    expect(shelved).to_contain_text(re.compile(r"In maintenance until \d\d:\d\d.* by dora; itself: Error"))
    expect(causes.locator("[data-node]")).to_have_count(0)
    expect(causes).to_have_attribute("data-alarms", "")
    expect(page.locator("#instruction")).to_have_attribute("data-urgency", "none")
    expect(page.locator("[data-alarm]")).to_have_count(0)
    # What it shows and masks is as before.
    expect(tile).to_have_attribute("data-state", "error")
    expect(tile).to_contain_text("1 in maintenance")
    expect(page.locator("#tile-nav")).to_have_attribute("data-reason", "masked")
    check_sizes(page, "an error that is shelved")

    reads = other_page(page, trouble, server, READER, "/developer/why?node=base%2Fimu")
    expect(reads.locator("#shelved")).to_have_text(told)
    expect(reads.locator("#shelve, #unshelve")).to_have_count(0)
    reads.goto(server.url + "/developer/audit")
    expect(reads.locator("#audit tbody tr").filter(has_text="base/imu for 60 min")).to_contain_text("dora")
    expect(reads.locator("#shelved")).to_have_text(told)
    reads.goto(server.url + "/")
    expect(reads.locator("#causes [data-shelved='base/imu']")).to_be_visible()
    assert [it["node"] for it in Client(server, *READER).snapshot()["shelved"]] == ["base/imu"]

    # While it is fine it is not green either.
    machine.levels["imu"] = 0
    expect(tile).to_have_attribute("data-state", "ok")
    expect(shelved).to_contain_text("itself: OK")
    expect(tile).to_contain_text("1 in maintenance")
    expect(causes.locator(".calm")).to_have_count(0)
    shelved.locator(".open").click()
    row = page.locator("#detail-base [data-module='base/imu']")
    expect(row.locator(".state")).to_have_text("In maintenance")
    expect(row).to_contain_text("itself: OK")
    page.keyboard.press("Escape")
    page.locator("[data-tool=language]").click()
    expect(shelved).to_contain_text("In Wartung bis")
    check_sizes(page, "an OK that is shelved")
    expect(dev.locator("#modules tr[data-module='base/imu']")).to_have_count(0)
    dev.goto(server.url + "/developer")
    expect(dev.locator("#modules tr[data-module='base/imu'] .shelved")).to_have_text("Shelved")

    # It ends by a click; what still fails calls anew.
    machine.levels["imu"] = 2
    expect(shelved).to_contain_text("selbst: Fehler")
    dev.goto(server.url + "/developer/why?node=base%2Fimu")
    dev.locator("#unshelve button").click()
    expect(causes.locator("[data-node='base/imu'] button[name=acknowledge]")).to_be_visible()
    expect(causes).not_to_have_attribute("data-alarms", "")
    expect(dev.locator("#shelved")).to_have_count(0)

    # It ends as soon as the machine moves, and nothing is shelved meanwhile.
    dev.locator("#shelve button").click()
    expect(shelved).to_be_visible()
    machine.mps = 1.0
    expect(causes.locator("[data-node='base/imu'] button[name=acknowledge]")).to_be_visible()
    dev.locator("#shelve button").click()
    expect(dev.locator("body")).to_contain_text("Nothing is shelved while it may move.")
    trouble.expect("409")
