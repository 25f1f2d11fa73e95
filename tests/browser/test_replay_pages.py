"""The replay of an incident in the running HMI: the screens as they were, at any instant, and nothing that acts."""

import datetime
import json
import os
import re
import urllib.error
import urllib.request

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter
from test_developer import CAUSE, DEVELOPER, STATUS, prepare
from vehicle import OPERATOR, ROOT, Client, until

# Every route of the server, as the table of accesses lists them; it has to list all.
ROUTES = re.findall(r'^ +\("([A-Z]+)", "([^"]+)", \[', (ROOT / "crates/web/tests/http/access.rs").read_text(), re.MULTILINE)
OF_ALL = {"/alarms/{*path}": "/alarms/1/acknowledge", "/modules/{*path}": "/modules/sensors/imu/reset"}


def actions(number):
    """The addresses of all that can be sent to the server."""
    paths = [OF_ALL.get(path, path).replace("{id}", str(number)) for method, path in ROUTES if method == "POST"]
    assert len(ROUTES) > 50 and {"/vehicle/stop", "/logout", "/api/v1/mark", f"/incidents/{number}/note"} <= set(paths), paths
    return paths


def answer(opener, server, method, path):
    """The status of the answer to a program's request."""
    headers = {"Origin": server.url, "Accept": "application/json"}
    data = b"version=1" if method == "POST" else None
    request = urllib.request.Request(server.url + path, data=data, method=method, headers=headers)
    try:
        with opener.open(request, timeout=20) as answered:
            return answered.status
    except urllib.error.HTTPError as error:
        return error.code


@pytest.fixture
def incident(server, vehicle):
    """A sensor failed for a while, which is recorded."""
    operator = prepare(server)
    client = Client(server, *DEVELOPER)

    def ask(path):
        with client.opener.open(server.url + path, timeout=10) as answer:
            return json.load(answer)

    vehicle.set(STATUS, 2, "no packets")
    until(lambda: any(root["node"] == CAUSE for root in operator.snapshot()["roots"]), 20, operator.snapshot)
    now = lambda: datetime.datetime.fromisoformat(operator.snapshot()["at"]).timestamp()
    began = now()
    until(lambda: now() > began + 2, 20, "it lasts")
    vehicle.set(STATUS, 0)
    until(lambda: not operator.snapshot()["roots"], 20, operator.snapshot)
    about = lambda: [it for it in ask("/api/v1/incidents") if CAUSE in it["roots"] and it["recording"]["finished"]]
    number = until(about, 90, lambda: ask("/api/v1/incidents"))[0]["id"]
    return number, ask(f"/api/v1/incidents/{number}")


def failed_at(told):
    return next(it["at_ms"] for it in told["story"]["moments"] if it["kind"] == "fails" and (it["node"], it["state"]) == (CAUSE, "error"))


def test_the_screens_are_as_they_were_and_nothing_acts(server, vehicle, page, incident, tmp_path):
    number, told = incident
    enter(page, server, *DEVELOPER)
    page.goto(f"{server.url}/incidents/{number}")
    page.locator("#replay").click()
    page.wait_for_url(f"**/replay/{number}")
    expect(page.locator("body")).to_have_attribute("data-live", "replay")
    expect(page.locator(".replay-sign")).to_contain_text(re.compile(r"Replay|Wiedergabe"))
    screen = page.frame_locator("iframe[name=screen]")
    body = screen.locator("body")
    expect(body).to_have_attribute("data-live", "replay")
    tile = screen.locator("#tile-sensors")
    expect(tile).to_be_visible()
    assert violations(page) == ""

    # At the fault, and again before it.
    fault_ms = failed_at(told)
    page.goto(f"{server.url}/replay/{number}?at={fault_ms + 1000}")
    expect(tile).to_have_attribute("data-state", "error")
    expect(screen.locator(f"#causes [data-node='{CAUSE}']")).to_be_visible()
    expect(screen.locator("#tile-localization")).to_have_attribute("data-reason", "masked")
    page.locator("input[name=at]").fill(str(fault_ms - 1000))
    expect(tile).to_have_attribute("data-state", "ok")
    page.locator("button[name=next]").click()
    page.locator("button[name=next]").click()
    if folder := os.environ.get("REPLAY_SHOTS"):
        page.goto(f"{server.url}/replay/{number}?at={fault_ms + 1000}")
        expect(tile).to_have_attribute("data-state", "error")
        for name, size in [("1280", (1280, 800)), ("1920", (1920, 1080)), ("1024", (1024, 600))]:
            page.set_viewport_size({"width": size[0], "height": size[1]})
            page.wait_for_timeout(500)
            page.screenshot(path=f"{folder}/replay-{name}.png")

    # It plays to the end, faster than it was.
    page.locator("select[name=speed]").select_option("20")
    page.locator("button[name=play]").click()
    at = lambda: int(page.locator("input[name=at]").input_value())
    until(lambda: at() >= told["story"]["to_ms"] - 500, 30, lambda: f"the end, {at()} of {told['story']['to_ms']}")
    expect(tile).to_have_attribute("data-state", "ok")
    expect(page.locator("body")).not_to_have_attribute("data-playing", "")

    # The developer's pages are those of the same instant. An address shows its moment also while it plays.
    page.locator("select[name=speed]").select_option("0.1")
    page.locator("button[name=play]").click()
    expect(page.locator("body")).to_have_attribute("data-playing", "")
    page.goto(f"{server.url}/replay/{number}?at={fault_ms + 1000}")
    expect(page.locator("body")).not_to_have_attribute("data-playing", "")
    # The slider has steps.
    assert abs(at() - (fault_ms + 1000)) < 100
    page.locator("nav a").nth(1).click()
    row = screen.locator(f'tbody:last-child [data-module="{CAUSE}"]')
    expect(row).to_have_attribute("data-state", "error")
    expect(row).to_contain_text("no packets")
    page.locator("nav a").nth(2).click()
    expect(screen.locator("#graph .node").first).to_be_visible()

    # Nothing can be done: no button is there.
    page.locator("nav a").first.click()
    expect(body).to_have_attribute("data-live", "replay")
    expect(screen.locator("button[name=stop]:visible, button[name=acknowledge]:visible, form:visible")).to_have_count(0)


def test_no_route_acts_in_a_replay_whoever_asks(server, vehicle, incident):
    number, _ = incident
    stand = lambda client: {key: client.snapshot()[key] for key in ("stage", "countermeasures", "alarms", "operator")}
    developer, operator = Client(server, *DEVELOPER), Client(server, *OPERATOR)
    server.add_user("otto", "a long password", role="authority")
    authority, stranger = Client(server, "otto", "a long password"), urllib.request.build_opener()
    told = lambda: developer.opener.open(f"{server.url}/api/v1/incidents/{number}", timeout=20).read()
    before, incidents = stand(developer), told()
    for subject in (number, "recent"):
        for client in (developer, authority):
            until(lambda: answer(client.opener, server, "GET", f"/replay/{subject}") == 200, 60, f"the replay of {subject}")
        screen = f"/replay/{subject}/screen"
        for path in actions(number):
            for opener in (developer.opener, authority.opener):
                # The screens have no replays, incidents and logins of their own.
                assert answer(opener, server, "POST", screen + path) in (403, 404, 405, 409), (subject, path)
                assert answer(opener, server, "GET", screen + path) in (200, 403, 404, 405, 409), (subject, path)
            assert answer(operator.opener, server, "POST", screen + path) in (403, 405), (subject, path)
            assert answer(stranger, server, "POST", screen + path) == 401, (subject, path)
        for path in (path for method, path in ROUTES if method == "GET"):
            status = answer(developer.opener, server, "GET", screen + path.replace("{id}", str(number)).replace("{*path}", "page.js"))
            assert status < 500 or path == "/readyz", (subject, path, status)
            assert answer(operator.opener, server, "GET", screen + path.replace("{*path}", "page.js")) == 403, (subject, path)
    # The sessions are as they were, too.
    assert stand(developer) == before and told() == incidents


def test_two_people_replay_while_the_vehicle_goes_on(server, vehicle, page, incident):
    number, told = incident
    clients = [Client(server, *DEVELOPER) for _ in range(2)]

    def ask(client, path, **order):
        data = "&".join(f"{key}={value}" for key, value in order.items()).encode() or None
        headers = {"Origin": server.url, "Accept": "application/json"}
        request = urllib.request.Request(f"{server.url}{path}", data=data, headers=headers)
        with client.opener.open(request, timeout=20) as answer:
            text = answer.read()
        return json.loads(text) if text.startswith(b"{") else text

    fault_ms = failed_at(told)
    for client, at_ms in zip(clients, (fault_ms - 1000, fault_ms + 1000)):
        ask(client, f"/replay/{number}?at={at_ms}")
    snapshot = lambda client: ask(client, f"/replay/{number}/screen/api/v1/snapshot")
    shown = lambda client: next(it["state"] for it in snapshot(client)["groups"] if it["id"] == "sensors")
    until(lambda: [shown(client) for client in clients] == ["ok", "error"], 10, lambda: [shown(it) for it in clients])
    # As it was: the API says the same as the recording.
    assert [root["node"] for root in snapshot(clients[1])["roots"]] == [CAUSE]
    # The recording has nanoseconds, the list of incidents milliseconds.
    assert abs(ask(clients[0], f"/replay/{number}/state", step="next")["from_ms"] - told["story"]["from_ms"]) <= 2
    live = lambda: clients[0].snapshot()["at"]
    first = live()
    until(lambda: live() > first, 5, "the vehicle goes on")


def test_two_moments_stand_side_by_side_with_what_differs(server, page, incident):
    number, told = incident
    fault_ms = failed_at(told)
    enter(page, server, *DEVELOPER)
    page.goto(f"{server.url}/replay/{number}?at={fault_ms - 1000}")
    expect(page.frame_locator("iframe[name=screen]").locator("#tile-sensors")).to_have_attribute("data-state", "ok")
    page.locator("button[name=remember]").click()
    page.locator("input[name=at]").fill(str(fault_ms + 1000))
    page.locator("#differs").click()
    page.wait_for_url("**/differences?*")
    row = page.locator(f"#differences tr[data-node='{CAUSE}']")
    expect(row.locator("td").nth(0).locator(".chip")).to_have_attribute("data-state", "ok")
    expect(row.locator("td").nth(1).locator(".chip")).to_have_attribute("data-state", "error")
    expect(row.locator("td").nth(1)).to_contain_text("no packets")
    masked = page.locator("#differences tr[data-node='localization'] td").nth(1)
    expect(masked.locator(".chip")).to_have_attribute("data-state", "ignore")
    expect(masked).to_contain_text(CAUSE)
    # It can be saved, as every table.
    buttons = page.locator(".export:has(+ #differences) button")
    expect(buttons).to_have_count(3)
    with page.expect_download() as saved:
        buttons.filter(has_text="JSON").click()
    with open(saved.value.path(), encoding="utf-8") as file:
        assert CAUSE in [next(iter(row.values())) for row in json.load(file)["rows"]]
    assert violations(page) == ""
    if folder := os.environ.get("REPLAY_SHOTS"):
        page.screenshot(path=f"{folder}/differences.png")
    address = page.url
    client = Client(server, *DEVELOPER)
    client.opener.open(f"{server.url}/replay/{number}", timeout=10)
    request = urllib.request.Request(address, headers={"Accept": "application/json"})
    found = json.load(client.opener.open(request, timeout=10))["differences"]
    assert CAUSE in [node["node"] for node in found["nodes"]] and found["vehicle"], found
    page.goto(f"{server.url}/replay/{number}/differences?a={fault_ms}&b={fault_ms}")
    expect(page.locator(".empty")).to_contain_text("Nothing differs")
    page.locator("#leave").click()
    page.wait_for_url(f"**/replay/{number}?at=*")


def test_any_moment_is_shown_again_from_the_best_source(server, vehicle, page, incident):
    number, told = incident
    fault_ms = failed_at(told)
    enter(page, server, *DEVELOPER)
    screen = page.frame_locator("iframe[name=screen]")
    clock = lambda: page.evaluate("() => Number(document.querySelector('input[name=at]').value)")

    # The recorder still has the last minutes, from its start on, whatever is an incident.
    page.goto(f"{server.url}/developer/timeline")
    page.locator("#show-moment").click()
    page.wait_for_url("**/replay/recent?at=*")
    expect(page.locator(".replay-sign")).to_be_visible()
    expect(screen.locator("#tile-sensors")).to_have_attribute("data-state", "ok")
    page.goto(f"{server.url}/developer/moment?at={fault_ms + 500}")
    page.wait_for_url("**/replay/recent?at=*")
    expect(screen.locator("#tile-sensors")).to_have_attribute("data-state", "error")
    expect(screen.locator(f"#causes [data-node='{CAUSE}']")).to_be_visible()
    assert abs(clock() - (fault_ms + 500)) < 100
    assert page.locator(f".lane[data-node='{CAUSE}'] .bar-error").count() == 1
    assert violations(page) == ""

    # A later moment than was held when it was opened is found in what is held now.
    vehicle.set(STATUS, 2, "no packets again")
    client = Client(server, *DEVELOPER)
    root = lambda: next((root for root in client.snapshot()["roots"] if root["node"] == CAUSE), None)
    since = datetime.datetime.fromisoformat(until(root, 20, client.snapshot)["since"])
    now = lambda: datetime.datetime.fromisoformat(client.snapshot()["at"])
    until(lambda: (now() - since).total_seconds() > 1, 20, client.snapshot)
    page.goto(f"{server.url}/developer/moment")
    page.wait_for_url("**/replay/recent?at=*")
    expect(screen.locator("#tile-sensors")).to_have_attribute("data-state", "error")
    vehicle.set(STATUS, 0)

    # What nothing has recorded is told by the history, if it knows it.
    page.goto(f"{server.url}/developer/moment?at={fault_ms - 86_400_000}")
    page.wait_for_url("**/developer/timeline?*unrecorded*")
    expect(page.locator(".past")).to_contain_text("Nothing holds this moment")
    # Of what is still to come the end of what is recorded is shown, which is said.
    page.goto(f"{server.url}/developer/moment?at={fault_ms + 86_400_000}")
    page.wait_for_url("**/replay/recent?at=*")
    expect(page.locator("#beyond")).to_contain_text("It ends here")
    page.goto(f"{server.url}/replay/recent")
    page.locator("#leave").click()
    page.wait_for_url("**/developer")
    expect(page.locator("body")).to_have_attribute("data-live", "live")


def test_timeline_topics_and_nodes_are_those_of_the_shown_instant(server, vehicle, page, incident):
    number, told = incident
    fault_ms = failed_at(told)
    enter(page, server, *DEVELOPER)
    base = f"{server.url}/replay/{number}"
    page.goto(f"{base}?at={fault_ms + 1000}")
    screen = page.frame_locator("iframe[name=screen]")
    expect(screen.locator("#tile-sensors")).to_have_attribute("data-state", "error")
    page.locator("nav a[href$='/developer/timeline']").click()
    lane = screen.locator("#timeline .lane[data-node=sensors]")
    expect(lane.locator(".then .chip")).to_have_attribute("data-state", "error")
    expect(lane.locator(".bar-error")).to_have_count(1)
    end_ms = int(screen.locator("#timeline").get_attribute("data-to"))
    assert abs(end_ms - (fault_ms + 1000)) < 100, "nothing of what came later is shown"
    expect(screen.locator("#timeline [data-zoom=whole]")).to_have_text("30 s")
    # A click in it moves the replay.
    well = lane.locator(".bar-ok").last.bounding_box()
    page.mouse.click(well["x"] + well["width"] / 2, well["y"] + 8)
    expect(lane.locator(".then .chip")).to_have_attribute("data-state", "ok")
    assert int(screen.locator("#timeline").get_attribute("data-to")) < end_ms

    # The messages that were received until then, and no more is claimed.
    page.locator("nav a[href$='/developer/topics']").click()
    row = screen.locator("[data-topic='/diagnostics']")
    expect(row).to_contain_text("Hz")
    messages = lambda: int(row.locator("td").nth(2).inner_text())
    before = messages()
    expect(screen.locator("#not-recorded")).to_contain_text("not known")
    page.goto(f"{base}?at={fault_ms + 2000}")
    page.locator("nav a[href$='/developer/topics']").click()
    expect(row).to_contain_text("Hz")
    assert messages() > before, (messages(), before)

    # A node's past, and from each of its changes to every page of that instant.
    screen.locator("body").evaluate("(_, path) => location.assign(path)", f"/replay/{number}/screen/developer/why?node={CAUSE}")
    change = screen.locator("#transitions tbody tr").filter(has=screen.locator("[data-state=error]")).first
    expect(change).to_contain_text("no packets")
    change.locator("a").first.click()
    page.wait_for_url(f"**/replay/{number}?at={fault_ms}")
    assert violations(page) == ""
