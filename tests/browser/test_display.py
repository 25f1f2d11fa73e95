"""The display in each of its own conditions: stale, dead, without a socket, without a session, in any
size, and with open sheets."""

import re
import signal
import subprocess

import pytest
from playwright.sync_api import Error, expect

from operating import DEMO_OPERATOR, ask_for_clearance, let_colours_settle, localize, log_in_by_touch, stage, step, touch_context, watch
from accessible import violations
from sizes import SIZES, SMALL, STEPS_NOT_WHOLE, check_elsewhere, check_sizes, check_steps_in_small_windows
from vehicle import OPERATOR, TELLTALE, Client, Server, Writer, own_domain

LATCHED = """vehicle: { stages: none }
groups:
  - id: drive
    name: Drive
    modules:
      - { id: brake, status: brake, latch: 100ms, timeout: 1h, name: Brake weak, help: Stop. }
      - { id: motor, status: motor, timeout: 1h }
"""


# It is stale for a second only, so nobody who looks now and then would see it.
AWAIT_STALE = """() => void (window.stale = new Promise(resolve => {
  const look = () => document.body.dataset.live === "stale" && resolve();
  new MutationObserver(look).observe(document.body, { attributes: true, attributeFilter: ["data-live"] });
}))"""


@pytest.fixture
def demo(tmp_path):
    server = Server(tmp_path, own_domain() + 43, "demo").start()
    yield server
    server.send(signal.SIGCONT)
    assert server.stop() == 0


@pytest.fixture
def display(chromium, trouble, demo):
    context = touch_context(chromium, reduced_motion="reduce")
    page = context.new_page()
    watch(page, trouble)
    log_in_by_touch(page, demo, *DEMO_OPERATOR)
    yield page
    context.close()


def clean_in_both_palettes(page, name):
    """Nothing for axe-core to find, whatever can be touched."""
    for palette in ("day", "night"):
        page.evaluate("palette => void (document.documentElement.dataset.palette = palette)", palette)
        let_colours_settle(page)
        found = violations(page)
        assert not found, f"{name}, {palette}:\n{found}"


# On a computer that is too busy for it the display is not live, and says so instead of its sheets.
@pytest.mark.alone
def test_sheets_details_and_a_display_that_is_not_live_can_be_read_by_all(demo, display, trouble):
    page = display
    localize(page)
    step(page, "stops").tap()
    expect(page.locator("#sheet-stops")).to_be_visible()
    clean_in_both_palettes(page, "stops")
    page.locator("#sheet-stops .close").tap()
    client = Client(demo, *DEMO_OPERATOR)
    # Two entries that are over and two that are active: more than fit.
    for fault, tile in (("localization_jump", "localization"), ("can_loss", "can")):
        client.post("/demo/fault", name=fault, active="true")
        expect(page.locator(f"#tile-{tile}")).to_have_attribute("data-state", "error")
        client.post("/demo/fault", name=fault, active="false")
        expect(page.locator(f"#tile-{tile}")).to_have_attribute("data-state", "ok", timeout=20_000)
    for fault in ("costmap_delay", "low_battery"):
        client.post("/demo/fault", name=fault, active="true")
    expect(page.locator("#tile-perception")).to_have_attribute("data-state", "error")
    expect(page.locator("#causes .more")).to_contain_text("more")
    check_sizes(page, "many")
    page.locator("#causes .more").tap()
    expect(page.locator("#sheet-causes")).to_be_visible()
    clean_in_both_palettes(page, "causes")
    page.locator("#sheet-causes .close").tap()
    page.locator("#tile-can").tap()
    expect(page.locator("#panel-can .spark").first).to_be_visible()
    clean_in_both_palettes(page, "detail")
    page.locator("#panel-can .close").tap()
    page.evaluate(AWAIT_STALE)
    demo.send(signal.SIGSTOP)
    page.evaluate("() => window.stale")
    clean_in_both_palettes(page, "stale")
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    clean_in_both_palettes(page, "dead")
    demo.send(signal.SIGCONT)
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    trouble.expect("WebSocket", "ERR_", "htmx:ws:error")


# Presses Enter on the second step as soon as it is there.
CONFIRM_AT_ONCE = """() => {
  const form = document.getElementById("confirm");
  new MutationObserver((_, observer) => {
    if (form.hidden) return;
    observer.disconnect();
    form.requestSubmit(form.elements.confirm);
  }).observe(form, { attributes: true });
}"""


def test_a_double_tap_on_clearance_drives_nowhere(demo, display):
    page, confirm, posted = display, step(display, "confirm"), []
    page.on("request", lambda request: request.url.endswith("/confirm") and posted.append(request.url))
    localize(page)
    ready = page.locator("#actions button[name=clearance]:not([aria-disabled])")
    for lang in ("en", "de"):
        page.locator("html").evaluate("(html, lang) => void (html.lang = lang)", lang)
        for width, height in SIZES + SMALL:
            page.set_viewport_size({"width": width, "height": height})
            expect(ready).to_be_visible(timeout=40_000)
            asked = ready.bounding_box()
            check_elsewhere("Drive", ask_for_clearance(page), asked, f"{width}x{height}, {lang}")
            # Right after the first step no tap counts.
            expect(page.locator("#actions[data-quiet]")).to_have_count(0)
            try:
                step(page, "cancel").click(force=True, timeout=3_000)
            except Error:
                # News has taken the step back already.
                expect(confirm).to_be_hidden(timeout=100)
            expect(confirm).to_be_hidden()
    page.evaluate(CONFIRM_AT_ONCE)
    ask_for_clearance(page)
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    assert posted == []


@pytest.mark.parametrize("width, height", [(390, 844), (1920, 1080)])
def test_other_sizes_do_not_break(demo, display, width, height):
    page = display
    localize(page)
    client = Client(demo, *DEMO_OPERATOR)
    client.post("/demo/fault", name="localization_jump", active="true")
    expect(page.locator("#tile-localization")).to_have_attribute("data-state", "error")
    page.set_viewport_size({"width": width, "height": height})
    wide = page.evaluate("() => document.documentElement.scrollWidth")
    assert wide <= width, f"{wide} px of {width}"
    for part in ("#top .stage", "#live", "#tile-localization", "#causes .cause", "#step button:not([hidden])", "#causes button[name=acknowledge]"):
        expect(page.locator(part).first).to_be_visible()
        box = page.locator(part).first.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width + 0.5, f"{part}: {box}"
    # All at one moment: the list above them grows.
    boxes = page.locator(".tile").evaluate_all("tiles => tiles.map((tile) => tile.getBoundingClientRect().toJSON())")
    for index, one in enumerate(boxes):
        for other in boxes[index + 1 :]:
            apart = (
                one["x"] + one["width"] <= other["x"] + 0.5
                or other["x"] + other["width"] <= one["x"] + 0.5
                or one["y"] + one["height"] <= other["y"] + 0.5
                or other["y"] + other["height"] <= one["y"] + 0.5
            )
            assert apart, f"{one} over {other}"
    page.locator("#tile-localization").tap()
    expect(page.locator("#panel-localization .close")).to_be_visible()
    box = page.locator("#panel-localization").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= width + 0.5, box
    assert not violations(page), violations(page)


def test_the_clearance_and_its_question_are_whole_in_a_small_window(demo, display, trouble):
    localize(display)
    check_steps_in_small_windows(display, "clearance")
    trouble.expect("409")


def test_with_two_errors_and_an_unknown_speed_every_step_is_whole(demo, display, trouble):
    page, client = display, Client(demo, *DEMO_OPERATOR)
    localize(page)
    for fault, tile in (("can_loss", "can"), ("sensor_outage", "sensors")):
        client.post("/demo/fault", name=fault, active="true")
        expect(page.locator(f"#tile-{tile}")).to_have_attribute("data-state", "error")
    expect(page.locator("#motion")).to_have_attribute("data-moving", "unknown")
    expect(step(page, "stop")).to_be_visible()
    expect(step(page, "clearance")).to_be_visible()
    for lang in ("en", "de"):
        if page.locator("html").get_attribute("lang") != lang:
            page.locator("[data-tool=language]").evaluate("button => button.click()")
        expect(page.locator("html")).to_have_attribute("lang", lang)
        check_sizes(page, f"unknown speed, {lang}")
        for width, height in SMALL:
            page.set_viewport_size({"width": width, "height": height})
            page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            assert page.evaluate(STEPS_NOT_WHOLE) == [], (lang, width, height)
            title = page.locator("#causes .title").first
            box, list_box = title.bounding_box(), page.locator("#causes-list").bounding_box()
            assert box["y"] + box["height"] <= list_box["y"] + list_box["height"] + 3, (lang, width, height)
            # Both are in sight, or the second one is counted.
            both = page.locator("#causes .cause:visible, #causes .more:visible")
            expect(both).to_have_count(2)
        page.set_viewport_size({"width": 1280, "height": 800})


def test_a_lost_session_leads_to_the_login(demo, display, chromium, trouble):
    page = display
    stage(page, "localizing")
    page.context.clear_cookies()
    step(page, "localize").first.tap()
    page.wait_for_url(demo.url + "/login*")
    expect(page.locator(".session-end")).to_have_count(0)
    trouble.expect("401", "403", "Failed to load resource")


@pytest.fixture
def others(tmp_path):
    """A server with two operators, whose users can be removed while it runs."""
    server = Server(tmp_path, own_domain() + 45)
    for name in ("anna", "bert"):
        server.add_user(name, OPERATOR[1])
    server.start()
    yield server
    assert server.stop() == 0


def enters(page, server, name, takes_over=False):
    page.goto(server.url + "/login")
    page.locator("[name=name]").fill(name)
    page.locator("[name=secret]").fill(OPERATOR[1])
    page.locator("form .primary").tap()
    if takes_over:
        page.get_by_role("button", name=re.compile("Take the place|ablösen")).tap()
    expect(page.locator("body")).to_have_attribute("data-live", "live")


def remove(server, name):
    words = [TELLTALE, "user", "remove", name, "--data", str(server.folder)]
    subprocess.run(words, check=True, capture_output=True, timeout=30)


@pytest.mark.parametrize(
    "lang, end, says",
    [
        ("en", "taken", "Another operator has taken your place."),
        ("de", "taken", "Jemand anderes hat Sie abgelöst."),
        ("en", "left", "You logged out at another display."),
        ("en", "removed", "This user was removed. Call the control room."),
    ],
)
def test_the_login_says_why_a_session_is_over(others, chromium, trouble, lang, end, says):
    first, second = touch_context(chromium, lang), touch_context(chromium, lang)
    page, other = first.new_page(), second.new_page()
    watch(page, trouble)
    enters(page, others, "anna")
    if end == "taken":
        enters(other, others, "bert", takes_over=True)
    elif end == "left":
        enters(other, others, "anna")
        step(other, "logout").tap()
        expect(other).to_have_url(others.url + "/login")
        expect(other.locator(".session-end")).to_have_count(0)
    else:
        remove(others, "anna")
    expect(page).to_have_url(others.url + "/login")
    expect(page.locator(".session-end")).to_have_text(says)
    assert not violations(page), violations(page)
    # Nothing from the address is shown.
    page.goto(others.url + "/login?why=forged&farewell=forged")
    expect(page.locator(".session-end")).to_have_text(says)
    assert "forged" not in page.content()
    trouble.expect("401", "403", "Failed to load resource", "WebSocket")
    first.close()
    second.close()


def test_after_an_update_of_the_server_the_page_loads_itself_anew(demo, display, trouble):
    page, client, held = display, Client(demo, *DEMO_OPERATOR), []
    stage(page, "localizing")
    # A tap that was sent is answered first, however long that takes here.
    page.evaluate("() => void (AbortSignal.timeout = () => new AbortController().signal)")
    page.route("**/vehicle/localize", lambda route: held.append(route))
    step(page, "localize").first.tap()
    expect(page.locator("body[data-unanswered]")).to_be_attached()
    page.evaluate("() => { document.body.dataset.layout = 'of another version'; window.isOld = true; }")
    client.post("/demo/fault", name="low_battery", active="true")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "warning")
    assert page.evaluate("() => window.isOld")
    with page.expect_response("**/vehicle/localize") as answer:
        held.pop().continue_()
    page.wait_for_function("() => !window.isOld")
    page.unroute("**/vehicle/localize")
    if answer.value.status == 409:
        # On a busy machine a silence may forbid it in this moment: it was answered, and is asked for again.
        trouble.expect("409")
        localize(page)
    stage(page, "standby", 20)
    expect(page.locator("body")).to_have_attribute("data-live", "live")


def test_a_browser_without_sockets_says_that_it_shows_nothing_live(demo, display, trouble):
    page = display
    page.add_init_script("delete window.WebSocket")
    page.reload()
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    expect(page.locator(".frozen b").filter(visible=True)).to_have_text(["Display frozen.", "Take over."])
    unfit = page.locator(".unfit span").filter(visible=True)
    expect(unfit).to_contain_text("Use another one")
    check_sizes(page, "no sockets")
    clean_in_both_palettes(page, "no sockets")
    page.locator("[data-tool=language]").evaluate("button => button.click()")
    expect(unfit).to_contain_text("Anderen verwenden")
    trouble.expect("WebSocket")
    # A user without WebSocket learns it before the login.
    page.context.clear_cookies()
    page.goto(demo.url + "/login")
    expect(page.locator(".unfit")).to_contain_text("Use another one")


def test_closing_the_notice_leaves_the_detail_open(demo, display, trouble):
    page = display
    stage(page, "localizing")
    page.locator("#tile-can").tap()
    panel, notice = page.locator("#panel-can"), page.locator("#notice")
    expect(panel).to_be_visible()
    for _ in range(2):
        # Refused: there is no alarm with this number.
        page.evaluate(
            """() => {
              const form = document.createElement('form');
              form.action = '/alarms/999999/acknowledge';
              form.dataset.act = 'acknowledge';
              form.innerHTML = '<input type=hidden name=version value=1>';
              document.body.append(form);
              form.requestSubmit();
              form.remove();
            }"""
        )
        expect(notice).to_be_visible()
        notice.locator("[name=dismiss]").tap()
        expect(notice).to_be_hidden()
        expect(panel).to_be_visible()
    panel.locator(".close").tap()
    expect(panel).to_be_hidden()
    trouble.expect("409", "404")


def test_an_error_that_is_held_is_reset_at_its_component(tmp_path, chromium, trouble):
    config = tmp_path / "held.yaml"
    config.write_text(LATCHED)
    server = Server(tmp_path, own_domain() + 44, config=config)
    server.add_user(*OPERATOR)
    server.start()
    writer = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "writer.log")
    report = lambda level: writer.write(
        statuses=[
            {"level": it, "name": name, "message": "", "hardware_id": "", "values": {}}
            for name, it in (("brake", level), ("motor", 0))
        ]
    )
    context = touch_context(chromium)
    page = context.new_page()
    watch(page, trouble)
    try:
        log_in_by_touch(page, server, *OPERATOR)
        writer.write(wait_matched=1, timeout=10)
        report(2)
        tile, held = page.locator("#tile-drive"), page.locator("#panel-drive .held")
        expect(tile).to_have_attribute("data-state", "error")
        tile.tap()
        expect(held).to_contain_text("Held until reset")
        let_colours_settle(page)
        held.locator("button").tap(force=True)
        expect(page.locator("#notice li").first).to_be_visible()
        page.locator("#notice [name=dismiss]").tap()
        report(0)
        expect(held.locator("button:not([aria-disabled])")).to_be_visible()
        expect(tile).to_have_attribute("data-state", "error")
        expect(page.locator("#instruction")).to_contain_text("touch here")
        held.locator("button").tap()
        expect(tile).to_have_attribute("data-state", "ok")
        expect(held).to_have_count(0)
        trouble.expect("409")
    finally:
        context.close()
        writer.close()
        assert server.stop() == 0


def test_what_is_outside_of_the_configuration_is_one_quiet_line(tmp_path, chromium, trouble):
    config = tmp_path / "other.yaml"
    config.write_text(LATCHED)
    server = Server(tmp_path, own_domain() + 45, config=config)
    server.add_user(*OPERATOR)
    server.start()
    writer = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "writer.log")
    status = lambda name, level: {"level": level, "name": name, "message": "", "hardware_id": "", "values": {}}
    well = [status("brake", 0), status("motor", 0)]
    context = touch_context(chromium, reduced_motion="reduce")
    page = context.new_page()
    watch(page, trouble)
    try:
        log_in_by_touch(page, server, *OPERATOR)
        writer.write(wait_matched=1, timeout=10)
        writer.write(statuses=[*well, status("stray", 0)])
        expect(page.locator("#causes-calm")).to_have_attribute("data-good", "true")
        expect(page.locator("#causes-aside")).to_have_count(0)
        writer.write(statuses=[*well, status("stray", 2)])
        line = page.locator("#causes-aside")
        expect(line).to_have_text("1 error outside of the configuration")
        expect(page.locator("#causes-calm")).to_have_attribute("data-good", "true")
        expect(page.locator("#causes")).to_have_attribute("data-alarms", "")
        check_sizes(page, "other")
        clean_in_both_palettes(page, "other")
        # It stands below the faults, and none of them is cut for it.
        writer.write(statuses=[status("brake", 2), status("motor", 2), status("stray", 2)])
        expect(page.locator("#causes .cause")).to_have_count(2)
        check_sizes(page, "other and what is wrong")
        bottom = lambda where: (box := page.locator(where).bounding_box())["y"] + box["height"]
        top = lambda where: page.locator(where).bounding_box()["y"]
        assert bottom("#causes .cause:last-child") <= top("#causes-aside") + 1
        assert bottom("#causes-aside") <= bottom("#causes") + 1
        for width, height in ((390, 844), (800, 1280), (1920, 1080)):
            page.set_viewport_size({"width": width, "height": height})
            expect(line).to_be_visible()
            assert page.evaluate("() => document.documentElement.scrollWidth") <= width
        page.set_viewport_size({"width": 1280, "height": 800})
        page.screenshot(path=tmp_path / "other.png")
    finally:
        context.close()
        writer.close()
        assert server.stop() == 0
