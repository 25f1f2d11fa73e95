"""A vehicle, a real hub and a console. The fleet keeps the heads of a vehicle's audit log: `telltale fleet verify` finds a log
that was put back, which the vehicle's own files do not show. An engineer fetches a recording on the console's page."""

import hashlib
import json
import re
import shutil

import pytest
from playwright.sync_api import expect

from accessible import violations
from hub import CONFIG, running_console, running_hub, telltale
from operating import enter
from vehicle import Client, Server, own_domain, until

# The vehicle looks for new records every 30 s.
pytestmark = pytest.mark.timed

ID = "shuttle-03"
# What holds the audit log, with its head and its key. The outbox to the fleet stays.
LOG = ("telltale.db", "telltale.db-wal", "telltale.db-shm", "audit.head", "audit.key")
TOLD_S = 60


@pytest.fixture
def hub(tmp_path):
    with running_hub(tmp_path, ID) as hub:
        yield hub


@pytest.fixture
def console_server(hub, tmp_path):
    with running_console(tmp_path, hub) as server:
        yield server


@pytest.fixture
def console(console_server):
    """The data folder of a console that runs."""
    return console_server.folder


def drive(data, config, console, is_told):
    """Lets the vehicle drive until the console has the expected heads."""
    server = Server(data, own_domain(), config=config).start()
    try:
        until(is_told, TOLD_S, lambda: f"the console is told: {verify(console)}\n{server.read_log()}")
    finally:
        assert server.stop() == 0, server.read_log()


def verify(console, *words):
    return telltale("fleet", "verify", ID, "--data", console, *words)


def last(console):
    """The number of the last head that the console was told."""
    found = re.search(r"^last  (\d+):", verify(console)[0], re.MULTILINE)
    return int(found[1]) if found else 0


def test_an_audit_log_that_was_put_back_is_found(hub, console, tmp_path):
    folder, url = hub
    data, old = tmp_path / "vehicle", tmp_path / "old"
    data.mkdir()
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG.format(id=ID, module="lidar", url=url, hub=folder))
    drive(data, config, console, lambda: last(console) > 0)
    shutil.copytree(data, old)
    records = int(telltale("audit", "verify", "--data", old)[0].split()[1])
    drive(data, config, console, lambda: last(console) > records)
    said, code = verify(console, "--audit", data)
    assert code == 0 and "ok " in said and "BAD" not in said, said
    said, code = verify(console)
    assert code == 0 and "give the vehicle's data folder with --audit" in said, said

    # The last drive is forgotten. Nothing in the vehicle shows it.
    for name in LOG:
        (data / name).unlink(missing_ok=True)
        if (old / name).exists():
            shutil.copy2(old / name, data / name)
    said, code = telltale("audit", "verify", "--data", data)
    assert code == 0 and said.startswith("ok"), said
    said, code = verify(console, "--audit", data)
    assert code == 1 and "BAD" in said, said
    said, code = verify(console, "--audit", data, "--key", old / "audit.key")
    assert code == 1 and "BAD" in said, said

    # It drives on: its new heads contradict its old ones, also without its log.
    drive(data, config, console, lambda: verify(console)[1] == 1)
    said, _ = verify(console)
    assert "BAD   told record" in said and "an older copy of its audit log" in said, said


def test_an_engineer_fetches_a_recording(hub, console_server, page, tmp_path):
    folder, url = hub
    data, config = tmp_path / "vehicle", tmp_path / "vehicle.yaml"
    data.mkdir()
    config.write_text(CONFIG.format(id=ID, module="lidar", url=url, hub=folder) + "recording: { after: 1s }\n")
    for role in ("engineer", "control_room"):
        console_server.add_user(role, "three words apart", role)
    vehicle = Server(data, own_domain(), config=config)
    vehicle.add_user("developer", "three words apart", "developer")
    vehicle.start()
    try:
        assert json.loads(Client(vehicle, "developer", "three words apart").post("/api/v1/mark", note="look at this"))["incident"] == 1
        enter(page, console_server, "control_room", "three words apart")
        address = f"{console_server.url}/vehicles/{ID}"
        until(lambda: page.goto(address).status == 200, TOLD_S, "the vehicle is heard")
        incident = page.locator("#incident-1")
        # The vehicle looks for incidents that ended every 30 s.
        expect(incident).to_contain_text(re.compile(r"\d B|kB|MB"), timeout=1000 * TOLD_S)
        expect(page.get_by_role("button", name="Fetch recording")).to_have_count(0)
        page.get_by_role("button", name="Log out").click()
        enter(page, console_server, "engineer", "three words apart")
        page.goto(address)
        button = page.get_by_role("button", name="Fetch recording 1", exact=True)
        expect(button).to_be_visible()
        assert not violations(page)
        button.click()
        download = page.get_by_role("link", name="Download recording 1", exact=True)
        expect(download).to_be_visible(timeout=30_000)
        expect(incident).to_contain_text("The recording is here.")
        assert not violations(page)
        with page.expect_download() as taken:
            download.click()
        fetched = tmp_path / "fetched.mcap"
        taken.value.save_as(fetched)
        said, code = telltale("incident", "verify", 1, "--data", data)
        assert code == 0 and hashlib.sha256(fetched.read_bytes()).hexdigest() in said, said
        said, code = telltale("replay", fetched)
        assert code == 0, said
    finally:
        assert vehicle.stop() == 0, vehicle.read_log()
