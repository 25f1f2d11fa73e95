"""Texts fit: on a phone in German, and in the audit log. Sizes fit the density of the display."""

import pytest
from playwright.sync_api import expect

from operating import log_in, touch_context, watch
from sizes import SIZES, SMALL, check_steps_in_small_windows, faults
from vehicle import CONFIG, OPERATOR, Client, serving, until

CUT = """() => [...document.querySelectorAll(".instruction *, .cause .title, .cause .help, .top .vehicle")]
  .filter(it => it.scrollWidth > it.clientWidth + 1 && getComputedStyle(it).display !== "inline").map(it => it.textContent)"""
# Texts for screen readers, in closed sheets too.
SAID = """() => {
  const shown = it => { for (; it; it = it.parentElement) {
    if (it.hidden || (getComputedStyle(it).display === "none" && !it.popover)) return false; } return true; };
  const texts = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) if (walk.currentNode.data.trim() && shown(walk.currentNode.parentElement)) texts.push(walk.currentNode.data.trim());
  for (const it of document.querySelectorAll("[aria-label]")) texts.push(it.getAttribute("aria-label"));
  return texts;
}"""
# Cells of the log in which one word takes more than one line.
BROKEN = """() => [...document.querySelectorAll(".log td")].filter(it => {
  const range = document.createRange();
  range.selectNodeContents(it);
  return !/[ /-]/.test(it.innerText.trim()) && new Set([...range.getClientRects()].map(rect => Math.round(rect.top))).size > 1;
}).map(it => it.innerText)"""


# Forty groups, each resting on the one above it in its column and on the first one.
FORTY = "vehicle: { stages: none }\ngroups:\n" + "".join(
    f"  - {{ id: g{number}, name: Group {number}, depends_on: [{', '.join(on)}], modules: [{{ id: m, status: s{number} }}] }}\n"
    for number in range(1, 41)
    for on in [[f"g{number - 7}"] if number > 7 else []]
)


@pytest.fixture
def german(chromium, trouble, server):
    """An operator's page in German, and the operator as a program."""
    client = Client(server, *OPERATOR)
    context = touch_context(chromium, "de")
    context.add_cookies(client.browser_cookies())
    page = context.new_page()
    watch(page, trouble)
    yield page, client
    context.close()


def test_on_a_phone_nothing_is_cut_and_what_to_do_is_in_sight(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    client.stop()
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(server.url + "/")
    expect(page.locator("#instruction[data-urgency=be_ready] strong")).to_be_visible()
    assert page.evaluate(CUT) == []
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390
    box = lambda selector: page.locator(selector).first.bounding_box()
    told, bar, title = box("#instruction"), box("#actions"), box("#instruction strong")
    assert told["y"] + told["height"] <= bar["y"], (told, bar)
    assert title["width"] > 200 and told["height"] < 300


def test_in_a_small_window_what_to_do_and_stop_are_in_sight_and_each_component_has_a_line(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    vehicle.set("velodyne_packet_alive", 2, "Only 2.0 scans per second")
    page.goto(server.url + "/")
    expect(page.locator("#instruction[data-urgency=be_ready] strong")).to_be_visible()
    for width, height in SMALL:
        page.set_viewport_size({"width": width, "height": height})
        for part in ("#motion", "#instruction", "#step button[name=stop]"):
            expect(page.locator(part)).to_be_in_viewport(ratio=0.99)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= width
        stop, told = (page.locator(part).bounding_box() for part in ("#step button[name=stop]", "#instruction"))
        bar = page.locator("#actions").bounding_box()
        assert stop["height"] >= 88 and told["y"] + told["height"] <= bar["y"], (stop, told, bar)
        assert page.locator("#motion").evaluate("it => it.scrollWidth <= it.clientWidth + 1"), (width, height)
        expect(page.locator("#arrows")).to_be_hidden()
        for tile in page.locator(".tile").all():
            expect(tile.locator(".icon")).to_be_visible()
            box, name, word = (tile.locator(part).bounding_box() for part in (":scope", ".name", ".state"))
            assert word["width"] > 8 and word["height"] > 8, word
            beside = name["x"] + name["width"] <= word["x"] + 1 or name["y"] + name["height"] <= word["y"] + 1
            assert beside and word["x"] + word["width"] <= box["x"] + box["width"], (width, name, word)
            # A masked row names the component that it waits for.
            if tile.get_attribute("data-reason") == "masked":
                expect(tile.locator(".line")).to_be_visible()
        # Motion, instruction and STOP stay in sight beside the sheet of a component.
        page.locator("#tile-sensors").tap()
        expect(page.locator("#panel-sensors")).to_be_visible()
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        sheet = page.locator("#panel-sensors").bounding_box()
        for part in ("#motion", "#instruction", "#step button[name=stop]"):
            if (width, height) == (390, 844) and part != "#step button[name=stop]":
                continue
            box = page.locator(part).bounding_box()
            assert box["y"] >= 0 and (box["y"] + box["height"] <= sheet["y"] + 1 or box["y"] >= sheet["y"] + sheet["height"] - 1), (part, box, sheet)
        page.keyboard.press("Escape")


def test_to_continue_and_its_question_are_whole_beside_stop_in_a_small_window(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    client.stop()
    page.goto(server.url + "/")
    check_steps_in_small_windows(page, "release")


# Whether the longest text of the way is left out or lies in its box.
HAS_ROOM = """() => {
  const place = document.querySelector("#step .next > span");
  const way = place.querySelector(".way") ?? place.appendChild(Object.assign(document.createElement("span"), { className: "text way" }));
  way.textContent = "Noch etwa 99,9\u00a0km, 60\u00a0min";
  const [text, box] = [way, way.closest(".next")].map(it => it.getBoundingClientRect());
  const lines = document.createRange();
  lines.selectNodeContents(way);
  return text.width === 0 || (lines.getBoundingClientRect().right <= box.right && text.bottom <= box.bottom && box.bottom <= innerHeight);
}"""


def test_how_far_the_next_stop_is_has_room_in_every_window_or_is_left_out(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    page.goto(server.url + "/")
    expect(page.locator("#step .next strong")).to_have_text("Unterwegs")
    # Nobody has touched this page, so that it says that the sound is off.
    expect(page.locator("[data-tool=sound] span.if-off:visible")).to_have_text("Ton aus")
    for width, height in (*SIZES, *SMALL):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate(HAS_ROOM), (width, height)
        if (width, height) == (800, 480):
            expect(page.locator("#step .way")).to_be_visible()
        page.wait_for_function("() => { const it = document.getElementById('motion'); return it.scrollWidth <= it.clientWidth + 1; }", timeout=5000)


def test_a_warning_keeps_its_count_and_its_icon(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    vehicle.set("can: battery", 1, "18 %")
    page.goto(server.url + "/")
    expect(page.locator("#tile-can[data-state=warning]")).to_be_visible()
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        assert not faults(page), f"{width}x{height}: {faults(page)}"
        for part in (".state", ".line", ".icon"):
            expect(page.locator(f"#tile-can {part}")).to_be_visible()


def test_the_tick_is_whole_beside_the_question_for_the_stop(server, vehicle, german, trouble):
    page, _ = german
    vehicle.set("can: battery", 1, "18 %")
    page.set_viewport_size({"width": 800, "height": 480})
    page.goto(server.url + "/")
    expect(page.locator("#step button[name=localize]").first).to_be_visible()
    expect(page.locator("#causes .title")).to_have_text(["Batterie ist schwach"])
    tick, bar = (page.locator(part).bounding_box() for part in ("#causes button[name=acknowledge]", "#actions"))
    assert tick["y"] + tick["height"] <= bar["y"], (tick, bar)


# Inside which words a line of the faults' titles ends, without a hyphen of theirs.
TORN = """() => [...document.querySelectorAll("#causes .title")].flatMap(title => {
  const node = title.firstChild, torn = [];
  const top = at => { const range = document.createRange(); range.setStart(node, at); range.setEnd(node, at + 1); return [...range.getClientRects()].at(-1)?.top ?? 0; };
  for (let at = 1; at < node.length; at++) {
    if (top(at) > top(at - 1) + 4 && !/[\\s\\u00ad-]/.test(node.data[at - 1])) torn.push(node.data.slice(0, at));
  }
  return torn;
})"""


def test_a_long_word_breaks_where_the_configuration_says(server, vehicle, german, trouble):
    page, client = german
    vehicle.drive(True)
    until(lambda: client.snapshot()["stage"] == "active", 20, client.snapshot)
    vehicle.set("can: bus", 2, "silent")
    page.goto(server.url + "/")
    title = page.locator("#causes .title").first
    expect(title).to_have_text("Fahrzeugdaten fehlen")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        assert not faults(page), f"{width}x{height}: {faults(page)}"
        assert page.evaluate(TORN) == [], f"{width}x{height}"
    page.set_viewport_size({"width": 1024, "height": 600})
    assert title.evaluate("it => it.getClientRects()[0].height / parseFloat(getComputedStyle(it).lineHeight)") > 1.5


def test_after_a_switch_of_the_language_nothing_keeps_the_old_one(server, vehicle, german, trouble):
    page, _ = german
    page.goto(server.url + "/")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    page.locator("[data-tool=language]").tap()
    expect(page.locator("#top .stage")).to_have_text("Localizing")
    said = page.evaluate(SAID)
    words = ("Schließen", "Störung", "Anzeige", "Prüfung", "Wo steht", "Fahrbegleitung", "Sensoren", "Wartet auf", "seit")
    kept = [text for text in said if any(word in text for word in words)]
    assert len(said) > 50 and not kept, kept


def test_the_audit_log_breaks_no_word_and_speaks_german(server, german, trouble):
    page, _ = german
    server.add_user("aron", "lantern-48-harbour", role="authority")
    reader = Client(server, "aron", "lantern-48-harbour")
    page.context.add_cookies(reader.browser_cookies())
    for width in (1280, 800):
        page.set_viewport_size({"width": width, "height": 800})
        page.goto(server.url + "/developer/audit")
        expect(page.locator(".log tbody tr", has_text="Anmeldung").first).to_be_visible()
        assert page.evaluate(BROKEN) == []
    text = page.locator(".log tbody").inner_text()
    assert "ausgeführt" in text and "Aufsicht" in text and "done" not in text and "login" not in text, text


# The heights of the smallest buttons and links, and the size of a rem.
MEASURES = """() => {
  const shown = it => it.getClientRects().length && getComputedStyle(it).visibility === "visible";
  const least = selector => Math.min(...[...document.querySelectorAll(selector)].filter(shown).map(it => it.getBoundingClientRect().height));
  return [parseFloat(getComputedStyle(document.documentElement).fontSize), least("button, a"), least(".primary")];
}"""


def test_buttons_keep_their_millimetres_on_a_denser_display(chromium, trouble, tmp_path):
    config = tmp_path / "dense.yaml"
    config.write_text(CONFIG.read_text() + "\ndisplay: { dpi: 170 }\n")
    with serving(tmp_path, config=config) as server:
        context = touch_context(chromium)
        page = context.new_page()
        watch(page, trouble)

        def check():
            expect(page.locator("html")).to_have_attribute("data-dpi", "170")
            rem, button, primary = page.evaluate(MEASURES)
            assert rem == pytest.approx(16 * 170 / 149, abs=0.01)
            assert button >= 88 * 170 / 149 - 0.5 and primary >= 117 * 170 / 149 - 0.5, (button, primary)

        page.goto(server.url + "/")
        page.wait_for_url(server.url + "/login*")
        check()
        context.add_cookies(Client(server, *OPERATOR).browser_cookies())
        page.goto(server.url + "/")
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        check()
        context.close()


def test_forty_groups_have_room_in_every_window(chromium, trouble, tmp_path):
    config = tmp_path / "forty.yaml"
    config.write_text(FORTY)
    with serving(tmp_path, config=config) as server:
        context = touch_context(chromium)
        page = context.new_page()
        watch(page, trouble)
        log_in(page, server)
        expect(page.locator("body")).to_have_attribute("data-live", "live")
        expect(page.locator(".tile[data-state=unknown]")).to_have_count(40)
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            # So many are no targets of 15 mm, and the word of a state may have no room.
            found = [it for it in faults(page) if not it.startswith(("touch", "leaves its tile: state"))]
            assert not found, f"{width}x{height}: {found}"
        context.close()


# Fourteen nodes of a robot, some with long names.
NODES = [
    "Base", "Battery driver", "Docking", "IMU", "Lidar front", "AMCL", "Lidar rear", "Lifecycle manager navigation",
    "Lifecycle manager localization", "Planner server", "Base driver", "Controller server", "Docking server", "Other",
]
ROBOT = "vehicle: { stages: none }\ngroups:\n" + "".join(
    f"  - {{ id: g{number}, name: {name}, modules: [{{ id: m, status: s{number} }}] }}\n" for number, name in enumerate(NODES)
)
# Tiles that are not on the board, whose state is cut, or whose icon lies over a text.
CROWDED = """() => {
  const board = document.querySelector(".board").getBoundingClientRect();
  const shared = (a, b, from, to) => Math.min(a[to], b[to]) - Math.max(a[from], b[from]);
  const lines = (it) => { const range = document.createRange(); range.selectNodeContents(it); return [...range.getClientRects()]; };
  return [...document.querySelectorAll(".tile")].filter((tile) => {
    const [box, word, icon] = [tile, tile.querySelector(".state"), tile.querySelector(".icon")].map((it) => it.getBoundingClientRect());
    const over = [...tile.querySelectorAll(".state, .line")].some((it) => lines(it).some((line) =>
      shared(line, icon, "left", "right") > 3 && shared(line, icon, "top", "bottom") > 3));
    // In the lowest tiles the words are for screen readers.
    const isNamesOnly = document.querySelector("[data-names-only]") !== null;
    return box.bottom > board.bottom || (!isNamesOnly && (word.bottom > box.bottom || over));
  }).map((tile) => tile.textContent.trim());
}"""


def test_long_names_leave_the_state_its_place(chromium, trouble, tmp_path):
    config = tmp_path / "robot.yaml"
    config.write_text(ROBOT)
    with serving(tmp_path, config=config) as server:
        context = touch_context(chromium)
        page = context.new_page()
        watch(page, trouble)
        log_in(page, server)
        expect(page.locator(".tile[data-state=unknown]")).to_have_count(len(NODES))
        for width, height in [*SIZES, (800, 480)]:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_function(f"() => ({CROWDED})().length === 0", timeout=5000)
            # Names that begin alike are told apart by their ends.
            short = page.locator("[data-short]")
            shown = short.evaluate_all("names => names.map(it => [it.dataset.short, it.textContent.slice(-2)])")
            assert all("…" in name and name.endswith(end) for name, end in shown), shown
        assert shown, "at 800x480 a long name has no room"
        context.close()
