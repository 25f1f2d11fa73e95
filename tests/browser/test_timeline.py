"""The timeline under a pointer and from the keyboard: crosshair, zoom, moment; all of it stands in the address."""

import re
from datetime import datetime, timezone
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import expect

from accessible import violations
from test_developer import CAUSE, STATUS, developer, visit  # noqa: F401
from vehicle import until


def asked(page):
    return {name: values[0] for name, values in parse_qs(urlsplit(page.url).query).items()}


def strip(page, node="sensors"):
    return page.locator(f'.lane[data-node="{node}"] > svg').bounding_box()


def put(page, share, node="sensors"):
    box = strip(page, node)
    page.mouse.move(box["x"] + box["width"] * share, box["y"] + 8)


@pytest.fixture
def timeline(server, vehicle, developer):
    """A timeline whose newest seconds show a fault."""
    page = developer
    visit(page, server, "/developer/timeline?span=30")
    vehicle.set(STATUS, 2, "no packets")
    lane = page.locator('.lane[data-node="sensors"]')
    expect(lane.locator(".bar-error")).to_be_attached()
    # Wide enough to be pointed at.
    until(lambda: (lane.locator(".bar-error").last.bounding_box() or {"width": 0})["width"] > 20, 20, lane.inner_html)
    return page


def test_a_crosshair_tells_the_time_and_each_state(timeline, trouble):
    page = timeline
    put(page, 0.995)
    expect(page.locator(".cross output")).to_have_text(re.compile(r"^\d\d:\d\d:\d\d\.\d{3}$"))
    under = page.locator('.lane[data-node="sensors"] .under')
    expect(under.locator(".chip")).to_have_text("Error")
    expect(under.locator(".chip")).to_have_attribute("data-state", "error")
    expect(page.locator('.lane[data-level="stage"] .under .chip')).to_have_text("Ready")
    # It stays while the page goes on under it.
    to = page.locator("#timeline").get_attribute("data-to")
    expect(page.locator("#timeline")).not_to_have_attribute("data-to", to)
    expect(under).to_be_visible()
    assert violations(page) == ""
    page.mouse.move(5, 5)
    expect(page.locator(".cross")).to_be_hidden()
    expect(under).to_be_hidden()


def test_dragging_chooses_a_span_and_back_leaves_it(timeline, trouble):
    page = timeline
    box = strip(page)
    from_ms, to_ms = (int(page.locator("#timeline").get_attribute(f"data-{end}")) for end in ("from", "to"))
    put(page, 0.5)
    page.mouse.down()
    put(page, 0.75)
    expect(page.locator(".selected")).to_be_visible()
    put(page, 0.8)
    page.mouse.up()
    expect(page.locator(".past")).to_be_visible()
    expect(page.locator(".selected")).to_be_hidden()
    span, until_ms = int(asked(page)["span"]), int(asked(page)["until"])
    # A third of thirty seconds; the page went on while the mouse moved.
    assert 9 <= span <= 11, page.url
    assert from_ms < until_ms < to_ms + 20_000, (from_ms, until_ms, to_ms, box)
    expect(page.locator("#timeline")).to_have_attribute("data-to", str(until_ms))
    page.go_back()
    expect(page.locator(".past")).to_have_count(0)
    assert asked(page) == {"span": "30"}


def test_the_wheel_zooms_where_it_points_and_stays_live_at_the_right(timeline, trouble):
    page = timeline
    put(page, 0.999)
    page.mouse.wheel(0, -100)
    page.wait_for_url(re.compile("span=2[45]"))
    assert "until" not in asked(page), page.url
    expect(page.locator("[name=span] option:checked")).to_have_text(re.compile("2[45] s"))
    put(page, 0.3)
    page.mouse.wheel(0, 100)
    expect(page.locator("[name=span] option:checked")).to_have_text(re.compile("3[012] s"))
    page.keyboard.press("0")
    page.wait_for_url(lambda url: not urlsplit(url).query)
    expect(page.locator("select[name=span]")).to_have_value("120")


def test_keys_and_links_do_what_the_pointer_does(timeline, trouble):
    page = timeline
    page.keyboard.press("+")
    shows = lambda seconds: expect(page.locator("[name=span] option:checked")).to_have_text(f"{seconds} s")
    expect(page.locator("#timeline [data-zoom=out]")).to_have_attribute("href", "?span=30")
    shows(15)
    page.keyboard.press("-")
    expect(page.locator("#timeline [data-zoom=out]")).to_have_attribute("href", "?span=60")
    shows(30)
    # A click and the arrow keys choose the moment.
    put(page, 0.995)
    page.mouse.down()
    page.mouse.up()
    page.wait_for_url(re.compile(r"\bat=\d+"))
    expect(page.locator('.lane[data-node="sensors"] .then .chip')).to_have_text("Error")
    at = int(asked(page)["at"])
    step = 300
    page.keyboard.press("ArrowLeft")
    page.wait_for_url(re.compile(f"at={at - step}"))
    page.keyboard.press("Shift+ArrowRight")
    at -= step - step // 10
    page.wait_for_url(re.compile(f"at={at}"))
    moment = page.locator("#timeline .pager time")
    expect(moment).to_have_text(re.compile(r"\d\d:\d\d:\d\d\.\d{3}$"))
    # The moment stays in any other span: in a shorter one, by dragging, by the wheel, in an earlier one.
    # The address changes before the page does.
    shown = datetime.fromtimestamp(at / 1000, timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    expect(moment).to_have_attribute("datetime", shown)
    page.keyboard.press("+")
    page.wait_for_url(re.compile("span=15"))
    shows(15)
    put(page, 0.5)
    page.mouse.wheel(0, 100)
    page.wait_for_url(re.compile(r"span=(18|19|20)\b"))
    put(page, 0.1)
    page.mouse.down()
    put(page, 0.3)
    put(page, 0.4)
    page.mouse.up()
    page.wait_for_url(re.compile(r"span=[67]\b"))
    expect(page.locator('.lane[data-node="sensors"] .then .chip')).to_have_text("not shown")
    expect(page.locator("line.moment")).to_have_count(0)
    assert asked(page)["at"] == str(at) and moment.get_attribute("datetime") == shown
    page.get_by_role("link", name="Show the moment").click()
    expect(page.locator("line.moment").first).to_be_attached()
    expect(page.locator('.lane[data-node="sensors"] .then .chip')).to_have_text("Error")
    assert asked(page)["at"] == str(at) and moment.get_attribute("datetime") == shown
    page.get_by_role("link", name="Live", exact=True).click()
    expect(page.locator(".past")).to_have_count(0)


def test_a_click_sets_the_moment_of_all_pages(timeline, trouble):
    page = timeline
    put(page, 0.995)
    page.mouse.down()
    page.mouse.up()
    page.wait_for_url(re.compile(r"\bat=\d+"))
    expect(page.locator("#timeline")).to_have_attribute("data-chosen", asked(page)["at"])
    at = int(asked(page)["at"])
    # Links lead there however they are opened, those of the search too.
    graph = page.locator("nav").get_by_role("link", name="Graph")
    expect(graph).to_have_attribute("href", f"/developer/moment?at={at}&screen=%2Fdeveloper%2Fgraph")
    with page.context.expect_page() as opened:
        graph.click(modifiers=["Control"])
    opened.value.wait_for_url(f"**/replay/recent?at={at}&screen=*")
    opened.value.close()
    page.keyboard.press("Control+k")
    page.keyboard.type("velodyne")
    found = page.locator("dialog#search [data-open]").first
    expect(found).to_contain_text("velodyne")
    found.hover()
    page.mouse.down()
    expect(found).to_have_attribute("href", re.compile(rf"/developer/moment\?at={at}&screen=%2Fdeveloper%2Fwhy"))
    page.mouse.move(0, 0)
    page.mouse.up()
    page.keyboard.press("Escape")
    expect(page.locator("dialog#search")).to_be_hidden()
    # Back in the present they lead to the live pages.
    page.get_by_role("link", name="Live", exact=True).click()
    expect(graph).to_have_attribute("href", "/developer/graph")
    page.go_back()
    page.wait_for_url(re.compile(rf"\bat={at}"))
    graph.click()
    page.wait_for_url(f"**/replay/recent?at={at}&screen=*")
    screen = page.frame_locator("iframe[name=screen]")
    expect(screen.locator("#graph")).to_be_visible()
    # In the replay the moment is the replay's.
    page.get_by_role("link", name="Timeline").click()
    lane = screen.locator('.lane[data-node="sensors"]')
    expect(lane.locator(".then .chip")).to_have_text("Error")
    well = lane.locator(".bar-ok").last.bounding_box()
    page.mouse.click(well["x"] + well["width"] / 2, well["y"] + 8)
    expect(lane.locator(".then .chip")).to_have_text("OK")
    shown = page.locator("input[name=at]")
    until(lambda: int(shown.input_value()) < at, 20, shown.input_value)
    page.get_by_role("link", name="Operator").click()
    expect(screen.locator("#tile-sensors")).to_have_attribute("data-state", "ok")
    page.locator("#leave").click()
    page.wait_for_url("**/developer")


def test_the_strip_of_a_node_has_the_same_crosshair_and_zoom(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, f"/developer/why?node={CAUSE.replace('/', '%2F')}&span=30")
    expect(page.locator("#past .chart canvas")).to_be_visible()
    box = page.locator("#past .lane[data-node] > svg").bounding_box()
    page.mouse.move(box["x"] + box["width"] - 2, box["y"] + 8)
    expect(page.locator("#past .under .chip")).to_have_text("OK")
    expect(page.locator("#past .plot output")).to_have_text(re.compile(r"\d\.\d{3}\s+1$"))
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + 8, steps=3)
    page.mouse.up()
    page.wait_for_url(re.compile("until=|span=1[56]"))
    expect(page.locator("h3.node")).to_contain_text(CAUSE)
