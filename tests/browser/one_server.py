"""Fixtures for test files whose tests change nothing that lasts: one server and one vehicle for the whole file."""

import contextlib

import pytest

from vehicle import Vehicle, serving


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("server")) as server:
        yield server


@pytest.fixture(scope="module")
def vehicle(server):
    with contextlib.closing(Vehicle(server.domain, server.folder)) as vehicle:
        yield vehicle
