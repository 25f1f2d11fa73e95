"""The touches of an operator at a display."""

from playwright.sync_api import TimeoutError, expect


DEMO_OPERATOR = ("operator", "246810")
DISPLAY = {"width": 1280, "height": 800}


def touch_context(chromium, lang="en", palette="night", **more):
    context = chromium.new_context(viewport=DISPLAY, locale="de-DE" if lang == "de" else "en-GB", has_touch=True, **more)
    context.set_default_timeout(20_000)
    return context


def watch(page, trouble):
    """Notes everything that the browser complains about, but for a server that says it is not ready."""

    def note(message):
        if message.type in ("error", "warning") and not message.location.get("url", "").endswith("/readyz"):
            trouble.append(message.text)

    page.on("console", note)
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.add_init_script(
        "addEventListener('securitypolicyviolation',"
        " event => console.error(`CSP: ${event.violatedDirective} ${event.blockedURI}`))"
    )


def type_by_touch(page, name, secret):
    """Fills the form with the pad alone."""
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


def stage(page, name, seconds=10):
    expect(page.locator("body")).to_have_attribute("data-stage", name, timeout=seconds * 1000)


def step(page, name):
    return page.locator(f"#actions button[name={name}]")


LOCALIZED_OR_TOLD = "() => document.body.dataset.stage === 'standby' || !document.getElementById('notice').hidden"


def localize(page):
    """A tap while a busy machine lets the display grow stale is not sent, says so, and is made again."""
    stage(page, "localizing")
    for _ in range(5):
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        step(page, "localize").first.tap()
        page.wait_for_function(LOCALIZED_OR_TOLD)
        if page.locator("body").get_attribute("data-stage") == "standby":
            return
        page.locator("#notice [name=dismiss]").evaluate("button => button.click()")
    stage(page, "standby")


CLEARED = "() => ['cleared', 'active'].includes(document.body.dataset.stage)"


def ask_for_clearance(page):
    """The first step, as soon as nothing stands in the way; it is refused where something has just come up."""
    ready = page.locator("#actions button[name=clearance]:not([aria-disabled])")
    for _ in range(5):
        expect(ready).to_be_visible(timeout=40_000)
        try:
            ready.tap(timeout=3_000)
            return step(page, "confirm").wait_for(timeout=3_000)
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


def acknowledge_all(page):
    """One tap for each alarm, and each does what it says: the button goes, or means another one."""
    button = page.locator("#causes button[name=acknowledge]")
    meant = lambda: button.get_attribute("value") if button.count() else None
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
        expect(one).to_have_count(0)
