"""Makes docs/screens/ from the running demo: every state of the operator's page, by night in
English and by day in German, at 5/8 of its size.

    tests/run.sh screens
"""

import os
import re
import signal
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import expect, sync_playwright

from operating import DEMO_OPERATOR, DISPLAY, acknowledge_all, clear, get_going, localize, release, stage, step, type_by_touch
from vehicle import CHROMIUM, ROOT, Client, Server, own_domain

SCALE = 0.625


class Camera:
    def __init__(self, page, folder, suffix):
        self.page, self.folder, self.suffix = page, folder, suffix

    def take(self, name, settled_ms=600):
        self.page.wait_for_timeout(settled_ms)
        self.page.screenshot(path=self.folder / f"{name}-{self.suffix}.png")
        print(f"{name}-{self.suffix}", flush=True)


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/screens"
    folder.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        for lang, palette in (("en", "night"), ("de", "day")):
            server = Server(Path(tempfile.mkdtemp(prefix="telltale-")), own_domain() + 42, "demo").start()
            try:
                context = browser.new_context(
                    viewport=DISPLAY, device_scale_factor=SCALE, has_touch=True, reduced_motion="reduce"
                )
                context.set_default_timeout(20_000)
                cookies = {"lang": lang, "palette": palette}
                context.add_cookies([{"name": k, "value": v, "url": server.url} for k, v in cookies.items()])
                page = context.new_page()
                story(page, server, Camera(page, folder, f"{palette}-{lang}"))
                context.close()
            finally:
                server.send(signal.SIGCONT)
                server.stop()
        browser.close()


def story(page, server, camera):
    page.goto(server.url + "/login")
    camera.take("locked")
    type_by_touch(page, *DEMO_OPERATOR)
    camera.take("login")
    page.locator(".digits [data-key=enter]").tap()
    stage(page, "localizing")
    client = Client(server, *DEMO_OPERATOR)
    camera.take("localizing")
    client.post("/demo/fault", name="low_battery", active="true")
    localize(page)
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "warning")
    camera.take("standby")
    # A disabled button takes a tap all the same, and says why nothing happens.
    step(page, "clearance").tap(force=True)
    expect(page.locator("#actions[data-refused]")).to_be_visible()
    camera.take("refused")
    # The sheet of all checks opens where they have no room.
    page.keyboard.press("Escape")
    client.post("/demo/fault", name="low_battery", active="false")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "ok")
    ready = page.locator("#actions button[name=clearance]:not([aria-disabled])")
    expect(ready).to_be_visible(timeout=40_000)
    camera.take("ready")
    ready.tap()
    camera.take("confirm")
    # A change meanwhile withdraws the question.
    if not step(page, "confirm").is_visible():
        clear(page)
    else:
        step(page, "confirm").tap()
    stage(page, "active", 20)
    expect(page.locator("#causes .calm")).to_be_visible()
    camera.take("active")
    client.post("/demo/fault", name="low_battery", active="true")
    expect(page.locator("#tile-can")).to_have_attribute("data-state", "warning")
    camera.take("warning")
    client.post("/demo/fault", name="sensor_outage", active="true")
    expect(page.locator("#causes [data-node]").first).to_have_attribute("data-node", "sensors/velodyne_packet_alive")
    expect(page.locator("#tile-execution")).to_have_attribute("data-reason", "masked")
    expect(page.locator("#countermeasure")).to_have_attribute("data-state", "engaged")
    page.wait_for_timeout(3000)
    camera.take("two")
    client.post("/demo/fault", name="sensor_outage", active="false")
    client.post("/demo/fault", name="low_battery", active="false")
    expect(page.locator("#instruction strong")).to_have_text(re.compile("Weiterfahren|Continue"))
    expect(page.locator("#causes [data-node]")).to_have_count(0)
    camera.take("held")
    acknowledge_all(page)
    release(page)
    get_going(page)
    client.post("/demo/fault", name="localization_jump", active="true")
    expect(page.locator("#tile-execution")).to_have_attribute("data-reason", "masked")
    expect(page.locator("#countermeasure")).to_have_attribute("data-state", "engaged")
    camera.take("fault")
    page.locator("#tile-perception").tap()
    camera.take("detail")
    page.keyboard.press("Escape")
    server.send(signal.SIGSTOP)
    expect(page.locator("body")).to_have_attribute("data-live", "stale")
    camera.take("stale", settled_ms=50)
    expect(page.locator("body")).to_have_attribute("data-live", "dead")
    camera.take("dead")


if __name__ == "__main__":
    main()
