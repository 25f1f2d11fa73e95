"""A real hub of a fleet, with the vehicles that it admits, and a console over it."""

import contextlib
import os
import subprocess

from programs import Program
from vehicle import STARTUP_S, TELLTALE, Server, free_port, own_domain, until

NATS = os.environ.get("TELLTALE_NATS_SERVER") or "nats-server"
CONFIG = """vehicle: {{ id: {id}, stages: none }}
fleet: {{ hub: '{url}', credentials: {hub}/{id}.nk, ca: {hub}/hub.pem }}
groups:
  - {{ id: sensors, modules: [{{ id: {module}, status: {module}, timeout: 1h }}] }}
"""


def telltale(*words):
    done = subprocess.run([TELLTALE, *map(str, words)], capture_output=True, text=True, timeout=60)
    return done.stdout + done.stderr, done.returncode


@contextlib.contextmanager
def running_hub(root, *ids):
    """Its folder and its address."""
    folder, url = root / "hub", f"tls://127.0.0.1:{free_port()}"
    enrol = [["enrol", id, "--dir", folder] for id in ids]
    for words in (["hub-config", folder, "--listen", url.removeprefix("tls://"), "--disk", 1], *enrol):
        said, code = telltale("fleet", *words)
        assert code == 0, said
    server = Program("env", "-C", folder, NATS, "-c", "nats-server.conf", log=root / "hub.log")
    streams = lambda: telltale("fleet", "streams", "--dir", folder, "--hub", url, "--disk", 1)
    until(lambda: streams()[1] == 0, STARTUP_S, lambda: f"the hub starts: {streams()}")
    yield folder, url
    server.kill()


@contextlib.contextmanager
def running_console(root, hub, *flags):
    folder, url = hub
    data = root / "console"
    data.mkdir()
    server = Server(data, own_domain(), "console")
    words = [TELLTALE, "fleet", "serve", "--hub", url, "--credentials", folder / "console.nk", "--data", data]
    server.run([*words, "--listen", f"127.0.0.1:{server.port}", *flags])
    yield server
    assert server.stop() == 0, server.read_log()
