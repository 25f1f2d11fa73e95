"""What stands around a browser test: the real server, and the foreign DDS peers of a vehicle."""

import contextlib
import functools
import http.cookiejar
import itertools
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from programs import PYTHON, ROOT, TELLTALE, peer, until  # noqa: F401

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium-headless-shell") or shutil.which("chromium")
# The vehicle of these tests speaks on /diagnostics alone.
CONFIG = ROOT / "config/self-diagnosing-shuttle.yaml"
OPERATOR = ("anna", "975310")
STARTUP_S = 20
STOP = "rt/telltale/maneuver_stop_request"


def lock(domain):
    """A socket that keeps other processes off this DDS domain while it is bound, the tests in Rust too
    (`tests/it/peer.rs`); `None` where another one holds it."""
    held = socket.socket()
    try:
        held.bind(("127.0.0.1", 5200 + domain))
        return held
    except OSError:
        held.close()
        return None


LOCKS = []


@functools.cache
def own_domain():
    """The DDS domain of this process, which no other one uses; those 40 to 45 above it are its own too.
    Up to 101 their ports stay below the range from which the kernel gives out others."""
    for step in range(50):
        domain = 1 + (os.getpid() + step) % 50
        held = [lock(it) for it in (domain, *range(domain + 40, domain + 46))]
        if all(held):
            LOCKS.extend(held)
            return domain
        for taken in filter(None, held):
            taken.close()
    raise AssertionError("no free DDS domain for a test")


PORTS = itertools.count()


def free_port():
    """A port that no connection of another program gets meanwhile: below those that the kernel gives
    out, in a range that goes with the domain of this process."""
    for _ in range(100):
        port = 10_000 + 100 * own_domain() + next(PORTS) % 100
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue
    raise AssertionError("no free port for a test")


class Server:
    """`telltale serve` or `telltale demo` on a port and a data folder of its own."""

    def __init__(self, folder, domain, command="serve", flags=(), config=CONFIG, interface="127.0.0.1"):
        self.folder, self.domain, self.command, self.flags = folder, domain, command, flags
        self.interface = interface
        self.config = config
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.process = None

    def add_user(self, name, secret, role="operator"):
        words = [TELLTALE, "user", "add", name, "--role", role, "--data", str(self.folder)]
        subprocess.run(words, input=f"{secret}\n{secret}\n", text=True, check=True, capture_output=True, timeout=30)

    def start(self):
        words = [TELLTALE, self.command, "--listen", f"127.0.0.1:{self.port}", "--domain", str(self.domain), *self.flags]
        if self.command == "serve":
            words += ["--config", str(self.config), "--data", str(self.folder), "--interface", self.interface]
        return self.run(words)

    def run(self, words):
        """Starts it by these words, and waits until it answers."""
        self.log = open(self.folder / f"{self.command}.log", "ab")
        self.process = subprocess.Popen(list(map(str, words)), stdout=self.log, stderr=self.log, stdin=subprocess.DEVNULL)
        until(self.answers, STARTUP_S, lambda: f"the server answers\n{self.read_log()}")
        return self

    def answers(self):
        assert self.process.poll() is None, f"the server ended:\n{self.read_log()}"
        try:
            with urllib.request.urlopen(self.url + "/healthz", timeout=1) as answer:
                return answer.status == 200
        except (urllib.error.URLError, OSError):
            return False

    def children(self):
        """The DDS processes."""
        task = Path(f"/proc/{self.process.pid}/task")
        with contextlib.suppress(OSError):
            return [int(pid) for part in task.iterdir() for pid in (part / "children").read_text().split()]
        return []

    def memory_mb(self):
        """What all its processes hold."""
        return sum(map(megabytes, [self.process.pid, *self.children()]))

    def read_log(self):
        return (self.folder / f"{self.command}.log").read_text(errors="replace")

    def send(self, number):
        self.process.send_signal(number)

    def pause(self):
        """Stops it, as Ctrl-Z does, and waits until it has stopped; SIGCONT lets it go on."""
        self.send(signal.SIGSTOP)
        os.waitpid(self.process.pid, os.WUNTRACED)

    def kill(self):
        self.process.kill()
        self.process.wait(timeout=10)
        self.log.close()

    def stop(self):
        """Asks it to end, as systemd does, and returns its exit code."""
        if self.process is None or self.process.poll() is not None:
            return self.process and self.process.returncode
        self.send(signal.SIGCONT)
        self.send(signal.SIGTERM)
        try:
            return self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"the server does not end on SIGTERM:\n{self.read_log()}") from None
        finally:
            self.log.close()


def megabytes(pid):
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
    return 0


@contextlib.contextmanager
def serving(folder, **options):
    """A server that an operator can log in to, which has to end well."""
    server = Server(folder, own_domain(), **options)
    server.add_user(*OPERATOR)
    server.start()
    try:
        yield server
    except BaseException:
        server.stop()
        raise
    code = server.stop()
    assert code == 0, f"exit code {code}:\n{server.read_log()}"


class Client:
    """A program with a session, as the HTTP interface offers it."""

    def __init__(self, server, name, secret, **more):
        self.server = server
        self.jar = http.cookiejar.CookieJar()
        self.opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(self.jar))
        self.post("/login", name=name, secret=secret, **more)
        assert self.cookie(), f"no session for {name}"

    def cookie(self):
        return "; ".join(f"{cookie.name}={cookie.value}" for cookie in self.jar)

    def browser_cookies(self):
        """The session, as a browser takes it."""
        return [{"name": it.name, "value": it.value, "url": self.server.url} for it in self.jar]

    def post(self, path, **fields):
        body = urllib.parse.urlencode(fields).encode()
        headers = {"Origin": self.server.url, "Accept": "application/json"}
        request = urllib.request.Request(self.server.url + path, data=body, headers=headers)
        with self.opener.open(request, timeout=10) as answer:
            return answer.read()

    def stop(self):
        """Requests a stop, which counts as sent as soon as somebody of the vehicle listens."""
        until(self.was_stop_sent, 20, "the vehicle listens")

    def release(self):
        """Lets the vehicle go on, before a display that confirms what it is shown."""
        with Display(self.server, self):
            until(self.was_released, 20, "the release is granted")

    def was_released(self):
        if all(it["request"] == "notify" for it in self.snapshot()["countermeasures"]):
            return True
        try:
            token = json.loads(self.post("/vehicle/release", version=self.snapshot()["seq"]))["token"]
            self.post("/vehicle/release/confirm", token=token)
        except urllib.error.HTTPError as error:
            # The display has confirmed nothing yet, or something has changed.
            assert error.code == 409, error.read()
            return False
        return True

    def was_stop_sent(self):
        try:
            self.post("/vehicle/stop", version=self.snapshot()["seq"])
        except urllib.error.HTTPError as error:
            assert error.code == 503, error.read()
            return False
        return True

    def snapshot(self):
        with self.opener.open(self.server.url + "/api/v1/snapshot", timeout=10) as answer:
            return json.load(answer)


class Display:
    """A page on the socket of the operator's screen, without a browser: it confirms every message."""

    def __init__(self, server, client):
        url = server.url.replace("http", "ws", 1) + "/ws"
        self.opening = connect(url, additional_headers={"Cookie": client.cookie()}, origin=server.url, max_size=2**22)
        self.thread = threading.Thread(target=self.confirm)

    def __enter__(self):
        self.socket = self.opening.__enter__()
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.opening.__exit__(*error)
        self.thread.join()

    def confirm(self):
        with contextlib.suppress(ConnectionClosed):
            for message in self.socket:
                said = json.loads(message)
                if "seq" in said:
                    self.socket.send(json.dumps({"shown": said["seq"], **({"beat": said["beat"]} if "beat" in said else {})}))


class Writer:
    """One topic of a foreign DDS participant in a process of its own, elsewhere where `by` and `options` say so."""

    def __init__(self, domain, topic, type_name, log, by=(), options=()):
        self.program = peer(domain, *options, "pub", "--topic", topic, "--type", type_name, by=by, log=log)
        self.write, self.close, self.kill, self.ends = self.program.tell, self.program.close, self.program.kill, self.program.ends


def listener(domain, **more):
    """A node of the vehicle that listens to what it may be asked for."""
    return peer(domain, "sub", "--topic", f"{STOP}=Bool", **more)


class Vehicle:
    """Publishes every status that the configuration names, ten times a second, and the signal."""

    PERIOD_S = 0.1

    def __init__(self, domain, folder, options=()):
        found = re.findall(r"\bstatus: (?:'([^']+)'|([^\s},]+))", CONFIG.read_text())
        names = [quoted or plain for quoted, plain in found]
        assert len(names) > 20, f"statuses found in {CONFIG}: {names}"
        self.statuses = {name: (0, "fine") for name in names}
        self.active = False
        self.diagnostics = Writer(domain, "rt/diagnostics", "DiagnosticArray", folder / "diagnostics.log", options=options)
        self.signal = Writer(domain, "rt/mission/active", "Bool", folder / "active.log", options=options)
        self.listener = peer(domain, *options, "sub", "--topic", f"{STOP}=Bool", log=folder / "listener.log")
        self.lock = threading.Lock()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.ended.wait(self.PERIOD_S):
            self.publish()

    def publish(self):
        with self.lock:
            self.signal.write(bool=self.active)
            statuses = [
                {"level": level, "name": name, "message": message, "hardware_id": "vehicle", "values": {"n": "1"}}
                for name, (level, message) in self.statuses.items()
            ]
            self.diagnostics.write(statuses=statuses)

    def set(self, name, level, message="fine"):
        assert name in self.statuses, name
        self.statuses[name] = (level, message)
        self.publish()

    def drive(self, active):
        self.active = active
        self.publish()

    def close(self):
        self.ended.set()
        self.thread.join(timeout=10)
        for part in (self.diagnostics, self.signal, self.listener):
            part.close()
