"""The what-if of an incident: a developer edits the configuration and sees what it would have changed."""

import json
import os
import re

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter
from test_developer import CAUSE, DEVELOPER, visit
from test_replay_pages import incident  # noqa: F401
from vehicle import Client

SHOTS = os.environ.get("REPLAY_SHOTS")
LOCALIZATION = "localization/scan_matching"


def shoot(page, server, name):
    """Pictures of the page in both palettes and two sizes, where somebody wants to look at them."""
    for palette in ("day", "night"):
        page.context.add_cookies([{"name": "palette", "value": palette, "url": server.url}])
        page.reload()
        page.wait_for_timeout(500)
        for width, height in ((1280, 800), (1920, 1080)):
            page.set_viewport_size({"width": width, "height": height})
            page.screenshot(path=f"{SHOTS}/what-if-{name}-{palette}-{width}.png", full_page=True)


def test_a_dependency_that_is_removed_shows_the_alarms_that_it_hid(server, vehicle, page, trouble, incident):  # noqa: F811
    number, _ = incident
    enter(page, server, *DEVELOPER)
    visit(page, server, f"/incidents/{number}")
    page.locator("#what-if").click()
    page.wait_for_url(f"**/incidents/{number}/what-if")
    text = page.locator("textarea")
    recorded = text.input_value()
    assert "depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]" in recorded

    # The same configuration first.
    page.locator("button[name=run]").click()
    expect(page.locator("#phase")).to_have_attribute("data-progress", "done")
    expect(page.locator(f"#compared [data-incident='{number}']")).to_have_attribute("data-differs", "false")
    assert violations(page) == ""

    # What is typed stays where it is while the page is renewed.
    new = recorded.replace("depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]", "depends_on: [can/wheel_speed]")
    text.fill(new)
    page.locator("button[name=run]").click()
    page.wait_for_url(f"**/incidents/{number}/what-if")
    row = page.locator(f"#compared [data-incident='{number}']")
    expect(row).to_have_attribute("data-differs", "true")
    expect(page.locator("#phase")).to_have_attribute("data-progress", "done")
    assert text.input_value() == new
    expect(page.locator("#strips [data-node]")).not_to_have_count(0)
    expect(page.locator("#differences")).to_contain_text("depends_on from [sensors/velodyne_packet_alive, can/wheel_speed] to [can/wheel_speed]")
    assert violations(page) == ""
    if SHOTS:
        shoot(page, server, "differs")
    page.reload()
    row.locator(".first a").click()
    page.wait_for_url(re.compile(rf"/replay/{number}\?at=\d+$"))
    expect(page.locator("body")).to_have_attribute("data-live", "replay")
    # A second into it.
    page.goto(f"{server.url}/replay/{number}?at={int(page.url.rpartition('=')[2]) + 1000}")
    screen = page.frame_locator("iframe")
    recorded_tile = screen.locator("#tile-localization")
    expect(recorded_tile).to_have_attribute("data-reason", "masked")
    expect(page.locator("[data-edited]")).to_have_count(0)

    # The same moment by the edited configuration, which every screen says.
    page.locator("#other").click()
    page.wait_for_url(re.compile(rf"/replay/{number}-what-if\?at=\d+$"))
    expect(page.locator("body")).to_have_attribute("data-edited", "Edited configuration")
    expect(page.locator("#edited")).to_be_visible()
    expect(screen.locator("body")).to_have_attribute("data-edited", "Edited configuration")
    expect(screen.locator("body")).to_have_attribute("data-live", "replay")
    # It no longer waits for the sensors, and is well by itself.
    expect(screen.locator("#tile-localization")).not_to_have_attribute("data-reason", "masked")
    expect(screen.locator("#tile-localization")).to_have_attribute("data-state", "ok")
    assert violations(page) == ""
    if SHOTS:
        shoot(page, server, "replay")
    page.get_by_role("link", name="Graph").click()
    expect(screen.locator("body.page-developer")).to_have_attribute("data-edited", "Edited configuration")
    page.locator("#other").click()
    page.wait_for_url(re.compile(rf"/replay/{number}\?at=\d+$"))

    # A mistake leads to its line.
    visit(page, server, f"/incidents/{number}/what-if")
    text.fill(recorded.replace("timeout: 2s", "timeout: soon", 1))
    page.locator("button[name=run]").click()
    expect(page.locator("#phase")).to_have_attribute("data-progress", "wrong")
    # Nothing is shown by a wrong configuration. The page's console would tell of the refusal.
    assert page.context.request.get(f"{server.url}/replay/{number}-what-if").status == 404
    if SHOTS:
        shoot(page, server, "wrong")
    # It stands above the text, and its line is marked.
    wrong = 1 + next(at for at, line in enumerate(text.input_value().split("\n")) if "timeout: soon" in line)
    expect(page.locator(".numbers .wrong")).to_have_text(str(wrong))
    expect(page.locator(".numbers")).to_contain_text(str(len(text.input_value().split("\n"))))
    assert page.locator("#problems").bounding_box()["y"] < text.bounding_box()["y"]
    page.locator("#problems button").first.click()
    number, field = page.locator(".numbers .wrong").bounding_box(), text.bounding_box()
    assert field["y"] < number["y"] < field["y"] + field["height"], "the numbers are where the lines are"
    chosen = page.evaluate("() => { const it = document.activeElement; return it.value.slice(it.selectionStart, it.selectionEnd) }")
    assert "timeout: soon" in chosen
    assert violations(page) == ""


LIMIT = "      - { id: rate, monitor: { frequency: { topic: /mission/active, type: std_msgs/msg/Bool, window: 2s, warning_below: 3, error_below: 1 } } }\n"


def test_a_click_writes_into_the_text_and_the_editor_stays_where_it_was(server, vehicle, page, trouble, incident):  # noqa: F811
    number, _ = incident
    enter(page, server, *DEVELOPER)
    visit(page, server, f"/incidents/{number}/what-if")
    text = page.locator("textarea")
    recorded = text.input_value()
    chip = lambda node, entry: page.locator(f'#by-click [data-node="{node}"] [data-entry="{entry}"]')
    changed = lambda: [int(it) for it in page.locator(".numbers .changed").all_inner_texts()]

    def run():
        page.locator("button[name=run]").click()
        expect(page.locator("#phase")).to_have_attribute("data-progress", "done")

    # A dependency is switched off in the text, its line is marked and can be seen.
    chip("localization", "sensors/velodyne_packet_alive").click()
    line = 1 + next(at for at, it in enumerate(text.input_value().split("\n")) if it == "    depends_on: [can/wheel_speed]")
    assert changed() == [line]
    mark, field = page.locator(".numbers .changed").bounding_box(), text.bounding_box()
    assert field["y"] < mark["y"] < field["y"] + field["height"]
    chip("localization", "can/wheel_speed").click()
    assert text.input_value().split("\n")[line - 1] == "    depends_on: []"
    chip("localization", "can/wheel_speed").click()
    assert violations(page) == ""

    # What is typed above moves the places below.
    text.evaluate("it => it.setSelectionRange(0, 0)")
    text.press("#")
    text.press("Enter")
    chip("localization", "sensors/velodyne_packet_alive").click()
    assert text.input_value() == "#\n" + recorded and changed() == []
    chip("localization", "sensors/velodyne_packet_alive").click()

    # The answer leaves the text, its place and the caret alone.
    text.evaluate("it => { it.setSelectionRange(500, 510); it.scrollTop = 333; it.isTheSame = true }")
    stands = "it => [it.isTheSame, it.scrollTop, it.selectionStart, it.selectionEnd]"
    before = text.evaluate(stands)
    run()
    expect(page.locator(f"#compared [data-incident='{number}']")).to_have_attribute("data-differs", "true")
    expect(page.locator("#differences")).to_contain_text("depends_on from [sensors/velodyne_packet_alive, can/wheel_speed] to [can/wheel_speed]")
    assert text.evaluate(stands) == before and before[0]
    expect(chip("localization", "sensors/velodyne_packet_alive")).to_have_attribute("aria-pressed", "false")

    # What is written over has no place any more; without its text nothing is written.
    text.fill(recorded.replace("    modules:\n", "    modules:\n" + LIMIT, 1))
    expect(chip("localization", "can/wheel_speed")).to_be_disabled()
    run()
    page.reload()
    below = page.locator('#by-click [data-node="sensors/rate"] label', has_text="warning_below").locator("input")
    below.fill("2")
    assert LIMIT.replace("warning_below: 3", "warning_below: 2") in text.input_value()
    expect(below).to_be_focused()
    below.fill("")
    assert "warning_below: 2," in text.input_value(), "nothing is no limit"
    below.fill("0.5")
    page.locator("button[name=run]").click()
    expect(page.locator("#phase")).to_have_attribute("data-progress", "wrong")
    assert "warning_below: 0.5," in text.input_value()


def test_it_works_without_scripts(server, vehicle, chromium, incident):  # noqa: F811
    number, _ = incident
    developer = Client(server, *DEVELOPER)
    context = chromium.new_context(java_script_enabled=False)
    context.add_cookies(developer.browser_cookies())
    page = context.new_page()
    page.goto(f"{server.url}/incidents/{number}/what-if")
    page.locator("button[name=run]").click()
    page.wait_for_url(f"**/incidents/{number}/what-if")
    for _ in range(100):
        progress = page.locator("#phase").get_attribute("data-progress")
        if progress == "done":
            break
        assert progress in ("waiting", "running")
        page.locator("#phase a").click()
    expect(page.locator(f"#compared [data-incident='{number}']")).to_have_attribute("data-differs", "false")
    context.close()
