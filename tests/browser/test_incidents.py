"""The developer's pages of incidents: from a fault over real DDS to its story."""

import json
import re
import subprocess

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter, log_in, watch
from test_developer import CAUSE, DEVELOPER, STATUS, prepare, visit
from vehicle import OPERATOR, TELLTALE, Client, until


def reader(server):
    """Asks for JSON as a developer's program."""
    client = Client(server, *DEVELOPER)

    def ask(path):
        with client.opener.open(server.url + path, timeout=10) as answer:
            return json.load(answer)

    return ask


@pytest.mark.parametrize("palette", ["night", "day"])
def test_a_fault_is_listed_told_noted_and_kept(server, vehicle, page, trouble, palette):
    prepare(server)
    enter(page, server, *DEVELOPER)
    page.context.add_cookies([{"name": "palette", "value": palette, "url": server.url}])
    ask = reader(server)
    vehicle.set(STATUS, 2, "<b>no packets</b>")
    about = lambda: [it for it in ask("/api/v1/incidents") if CAUSE in it["roots"]]
    until(about, 20, lambda: ask("/api/v1/incidents"))
    incident = about()[0]["id"]
    finished = lambda: ask(f"/api/v1/incidents/{incident}")["recording"]["finished"]
    # While it is being recorded, its page tells what is on the disk.
    visit(page, server, f"/incidents/{incident}")
    expect(page.locator("#story tbody")).to_contain_text(f"{CAUSE}: Error, “<b>no packets</b>”")
    until(finished, 90, lambda: ask(f"/api/v1/incidents/{incident}"))
    story = ask(f"/api/v1/incidents/{incident}")["story"]
    assert story["complete"] and not story["left_out"] and not story["lost"], story
    assert any(it["kind"] == "fails" and it["node"] == CAUSE for it in story["moments"]), story["moments"]

    visit(page, server, "/incidents?cause=VELODYNE")
    row = page.locator(f"[data-incident='{incident}']")
    expect(row).to_contain_text(CAUSE)
    # What it was, as the operator's page says it, and how bad.
    expect(row).to_have_attribute("data-state", "error")
    expect(row.locator(".told")).to_contain_text("LiDAR data missing (Sensors)")
    assert row.locator(".state span").evaluate("it => getComputedStyle(it).backgroundColor") == "rgb(168, 13, 27)"
    assert violations(page) == ""
    # The row opens by the keyboard, and wherever it is clicked.
    page.keyboard.press("j")
    expect(page.locator("[data-row] [data-open]").first).to_be_focused()
    row.locator("[data-open]").focus()
    page.keyboard.press("Enter")
    page.wait_for_url(f"**/incidents/{incident}")
    page.go_back()
    row.locator("td").nth(3).click()
    page.wait_for_url(f"**/incidents/{incident}")
    # Its heading is the sentence of the list.
    expect(page.locator("#incident h3")).to_contain_text("LiDAR data missing (Sensors)")
    expect(page.locator("#incident .chip")).to_have_text("Error")
    expect(page.locator("#story tbody")).to_contain_text("hides: ")
    expect(page.locator(f"#states [data-node='{CAUSE}'] .bar-error")).not_to_have_count(0)
    expect(page.locator("#freeze")).to_contain_text(CAUSE)
    expect(page.locator("[data-topic='/diagnostics']")).to_be_visible()
    assert violations(page) == ""
    with page.expect_download() as download:
        page.locator("#download").click()
    assert download.value.suggested_filename == f"incident-{incident}.mcap"

    with page.context.expect_page() as opened:
        page.locator("#report").click()
    report = opened.value
    watch(report, trouble)
    report.reload()
    expect(report.locator("h2")).to_have_text(f"Incident report {incident}")
    expect(report.locator("#verify")).to_contain_text("still had it")
    assert violations(report) == ""
    assert report.evaluate("getComputedStyle(document.querySelector('.bar-error')).fill") == "rgb(168, 13, 27)"
    report.close()

    page.locator("input[name=note]").fill("a <worn> cable")
    page.locator("button[name=save]").click()
    expect(page.locator("#said")).to_contain_text("a <worn> cable")
    page.locator("button[name=keep]").click()
    expect(page.locator("#incident .flag")).to_contain_text(["kept"])
    assert page.url.endswith(f"/incidents/{incident}"), page.url
    visit(page, server, "/incidents?kept=true&marked=false")
    expect(row).to_contain_text("a <worn> cable")


def test_the_operator_marks_a_moment_with_one_tap_and_sees_that_it_is_recorded(server, vehicle, page, trouble):
    prepare(server)
    log_in(page, server)
    body, mark = page.locator("body"), page.locator("button[name=mark]")
    # The page hears of the recorder over its connection, which a busy machine may let wait.
    expect(body).to_have_attribute("data-live", "live")
    # What the vehicle lacked while it started may still be recorded.
    expect(body).to_have_attribute("data-recorder", re.compile("ready|recording"))
    mark.click()
    expect(page.locator(".mark[data-marked]")).to_be_visible()
    expect(page.locator(".mark [role=status]")).to_contain_text("Marked in the recording.")
    expect(body).to_have_attribute("data-recorder", "recording")
    expect(page.locator(".recording")).to_contain_text("REC")
    ask = reader(server)
    marked = until(lambda: ask("/api/v1/incidents?marked=true"), 10, lambda: ask("/api/v1/incidents"))
    triggers = lambda: ask(f"/api/v1/incidents/{marked[0]['id']}")["triggers"]
    assert [it["what"] for it in triggers() if it["kind"] == "mark"] == [OPERATOR[0]]
    expect(page.locator(".mark:not([data-marked])")).to_be_visible()

    # A mark that did not arrive says so.
    page.route("**/api/v1/mark", lambda route: route.abort())
    mark.click()
    expect(page.locator("#notice .not-marked:visible")).to_contain_text("Not marked")
    trouble.expect("ERR_FAILED")
    page.unroute("**/api/v1/mark")
    mark.click()
    expect(page.locator("#notice")).to_be_hidden()

    # Developers mark with a note.
    page.context.clear_cookies()
    enter(page, server, *DEVELOPER)
    visit(page, server, "/incidents")
    page.locator("#mark input[name=note]").fill("a <b>bump</b>")
    page.locator("#mark button").click()
    page.wait_for_url("**/incidents")
    notes = lambda: [it["note"] for it in triggers()]
    until(lambda: "a <b>bump</b>" in notes(), 10, notes)


def test_a_report_needs_nothing_but_itself(server, vehicle, chromium, trouble, tmp_path):
    prepare(server)
    ask = reader(server)
    message = "no packets: " + "https://example.org/?q=" + "x" * 300
    vehicle.set(STATUS, 2, message)
    about = lambda: [it for it in ask("/api/v1/incidents") if CAUSE in it["roots"]]
    until(about, 20, lambda: ask("/api/v1/incidents"))
    incident = about()[0]["id"]
    # Beside the server, which still writes the recording.
    file = tmp_path / "report.html"
    said = subprocess.run(
        [TELLTALE, "incident", "export", str(incident), "--report", file, "--data", server.folder],
        capture_output=True, text=True, timeout=60,
    )
    assert said.returncode == 0 and "not finished" in said.stderr, said
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, offline=True, java_script_enabled=False)
    page = context.new_page()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    watch(page, trouble)
    page.goto(file.as_uri())
    expect(page.locator("h2")).to_have_text(f"Incident report {incident}")
    expect(page.locator("#story tbody")).to_contain_text(f"{CAUSE}: Error, “no packets: https://example.org")
    expect(page.locator(f"#states [data-node='{CAUSE}'] .bar-error")).not_to_have_count(0)
    expect(page.locator("#verify")).to_contain_text("has no hash")
    for width in (1280, 700):
        page.set_viewport_size({"width": width, "height": 800})
        size = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert size[0] <= size[1], f"something is wider than the window: {size}"
    # On paper.
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 688, "height": 1000})
    size = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert size[0] <= size[1], f"something is wider than the paper: {size}"
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")
    assert asked == [file.as_uri()], asked
    context.close()
