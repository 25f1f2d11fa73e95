"""What the instruction asks for while one fault waits for another, and how a second fault looks."""

import re

import pytest
from playwright.sync_api import expect

from operating import acknowledge_all, expect_standing, expect_tile, log_in, tile, touch_context, watch
from sizes import FAULTS, SIZES
from vehicle import CONFIG, OPERATOR, Client, serving, until

JUMP, PATH, BRAKE = "localization: tf_quality", "planning: trajectory", "execution: brake"


def asking(text, status, urgency):
    """A configuration in which the help of this status asks for so much."""
    head, tail = text.split(f"status: '{status}'", 1)
    return f"{head}status: '{status}'" + re.sub(r"(help: {[^}]*?) }", rf"\1, urgency: {urgency} }}", tail, count=1)


@pytest.fixture
def server(tmp_path):
    text = CONFIG.read_text()
    for status, urgency in ((JUMP, "be_ready"), (PATH, "take_over"), (BRAKE, "take_over")):
        text = asking(text, status, urgency)
    config = tmp_path / "urgent.yaml"
    config.write_text(text)
    with serving(tmp_path, config=config) as server:
        yield server


@pytest.fixture
def page(chromium, trouble):
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


def asked(page, urgency):
    return page.locator(f"#instruction[data-urgency={urgency}] strong")


def test_what_waits_asks_for_as_much_as_ever_until_it_is_acknowledged(server, vehicle, driving, trouble):
    page, causes = driving, driving.locator("#causes [data-node]")
    vehicle.set(JUMP, 2, "1.2 m")
    vehicle.set(PATH, 2, "curvature")
    expect_tile(page, "planning", "ignore", "masked")
    expect(asked(page, "take_over")).to_have_text("Take over. Stop.")
    expect(page.locator("#countermeasure")).to_contain_text("Position jumped.")
    expect(causes).to_have_count(1)
    expect(causes).not_to_contain_text("Be ready")
    expect(tile(page, "planning")).to_have_attribute("data-own", "1")
    expect(page.get_by_role("button", name="1 fault of its own")).to_have_count(1)
    tile(page, "planning").tap()
    expect(page.locator("#detail-planning .sum")).to_contain_text("1 fault of its own")
    page.keyboard.press("Escape")
    # What waits has nothing to do any more: nothing got better.
    vehicle.set(PATH, 0)
    expect(tile(page, "planning")).not_to_have_attribute("data-own", re.compile("."))
    expect(asked(page, "take_over")).to_have_text("Take over. Stop.")
    acknowledge_all(page)
    expect(asked(page, "be_ready")).to_have_text("Watch the road. Be ready to stop.")
    # A rise calls anew, though all is acknowledged; what was known before does not.
    vehicle.set(JUMP, 0)
    expect(causes).to_have_count(0)
    vehicle.set(JUMP, 2, "1.2 m")
    expect(asked(page, "be_ready")).to_be_visible()
    expect(causes).to_have_count(1)
    acknowledge_all(page)
    expect(page.locator("#causes")).to_have_attribute("data-alarms", "")
    vehicle.set(PATH, 2, "curvature")
    expect(asked(page, "take_over")).to_be_visible()
    expect(page.locator("#causes")).to_have_attribute("data-alarms", re.compile(r"^\d+$"))


@pytest.mark.parametrize("lang, marked", [("en", "second fault"), ("de", "weitere Störung")])
def test_a_second_fault_stands_first_if_it_is_the_more_urgent_one_and_nothing_is_cut(
    server, vehicle, chromium, trouble, lang, marked
):
    context = touch_context(chromium, lang)
    client = Client(server, *OPERATOR)
    context.add_cookies(client.browser_cookies())
    page = context.new_page()
    watch(page, trouble)
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    vehicle.set(JUMP, 2, "1.2 m")
    vehicle.set(PATH, 2, "curvature")
    page.goto(server.url + "/")
    expect_tile(page, "planning", "ignore", "masked")
    # Longer than a cause explains what follows.
    page.wait_for_timeout(6_000)
    vehicle.set(BRAKE, 2, "no pressure")
    expect_tile(page, "execution", "error")
    causes = page.locator("#causes [data-node]")
    expect(causes).to_have_count(2)
    expect(causes.first).to_have_attribute("data-node", "execution/brake")
    expect(page.locator("#causes [data-second]")).to_have_count(1)
    expect(causes.first.locator(".second")).to_have_text(marked)
    assert [root["second"] for root in client.snapshot()["roots"]] == [False, True]
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for palette in ("day", "night"):
            page.evaluate("palette => document.documentElement.dataset.palette = palette", palette)
            page.wait_for_timeout(300)
            assert page.evaluate(FAULTS) == [], f"{width}x{height} {palette}"
            expect(causes.first.locator(".title")).to_be_visible()
    context.close()
