"""`telltale demo --robot`: a machine that is no shuttle, to somebody who stands beside it."""

import re

import pytest
from playwright.sync_api import expect

from operating import DEMO_OPERATOR, enter, watch
from sizes import check_sizes
from vehicle import Client, Server, own_domain

# The simulation lives in real time.
pytestmark = pytest.mark.timed

TILES = ["lidars", "imu", "base", "localization", "navigation", "battery", "docking"]
# What is said of shuttles alone, on everything that somebody can read.
SHUTTLE = re.compile(
    r"take over|by itself|autonom|driving|drives|clearance|stop\b|shuttle|control room"
    r"|übernehm|selbsttätig|fährt|freigabe|anhalten|leitstelle|losfahren",
    re.IGNORECASE,
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    server = Server(tmp_path_factory.mktemp("robot"), own_domain() + 41, "demo", ["--robot"]).start()
    yield server
    assert server.stop() == 0


def page_in(chromium, trouble, server, lang):
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="de-DE" if lang == "de" else "en-GB")
    context.set_default_timeout(20_000)
    page = context.new_page()
    watch(page, trouble)
    enter(page, server, *DEMO_OPERATOR)
    expect(page.locator("html")).to_have_attribute("lang", lang)
    return page


def neutral(page, what):
    said = page.locator("body").inner_text()
    assert not SHUTTLE.search(said), f"{what}: {SHUTTLE.findall(said)} in {said}"
    for name in ("stop", "release", "clearance", "localize", "shutdown"):
        expect(page.locator(f"button[name={name}]:visible")).to_have_count(0)


@pytest.mark.parametrize("lang, runs", [("en", "Running"), ("de", "In Betrieb")])
def test_a_fault_shows_its_cause_and_who_waits_in_neutral_words(robot, chromium, trouble, lang, runs):
    client = Client(robot, *DEMO_OPERATOR)
    page = page_in(chromium, trouble, robot, lang)
    tile = lambda name: page.locator(f"#tile-{name}")
    try:
        for name in TILES:
            expect(tile(name)).to_have_attribute("data-state", "ok", timeout=30_000)
        expect(page.locator("#top .stage")).to_have_text(runs)
        neutral(page, "all is well")
        client.post("/demo/fault", name="lidar_outage", active="true")
        expect(tile("lidars")).to_have_attribute("data-state", "error")
        for name in ("localization", "navigation"):
            expect(tile(name)).to_have_attribute("data-reason", "masked")
        expect(tile("battery")).to_have_attribute("data-state", "ok")
        expect(page.locator("#causes [data-node]")).to_have_count(1)
        expect(page.locator("#causes [data-node]")).to_have_attribute("data-node", "lidars/front")
        neutral(page, "a fault")
    finally:
        client.post("/demo/fault", name="lidar_outage", active="false")
        expect(tile("lidars")).to_have_attribute("data-state", "ok")
        page.context.close()


def test_the_demo_offers_the_faults_of_the_robot(robot, chromium, trouble):
    page = page_in(chromium, trouble, robot, "de")
    page.goto(robot.url + "/demo")
    expect(page.locator("[data-fault]")).to_have_count(7)
    expect(page.locator("[data-fault=docking_failed]")).to_contain_text("Andocken misslungen")
    check_sizes(page, "the demo's page")
    assert page.locator("header").bounding_box()["height"] < 100, "title and tools stand in one line"
    neutral(page, "the demo's page")
    page.context.close()
