"""The developer's pages of incidents: from a fault over real DDS to its story."""

import json

import pytest
from playwright.sync_api import expect

from accessible import violations
from operating import enter
from test_developer import CAUSE, DEVELOPER, STATUS, prepare, visit
from vehicle import Client, until


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
    assert violations(page) == ""
    row.locator("[data-open]").click()
    page.wait_for_url(f"**/incidents/{incident}")
    expect(page.locator("#story tbody")).to_contain_text("hides: ")
    expect(page.locator(f"#states [data-node='{CAUSE}'] .bar-error")).not_to_have_count(0)
    expect(page.locator("#freeze")).to_contain_text(CAUSE)
    expect(page.locator("[data-topic='/diagnostics']")).to_be_visible()
    assert violations(page) == ""
    with page.expect_download() as download:
        page.locator("#download").click()
    assert download.value.suggested_filename == f"incident-{incident}.mcap"

    page.locator("input[name=note]").fill("a <worn> cable")
    page.locator("button[name=save]").click()
    expect(page.locator("#said")).to_contain_text("a <worn> cable")
    page.locator("button[name=keep]").click()
    expect(page.locator("#incident .flag")).to_contain_text(["kept"])
    assert page.url.endswith(f"/incidents/{incident}"), page.url
    visit(page, server, "/incidents?kept=true&marked=false")
    expect(row).to_contain_text("a <worn> cable")
