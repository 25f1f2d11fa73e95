"""A server, a vehicle and a browser page for each test that asks for them."""

import contextlib
import os

import pytest
from playwright.sync_api import expect, sync_playwright

from operating import expect_standing, log_in, watch
from vehicle import CHROMIUM, Vehicle, serving


# A busy machine may take this long for things that take a moment. Tests that measure time have limits of
# their own.
PATIENCE_MS = 20_000
expect.set_options(timeout=PATIENCE_MS)


def pytest_configure(config):
    config.addinivalue_line("markers", "alone: measures times close to their limits, so no other test may run beside it")
    config.addinivalue_line("markers", "timed: has limits of seconds, so at most one other test may run beside it")


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
