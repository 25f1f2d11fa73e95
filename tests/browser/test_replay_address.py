"""The page of a replay: its address, its day, and the search of the shown screen."""

import re
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import expect

from operating import log_in, watch
from programs import shown
from test_replay import BEGIN_NS, config, folder, plain  # noqa: F401
from vehicle import Client

BEGIN_MS = BEGIN_NS // 10**6


@pytest.fixture
def page(chromium, trouble):
    """Of somebody far from the recording."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB", timezone_id="Pacific/Auckland")
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


@pytest.fixture
def replay(plain, config, page):  # noqa: F811
    with shown(plain, config) as (url, name, password):
        log_in(page, SimpleNamespace(url=url), name, password)
        page.wait_for_url(f"{url}/replay/file")
        expect(page.frame_locator("iframe").locator("#tile-base")).to_be_visible()
        yield SimpleNamespace(url=url, name=name, password=password)
        page.goto("about:blank")


def asked(page):
    return {key: values[0] for key, values in parse_qs(urlsplit(page.url).query).items()}


def slider(page):
    return int(page.locator("input[name=at]").input_value())


def test_a_reload_stays_at_the_moment_and_the_screen(replay, page):
    screen = page.frame_locator("iframe")
    # Nothing was chosen yet.
    assert page.url == f"{replay.url}/replay/file"
    page.locator("input[name=at]").fill(str(BEGIN_MS + 2000))
    page.locator("button[name=next]").click()
    page.wait_for_url(f"**/replay/file?at={BEGIN_MS + 3000}")
    page.reload()
    assert slider(page) == BEGIN_MS + 3000
    expect(screen.locator("#tile-base")).to_have_attribute("data-state", "error")
    page.locator("nav a[href$='/developer/graph']").click()
    page.wait_for_url(f"**/replay/file?at={BEGIN_MS + 3000}&screen=%2Fdeveloper%2Fgraph")
    page.reload()
    expect(screen.locator("#graph .node").first).to_be_visible()
    assert slider(page) == BEGIN_MS + 3000
    # A page that comes without a load of its own, too; and the link is the address.
    screen.locator("nav a[data-key]", has_text="Statuses").click()
    expect(screen.locator("main")).to_have_attribute("data-page", "/replay/file/screen/developer")
    page.wait_for_url(f"**/replay/file?at={BEGIN_MS + 3000}&screen=%2Fdeveloper")
    assert page.locator("#moment").evaluate("it => it.href") == page.url
    page.locator("nav a").first.click()
    page.wait_for_url(f"**/replay/file?at={BEGIN_MS + 3000}")

    # While it plays, the address changes about once a second.
    page.evaluate("""() => {
      const replace = history.replaceState.bind(history);
      window.kept = [];
      history.replaceState = (...all) => { window.kept.push(performance.now()); replace(...all) };
    }""")
    page.locator("button[name=play]").click()
    page.wait_for_function("() => window.kept.length >= 3")
    page.locator("button[name=play]").click()
    expect(page.locator("body")).not_to_have_attribute("data-playing", "")
    kept = page.evaluate("() => window.kept")
    assert min(later - earlier for earlier, later in zip(kept[:2], kept[1:3])) >= 990, kept
    # The slider has steps of 10 ms.
    apart = "Math.abs(new URLSearchParams(location.search).get('at') - document.querySelector('input[name=at]').value)"
    page.wait_for_function(f"() => {apart} <= 10")
    at = int(asked(page)["at"])
    assert at > BEGIN_MS + 4000
    page.reload()
    assert abs(slider(page) - at) <= 10 and asked(page) == {"at": str(at)}


def test_the_remembered_moment_is_the_shown_one(replay, page):
    page.goto(f"{replay.url}/replay/file?at={BEGIN_MS + 2347}")
    clock = page.locator("#replay-clock")
    cursor = page.locator(".lane .cursor").first
    before = clock.get_attribute("datetime"), cursor.get_attribute("x1")
    page.locator("button[name=remember]").click()
    assert page.locator("#differs").get_attribute("href").endswith(f"?a={BEGIN_MS + 2347}&b={BEGIN_MS + 2347}")
    assert (clock.get_attribute("datetime"), cursor.get_attribute("x1")) == before


def test_a_frame_that_shows_no_screen_stops_nothing(replay, page, trouble):
    page.goto(f"{replay.url}/replay/file?at={BEGIN_MS + 2000}&screen=/developer/audit")
    screen = page.frame_locator("iframe")
    # A replay has no such screen.
    expect(screen.locator("#tile-base")).to_be_visible()
    # The browser refuses to frame this one.
    page.locator("iframe").evaluate("it => { it.src = '/healthz' }")
    page.wait_for_function("() => document.querySelector('iframe').contentDocument === null")
    refused = trouble.pop()
    assert "frame-ancestors" in refused, refused
    page.locator("button[name=next]").click()
    page.wait_for_url(f"**/replay/file?at={BEGIN_MS + 3000}")
    expect(page.locator("#lost")).to_be_hidden()
    page.locator("select[name=speed]").focus()
    page.keyboard.press("Control+k")
    expect(screen.locator("#filter")).to_be_focused()


def test_a_replay_says_its_day_and_all_its_times_are_those_of_the_browser(replay, page):
    page.goto(f"{replay.url}/replay/file?at={BEGIN_MS + 3000}")
    # In Auckland it is the next morning.
    day = re.compile(r"Tue, Sep 22, 2026")
    expect(page.locator(".dev-bar p")).to_contain_text(day)
    expect(page.locator("#replay-clock")).to_have_text("02:13:23.0")
    expect(page.locator(".lane.axis .label")).to_have_text(day)
    expect(page).to_have_title(day)
    date = page.frame_locator("iframe").locator("#date")
    expect(date).to_have_text("Sep 22, 2026")
    expect(page.frame_locator("iframe").locator("#clock")).to_have_text("02:13:23")
    page.locator("nav a[href$='/developer']").click()
    expect(date).to_have_text("Sep 22, 2026")
    page.goto(f"{replay.url}/replay/file/differences?a={BEGIN_MS + 2000}&b={BEGIN_MS + 4123}")
    for place, clock in enumerate(["02:13:22.000", "02:13:24.123"]):
        head = page.locator("#differences thead time").nth(place)
        expect(head).to_have_text(re.compile(rf"Tue, Sep 22, 2026 {re.escape(clock)}"))
    expect(page).to_have_title(day)


def test_ctrl_k_searches_the_shown_screen(replay, page):
    screen = page.frame_locator("iframe")
    page.goto(f"{replay.url}/replay/file?at={BEGIN_MS + 4000}")
    expect(screen.locator("#tile-base")).to_have_attribute("data-state", "error")
    # The operator's screen has no search: that of the developer's pages comes.
    page.locator("select[name=speed]").focus()
    page.keyboard.press("Control+k")
    expect(screen.locator("#filter")).to_be_focused()
    page.keyboard.type("motor")
    page.keyboard.press("Enter")
    found = screen.locator("main [data-open]").first
    expect(found).to_contain_text("base/motor")
    found.click()
    expect(screen.locator("h2").first).to_contain_text("base/motor")
    page.wait_for_url("**screen=%2Fdeveloper%2Fwhy%3Fnode%3D*")
    # Others open theirs.
    page.locator("nav a[href$='/developer/graph']").click()
    expect(screen.locator("#graph .node").first).to_be_visible()
    page.locator("select[name=speed]").focus()
    page.keyboard.press("Control+k")
    expect(screen.locator("dialog#search input")).to_be_focused()
    page.keyboard.type("power")
    expect(screen.locator("dialog#search [data-open]").first).to_contain_text("base/power")
    page.keyboard.press("Enter")
    expect(screen.locator("h2").first).to_contain_text("base/power")


def test_of_telltale_nothing_is_known_where_it_was_not(replay, page):
    client = Client(SimpleNamespace(url=replay.url), replay.name, replay.password)

    def body(path):
        with client.opener.open(f"{replay.url}/replay/file{path}", timeout=30) as answer:
            return answer.read().decode()

    assert 'data-node="base"' in (whole := body("")) and 'data-node="telltale"' not in whole
    for path in ("", "developer", "developer/graph", "developer/coverage", "api/v1/snapshot"):
        assert "telltale/" not in (screen := body(f"/screen/{path}")).replace("telltale/static", ""), path
        if path.endswith(("graph", "coverage")):
            assert "base" in screen and not re.search(r'node=telltale\b|"telltale"|>\s*telltale\s*<', screen), path
