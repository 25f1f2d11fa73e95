"""The page before a login, and the login itself."""

import re

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import touch_context, type_by_touch, watch
from sizes import check_sizes
from vehicle import OPERATOR, Client

AUTHORITY = ("aron", "lantern-48-harbour")


@pytest.mark.parametrize("path", ["audit", "configuration"])
def test_what_tells_no_state_stays_while_the_vehicle_is_locked(server, page, trouble, path):
    server.add_user(*AUTHORITY, role="authority")
    reader = Client(server, *AUTHORITY)
    page.context.add_cookies(reader.browser_cookies())
    loads = []
    page.on("load", lambda _: loads.append(page.url))
    page.goto(f"{server.url}/developer/{path}")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    # It would load itself anew at a heartbeat; these two are a second apart.
    for phase in ("0", "4"):
        page.wait_for_function("phase => document.querySelector('#live .pulse').dataset.phase === phase", arg=phase)
    assert len(loads) == 1, loads
    expect(page.locator("body")).to_have_attribute("data-stage", "locked")
    # Parts of the diagnosis appear with the operator, and disappear.
    page.goto(f"{server.url}/developer")
    expect(page.locator("#dev .empty")).to_contain_text("Locked")
    Client(server, *OPERATOR)
    expect(page.locator("#modules")).to_be_visible()


@pytest.fixture
def display(chromium, trouble):
    context = touch_context(chromium, "de")
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


def test_a_login_without_a_pin_says_so_in_the_pages_words(server, display, trouble):
    page = display
    page.goto(server.url + "/login")
    page.evaluate("() => addEventListener('invalid', () => console.error('a bubble'), true)")
    type_by_touch(page, "anna", "")
    page.locator(".digits [data-key=enter]").tap()
    expect(page.locator(".missing")).to_have_text("PIN oder Passwort fehlt.", use_inner_text=True)
    expect(page.locator(".digits")).to_be_visible()
    # Also in the lowest window all keys are in sight.
    before = page.viewport_size
    page.set_viewport_size({"width": 800, "height": 480})
    for key in [*page.locator(".digits button").all(), page.locator(".primary")]:
        expect(key).to_be_in_viewport(ratio=0.99)
    # What is missing is said once, in words.
    assert page.locator(".missing span:visible").evaluate("it => getComputedStyle(it, '::before').content") == "none"
    # Where there is no room for keys, the button that logs in is.
    page.set_viewport_size({"width": 640, "height": 400})
    expect(page.locator(".primary")).to_be_in_viewport(ratio=0.99)
    page.set_viewport_size(before)
    page.locator("[name=name]").fill("")
    page.locator(".primary").tap()
    expect(page.locator(".missing")).to_have_text("Der Name fehlt.", use_inner_text=True)
    expect(page.locator(".letters")).to_be_visible()
    assert page.url.endswith("/login")


# Every touch of the page, over all pages of this browser.
COUNT_TAPS = """addEventListener('pointerdown', () =>
  localStorage.setItem('taps', 1 + Number(localStorage.getItem('taps') ?? 0)), true)"""


def taps(page):
    # This has a limit of time, also while the page is another one.
    return int(page.wait_for_function("() => localStorage.getItem('taps') ?? '0'").json_value())


def enter_by_touch(page, server, name, secret):
    page.goto(server.url + "/login")
    type_by_touch(page, name, secret)
    page.locator(".digits [data-key=enter]").tap()


def test_a_first_login_takes_few_taps_and_a_hand_over_one_more(server, vehicle, chromium, trouble):
    """Two operators with a new display each, by touch alone."""
    first, second = touch_context(chromium), touch_context(chromium)
    for context in (first, second):
        context.add_init_script(COUNT_TAPS)
    page, other = first.new_page(), second.new_page()
    watch(page, trouble)
    watch(other, trouble)
    live = lambda page: expect(page.locator("body")).to_have_attribute("data-live", "live")
    # One operator alone is chosen already: six digits and Enter.
    enter_by_touch(page, server, *OPERATOR)
    live(page)
    assert taps(page) == 7
    server.add_user("berta", "864213")
    enter_by_touch(other, server, "berta", "864213")
    expect(other.locator(".failure")).to_have_text("anna is the operator. Take their place?")
    expect(other.locator("[name=secret]")).to_have_count(0)
    assert taps(other) == 8
    other.locator(".primary").tap()
    live(other)
    assert taps(other) == 9
    # The first operator takes the vehicle back: what is known is not asked.
    expect(page).to_have_url(re.compile("/login"))
    expect(page.locator(".known button").first).to_have_text("anna")
    before = taps(page)
    type_by_touch(page, *OPERATOR)
    page.locator(".digits [data-key=enter]").tap()
    page.locator(".primary").tap()
    live(page)
    assert taps(page) - before == 8
    trouble.expect("409", "401", "403", "WebSocket")
    first.close()
    second.close()


def test_another_operator_takes_over_at_the_same_display_with_one_pin(server, vehicle, chromium, trouble):
    context = touch_context(chromium)
    context.add_init_script(COUNT_TAPS)
    page = context.new_page()
    watch(page, trouble)
    server.add_user("berta", "864213")
    enter_by_touch(page, server, *OPERATOR)
    live = lambda: expect(page.locator("body")).to_have_attribute("data-live", "live")
    live()
    before = taps(page)
    page.locator("button[name=shutdown]").tap()
    page.get_by_role("link", name="Hand over").tap()
    expect(page.locator(".change")).to_have_text("On duty: anna. Who is next?")
    check_sizes(page, "hand-over")
    assert not violations(page), violations(page)
    # Nobody takes over from themselves: one other operator is chosen already.
    expect(page.locator(".known button")).to_have_text(["berta"])
    page.locator("[name=secret]").fill("999999")
    page.locator(".digits [data-key=enter]").tap()
    expect(page.locator(".failure:visible")).to_have_text("Name or PIN is wrong.")
    expect(page.locator(".change")).to_be_visible()
    type_by_touch(page, "berta", "864213")
    page.locator(".digits [data-key=enter]").tap()
    live()
    expect(page.locator("#top .operator")).to_contain_text("berta")
    # Two to come here, one for the wrong PIN, six digits and Enter.
    assert taps(page) - before == 10
    # The way back changes nothing.
    page.locator("button[name=shutdown]").tap()
    page.get_by_role("link", name="Hand over").tap()
    page.get_by_role("link", name="Back to the vehicle").tap()
    live()
    expect(page.locator("#top .operator")).to_contain_text("berta")
    trouble.expect("401")
    context.close()


def test_from_the_take_over_leads_a_large_button_back(server, vehicle, display, chromium, trouble):
    page = display
    server.add_user("berta", "864213")
    Client(server, *OPERATOR)
    # A browser without a session has no vehicle to go back to.
    enter_by_touch(page, server, "berta", "864213")
    back = page.locator("a.back")
    expect(back).to_have_text("Abbrechen")
    assert back.bounding_box()["height"] >= 88
    back.tap()
    expect(page).to_have_url(server.url + "/login")
    expect(page.locator("[name=secret]")).to_be_visible()
    # At the display of the operator in charge the vehicle is there still.
    context = touch_context(chromium, "de")
    shared = context.new_page()
    watch(shared, trouble)
    shared.goto(server.url + "/login")
    type_by_touch(shared, *OPERATOR)
    waiting = context.new_page()
    waiting.goto(server.url + "/login")
    type_by_touch(waiting, "berta", "864213")
    shared.locator(".digits [data-key=enter]").tap()
    expect(shared.locator("body")).to_have_attribute("data-live", "live")
    waiting.locator(".digits [data-key=enter]").tap()
    back = waiting.locator("a.back")
    expect(back).to_have_text("Zurück zum Fahrzeug")
    back.tap()
    expect(waiting.locator("body")).to_have_attribute("data-live", "live")
    context.close()
    trouble.expect("409", "401", "403")
