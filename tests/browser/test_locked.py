"""The page before a login, and the login itself."""

import re

import pytest
from playwright.sync_api import expect

from operating import touch_context, type_by_touch, watch
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
        expect(page.locator("#live .pulse")).to_have_attribute("data-phase", phase)
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
    page.locator("[name=name]").fill("")
    page.locator(".primary").tap()
    expect(page.locator(".missing")).to_have_text("Der Name fehlt.", use_inner_text=True)
    expect(page.locator(".letters")).to_be_visible()
    assert page.url.endswith("/login")


def test_from_the_take_over_leads_a_large_button_back(server, vehicle, display, trouble):
    page = display
    server.add_user("berta", "864213")
    Client(server, *OPERATOR)
    page.goto(server.url + "/login")
    type_by_touch(page, "berta", "864213")
    page.locator(".digits [data-key=enter]").tap()
    back = page.locator("a.back")
    expect(back).to_have_text("Zurück zum Fahrzeug")
    assert back.bounding_box()["height"] >= 88
    # The operator's name stays visible beside the missing parts.
    page.locator(".digits [data-key=enter]").tap()
    expect(page.locator(".missing")).to_have_text("PIN oder Passwort fehlt.", use_inner_text=True)
    expect(page.locator(".failure").filter(has_text="anna begleitet die Fahrt.")).to_be_visible()
    expect(back).to_have_attribute("href", "/")
    back.tap()
    expect(page).to_have_url(re.compile("/login|/$"))
    trouble.expect("409", "403")
