"""The developer's pages over real DDS: live, honest about it, and quick with thousands of modules."""

import re
import signal
import threading

import pytest
from playwright.sync_api import expect

from operating import enter
from vehicle import OPERATOR, Client, Server, Writer, own_domain, until

DEVELOPER = ("dora", "lantern-48-harbour")
CAUSE = "sensors/velodyne_packet_alive"
STATUS = "velodyne_packet_alive"


@pytest.fixture
def developer(server, vehicle, page):
    """A page of a developer's, of a vehicle that an operator has taken and that stands well."""
    prepare(server)
    enter(page, server, *DEVELOPER)
    return page


def prepare(server):
    """There is a developer, and an operator who took the vehicle, which stands well."""
    server.add_user(*DEVELOPER, role="developer")
    operator = Client(server, *OPERATOR)
    until(lambda: operator.snapshot()["overall"] == "ok", 20, operator.snapshot)
    operator.post("/vehicle/localize", stop="depot", version=operator.snapshot()["seq"])
    until(lambda: operator.snapshot()["stage"] == "standby", 20, operator.snapshot)
    until(lambda: operator.snapshot()["overall"] == "ok", 20, operator.snapshot)
    return operator


def visit(page, server, path):
    page.goto(server.url + path)
    expect(page.locator("body")).to_have_attribute("data-live", "live")


def row(page, module):
    return page.locator(f'tbody:last-child [data-module="{module}"]')


def test_statuses_are_live_and_the_keyboard_is_enough(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer")
    page.keyboard.press("f")
    page.keyboard.type("VELODYNE")
    expect(page.locator("#matching")).to_have_text("1")
    vehicle.set(STATUS, 2, "<b>no packets</b>")
    expect(row(page, CAUSE)).to_have_attribute("data-state", "error")
    expect(row(page, CAUSE)).to_contain_text("<b>no packets</b>")
    expect(page.locator("#dev-stage")).to_have_attribute("data-overall", "error")
    # The state has a word and a colour of its own; the stage is no alarm.
    expect(page.locator("#dev-stage .chip")).to_have_text("Error")
    grounds = page.evaluate("() => [...document.querySelectorAll('#dev-stage, #dev-stage .word, #dev-stage .chip')].map((it) => getComputedStyle(it).backgroundColor)")
    assert grounds[0] == grounds[1] != grounds[2], grounds
    page.keyboard.press("Escape")
    page.keyboard.press("j")
    page.keyboard.press("p")
    expect(page.locator(".pinned [data-module]")).to_have_count(1)
    page.keyboard.press("f")
    page.keyboard.press("Control+A")
    page.keyboard.type("odometry")
    expect(row(page, "localization/odometry")).to_have_attribute("data-reason", "masked")
    expect(page.locator(".pinned [data-module]")).to_have_count(1)
    page.reload()
    expect(page.locator(".pinned [data-module]")).to_have_count(1)
    expect(page.locator("#filter")).to_have_value("odometry")
    page.locator(".pinned [data-open]").focus()
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/developer/why"))
    expect(page.locator("#why")).to_contain_text("It reports: Error")
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()


def test_every_page_tells_of_a_fault_and_of_what_it_hides(server, vehicle, developer, trouble):
    page = developer
    vehicle.drive(True)
    vehicle.set(STATUS, 2, "no packets")
    visit(page, server, "/developer/masking")
    masked = page.locator("#masked")
    expect(masked.locator("tr", has_text="localization/tf_quality")).to_contain_text(CAUSE)
    visit(page, server, "/developer/graph")
    expect(page.locator(".line[data-hot]").first).to_be_attached()
    page.get_by_role("button", name="Close all").or_(page.get_by_role("link", name="Close all")).click()
    expect(page.locator(".node")).to_have_count(0)
    page.locator(".toggle").first.click()
    expect(page.locator(".node").first).to_be_visible()
    visit(page, server, "/developer/coverage")
    expect(page.locator('tr[data-group="can"] td')).to_have_count(6)
    page.locator('tr[data-group="can"] td a').click()
    expect(page.locator("#listed")).to_contain_text("can/battery")
    expect(page.locator("#listed h4")).to_have_text(["Components"])
    expect(page.locator("#coverage [data-technique] th")).to_have_text(["Components", "Data streams"])


def test_the_timeline_goes_on_and_back(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer/timeline?span=30")
    lane = page.locator('.lane[data-node="sensors"]')
    expect(lane.locator(".chip")).to_have_text("OK")
    # Wide enough to be pointed at.
    well = lane.locator(".bar-ok").last
    until(lambda: well.bounding_box()["width"] > 10, 10, lambda: f"time goes on: {well.bounding_box()}")
    vehicle.set(STATUS, 2, "no packets")
    expect(lane.locator(".bar-error")).to_be_attached()
    expect(lane.locator(".chip")).to_have_text("Error")
    expect(page.locator("#events")).to_contain_text("alarm raised")
    box = lane.locator(".bar-ok").last.bounding_box()
    strip = lane.locator("svg").bounding_box()
    at = round((box["x"] + box["width"] / 2 - strip["x"]) / strip["width"] * 1000)
    page.locator("[data-moment]").fill(str(at))
    expect(lane.locator(".chip")).to_have_text("OK")
    expect(page.locator(".past")).to_be_visible()
    page.get_by_role("link", name="Live", exact=True).click()
    expect(lane.locator(".chip")).to_have_text("Error")
    expect(page.locator(".past")).to_have_count(0)


def test_a_page_whose_server_hangs_says_so_and_comes_back(server, vehicle, developer, trouble):
    page = developer
    visit(page, server, "/developer")
    server.send(signal.SIGSTOP)
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    expect(page.locator(".late")).to_be_visible()
    server.send(signal.SIGCONT)
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    trouble.expect("WebSocket")


GROUPS, MODULES = 50, 100
ACT = """([act, done]) => new Promise((resolve) => {
  const start = performance.now();
  const is = () => new Function(`return ${done}`)();
  const look = () => {
    if (!is()) return;
    watch.disconnect();
    requestAnimationFrame(() => resolve(performance.now() - start));
  };
  const watch = new MutationObserver(look);
  watch.observe(document.querySelector("main"), { subtree: true, childList: true, characterData: true, attributes: true });
  new Function(act)();
})"""


def large_configuration(path):
    lines = ["vehicle: { id: large, name: Large, stages: none }", "defaults: { timeout: 60s }", "groups:"]
    for group in range(GROUPS):
        needs = f", depends_on: [g{group - 1:02}]" if group % 7 else ""
        modules = ", ".join(f"{{ id: m{m:03}, status: 'g{group:02}/s{m:03}' }}" for m in range(MODULES))
        lines.append(f"  - {{ id: g{group:02}{needs}, modules: [{modules}] }}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.alone
def test_five_thousand_modules_are_handled_in_a_tenth_of_a_second(chromium, tmp_path):
    config = large_configuration(tmp_path / "large.yaml")
    server = Server(tmp_path, own_domain(), config=config)
    server.add_user(*DEVELOPER, role="developer")
    server.start()
    writer = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "writer.log")
    ended = threading.Event()

    def publish():
        step = 0
        while not ended.wait(0.2):
            names = [divmod(step % 20 * 250 + index, MODULES) for index in range(250)]
            writer.write(
                statuses=[
                    {"level": 0, "name": f"g{g:02}/s{m:03}", "message": "fine", "hardware_id": "", "values": {"n": str(step)}}
                    for g, m in names
                ]
            )
            step += 1

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    # Scripts of a test are not part of the page: its policy must allow them.
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB", bypass_csp=True)
    page = context.new_page()
    try:
        enter(page, server, *DEVELOPER)
        visit(page, server, "/developer?sort=name")
        # Beside them there are Telltale's own modules.
        expect(page.locator("#matching")).to_have_text(re.compile(f"^{GROUPS * MODULES // 100}\\d\\d$"))
        every = page.locator("#matching").text_content()
        type_in = "const f = document.getElementById('filter'); f.value = '%s'; f.dispatchEvent(new Event('input', { bubbles: true }))"
        matching = "document.getElementById('matching').textContent === '%s'"
        first = "document.querySelector('#modules tbody:last-child tr').dataset.module === '%s'"
        click = "document.querySelector('[data-go=%s]').click()"
        acts = [
            (type_in % "g07/", matching % "100"),
            (type_in % "", matching % every),
            (click % "next", first % "g00/m030"),
            (click % "previous", first % "g00/m000"),
        ]
        # The best of a few rounds: other programs on this machine must not count.
        rounds = []
        for _ in range(4):
            times = sorted(page.evaluate(ACT, list(act)) for _ in range(5) for act in acts)
            rounds.append(times[int(len(times) * 0.95) - 1])
            if rounds[-1] < 100:
                break
        assert min(rounds) < 100, f"95th percentiles of the rounds in ms: {rounds}"
    finally:
        context.close()
        ended.set()
        thread.join()
        writer.close()
        server.stop()
