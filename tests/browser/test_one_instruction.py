"""One instruction at a time, and a list of faults that counts what it has no room for, in every window and both languages."""

import re

import pytest
from playwright.sync_api import expect

from operating import acknowledge_all, expect_standing, expect_tile, log_in, step, touch_context, watch
from sizes import SIZES, SMALL
from vehicle import OPERATOR, Client, until

LIDAR, SENSOR, BUS, BATTERY = "velodyne_packet_alive", "imu: status", "can: bus", "can: battery"

# The entries in sight by component, how many others the list counts, and what is cut or lies under the action bar.
LISTED = """() => {
  const shown = [...document.querySelectorAll("#causes .cause")].filter(it => it.getClientRects().length);
  const bar = document.getElementById("actions").getBoundingClientRect();
  const row = [...document.querySelectorAll("#causes-row button")].filter(it => it.getClientRects().length);
  const isUnder = it => {
    const { left, top, bottom, right } = it.getBoundingClientRect();
    return bottom > bar.top + 1 && right > bar.left && left < bar.right && top < bar.bottom;
  };
  const list = document.getElementById("causes-list");
  const isCut = it => it.getBoundingClientRect().bottom > list.getBoundingClientRect().bottom + 3;
  return {
    components: shown.map(it => it.dataset.node?.split("/")[0] ?? it.dataset.past.split("/")[0]),
    counted: Number(document.querySelector("#causes .more:not([hidden]) .count")?.textContent ?? 0),
    under: [...shown, ...row].filter(isUnder).map(it => it.textContent.trim()),
    cut: [
      ...row.filter(it => it.scrollWidth > it.clientWidth + 1).map(it => it.textContent.trim()),
      ...shown.map(it => it.querySelector(".title")).filter(isCut).map(it => it.textContent),
    ],
  };
}"""


@pytest.fixture(params=["en", "de"])
def shown(request, chromium, trouble, server):
    """An operator's page in each language."""
    context = touch_context(chromium, request.param)
    page = context.new_page()
    watch(page, trouble)
    log_in(page, server)
    yield page
    context.close()


def drive(page, vehicle):
    expect_standing_in_words(page)
    vehicle.drive(True)
    expect(page.locator("body")).to_have_attribute("data-stage", "active")


def expect_standing_in_words(page):
    """`expect_standing` reads English."""
    lang = page.locator("html").get_attribute("lang")
    switch = page.locator("[data-tool=language]")
    if lang != "en":
        switch.tap()
    expect_standing(page)
    if lang != "en":
        switch.tap()
        expect(page.locator("html")).to_have_attribute("lang", lang)


def look(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(LISTED)


def test_each_component_has_a_fault_in_sight_before_another_has_two_and_the_rest_is_counted(vehicle, shown, trouble):
    drive(shown, vehicle)
    for status in (LIDAR, SENSOR, BUS):
        vehicle.set(status, 2, "silent")
    causes = shown.locator("#causes .cause")
    expect(causes).to_have_count(3)
    for width, height in SIZES + SMALL:
        seen = look(shown, width, height)
        assert len(seen["components"]) + seen["counted"] == 3, (width, height, seen)
        assert len(seen["components"]) >= 1 and seen["under"] == [] and seen["cut"] == [], (width, height, seen)
        assert set(seen["components"][:2]) == {"sensors", "can"} or len(seen["components"]) in (1, 3), (width, height, seen)
        told = shown.locator("#instruction[data-urgency] strong")
        expect(told).to_be_visible()
        # No row gives an advice of its own beside it.
        expect(shown.locator("#causes .help:not([data-rest]):visible")).to_have_count(0)


def test_what_is_over_is_acknowledged_by_a_button_that_is_whole(vehicle, shown, trouble):
    drive(shown, vehicle)
    for status in (LIDAR, BUS):
        vehicle.set(status, 2, "silent")
    expect(shown.locator("#causes [data-node]")).to_have_count(2)
    for status in (LIDAR, BUS):
        vehicle.set(status, 0)
    expect(shown.locator("#causes [data-past]")).to_have_count(2)
    expect(shown.locator("#causes [name=acknowledge_over]")).to_have_count(1)
    for width, height in SIZES + SMALL:
        seen = look(shown, width, height)
        assert seen["cut"] == [] and seen["under"] == [], (width, height, seen)
        assert len(seen["components"]) + seen["counted"] == 2, (width, height, seen)


# What lies over the acknowledgements of the entries in sight.
OVER = """() => [...document.querySelectorAll("#causes .tick")].filter(it => it.getClientRects().length).flatMap(it => {
  const { left, top, width, height } = it.getBoundingClientRect();
  const found = [0.2, 0.8].map(at => document.elementFromPoint(left + width / 2, top + at * height));
  return found.filter(over => !it.contains(over)).map(over => over.outerHTML.slice(0, 200));
})"""


def test_a_fault_and_its_acknowledgement_are_whole_beside_the_step_that_lets_the_vehicle_go_on(server, vehicle, shown, trouble):
    drive(shown, vehicle)
    vehicle.set(BATTERY, 1, "18 %")
    vehicle.set(LIDAR, 2, "silent")
    Client(server, *OPERATOR).stop()
    expect(shown.locator("#causes [data-node='sensors/velodyne_packet_alive']")).to_be_visible()
    vehicle.set(LIDAR, 0)
    expect(shown.locator("#causes [data-past]")).to_have_count(1)
    expect(step(shown, "release")).to_be_visible()
    windows = SIZES + [(800, 480)]
    for size in windows:
        seen = look(shown, *size)
        assert seen["components"][0] == "can" and seen["cut"] == [] and seen["under"] == [], (size, seen)
        expect(shown.locator("#causes [data-node='can/battery'] .tick")).to_be_visible()
        # For a moment after a change no button takes a tap.
        until(lambda: shown.evaluate(OVER) == [], 10, lambda: (size, shown.evaluate(OVER)))
    # The question lasts ten seconds.
    step(shown, "release").tap()
    expect(shown.locator("#confirm [name=confirm]")).to_be_visible()
    for size in windows:
        seen = look(shown, *size)
        assert seen["components"][:1] == ["can"] and seen["cut"] == [] and seen["under"] == [], (size, seen)
        expect(shown.locator("#causes [data-node='can/battery'] .title")).to_be_visible()
        for name in ("confirm", "cancel"):
            expect(shown.locator(f"#confirm [name={name}]")).to_be_in_viewport(ratio=0.99)


def test_the_board_stays_where_it_is_when_an_alarm_comes(vehicle, shown, trouble):
    drive(shown, vehicle)
    board = lambda: shown.locator(".board").bounding_box()
    before = {}
    expect(shown.locator("#instruction")).to_be_hidden()
    for size in SIZES + [(800, 480)]:
        look(shown, *size)
        before[size] = board()
    vehicle.set(LIDAR, 2, "silent")
    expect(shown.locator("#instruction[data-urgency=be_ready]")).to_be_visible()
    for size, was in before.items():
        look(shown, *size)
        assert board() == was, (size, was, board())


def test_a_warning_that_was_acknowledged_stays_in_sight_as_seen(vehicle, shown, trouble):
    expect_standing_in_words(shown)
    vehicle.set(BATTERY, 1, "18 %")
    expect_tile(shown, "can", "warning")
    row = shown.locator("#causes [data-node='can/battery']")
    expect(row.locator(".tick")).to_be_visible()
    banner = shown.locator("#instruction")
    expect(banner).to_have_attribute("data-blocked", "")
    colour = "it => getComputedStyle(it).backgroundColor"
    assert banner.evaluate(colour) == shown.locator("#tile-can").evaluate(colour), "as strong as the tile"
    acknowledge_all(shown)
    expect(row.locator(".seen")).to_have_text(re.compile("seen|gesehen"))
    expect(row.locator(".title")).to_be_visible()
    expect(row.locator(".help")).to_have_text(re.compile(r"^(Nothing to do for now\.|Vorerst ist nichts zu tun\.)$"))
    expect(banner).not_to_have_attribute("data-blocked", "")


def test_the_instruction_asks_the_question_of_the_second_step(server, vehicle, shown, trouble):
    drive(shown, vehicle)
    Client(server, *OPERATOR).stop()
    asked = shown.locator(".question strong:visible")
    expect(asked).to_have_count(0)
    step(shown, "release").tap()
    expect(asked).to_have_text(re.compile(r"Start driving\?|Losfahren\?"))
    expect(shown.locator("#instruction")).to_be_hidden()
    expect(shown.locator("#instruction strong")).to_have_count(1)
    shown.keyboard.press("Escape")
    expect(asked).to_have_count(0)
    expect(shown.locator("#instruction strong")).to_be_visible()
