"""The operator's page over real DDS: the vehicle and its faults."""

import re

import pytest
from playwright.sync_api import expect

from operating import TILES, expect_standing, expect_tile, log_in, tile
from vehicle import until

BEHIND_SENSORS = ["localization", "perception", "prediction", "planning", "execution"]
CAUSE = "sensors/velodyne_packet_alive"


def test_nothing_of_the_vehicle_is_shown_before_the_login(server, vehicle, page, trouble):
    page.goto(server.url + "/")
    page.wait_for_url(server.url + "/login*")
    words = page.content().lower()
    for name in TILES:
        if name != "can":
            assert name not in words, f"{name} on the login page"
    log_in(page, server, secret="864209")
    expect(page.locator("body")).not_to_have_attribute("data-live", "live")
    assert page.url.startswith(server.url + "/login")
    trouble.expect("401", "403")


def test_a_fault_over_dds_turns_its_tile_red_and_what_waits_for_it_grey(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    expect(page.locator("#causes [data-node]")).to_have_count(0)

    vehicle.drive(True)
    expect(page.locator("body")).to_have_attribute("data-stage", "active")
    for name in TILES:
        expect_tile(page, name, "ok")
    # Its configuration names no speed: nothing is said of driving.
    expect(page.locator("#motion[data-moving=unknown]")).to_have_text("No speed signal")

    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    expect_tile(page, "sensors", "error")
    expect(tile(page, "sensors")).to_contain_text("Error")
    for name in BEHIND_SENSORS:
        expect_tile(page, name, "ignore", "masked")
        expect(tile(page, name)).to_contain_text("Waiting for")
        expect(tile(page, name)).not_to_contain_text("Not active")
    for name in ("can", "mission"):
        expect_tile(page, name, "ok")
    causes = page.locator("#causes [data-node]")
    expect(causes).to_have_count(1)
    expect(causes).to_have_attribute("data-node", CAUSE)
    expect(causes).to_contain_text("LiDAR data missing")
    expect(page.locator("#instruction[data-urgency=be_ready] strong")).to_have_text("Stop. Call the control room.")

    vehicle.set("velodyne_packet_alive", 0)
    for name in TILES:
        expect_tile(page, name, "ok")
    expect(causes).to_have_count(0)
    vehicle.drive(False)
    expect_standing(page)


def test_the_path_from_the_cause_to_what_it_masks_is_drawn(server, vehicle, page, trouble):
    log_in(page, server)
    vehicle.drive(True)
    expect_tile(page, "execution", "ok")
    drawn = page.locator(".arrow[data-hot]")
    expect(drawn).to_have_count(0)
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    expect_tile(page, "execution", "ignore", "masked")
    way = lambda arrow: (arrow.get_attribute("data-from"), arrow.get_attribute("data-to"))
    ways = lambda: {way(arrow) for arrow in drawn.all()}
    until(lambda: reaches(ways(), "sensors") == set(BEHIND_SENSORS), 20, lambda: f"the path is {ways()}")
    tile(page, "execution").click()
    chain = page.locator("#detail-execution .why")
    expect(chain.locator(".step").last).to_have_text("Execution")
    chain.get_by_role("button", name="Sensors").click()
    expect(page.locator(f"#detail-sensors [data-module='{CAUSE}']")).to_be_visible()
    page.locator("#panel-sensors .close").click()
    for arrow in drawn.all():
        box = arrow.bounding_box()
        assert box and box["width"] + box["height"] > 10, f"{way(arrow)} cannot be seen: {box}"


def reaches(ways, start):
    """Where one gets along the arrows."""
    found, ends = set(), {start}
    while ends:
        ends = {end for begin, end in ways if begin in ends} - found
        found |= ends
    return found


@pytest.mark.parametrize("level, state, word", [(1, "warning", "Warning"), (3, "unknown", "Unknown")])
def test_a_warning_and_the_unknown_mask_nothing(server, vehicle, page, trouble, level, state, word):
    log_in(page, server)
    expect_standing(page)
    vehicle.set("localization: tf_quality", level, "not sure")
    expect_tile(page, "localization", state)
    expect(tile(page, "localization")).to_contain_text(word)
    for name in ("perception", "prediction"):
        expect_tile(page, name, "ok")


def test_a_status_that_stops_coming_is_unknown_never_ok(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    del vehicle.statuses["mission: server"]
    expect_tile(page, "mission", "unknown")


# Closed panels are not updated bit by bit; what the server said of that of the sensors is noted.
LATE_PANELS = """() => {
  const { receive } = HiddenPanels.prototype;
  window.heard = [];
  HiddenPanels.prototype.updateNext = () => {};
  HiddenPanels.prototype.receive = function (message) {
    receive.call(this, message);
    window.heard.push(message.behind?.["detail-sensors"] ?? "");
  };
}"""


def test_what_stands_behind_a_tile_is_of_now_when_it_opens(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    row = page.locator(f"#detail-sensors [data-module='{CAUSE}']")
    # A closed panel is not updated at once.
    page.evaluate(LATE_PANELS)
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    expect_tile(page, "sensors", "error")
    page.wait_for_function("() => window.heard.some(it => it.includes('Only 2.0 scans per second'))")
    expect(row).to_have_attribute("data-state", "ok")
    page.evaluate(
        "() => document.addEventListener('beforetoggle', ({ target }) =>"
        " void (window.opened = target.textContent), { once: true, capture: true })"
    )
    tile(page, "sensors").click()
    assert "Only 2.0 scans per second" in page.evaluate("() => window.opened")
    expect(row).to_be_visible()
    # While it is open it is updated.
    vehicle.set("velodyne_packet_alive", 1, "Only 8.0 scans per second")
    expect(row).to_contain_text("Only 8.0 scans per second")
    expect(row.locator("time")).to_have_text(re.compile(r"^\d+ s$"))
    vehicle.set("velodyne_packet_alive", 0)
    expect(row).to_have_attribute("data-state", "ok")


def test_hostile_words_from_the_vehicle_are_shown_as_words(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    hostile = "<img src=x onerror=alert(1)>\u202e</script>"
    vehicle.set("velodyne_packet_alive", 2, hostile)
    expect_tile(page, "sensors", "error")
    assert page.locator("img[src=x]").count() == 0
    assert "\u202e" not in page.locator("body").inner_text()
