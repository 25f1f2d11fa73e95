"""How long the machine, or a page on it, stood still: what took longer than it may then says nothing."""

import contextlib
import threading
import time


class Machine:
    """A thread that wants to run every 20 ms, and notes how late it was."""

    EVERY_S = 0.02

    def __init__(self):
        self.worst_s = 0.0
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            before = time.monotonic()
            time.sleep(self.EVERY_S)
            self.worst_s = max(self.worst_s, time.monotonic() - before - self.EVERY_S)


# The same in a page, where scripts run one after the other.
WATCH = """() => {
  window.stoodStill = 0;
  let before = performance.now();
  window.standing = setInterval(() => {
    const now = performance.now();
    window.stoodStill = Math.max(window.stoodStill, now - before - 20);
    before = now;
  }, 20);
}"""


@contextlib.contextmanager
def stalled(page):
    """Gives a function: for how many seconds the page stood still meanwhile, at most at once."""
    page.evaluate(WATCH)
    yield lambda: page.evaluate("() => window.stoodStill") / 1000
    page.evaluate("() => clearInterval(window.standing)")
