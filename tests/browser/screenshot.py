"""Makes docs/screenshot.png from the running demo: the LiDAR has failed while the shuttle drives.

    tests/run.sh screenshot
"""

import os
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from vehicle import CHROMIUM, ROOT, Client, Server, own_domain, until

OPERATOR = ("operator", "246810")
DEPARTURE_S = 40


def main():
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/screenshot.png"
    server = Server(Path(tempfile.mkdtemp(prefix="telltale-")), own_domain(), "demo").start()
    try:
        with sync_playwright() as playwright:
            arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
            page = browser.new_page(viewport={"width": 1280, "height": 800}, locale="en-GB")
            page.goto(server.url + "/login")
            page.locator("[name=name]").fill(OPERATOR[0])
            page.locator("[name=secret]").fill(OPERATOR[1])
            page.locator("[name=secret]").press("Enter")
            page.locator("body[data-live=live]").wait_for()
            client = Client(server, *OPERATOR)
            until(lambda: client.snapshot()["stage"] == "active", DEPARTURE_S, "departure")
            client.post("/demo/fault", name="sensor_outage", active="true")
            page.locator("#tile-sensors[data-state=error]").wait_for()
            page.locator("#tile-execution[data-reason=masked]").wait_for()
            page.screenshot(path=target)
            browser.close()
    finally:
        server.stop()
    print(target)


if __name__ == "__main__":
    main()
