"""A server, a vehicle and a browser page for each test that asks for them."""

import contextlib
import os

import pytest
from _pytest.runner import runtestprotocol
from playwright.sync_api import expect, sync_playwright

from operating import expect_standing, log_in, watch
from stall import MACHINE
from vehicle import CHROMIUM, Vehicle, serving


# A busy machine may take this long for things that take a moment. Tests that measure time have limits of
# their own.
PATIENCE_MS = 20_000
expect.set_options(timeout=PATIENCE_MS)


def pytest_configure(config):
    config.addinivalue_line("markers", "alone: measures times close to their limits, so no other test may run beside it")
    config.addinivalue_line("markers", "timed: has limits of seconds, so at most two other tests may run beside it")


# A machine that stood still for so long says nothing about the times of a program on it: of the ten messages a second that
# the simulated planner sends, its monitor misses two.
STALL_S = 0.2


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Repeats a test once, and says so, if it failed while the machine stood still: a display grows stale
    meanwhile, and sends no tap."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    MACHINE.worst_s = 0.0
    reports = runtestprotocol(item, nextitem=nextitem, log=False)
    if any(report.failed for report in reports) and MACHINE.worst_s > STALL_S:
        why = "\n".join(report.longreprtext for report in reports if report.failed)
        item.warn(UserWarning(f"repeated: the machine stood still for {MACHINE.worst_s:.2f} s when it failed:\n{why}"))
        item._initrequest()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.fixture(scope="session")
def chromium():
    # Chromium's own sandbox needs a user that is not root.
    arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def server(request, tmp_path):
    with serving(tmp_path, **getattr(request, "param", {})) as server:
        yield server


@pytest.fixture
def vehicle(server, tmp_path):
    with contextlib.closing(Vehicle(server.domain, tmp_path)) as vehicle:
        yield vehicle


class Trouble(list):
    """What the browser complained about."""

    def expect(self, *parts):
        """Forgets complaints that a test provokes: those which contain one of these parts."""
        self[:] = [text for text in self if not any(part in text for part in parts)]


@pytest.fixture
def trouble():
    """Errors on the console, uncaught exceptions and breaches of the content security policy:
    any of them fails the test."""
    trouble = Trouble()
    yield trouble
    assert not trouble, "\n".join(trouble)


@pytest.fixture
def page(chromium, trouble):
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB")
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    watch(page, trouble)
    yield page
    context.close()


@pytest.fixture
def driving(server, vehicle, page):
    """An operator's page of a vehicle that drives."""
    log_in(page, server)
    expect_standing(page)
    vehicle.drive(True)
    expect(page.locator("body")).to_have_attribute("data-stage", "active")
    return page
