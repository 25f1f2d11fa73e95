"""The console of a fleet in a browser, over `telltale demo --fleet`: the worst vehicle first with its cause, and nothing old
that looks live."""

import json
import os
import re
import signal
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter, log_in, watch
from vehicle import TELLTALE, Client, Server, own_domain, until

# The simulation, and what is late or lost, live in real time.
pytestmark = pytest.mark.timed

USERS = {"control": "demo-control", "engineer": "demo-engineer", "authority": "demo-authority"}
CONTROL = ("control", USERS["control"])
IN_FAULT, IN_TUNNELS, SWITCHED_OFF = "shuttle-01", "shuttle-02", "robot-03"

# A fault comes at least this often, a tunnel too; then a vehicle is late after 35 s and lost after 65 s.
FAULT_MS = 260_000
TUNNEL_MS = 320_000
LOST_MS = 90_000
# After a hub's restart vehicles wait for up to two minutes before they try again.
BACK_MS = 170_000

SIZES = [(1280, 800), (1920, 1080), (390, 844)]
LOOKS = [("en", "night"), ("de", "day")]
WIDTHS = "() => [document.documentElement.scrollWidth, innerWidth]"
# The rows that look as if the vehicle were heard now: with the green, the amber or the red of a state.
COLOURED = """() => [...document.querySelectorAll("#vehicles > li")].filter(row => {
  const style = getComputedStyle(document.documentElement);
  const probe = row.appendChild(document.createElement("i"));
  const colours = ["ok", "bad-text", "late-text"].map(it => {
    probe.style.color = `var(--${it})`;
    return getComputedStyle(probe).color;
  });
  probe.remove();
  return colours.includes(getComputedStyle(row.querySelector("[data-cell=state]")).color);
}).map(row => row.id)"""


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    server = Server(tmp_path_factory.mktemp("fleet"), own_domain(), "demo")
    server.run([TELLTALE, "demo", "--fleet", "3", "--listen", f"127.0.0.1:{server.port}"])
    yield server
    # A hub that lost its demo would run on.
    hubs = server.children()
    assert server.stop() == 0
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in hubs), 10, lambda: f"the hub ends: {hubs}")


@pytest.fixture(scope="module")
def client(demo):
    client = Client(demo, *CONTROL)
    until(lambda: len(vehicles(client)) == 3, 120, lambda: f"three vehicles are heard: {vehicles(client)}")
    return client


@pytest.fixture
def console(demo, client, page):
    enter(page, demo, *CONTROL)
    return page


def get(client, path):
    with client.opener.open(client.server.url + path, timeout=10) as answer:
        return answer.read()


def vehicles(client):
    return json.loads(get(client, "/api/v1/vehicles"))


def then(client):
    """The page of the vehicle in fault at its first alarm, on the day before this demo or earlier."""
    told = json.loads(get(client, f"/api/v1/vehicles/{IN_FAULT}/history?from=2020-01-01T00:00:00Z"))
    at = next(it["at"] for it in told["messages"] if it["kind"] == "alarm")
    return f"/vehicles/{IN_FAULT}?at={at}"


def row(page, vehicle):
    return page.locator(f"#v-{vehicle}")


def test_programs_see_the_vehicles_of_the_demo_with_days_of_history(client):
    found = {it["id"]: it for it in vehicles(client)}
    assert set(found) == {IN_FAULT, IN_TUNNELS, SWITCHED_OFF}
    assert found[IN_FAULT]["name"] == "Shuttle 1" and found[SWITCHED_OFF]["name"] == "Robot 3"
    assert re.fullmatch("[0-9a-f]{64}", found[IN_FAULT]["config"])
    told = lambda: json.loads(get(client, f"/api/v1/vehicles/{IN_FAULT}/history?from=2020-01-01T00:00:00Z"))
    until(lambda: [it["kind"] for it in told()["messages"]].count("goodbye") == 4, 30, told)
    assert told()["unknown"] == [] and told()["contradictions"] == 0
    groups = json.loads(get(client, "/api/v1/incidents?group=cause"))
    assert any(IN_FAULT in it["vehicles"] and it["count"] >= 4 for it in groups), groups


@pytest.mark.parametrize("name", USERS)
def test_each_role_logs_in_and_out(demo, client, page, name):
    enter(page, demo, name, USERS[name])
    expect(page.locator(".user")).to_have_text(name)
    expect(row(page, IN_FAULT)).to_be_visible()
    page.get_by_role("button", name="Log out").click()
    page.wait_for_url(demo.url + "/login")


def test_a_wrong_password_is_said(demo, page, trouble):
    log_in(page, demo, "control", "wrong words here")
    expect(page.get_by_role("alert")).to_have_text("Name or password is wrong.")
    trouble.expect("401")


def test_no_route_acts(demo, client):
    paths = ["/", "/overview", f"/vehicles/{IN_FAULT}", f"/vehicles/{IN_FAULT}/state", f"/vehicles/{IN_FAULT}/log", "/api/v1/vehicles", f"/api/v1/vehicles/{IN_FAULT}/snapshot", f"/api/v1/vehicles/{IN_FAULT}/history"]
    paths += [f"/api/v1/vehicles/{IN_FAULT}/log", f"/api/v1/vehicles/{IN_FAULT}/incidents", "/api/v1/groups", "/api/v1/openapi.json"]
    paths += ["/incidents", "/api/v1/incidents", "/api/v1/what-ifs", "/healthz", "/readyz"]
    expected = [(method, path, 405) for path in paths for method in ("POST", "PUT", "PATCH", "DELETE")]
    expected += [(method, "/vehicle/stop", 404) for method in ("GET", "POST", "PUT")]
    for method, path, status in expected:
        request = urllib.request.Request(demo.url + path, method=method, headers={"Origin": demo.url})
        with pytest.raises(urllib.error.HTTPError) as error:
            client.opener.open(request, timeout=10)
        assert error.value.code == status, (method, path)


@pytest.mark.parametrize("lang, palette", LOOKS)
def test_the_pages_fit_and_are_accessible(demo, client, chromium, trouble, lang, palette):
    context = chromium.new_context(locale="en-GB")
    context.set_default_timeout(20_000)
    cookies = {"lang": lang, "palette": palette}
    context.add_cookies([{"name": name, "value": value, "url": demo.url} for name, value in cookies.items()])
    page = context.new_page()
    watch(page, trouble)
    page.goto(demo.url + "/login")
    assert not violations(page)
    enter(page, demo, *CONTROL)
    pages = [("/", f"#v-{IN_FAULT}"), (f"/vehicles/{IN_FAULT}", ".tile"), ("/?q=robot", f"#v-{SWITCHED_OFF}"), ("/incidents", ".incident-groups li")]
    for path, there in [*pages, (then(client), ".replay-sign")]:
        page.goto(demo.url + path)
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            expect(page.locator(there).first).to_be_visible()
            wide, most = page.evaluate(WIDTHS)
            assert wide <= most, f"{path}: {wide} px wide in a window of {most}"
            expect(page.locator("body")).not_to_have_attribute("data-dead", "")
            assert not violations(page), (path, width, lang, palette)
    expect(page.locator("html")).to_have_attribute("lang", lang)
    context.close()


def test_a_search_finds_vehicles_and_an_error_leads_back(demo, console, trouble):
    console.get_by_role("searchbox").fill("robot")
    console.get_by_role("searchbox").press("Enter")
    expect(console.locator(".found")).to_contain_text("One vehicle found.")
    expect(console.locator("#vehicles > li")).to_have_count(1)
    expect(row(console, SWITCHED_OFF)).to_be_visible()
    console.goto(demo.url + "/vehicles/nobody")
    trouble.expect("404")
    console.get_by_role("link", name="Back to the fleet").click()
    expect(row(console, IN_FAULT)).to_be_visible()


def test_a_vehicle_has_a_page_that_follows_it(demo, console):
    row(console, IN_FAULT).get_by_role("link").click()
    console.wait_for_url(f"{demo.url}/vehicles/{IN_FAULT}")
    expect(console.locator("#log .lines li").first).to_be_visible()
    # The drives of the last day, which were before this demo.
    expect(console.locator("[data-kind=goodbye]").first).to_contain_text("Telltale ended")
    expect(console.locator("#log time").last).to_have_text(re.compile(r"\d+ \w+ \d{4}, \d\d:\d\d:\d\d"))
    fault = console.locator(".wrong li").filter(has_text="localization/tf_quality")
    expect(fault).to_be_visible(timeout=FAULT_MS)
    expect(fault).to_contain_text(re.compile("wait for it: .*perception"))
    tile = console.locator(".component").filter(has=console.locator(".name", has_text="perception")).locator(".tile")
    expect(tile).to_have_attribute("data-reason", "masked")
    expect(tile).to_contain_text("Waiting for")
    # Nothing was loaded again: the alarm of now comes by itself, before all that was there.
    expect(console.locator("#log .lines li").filter(has_text="localization/tf_quality").first).to_contain_text("Alarm")


def test_a_vehicle_is_shown_as_it_was_in_the_frame_of_a_replay(demo, client, console):
    console.goto(demo.url + then(client))
    asked = []
    console.on("request", lambda request: asked.append(request.url))
    expect(console.locator(".replay-sign")).to_have_text(re.compile(r"Replay \d+ \w+ \d{4}, \d\d:\d\d:\d\d"))
    frame = "getComputedStyle(document.body, '::after').border"
    assert console.evaluate(frame).startswith("6px solid"), console.evaluate(frame)
    expect(row(console, IN_FAULT)).to_have_attribute("data-state", "error")
    expect(console.locator(".wrong li").first).to_contain_text(re.compile("wait for it: "))
    expect(console.locator("#log li[aria-current]").first).to_contain_text("Alarm")
    alarm = console.url
    console.get_by_role("link", name="Next change").click()
    console.wait_for_url(lambda url: url > alarm)
    console.get_by_role("link", name="Previous change").click()
    expect(console.locator("#log li[aria-current]").first).to_contain_text("Alarm")
    console.get_by_role("link", name="24 hours").click()
    expect(console.locator(".replay-sign")).to_be_visible()
    assert not [url for url in asked if re.search("/(state|log)([?]|$)", url)], asked
    console.get_by_role("link", name="Back to now").click()
    console.wait_for_url(f"{demo.url}/vehicles/{IN_FAULT}")
    expect(console.locator("#log [data-kind=goodbye] a").first).to_be_visible()
    assert console.locator("[data-replay]").count() == 0


def test_a_recording_is_fetched_and_replayed_with_the_operators_screen(demo, client, page):
    enter(page, demo, "engineer", USERS["engineer"])
    page.goto(f"{demo.url}/vehicles/{IN_FAULT}")
    page.locator("form[action$='/fetch'] button").first.click()
    replay = page.locator("a[href^='/replay/']")
    expect(replay).to_be_visible(timeout=60_000)
    replay.click()
    screen = page.frame_locator("iframe[name=screen]")
    expect(screen.locator("#instruction")).to_contain_text("Take over", timeout=30_000)
    expect(screen.locator("[data-tile=localization], #tile-localization").first).to_contain_text("Error")
    page.get_by_role("link", name="Statuses").click()
    expect(screen.locator("#modules")).to_contain_text("localization/tf_quality")
    page.locator("#leave").click()
    expect(page.locator("h1")).to_contain_text(IN_FAULT)


def test_a_vehicle_that_says_goodbye_is_off_and_grey(console):
    off = row(console, SWITCHED_OFF)
    expect(off).to_have_attribute("data-contact", "off", timeout=120_000)
    expect(off).to_contain_text("Vehicle off")
    assert f"v-{SWITCHED_OFF}" not in console.evaluate(COLOURED)


def test_the_worst_vehicle_is_first_with_its_cause_in_words(console):
    fault = row(console, IN_FAULT)
    expect(fault).to_have_attribute("data-state", "error", timeout=FAULT_MS)
    # Only one that was lost while it drove is worse.
    first = console.locator("#vehicles > li").first
    expect(first).to_have_attribute("data-urgency", re.compile("error|lost-driving"))
    expect(fault.locator("[data-cell=cause] b")).to_have_text(re.compile(r"\w+ \w+"))
    expect(fault.locator("[data-cell=cause] small").last).to_have_text("localization/tf_quality")
    expect(console.locator("[data-count=error]")).not_to_have_attribute("data-none", "")


def test_a_vehicle_in_a_tunnel_is_late_and_then_lost_and_comes_back(console):
    tunnel = row(console, IN_TUNNELS)
    expect(tunnel).to_have_attribute("data-contact", "late", timeout=TUNNEL_MS)
    expect(tunnel).to_contain_text("Late")
    assert f"v-{IN_TUNNELS}" not in console.evaluate(COLOURED)
    expect(tunnel).to_have_attribute("data-contact", "lost", timeout=LOST_MS)
    expect(tunnel).to_contain_text("Link lost")
    expect(tunnel.locator("[data-cell=age]")).to_have_text(re.compile(r"\d+ (s|min) ago"))
    # It drove or stood when it was lost.
    expect(tunnel).to_have_attribute("data-urgency", re.compile("lost"))
    expect(tunnel).to_have_attribute("data-contact", "live", timeout=BACK_MS)


def test_without_its_hub_nothing_is_shown_as_live_and_all_comes_back(demo, console, client):
    expect(row(console, IN_FAULT)).to_have_attribute("data-contact", "live", timeout=BACK_MS)
    [hub] = demo.children()
    os.kill(hub, signal.SIGKILL)
    expect(console.locator("#fleet")).to_have_attribute("data-hub-down", "", timeout=20_000)
    expect(console.get_by_role("alert").filter(has_text="Hub down")).to_be_visible()
    for vehicle in (IN_FAULT, IN_TUNNELS):
        expect(row(console, vehicle)).to_have_attribute("data-contact", "hub_down")
    assert console.evaluate(COLOURED) == []
    expect(console.locator("[data-count=ok] b")).to_have_text("0")
    with urllib.request.urlopen(demo.url + "/readyz", timeout=5) as answer:
        assert answer.status == 200
    expect(row(console, IN_FAULT)).to_have_attribute("data-contact", "live", timeout=BACK_MS)
    expect(console.locator("#fleet")).not_to_have_attribute("data-hub-down", "")
