"""The page of a node: why, its past, its values, its configuration, its neighbours and its incidents."""

import re

from playwright.sync_api import expect

from test_developer import CAUSE, DEVELOPER, STATUS, developer, prepare, visit  # noqa: F401
from accessible import violations
from operating import enter
from vehicle import CONFIG, until


def address(node):
    return f"/developer/why?node={node.replace('/', '%2F')}"


def test_a_node_tells_everything_that_is_known_of_it(server, vehicle, developer, trouble):
    page = developer
    vehicle.drive(True)
    visit(page, server, address(CAUSE))
    # Its values are drawn by uPlot, which no other page loads.
    expect(page.locator("#past .plot[data-plot=n] canvas")).to_be_visible()
    expect(page.locator("#past .plot[data-plot=n] > svg")).to_be_hidden()
    vehicle.set(STATUS, 2, "<b>no packets</b>")
    expect(page.locator("#past .bar-error")).to_be_attached()
    first = page.locator("#transitions tbody tr").first
    expect(first).to_contain_text("<b>no packets</b>")
    expect(first.locator("time")).to_have_text(re.compile(r"^\d\d:\d\d:\d\d\.\d{3}$"))
    expect(page.locator("#values tr", has_text="Hardware")).to_contain_text("vehicle")
    expect(page.locator("#values tr", has_text="Class")).to_be_visible()
    lines = CONFIG.read_text().splitlines()
    line = 1 + next(index for index, text in enumerate(lines) if "- id: velodyne_packet_alive" in text)
    expect(page.locator("#written li[aria-current]")).to_contain_text("velodyne_packet_alive")
    expect(page.locator("#written li[aria-current]")).to_have_attribute("value", str(line))
    # The incident that it causes.
    expect(page.locator("#caused tbody tr")).to_have_count(1)
    # Downwards: what waits for it. The way there and back keeps one frame.
    page.locator("#around [data-here]").wait_for()
    page.locator("#around [data-open]", has_text="Localization").click()
    expect(page.locator("h3.node")).to_contain_text("localization")
    expect(page.locator("#around [data-hot]").first).to_be_attached()
    expect(page.locator("#members")).to_contain_text("localization/odometry")
    # The incident belongs to its cause.
    expect(page.locator("#caused tbody tr")).to_have_count(0)
    page.go_back()
    expect(page.locator("#past .plot[data-plot=n] canvas")).to_be_visible()


def test_the_cursor_tells_the_number_under_it(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, address(CAUSE) + "&span=30")
    plot = page.locator("#past .plot[data-plot=n]")
    # Two samples are two seconds apart.
    until(lambda: len([it for it in plot.get_attribute("data-numbers").split(",") if "1" in it]) > 3, 30, plot.inner_html)
    over = plot.locator(".u-over")
    box = over.bounding_box()
    page.mouse.move(box["x"] + box["width"] - 4, box["y"] + 20)
    expect(plot.locator("output")).to_have_text(re.compile(r"^\d\d:\d\d:\d\d\.\d{3}\s+1$"))
    # An answer of the server leaves it.
    at = page.locator("#dev").get_attribute("data-at")
    expect(page.locator("#dev")).not_to_have_attribute("data-at", at)
    expect(plot.locator("output")).to_have_text(re.compile(r"\s1$"))


def test_a_number_of_a_second_node_is_drawn_into_the_plots(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, address(CAUSE))
    plot = page.locator("#past .plot[data-plot=n]")
    expect(plot.locator("canvas")).to_be_visible()
    field = page.locator("input[name=with]")
    offered = page.locator("#offered option").evaluate_all("all => all.map(it => it.value)")
    other = next(it for it in offered if not it.startswith(f"{CAUSE} "))
    # By the keyboard alone.
    field.focus()
    page.keyboard.type(other)
    page.keyboard.press("Enter")
    expect(plot).to_have_attribute("data-second", re.compile(r"[\d]"))
    expect(plot.locator(".label .second")).to_have_text(other)
    expect(plot.locator("canvas")).to_be_visible()
    assert violations(page, live=True) == ""
    # It stays while the page renews itself, and the cursor tells both numbers.
    at = page.locator("#dev").get_attribute("data-at")
    expect(page.locator("#dev")).not_to_have_attribute("data-at", at)
    expect(plot.locator(".label .second")).to_have_text(other)
    box = plot.locator(".u-over").bounding_box()
    page.mouse.move(box["x"] + box["width"] - 4, box["y"] + 20)
    expect(plot.locator("output")).to_have_text(re.compile(r"\s1\s+\|\s[\d.]+$"))
    # Another span keeps it, and what is typed while its answer is on the way.
    held = []
    page.route("**/why?*span=30*", lambda route: held.append(route), times=1)
    page.locator("[name=span]").select_option("30")
    page.wait_for_url("**span=30*")
    field.fill("")
    until(lambda: page.evaluate("1") and held, 10, str)
    held.pop().continue_()
    until(lambda: page.locator("#past .lanes").evaluate("it => it.dataset.end - it.dataset.start") == 30000, 10, str)
    expect(field).to_be_focused()
    expect(field).to_have_value("")
    expect(plot.locator(".label .second")).to_have_text(other)
    page.get_by_role("button", name="Apply").click()
    expect(plot).not_to_have_attribute("data-second", re.compile("."))
    expect(plot.locator("canvas")).to_be_visible()
    page.goto(server.url + address(CAUSE) + "&with=no%2F%3Cb%3Enode")
    expect(page.locator("#not-drawn")).to_have_text("There is no module with a number called no/<b>node.")
    expect(plot).not_to_have_attribute("data-second", re.compile("."))


def test_the_page_of_a_node_works_without_scripts(server, vehicle, chromium):
    prepare(server)
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB", java_script_enabled=False)
    try:
        page = context.new_page()
        enter(page, server, *DEVELOPER)
        page.goto(server.url + address(CAUSE))
        expect(page.locator("#why")).to_contain_text("It reports: OK")
        expect(page.locator("#values tr", has_text="n").last).to_contain_text("1")
        seen = lambda: page.goto(server.url + address(CAUSE)) and page.locator("#past .plot > svg").count()
        until(seen, 20, lambda: page.locator("#past").inner_html())
        expect(page.locator("#past .plot > svg").first).to_be_visible()
        expect(page.locator("#transitions tbody tr").first).to_be_visible()
        page.locator("[name=span]").select_option("600")
        page.get_by_role("button", name="Apply").click()
        expect(page.locator("h3.node")).to_contain_text(CAUSE)
        assert "span=600" in page.url, page.url
    finally:
        context.close()
