"""How long the machine, or a page on it, stood still: what took longer than it may then says nothing."""

import contextlib
import threading
import time


class Machine:
    """A thread that wants to run every 20 ms, and notes how late it was: at most, and in all."""

    EVERY_S = 0.02
    # What every machine does now and then.
    USUAL_S = 0.1

    def __init__(self):
        self.worst_s = self.total_s = 0.0
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            before = time.monotonic()
            time.sleep(self.EVERY_S)
            late_s = time.monotonic() - before - self.EVERY_S
            self.worst_s = max(self.worst_s, late_s)
            if late_s > self.USUAL_S:
                self.total_s += late_s


MACHINE = Machine()


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
