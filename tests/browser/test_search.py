"""One search over everything that has a name, on every page of the developer's."""

import re

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter
from test_developer import CAUSE, DEVELOPER, STATUS, developer, prepare, row, visit  # noqa: F401
from vehicle import until


def found(page):
    return page.locator("#search .results [data-open]")


@pytest.mark.parametrize("key", ["/", "Control+k"])
def test_the_keyboard_finds_a_node_from_any_page(server, vehicle, developer, trouble, key):
    page = developer
    visit(page, server, "/developer/coverage")
    page.evaluate("() => { window.kept = true }")
    page.keyboard.press(key)
    page.keyboard.type("packet velo")
    expect(found(page).first).to_have_text(CAUSE)
    assert violations(page) == ""
    page.keyboard.press("Enter")
    expect(page.locator("h3.node")).to_contain_text(CAUSE)
    expect(page.locator("#search")).to_be_hidden()
    assert page.evaluate("() => window.kept"), "a document was loaded"
    # The arrow keys choose another one, and Escape leaves everything as it was.
    page.keyboard.press(key)
    page.locator("#search [name=q]").fill("localization/")
    expect(found(page).nth(2)).to_be_visible()
    for _ in range(2):
        page.keyboard.press("ArrowDown")
    expect(found(page).nth(1)).to_be_focused()
    chosen = found(page).nth(1).text_content()
    page.keyboard.press("Enter")
    expect(page.locator("h3.node")).to_contain_text(chosen)
    page.keyboard.press(key)
    page.keyboard.press("Escape")
    expect(page.locator("h3.node")).to_contain_text(chosen)


def test_messages_topics_nodes_pages_and_incidents_are_found(server, vehicle, developer, trouble):
    page = developer
    vehicle.set(STATUS, 2, "<b>no packets</b> at all")
    visit(page, server, "/developer/search")
    expect(page.locator("main h2")).to_have_text("Search")
    field = page.locator("#filter")
    field.fill("<b>no at all")
    expect(page.locator("#found-nodes [data-open]").first).to_have_text(CAUSE)
    expect(page.locator("#found-nodes .chip").first).to_have_attribute("data-state", "error")
    field.fill("/mission/act")
    expect(page.locator("#found-topics [data-open]")).to_have_attribute("href", "/developer/topics?q=%2Fmission%2Factive")
    field.fill("audit")
    expect(page.locator("#found-pages [data-open]")).to_have_attribute("href", "/developer/audit")
    # An incident is found by its cause and by its number.
    field.fill(STATUS)
    until(lambda: page.reload() and page.locator("#found-incidents [data-open]").count(), 30, page.content)
    incident = page.locator("#found-incidents [data-open]").first.get_attribute("href")
    expect(page.locator("#found-incidents [data-open]").first).to_contain_text("LiDAR data missing (Sensors)")
    field.fill(incident.rsplit("/", 1)[1])
    expect(page.locator(f"#found-incidents [href='{incident}']")).to_be_visible()
    # And by what is said of it: with its number, as its fault is called, with its message.
    for words in [f"incident {incident.rsplit('/', 1)[1]}", "no packets</b>"]:
        field.fill(words)
        expect(page.locator(f"#found-incidents [href='{incident}']")).to_be_visible()
    page.locator(f"#found-incidents [href='{incident}']").click()
    page.wait_for_url(f"**{incident}")
    visit(page, server, "/developer/search?q=nothing-has-this-name")
    expect(page.locator(".found .empty")).to_be_visible()


def test_the_next_row_is_opened_and_not_pinned(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer?q=velodyne")
    row(page, CAUSE).wait_for()
    page.keyboard.press("j")
    expect(page.locator("#all [data-open]").first).to_be_focused()
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/developer/why"))
    expect(page.locator("#why")).to_be_visible()


def test_the_search_works_without_scripts(server, vehicle, chromium):
    prepare(server)
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB", java_script_enabled=False)
    try:
        page = context.new_page()
        enter(page, server, *DEVELOPER)
        page.goto(server.url + "/developer")
        page.locator("[data-search]").click()
        page.locator("#filter").fill("velodyne")
        page.locator("main button", has_text="Search").click()
        page.locator("#found-nodes [data-open]", has_text=CAUSE).first.click()
        expect(page.locator("#why")).to_be_visible()
    finally:
        context.close()
