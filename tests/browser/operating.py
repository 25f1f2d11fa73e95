"""What users do in a browser, by touch or not, and what an operator sees of a vehicle that stands."""

import re

from playwright.sync_api import Locator, TimeoutError, expect

from vehicle import OPERATOR

DEMO_OPERATOR = ("operator", "246810")
DISPLAY = {"width": 1280, "height": 800}
TILES = ["sensors", "localization", "perception", "prediction", "can", "mission", "planning", "execution"]


def touch_context(chromium, lang="en", palette="night", **more):
    context = chromium.new_context(viewport=DISPLAY, locale="de-DE" if lang == "de" else "en-GB", has_touch=True, **more)
    context.set_default_timeout(20_000)
    return context


REPLACED = "WebSocket is closed before the connection is established"


def watch(page, trouble):
    """Notes everything that the browser complains about, but for a server that says it is not ready, and for a
    connection that the page has replaced because it took too long on a busy machine."""

    def note(message):
        usual = message.location.get("url", "").endswith("/readyz") or REPLACED in message.text
        if message.type in ("error", "warning") and not usual:
            trouble.append(message.text)

    page.on("console", note)
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.add_init_script(
        "addEventListener('securitypolicyviolation',"
        " event => console.error(`CSP: ${event.violatedDirective} ${event.blockedURI}`))"
    )


def log_in(page, server, name=OPERATOR[0], secret=OPERATOR[1]):
    page.goto(server.url + "/")
    page.wait_for_url(server.url + "/login*")
    page.locator("[name=name]").fill(name)
    page.locator("[name=secret]").fill(secret)
    page.locator("[name=secret]").press("Enter")


def enter(page, server, name, secret):
    """Logs in, and is there."""
    log_in(page, server, name, secret)
    page.wait_for_url(server.url + "/")


def tile(page, name):
    return page.locator(f"#tile-{name}")


def expect_tile(page, name, state, reason=None):
    expect(tile(page, name)).to_have_attribute("data-state", state)
    if reason is None:
        expect(tile(page, name)).not_to_have_attribute("data-reason", re.compile("."))
    else:
        expect(tile(page, name)).to_have_attribute("data-reason", reason)


def expect_standing(page):
    """Logged in at a stop: all is well, and nobody asks the planner."""
    expect(page.locator("body")).to_have_attribute("data-stage", re.compile("localizing|standby"))
    if page.locator("body").get_attribute("data-stage") == "localizing":
        localize(page, Locator.click)
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    for name in TILES:
        if name in ("planning", "execution"):
            expect_tile(page, name, "ignore", "not_relevant")
            expect(tile(page, name)).to_contain_text("Not active")
        else:
            expect_tile(page, name, "ok")
            expect(tile(page, name)).to_contain_text("OK")


def type_by_touch(page, name, secret):
    """Fills the form with its buttons alone; the name is offered, or typed."""
    offered = page.locator(".known button").get_by_text(name, exact=True)
    if offered.count():
        if offered.get_attribute("aria-pressed") != "true":
            offered.tap()
    else:
        for letter in name:
            page.locator(f".letters [data-key='{letter}']").tap()
        page.locator(".letters [data-key=next]").tap()
    for digit in secret:
        page.locator(f".digits [data-key='{digit}']").tap()


def log_in_by_touch(page, server, name, secret):
    page.goto(server.url + "/login")
    type_by_touch(page, name, secret)
    page.locator(".digits [data-key=enter]").tap()
    expect(page.locator("body")).to_have_attribute("data-live", "live")


def let_colours_settle(page):
    """Waits until no colour is fading: the colour on the screen is in no computed style meanwhile, and the colour of
    an ended fault stays for a moment."""
    page.wait_for_function("() => !document.getAnimations().some(it => it instanceof CSSTransition)")


def stage(page, name, seconds=20):
    expect(page.locator("body")).to_have_attribute("data-stage", name, timeout=seconds * 1000)


def step(page, name):
    return page.locator(f"#actions button[name={name}]")


LOCALIZED_OR_TOLD = "() => document.body.dataset.stage === 'standby' || !document.getElementById('notice').hidden"


def localize(page, press=Locator.tap):
    """A tap while a busy machine lets the display grow stale is not sent, says so, and is made again."""
    stage(page, "localizing")
    for _ in range(5):
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        press(step(page, "localize").first)
        page.wait_for_function(LOCALIZED_OR_TOLD)
        if page.locator("body").get_attribute("data-stage") == "standby":
            return
        page.locator("#notice [name=dismiss]").evaluate("button => button.click()")
    stage(page, "standby")


CLEARED = "() => ['cleared', 'active'].includes(document.body.dataset.stage)"


def ask_for_clearance(page):
    """The first step, as soon as nothing stands in the way; it is refused where something has just come up, and taken back
    by news. Returns the place of the second step."""
    ready = page.locator("#actions button[name=clearance]:not([aria-disabled])")
    for _ in range(5):
        expect(ready).to_be_visible(timeout=40_000)
        try:
            ready.tap(timeout=3_000)
            step(page, "confirm").wait_for(timeout=3_000)
            if box := step(page, "confirm").bounding_box():
                return box
        except TimeoutError:
            continue
    raise AssertionError("a clearance is refused again and again")


def clear(page):
    """Both steps. What changes in between takes the first one back."""
    for _ in range(5):
        if page.evaluate(CLEARED):
            return
        ask_for_clearance(page)
        try:
            step(page, "confirm").tap(timeout=3_000)
            page.wait_for_function(CLEARED, timeout=5_000)
        except TimeoutError:
            continue
    assert page.evaluate(CLEARED), "the clearance is taken back again and again"


def release(page):
    """Both steps. STOP stays where it is meanwhile."""
    offered = page.locator("#step button[name=release]")
    for _ in range(5):
        try:
            offered.tap(timeout=10_000)
            expect(page.locator("#step button[name=stop]")).to_be_visible()
            step(page, "confirm").tap(timeout=3_000)
            return expect(offered).to_have_count(0)
        except (TimeoutError, AssertionError):
            continue
    raise AssertionError("a release is taken back again and again")


def arrive(page, seconds=120):
    """Waits for the next stop. A fault of a very busy machine holds the vehicle: it is released once that is over."""
    offered, stands = page.locator("#actions button[name=release]"), page.locator("body[data-stage=standby]")
    for _ in range(5):
        offered.or_(stands).first.wait_for(timeout=seconds * 1000)
        if stands.count():
            return
        release(page)
    raise AssertionError("the vehicle is held again and again")


FAST = "() => Number(document.getElementById('motion').textContent.match(/(\\d+)\\skm/)?.[1]) >= 18"


def get_going(page):
    """Waits until the shuttle drives fast enough to slow down for a while."""
    page.wait_for_function(FAST)


def acknowledge_all(page):
    """One tap for each alarm."""
    button = page.locator("#causes button[name=acknowledge]").first
    meant = lambda: button.get_attribute("value", timeout=1_000) if button.count() else None
    tapped = 0
    while (alarm := meant()) is not None:
        assert tapped < 20, f"{alarm} is acknowledged again and again"
        tapped += 1
        one = page.locator(f"#causes button[name=acknowledge][value='{alarm}']")
        try:
            one.tap(timeout=3000)
        except TimeoutError:
            # An entry that is over may disappear before the tap.
            assert meant() != alarm, f"{alarm} cannot be tapped"
            continue
        try:
            expect(one).to_have_count(0, timeout=5_000)
        except AssertionError:
            # Its fault changed at that moment, so the tap was refused and is made again.
            page.locator("#notice [name=dismiss]").evaluate("button => button.click()")
