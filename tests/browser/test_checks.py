"""A refused clearance names every check that fails, in the answer and on the page."""

import pytest
from playwright.sync_api import expect

from operating import expect_standing, expect_tile, log_in, step
from sizes import check_sizes
from vehicle import CONFIG, serving

# A request that no vehicle hears.
RULE = """
countermeasures:
  - { request: decelerate, mps2: 1.0, when: { groups: [can], state: error, stages: [standby] } }
"""
LEVELS = {
    "velodyne_packet_alive": 2,
    "camera_front: image_rate": 1,
    "imu: status": 1,
    "gnss: fix": 1,
    "can: battery": 1,
    "mission: server": 1,
    "mission: route": 1,
    "can: wheel_speed": 2,
}
WARNINGS = [
    "Front camera without picture",
    "Motion sensor disturbed",
    "Satellite reception poor",
    "Battery is low",
    "No connection to the control room",
    "Route missing",
]
# Each of the fifteen by what names it in the answer, and what does so on the page.
ANSWERED = {
    "Sensors": "Sensors is in error. Mend the cause first.",
    "CAN": "CAN is in error. Mend the cause first.",
    "Telltale": "Telltale is in error. Mend the cause first.",
    **{name: "Localization, Perception, Prediction: wait for Sensors" for name in ("Localization", "Perception", "Prediction")},
    **{name: f"{name} has a warning. Acknowledge it first." for name in WARNINGS},
    "goal": "No destination is set. Wait for one.",
    "countermeasure": "The vehicle is being slowed down. Release it when the cause is gone.",
    "unheard": "No vehicle hears a request to slow down. Call the control room.",
}
SHOWN = {
    **{name: "Sensors, CAN, Telltale: error" for name in ("Sensors", "CAN", "Telltale")},
    **{name: "Localization, Perception, Prediction: wait for Sensors" for name in ("Localization", "Perception", "Prediction")},
    **{name: f"Acknowledge first: {name}" for name in WARNINGS},
    "goal": "No destination",
    "countermeasure": "The vehicle is still held",
    "unheard": "No vehicle hears a request to slow down. Call the control room.",
}
# On a busy machine the display may be late as well.
LATE = "The display is not up to date. Wait for it, then try again."


@pytest.fixture
def server(tmp_path):
    config = tmp_path / "unheard.yaml"
    config.write_text(CONFIG.read_text() + RULE)
    with serving(tmp_path, config=config) as server:
        yield server


def test_each_of_fifteen_checks_is_named(server, vehicle, page, trouble):
    assert len(ANSWERED) == len(SHOWN) == 15
    log_in(page, server)
    expect_standing(page)
    for name, level in LEVELS.items():
        vehicle.set(name, level, "as the test wants it")
    expect_tile(page, "prediction", "ignore", "masked")
    listed = page.locator("#all-checks li:not(.holds)")
    expect(listed.filter(has_text=SHOWN["unheard"])).to_have_count(1)
    expect(listed.filter(has_text="Route missing")).to_have_count(1)
    assert {it.strip() for it in listed.all_text_contents()} == set(SHOWN.values())
    with page.expect_response("**/vehicle/clearance") as answered:
        step(page, "clearance").click(force=True)
    assert answered.value.status == 409
    assert set(answered.value.json()["refused"]) - {LATE} == set(ANSWERED.values())

    # The bar counts the reasons that have no room in it, and they open by themselves.
    sheet, beyond = page.locator("#sheet-checks"), page.locator("#step .checks li:not(.holds)[data-beyond]")
    expect(sheet).to_be_visible()
    expect(page.locator("#checks-more .count")).to_have_text(str(beyond.count()))
    check_sizes(page, "checks", also=unreadable)
    sheet.locator(".close").click()
    check_sizes(page, "bar")
    trouble.expect("409")


# Entries of the open sheet that no scrolling brings into sight as a whole.
UNREADABLE = """() => [...document.querySelectorAll("#all-checks li")].filter((it) => {
  it.scrollIntoView({ block: "nearest" });
  const { left, right, top, bottom } = it.getBoundingClientRect();
  const corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
  const sheet = document.getElementById("sheet-checks");
  const middle = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
  return !sheet.contains(middle) || corners.some(([x, y]) => x < 0 || y < 0 || x > innerWidth + 1 || y > innerHeight + 1);
}).map((it) => it.textContent.trim()).join("; ")"""


def unreadable(page):
    return page.evaluate(UNREADABLE)
