"""The statuses, worst first on lines of one height, and every table as a copy, as CSV and as JSON."""

import csv
import json
import re

from playwright.sync_api import expect

from accessible import violations
from test_developer import CAUSE, STATUS, developer, row, visit  # noqa: F401
from vehicle import until

FORMULA = '=HYPERLINK("http://evil";"x")'


def saved(page, table, form):
    button = page.locator(f"section:has({table}) .export [data-as={form}]")
    with page.expect_download() as download:
        button.click()
    name = download.value.suggested_filename
    assert re.fullmatch(rf"telltale-[\w-]+\.{form}|telltale-[\w-]+T[\d.]+Z\.{form}", name), name
    return download.value.path().read_text("utf-8-sig")


def test_the_worst_stands_first_and_every_row_is_one_line(server, vehicle, developer, trouble):
    page = developer
    vehicle.set(STATUS, 2, "no packets " * 30)
    visit(page, server, "/developer")
    rows = page.locator("#all [data-row]")
    expect(rows.first).to_have_attribute("data-module", CAUSE)
    expect(page.locator("#modules [aria-sort]")).to_contain_text("Shown")
    heights = lambda: {round(it) for it in page.evaluate("() => [...document.querySelectorAll('#all tr')].map((it) => it.getBoundingClientRect().height)")}
    assert heights() <= {28, 29}, heights()
    # The counts are those of what the text and the group leave, and lead to their states.
    expect(page.locator("#counts [data-state=error] b")).to_have_text("1")
    page.locator("#counts [data-state=ok]").click()
    expect(page.locator("#counts [data-state=ok]")).to_have_attribute("aria-current", "true")
    expect(page.locator("#all [data-state=error]")).to_have_count(0)
    expect(page.locator("#counts [data-state=error] b")).to_have_text("1")
    page.locator("#filter").fill("velodyne")
    expect(page.locator("#counts [data-state=ok] b")).to_have_text("0")
    page.locator("#counts [data-state='']").click()
    expect(row(page, CAUSE)).to_be_visible()
    assert violations(page) == ""
    # A value leads to its past.
    row(page, CAUSE).locator(".value").first.click()
    page.wait_for_url(re.compile("/developer/why.*#past"))
    expect(page.locator("#past .plot").first).to_be_attached()


def test_a_silent_module_is_marked(server, vehicle, developer, trouble):
    page = developer
    del vehicle.statuses[STATUS]
    visit(page, server, "/developer?q=velodyne")
    expect(row(page, CAUSE)).to_have_attribute("data-silent", "")
    expect(row(page, CAUSE)).to_contain_text("silent")


def test_a_table_is_saved_whole_and_holds_no_formula(server, vehicle, developer, trouble):
    page = developer
    vehicle.set(STATUS, 2, FORMULA)
    visit(page, server, "/developer")
    expect(row(page, CAUSE)).to_contain_text(FORMULA)
    count = int(page.locator("#matching").text_content())
    assert count > page.locator("#all tr").count(), "one page has all rows"
    rows = list(csv.DictReader(saved(page, "#modules", "csv").splitlines()))
    assert len(rows) == count
    ours = next(it for it in rows if it["Module"] == CAUSE)
    assert ours["Message"] == "'" + FORMULA and ours["Shown"] == "Error", ours
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT[\d:.]+Z", ours["Since"]), ours
    told = json.loads(saved(page, "#modules", "json"))
    assert len(told["rows"]) == count and told["page"] == "/developer", told["page"]
    assert next(it for it in told["rows"] if it["Module"] == CAUSE)["Message"] == FORMULA
    # The buttons stay while the page renews itself.
    at = page.locator("#dev").get_attribute("data-at")
    expect(page.locator("#dev")).not_to_have_attribute("data-at", at)
    expect(page.locator("section:has(#modules) .export")).to_have_count(1)


# The texts of a sheet that the buttons lie over.
COVERED = """() => [...document.querySelectorAll("#dev .export")].flatMap((row) => {
  const box = row.getBoundingClientRect();
  const around = [...row.parentElement.querySelectorAll(":is(p, h3, td, th, nav)")].filter((it) => !row.contains(it));
  return around.filter((it) => {
    const { top, bottom, height, width } = it.getBoundingClientRect();
    return height * width > 1 && top < box.bottom - 1 && bottom > box.top + 1;
  }).map((it) => it.textContent.trim());
})"""
NOTE_WORDS = """() => {
  window.said = [];
  const button = document.querySelector("section:has(#coverage) .export [data-as=copy]");
  new MutationObserver(() => window.said.push(button.textContent)).observe(button, { childList: true, characterData: true, subtree: true });
}"""


def test_a_table_is_copied_and_every_page_with_a_table_has_the_buttons(server, vehicle, developer, trouble):
    page = developer
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=server.url)
    vehicle.set(STATUS, 2, "-2+3")
    visit(page, server, "/developer/coverage")
    page.evaluate(NOTE_WORDS)
    page.locator("section:has(#coverage) .export [data-as=copy]").click()
    # It says so for a moment.
    page.wait_for_function("() => window.said.some((word) => word !== 'Copy')")
    assert page.evaluate("() => window.said.find((word) => word !== 'Copy')") == "Copied"
    copied = page.evaluate("() => navigator.clipboard.readText()").splitlines()
    assert copied[0].split("\t")[:4] == ["Group", "Isolated / Meta", "Isolated / Content", "Contextual / Meta"], copied[0]
    assert any(line.startswith("Sensors") for line in copied), copied
    visit(page, server, f"/developer/why?node={CAUSE.replace('/', '%2F')}")
    expect(page.locator("#transitions")).to_contain_text("-2+3")
    for path in ("/developer/topics", "/developer/audit", "/developer/why?node=sensors", "/developer/timeline"):
        visit(page, server, path)
        seen = lambda: page.locator("#dev table").count() == page.locator("#dev .export").count() > 0
        until(seen, 20, lambda: f"{path}: {page.locator('#dev .export').count()}")
    rows = list(csv.DictReader(saved(page, "#events", "csv").splitlines()))
    assert rows and set(rows[0]) == {"Time", "Event", "Of what", "Cause"}, rows[:1]
    # They stand in a row of their own, above what they save.
    for width, height in ((1280, 800), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        for path in ("/developer/audit", "/developer/why?node=sensors", "/developer/statistics"):
            visit(page, server, path)
            page.locator("#dev .export").first.wait_for()
            over = page.evaluate(COVERED)
            assert not over, (path, width, over)


def test_on_a_phone_nothing_lies_beside_the_window(server, vehicle, developer, trouble):
    page = developer
    vehicle.set(STATUS, 2, "no packets")
    visit(page, server, "/developer/timeline")
    until(lambda: page.goto(server.url + "/incidents") and page.locator("#incidents [data-row]").count(), 30, page.content)
    page.set_viewport_size({"width": 390, "height": 844})
    sheets = [
        ("/developer", ".sheet:has(#modules)"), ("/incidents", "#incidents"), ("/developer/timeline", "#timeline"),
        ("/developer/masking", ".sheet:has(.cards)"), ("/developer/audit", "#audit"), ("/developer/statistics", "#statistics"),
        (f"/developer/why?node={CAUSE.replace('/', '%2F')}", "#transitions"),
    ]
    for path, sheet in sheets:
        visit(page, server, path)
        beside = page.locator(sheet).first.evaluate("it => it.scrollWidth - it.clientWidth")
        assert beside == 0, (path, beside)
    # A strip has the whole width below its name, and a status says its state once.
    visit(page, server, "/developer/timeline")
    lane = page.locator('.lane[data-node="sensors"]')
    name, strip = lane.locator(".label").bounding_box(), lane.locator("svg").bounding_box()
    assert strip["y"] >= name["y"] + name["height"] and strip["width"] > 300, (name, strip)
    # In the window of a small laptop no column is beside it either.
    page.set_viewport_size({"width": 1024, "height": 768})
    for path, sheet in sheets[:2]:
        visit(page, server, path)
        assert page.locator(sheet).evaluate("it => it.scrollWidth - it.clientWidth") == 0, path
    # In a large one, with larger type, a time of day is whole.
    page.set_viewport_size({"width": 1920, "height": 1080})
    visit(page, server, "/developer")
    assert page.locator("#modules td:has(time)").evaluate_all("all => all.filter(it => it.scrollWidth > it.clientWidth).length") == 0
    page.set_viewport_size({"width": 390, "height": 844})
    visit(page, server, "/developer")
    expect(row(page, CAUSE).locator(".own")).to_be_hidden()
    expect(row(page, CAUSE).locator(".message")).to_be_in_viewport()
