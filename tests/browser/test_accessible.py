"""axe-core finds no violation on any page: the developer's, the authority's, the login in all its states,
the panels over the operator's page, and error pages."""

import re
import shutil

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import DEMO_OPERATOR, ask_for_clearance, enter, localize, log_in, log_in_by_touch, stage, step, touch_context, watch
from vehicle import CONFIG, OPERATOR, Client, Server, Vehicle, own_domain, until

DEVELOPER = ("dora", "lantern-48-harbour")
AUTHORITY = ("demo-authority", "authority")
STATUS = "velodyne_packet_alive"
CAUSE = "sensors/velodyne_packet_alive"
LOOKS = [("en", "night"), ("de", "day")]
SIZES = [{"width": 390, "height": 844}, {"width": 1920, "height": 1080}]
BODY = "() => [document.documentElement.scrollWidth, innerWidth]"
# By how much the table of topics is wider than its box, which would scroll.
OVER = "() => { const box = document.querySelector('.sheet:has(#topics)'); return box ? box.scrollWidth - box.clientWidth : 0; }"


def dress(context, server, lang, palette):
    cookies = {"lang": lang, "palette": palette}
    context.add_cookies([{"name": name, "value": value, "url": server.url} for name, value in cookies.items()])


def check(page, name):
    found = violations(page)
    assert not found, f"{name}:\n{found}"


@pytest.fixture
def broken(tmp_path):
    """A vehicle with an error and what it masks, diagnosed by a file that has changed meanwhile."""
    config = tmp_path / "shuttle.yaml"
    shutil.copy(CONFIG, config)
    server = Server(tmp_path, own_domain(), config=config)
    server.add_user(*OPERATOR)
    server.add_user(*DEVELOPER, role="developer")
    server.start()
    vehicle = Vehicle(server.domain, tmp_path)
    operator = Client(server, *OPERATOR)
    until(lambda: operator.snapshot()["overall"] == "ok", 20, operator.snapshot)
    operator.post("/vehicle/localize", stop="depot", version=operator.snapshot()["seq"])
    until(lambda: operator.snapshot()["stage"] == "standby", 20, operator.snapshot)
    vehicle.drive(True)
    vehicle.set("imu: status", 1, "warm")
    vehicle.set(STATUS, 2, "no packets")
    until(lambda: operator.snapshot()["overall"] == "error", 20, operator.snapshot)
    yield server, config
    vehicle.close()
    assert server.stop() == 0


def pages(config):
    """Addresses with what has to be there before they are looked at."""
    yield "/developer", "#modules [data-state=error]"
    yield f"/developer?pin={CAUSE}&level=abnormal&sort=state&desc=1", ".pinned [data-module]"
    yield "/developer?q=nothing-of-this-name", "#modules"
    yield "/developer/graph?open=all", ".line[data-hot]"
    yield "/developer/graph?open=none", ".toggle"
    yield "/developer/timeline?span=30", ".bar-error"
    yield f"/developer/timeline?span=600&until=9999999999999&at=1700000000000&node={CAUSE}", ".past"
    yield "/developer/topics", "#topics tbody tr"
    yield "/developer/masking", "#masked tbody tr"
    yield "/developer/coverage?cell=0%20sensors", "#listed"
    yield f"/developer/why?node={CAUSE}", "#why"
    yield "/developer/why?node=localization", "#why"
    yield "/developer/statistics", "#statistics h3"
    yield "/developer/learn?run=yes", "#learn[data-progress=done]"
    yield "/developer/graph?proposed=yes", ".proposed"
    yield "/developer/audit", "#audit tbody tr"
    yield "/developer/configuration", "#configuration[data-judged=true]"
    yield "/developer/configuration?q=nothing-of-this-name", "#running .empty"
    text = CONFIG.read_text()
    config.write_text(text.replace("timeout: 2s", "timeout: 3s"))
    yield "/developer/configuration", "#differences li"
    config.write_text(text.replace("timeout: 2s", "timeout: soon"))
    yield "/developer/configuration", "#problems"
    config.write_text(text)


@pytest.mark.parametrize("lang, palette", LOOKS)
def test_the_developers_pages(broken, chromium, trouble, lang, palette):
    server, config = broken
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(20_000)
    dress(context, server, lang, palette)
    page = context.new_page()
    watch(page, trouble)
    enter(page, server, *DEVELOPER)
    found = []
    for path, there in pages(config):
        page.set_viewport_size({"width": 1280, "height": 800})
        page.goto(server.url + path)
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        expect(page.locator(there).first).to_be_attached()
        found += [f"{path}: {it}" for it in violations(page, live=True).splitlines()]
        for size in SIZES:
            page.set_viewport_size(size)
            expect(page.locator("body")).to_have_attribute("data-live", "live")
            wide, most = page.evaluate(BODY)
            if wide > most:
                found.append(f"{path}: {wide} px wide in a window of {most}")
            over = page.evaluate(OVER)
            if over > 0:
                found.append(f"{path}, {size['width']} px: the topics are {over} px wider than their box")
            found += [f"{path}, {size['width']} px: {it}" for it in violations(page, live=True).splitlines()]
    page.set_viewport_size({"width": 1280, "height": 800})
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    found += [f"help: {it}" for it in violations(page, live=True).splitlines()]
    assert not found, "\n".join(found)
    context.close()


@pytest.mark.parametrize("lang, palette", LOOKS)
def test_what_refuses_and_who_is_not_logged_in(broken, chromium, trouble, lang, palette):
    server, _ = broken
    context = touch_context(chromium, lang)
    dress(context, server, lang, palette)
    page = context.new_page()
    watch(page, trouble)
    page.goto(server.url + "/login")
    check(page, "login")
    page.locator("[name=name]").fill(OPERATOR[0])
    page.locator("[name=secret]").fill("864209")
    page.locator("[name=secret]").press("Enter")
    expect(page.locator(".failure:visible")).not_to_be_empty()
    check(page, "a wrong secret")
    other = f"berta-{lang}-{palette}"
    server.add_user(other, "864213")
    log_in(page, server, other, "864213")
    expect(page.locator("a.back")).to_be_visible()
    check(page, "whether to take over")
    enter(page, server, *OPERATOR)
    for path, status in (("/developer", 403), ("/nowhere", 404), ("/vehicle/localize", 405)):
        answer = page.goto(server.url + path)
        assert answer.status == status
        check(page, f"{status}")
    trouble.expect("403", "404", "405", "401", "409")
    context.close()


def test_nobody_can_log_in_yet(chromium, trouble, tmp_path):
    server = Server(tmp_path, own_domain()).start()
    context = chromium.new_context()
    try:
        for lang, palette in LOOKS:
            dress(context, server, lang, palette)
            page = context.new_page()
            watch(page, trouble)
            page.goto(server.url + "/")
            expect(page.locator(".failure:visible")).not_to_be_empty()
            check(page, f"no users, {lang}")
    finally:
        context.close()
        assert server.stop() == 0


@pytest.mark.parametrize("lang, palette", LOOKS)
def test_what_opens_over_the_operators_page(chromium, trouble, tmp_path, lang, palette):
    server = Server(tmp_path, own_domain() + 40, "demo").start()
    context = touch_context(chromium, lang, reduced_motion="reduce")
    try:
        dress(context, server, lang, palette)
        page = context.new_page()
        watch(page, trouble)
        page.goto(server.url + "/login")
        for field, keys in (("secret", "digits"), ("name", "letters")):
            page.locator(f"[name={field}]").tap()
            expect(page.locator(f".{keys}")).to_be_visible()
            check(page, f"the pad's {keys}")
        log_in_by_touch(page, server, *DEMO_OPERATOR)
        stage(page, "localizing")
        client = Client(server, *DEMO_OPERATOR)
        page.goto(server.url + "/demo")
        check(page, "the demo's switches")
        page.goto(server.url + "/")
        localize(page)
        step(page, "stops").tap()
        expect(page.locator("#sheet-stops")).to_be_visible()
        check(page, "the stops")
        page.locator("#sheet-stops .close").tap()
        ask_for_clearance(page)
        check(page, "the confirmation")
        # It may have disappeared by itself: it is shown for ten seconds.
        page.locator("#confirm button[name=cancel]").evaluate("button => button.click()")
        expect(page.locator("#confirm")).to_be_hidden()
        client.post("/demo/fault", name="low_battery", active="true")
        client.post("/demo/fault", name="costmap_delay", active="true")
        expect(page.locator("#tile-perception")).to_have_attribute("data-state", "error")
        for sheet in ("checks", "causes"):
            page.evaluate(f"document.getElementById('sheet-{sheet}').showPopover()")
            check(page, f"the sheet of {sheet}")
            page.evaluate(f"document.getElementById('sheet-{sheet}').hidePopover()")
        check_authority(chromium, server, trouble, lang, palette)
        trouble.expect("409")
    finally:
        context.close()
        assert server.stop() == 0


def check_authority(chromium, server, trouble, lang, palette):
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    dress(context, server, lang, palette)
    page = context.new_page()
    watch(page, trouble)
    enter(page, server, "authority", "demo-authority")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    check(page, "the authority's page")
    page.goto(server.url + "/developer/audit")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    expect(page.locator("#audit tbody tr").first).to_be_visible()
    check(page, "the authority's audit log")
    context.close()
