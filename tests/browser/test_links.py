"""Links between the developer's pages load no document, and behave as if they did."""

import contextlib
import re
import signal

import pytest
from playwright.sync_api import Error, expect

from accessible import violations
from operating import enter
from test_developer import CAUSE, DEVELOPER, STATUS, prepare, row, visit
from one_server import server, vehicle  # noqa: F401
from vehicle import until

MARK = "() => { window.kept = true }"
IS_KEPT = "() => window.kept === true"
# A form of another page of this server, with a difference that nobody was shown.
POST = """() => {
  const form = Object.assign(document.createElement('form'), { method: 'post', action: '/developer/configuration/reload' });
  document.body.append(form);
  form.submit();
}"""


# These tests change nothing that lasts, so one server and one vehicle serve them all.


@pytest.fixture(scope="module")
def operator(server, vehicle):
    return prepare(server)


@pytest.fixture
def developer(server, vehicle, operator, page):
    """A page of a developer's, with a session of its own, of a vehicle that stands well."""
    vehicle.set(STATUS, 0)
    until(lambda: operator.snapshot()["overall"] == "ok", 20, operator.snapshot)
    enter(page, server, *DEVELOPER)
    return page


def at(page, path, heading):
    """The page stands there as after a load, without one."""
    page.wait_for_url(lambda url: re.sub(r"^\w+://[^/]+", "", url) == path)
    expect(page.locator("main h2")).to_have_text(heading)
    expect(page).to_have_title(f"{heading} - Telltale")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    assert page.evaluate(IS_KEPT), "a document was loaded"


def current(page):
    return page.locator("nav [aria-current=page]").all_text_contents()


def scrolled(page):
    return page.evaluate("() => scrollY")


def test_a_link_brings_the_other_page_and_the_history_leads_back_and_forward(server, vehicle, developer, trouble):
    page = developer
    page.set_viewport_size({"width": 1280, "height": 400})
    visit(page, server, "/developer?level=ok")
    page.evaluate(MARK)
    page.mouse.wheel(0, 300)
    until(lambda: scrolled(page) == 300, 20, lambda: scrolled(page))
    page.get_by_role("link", name="Graph", exact=True).click()
    at(page, "/developer/graph", "Graph")
    assert current(page) == ["Graph"] and scrolled(page) == 0
    # A screen reader hears the new page's name, and goes on from its beginning.
    expect(page.locator("main h2")).to_be_focused()
    page.keyboard.press("Tab")
    expect(page.locator("[data-zoom=in]")).to_be_focused()
    assert not violations(page)
    page.locator("#graph [data-open]").first.focus()
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/developer/why"))
    expect(page.locator("#why")).to_be_visible()
    assert current(page) == ["Statuses"]
    page.go_back()
    at(page, "/developer/graph", "Graph")
    expect(page.locator("#graph")).to_be_visible()
    page.go_back()
    at(page, "/developer?level=ok", "Statuses")
    until(lambda: scrolled(page) == 300, 20, lambda: scrolled(page))
    expect(page.locator("select[name=level]")).to_have_value("ok")
    page.go_forward()
    at(page, "/developer/graph", "Graph")
    assert scrolled(page) == 0
    page.reload()
    expect(page.locator("#graph")).to_be_visible()
    assert not page.evaluate(IS_KEPT)
    # The earlier entries belong to a document that is gone.
    page.go_back()
    expect(page.locator("main h2")).to_have_text("Statuses")
    expect(page.locator("select[name=level]")).to_have_value("ok")
    until(lambda: scrolled(page) == 300, 20, lambda: scrolled(page))


def test_what_stands_around_a_page_is_loaded_anew_where_it_is_another(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer")
    page.evaluate(MARK)
    # As another tab does.
    page.context.add_cookies([{"name": "lang", "value": "de", "url": server.url}])
    page.get_by_role("link", name="Coverage", exact=True).click()
    page.wait_for_url(server.url + "/developer/coverage")
    expect(page.locator("nav [aria-current]")).to_have_text("Abdeckung")
    assert not page.evaluate(IS_KEPT)


def test_steps_within_a_page_and_between_pages_are_steps_of_one_history(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer/why?node=localization")
    page.evaluate(MARK)
    page.locator(".members [data-open]").first.click()
    page.wait_for_url(re.compile("localization%2F"))
    expect(page.locator("main h2")).not_to_have_text("Why: localization")
    page.get_by_role("link", name="Statuses", exact=True).click()
    at(page, "/developer", "Statuses")
    page.locator("#filter").fill("odometry")
    expect(page.locator("#matching")).to_have_text("1")
    page.locator("#modules [data-pin]").click()
    expect(page.locator(".pinned tr")).to_have_count(1)
    page.get_by_role("link", name="Coverage", exact=True).click()
    at(page, "/developer/coverage", "Coverage")
    page.go_back()
    at(page, "/developer?q=odometry&pin=localization%2Fodometry", "Statuses")
    expect(page.locator("#filter")).to_have_value("odometry")
    expect(page.locator(".pinned tr")).to_have_count(1)
    page.go_back()
    expect(page.locator(".pinned tr")).to_have_count(0)
    expect(page.locator("#filter")).to_have_value("odometry")
    page.go_back()
    page.go_back()
    at(page, "/developer/why?node=localization", "Why: localization")
    # A link to the current page leads to its beginning.
    page.get_by_role("link", name="Statuses", exact=True).click()
    at(page, "/developer", "Statuses")
    page.locator("#filter").fill("odometry")
    expect(page.locator("#matching")).to_have_text("1")
    page.get_by_role("link", name="Statuses", exact=True).click()
    at(page, "/developer", "Statuses")
    expect(page.locator("#filter")).to_have_value("")


def test_what_a_page_has_of_its_own_works_after_it_came_by_a_link(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer/coverage")
    page.evaluate(MARK)
    page.keyboard.press("2")
    at(page, "/developer/graph", "Graph")
    width = lambda: page.locator("#graph").bounding_box()["width"]
    fitted = width()
    page.keyboard.press("+")
    assert width() > fitted
    page.keyboard.press("0")
    assert abs(width() - fitted) < 1
    page.locator("#picture").hover()
    page.mouse.wheel(0, -100)
    until(lambda: width() > fitted, 20, width)
    page.locator(".toggle").first.click()
    page.wait_for_url(re.compile("open="))
    page.keyboard.press("3")
    at(page, "/developer/timeline", "Timeline")
    lane = page.locator('.lane[data-node="sensors"]')
    expect(lane.locator(".bar-ok").first).to_be_attached()
    vehicle.set(STATUS, 2, "no packets")
    expect(lane.locator(".chip")).to_have_text("Error")
    page.locator("[data-moment]").fill("1")
    expect(page.locator(".past")).to_be_visible()
    page.get_by_role("link", name="Live", exact=True).click()
    expect(page.locator(".past")).to_have_count(0)
    page.locator("[data-add] input[name=node]").fill(CAUSE)
    page.keyboard.press("Enter")
    expect(page.locator(f'.lane[data-node="{CAUSE}"]')).to_be_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("1")
    at(page, "/developer", "Statuses")
    page.keyboard.press("f")
    page.keyboard.type("velodyne")
    expect(page.locator("#matching")).to_have_text("1")
    expect(row(page, CAUSE)).to_have_attribute("data-state", "error")
    vehicle.set(STATUS, 0)
    expect(row(page, CAUSE)).to_have_attribute("data-state", "ok")
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    page.keyboard.press("Escape")
    page.locator("[data-tool=language]").click()
    expect(page.locator("html")).to_have_attribute("lang", "de")
    expect(page.locator("#filter")).to_have_value("velodyne")


def test_who_is_no_longer_logged_in_is_led_to_the_login(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer")
    cookies = page.context.cookies()
    # A tab whose session has ended, while its socket is still open.
    page.context.clear_cookies()
    # If a busy machine has made it late, the page opens another socket, and is led there without the click.
    with contextlib.suppress(Error):
        page.evaluate("() => document.querySelector('nav [href=\"/developer/graph\"]')?.click()")
    page.wait_for_url(server.url + "/login")
    page.context.add_cookies(cookies)
    visit(page, server, "/developer")
    page.get_by_role("link", name="Graph", exact=True).click()
    page.wait_for_url(server.url + "/developer/graph")
    # Another tab logs out.
    page.context.request.post(server.url + "/logout", headers={"Origin": server.url})
    page.wait_for_url(server.url + "/login")
    trouble.expect("WebSocket")


def test_a_page_that_cannot_be_brought_is_left_to_the_browser(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer")
    page.evaluate(MARK)
    # A node that another configuration does not have. At once: news of the page mend the address.
    page.evaluate(
        """() => {
          const link = document.querySelector("#modules [data-open]");
          link.setAttribute("href", "/developer/why?node=gone");
          link.click();
        }"""
    )
    expect(page.locator("body")).to_contain_text("nothing at this address")
    page.go_back()
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    # A server that hangs: the current page says so, and the other page comes when it can.
    page.evaluate(MARK)
    server.send(signal.SIGSTOP)
    page.get_by_role("link", name="Masking", exact=True).click()
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    assert page.url.endswith("/developer")
    server.send(signal.SIGCONT)
    at(page, "/developer/masking", "Masking")
    trouble.expect("WebSocket", "404")


def test_what_a_form_answered_is_not_sent_again_by_the_history(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer/configuration")
    posted = []
    page.on("request", lambda request: request.method == "POST" and posted.append(request.url))
    page.evaluate(POST)
    expect(page.locator("#other")).to_be_visible()
    page.evaluate(MARK)
    page.locator("#running [data-go=next]").click()
    expect(page.locator("#running li").first).not_to_have_attribute("value", "1")
    page.get_by_role("link", name="Graph", exact=True).click()
    at(page, "/developer/graph", "Graph")
    page.go_back()
    expect(page.locator("main h2")).to_have_text("Configuration")
    page.go_back()
    at(page, "/developer/configuration", "Configuration")
    page.reload()
    expect(page.locator("#running li").first).to_have_attribute("value", "1")
    assert len(posted) == 1, posted
    trouble.expect("409")


def test_without_scripts_links_are_links(server, vehicle, developer, chromium, trouble):
    context = chromium.new_context(java_script_enabled=False)
    context.add_cookies(developer.context.cookies())
    page = context.new_page()
    page.goto(server.url + "/developer")
    for name, path in (("Graph", "/developer/graph"), ("Timeline", "/developer/timeline"), ("Statuses", "/developer")):
        page.get_by_role("link", name=name, exact=True).click()
        page.wait_for_url(server.url + path)
        assert current(page) == [name]
    context.close()


def test_the_statistics_stand_beside_the_incidents(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/incidents")
    page.evaluate(MARK)
    page.locator("#tabs").get_by_role("link", name="Statistics").click()
    at(page, "/developer/statistics", "Statistics")
    assert current(page) == ["Incidents"]
    expect(page.locator("#spans .button")).to_have_text(["1 day", "7 days", "30 days", "1 year"])
    expect(page.locator("#statistics h3").first).to_have_text("Statistics: 7 days")
    # Some seconds are recorded, which tell no rate.
    expect(page.locator("#statistics")).not_to_contain_text("an hour")
    page.get_by_role("link", name="30 days").click()
    at(page, "/developer/statistics?days=30", "Statistics")
    page.reload()
    expect(page.locator("#statistics h3").first).to_have_text("Statistics: 30 days")


def test_a_whole_row_and_a_chip_open_what_they_name(server, vehicle, developer, trouble):
    page = developer
    vehicle.set(STATUS, 2, "broken")
    visit(page, server, "/developer")
    page.evaluate(MARK)
    before = page.evaluate("() => history.length")
    row(page, CAUSE).locator("td.message").click()
    at(page, "/developer/why?node=sensors%2Fvelodyne_packet_alive", f"Why: {CAUSE}")
    assert page.evaluate("() => history.length") == before + 1, "it was opened more than once"
    visit(page, server, "/developer/coverage")
    page.locator("#coverage tr[data-group=sensors] th").click()
    page.wait_for_url("**/developer/why?node=sensors")
    # What happened names its nodes, and its moment.
    visit(page, server, "/developer/timeline")
    raised = page.locator("#events tr").filter(has_text=CAUSE).first
    expect(raised.locator("td a").first).to_have_attribute("href", re.compile("^/developer/moment"))
    raised.locator("a.value").click()
    page.wait_for_url("**/developer/why?node=sensors%2Fvelodyne_packet_alive*")


def test_strips_have_a_legend(server, vehicle, developer, trouble):
    page = developer
    for path in ("/developer/timeline", "/developer/why?node=sensors"):
        visit(page, server, path)
        looks = page.locator(".looks > span")
        expect(looks).to_have_count(9)
        for word in ("OK", "Warning", "Error", "Unknown", "because its cause is shown", "does not matter then", "no record"):
            expect(page.locator(".looks")).to_contain_text(word)
        for look in looks.locator("rect.bar").all():
            assert look.bounding_box()["width"] > 20
