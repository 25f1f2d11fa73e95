"""Makes docs/screenshot.png from the running demo: the LiDAR has failed while the shuttle drives.

    tests/run.sh screenshot
"""

import os
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from operating import DEMO_OPERATOR, clear, get_going, localize, log_in_by_touch, stage, touch_context
from vehicle import CHROMIUM, ROOT, Client, Server, own_domain


def main():
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/screenshot.png"
    server = Server(Path(tempfile.mkdtemp(prefix="telltale-")), own_domain(), "demo").start()
    try:
        with sync_playwright() as playwright:
            arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
            page = touch_context(browser, reduced_motion="reduce").new_page()
            log_in_by_touch(page, server, *DEMO_OPERATOR)
            localize(page)
            clear(page)
            stage(page, "active", 20)
            get_going(page)
            Client(server, *DEMO_OPERATOR).post("/demo/fault", name="sensor_outage", active="true")
            page.locator("#tile-sensors[data-state=error]").wait_for()
            page.locator("#tile-execution[data-reason=masked]").wait_for()
            page.locator("#countermeasure[data-state=engaged]").wait_for()
            page.wait_for_timeout(1000)
            page.screenshot(path=target)
            browser.close()
    finally:
        server.stop()
    print(target)


if __name__ == "__main__":
    main()
