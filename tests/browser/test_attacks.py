"""STOP is answered within a second while strangers, or accounts that may only read, attack the server."""

import json
import os
import selectors
import socket
import threading
import time
import urllib.error

import pytest
from playwright.sync_api import expect

from operating import step
from programs import peer, until
from vehicle import OPERATOR, Client, megabytes

pytestmark = pytest.mark.timed

# The folder for pictures of the page, for people to look at.
SCREENS = os.environ.get("TELLTALE_SCREENS")
STOPS = 10
STOP_EVERY_S = 0.5
ANSWERED_WITHIN_S = 1.0
BACK_S = 5


class Attack:
    """Connections that begin a request and do not go on; those that the server ends begin anew."""

    def __init__(self, server, begins):
        self.server, self.begins = server, begins
        self.open = [self.connect(begin) for begin in begins]

    def connect(self, begin):
        it = socket.create_connection(("127.0.0.1", self.server.port), timeout=5)
        it.sendall(begin)
        it.setblocking(False)
        return it

    def renew(self):
        for number, it in enumerate(self.open):
            try:
                ended = it.recv(4096) is not None
            except BlockingIOError:
                ended = False
            except OSError:
                ended = True
            if ended:
                it.close()
                self.open[number] = self.connect(self.begins[number])

    def close(self):
        for it in self.open:
            it.close()


def unfinished_login(server):
    head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: {server.url}\r\n"
    form = "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 100\r\n\r\nname=a"
    return (head + form).encode()


def check_stops(client, attack, driving, stops=STOPS, replaced=False):
    """Each of many stops is answered in time during the attack, and the driver's page stays live. Returns what the
    attack says at its end. `replaced`: the attack has the DDS process replaced, and a stop meanwhile may be told that
    nobody hears it yet."""
    took = []
    try:
        for _ in range(stops):
            attack.renew()
            version = client.snapshot()["seq"]
            asked = time.monotonic()
            try:
                client.post("/vehicle/stop", version=version)
            except urllib.error.HTTPError as error:
                told = error.read().decode()
                assert replaced and error.code == 503 and "Nobody listens" in told, (error.code, told)
            took.append(time.monotonic() - asked)
            time.sleep(STOP_EVERY_S)
    finally:
        said = attack.close()
    assert max(took) < ANSWERED_WITHIN_S, took
    # Where DDS was replaced, the last messages of the flood are still being read.
    expect(driving.locator("body")).to_have_attribute("data-live", "live", timeout=1000 * (BACK_S if replaced else 1))
    return said


def wrong_login(server):
    body = "name=operator&secret=135791"
    head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: {server.url}\r\nConnection: close\r\n"
    form = f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(body)}\r\n\r\n"
    return (head + form + body).encode()


def too_large(server):
    head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: {server.url}\r\n"
    form = "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 1000000000\r\n\r\n"
    return (head + form).encode() + 16_000 * b"a"


# What strangers send on each of so many connections.
STRANGERS = {
    "unfinished_logins": (128, unfinished_login),
    "wrong_logins": (64, wrong_login),
    "too_large_bodies": (128, too_large),
    "unfinished_heads": (512, lambda server: b"GET / HTTP/1.1\r\nHost: 127"),
    "silent_connections": (512, lambda server: b""),
}
# The memory of two hashes at once, 19 MiB each, and of the requests.
KEPT_MB = 100


@pytest.mark.parametrize("strangers", STRANGERS)
def test_stops_are_answered_beside_strangers(server, driving, trouble, strangers):
    client = Client(server, *OPERATOR)
    client.stop()
    before_mb = megabytes(server.process.pid)
    count, begin = STRANGERS[strangers]
    check_stops(client, Attack(server, count * [begin(server)]), driving)
    until(lambda: megabytes(server.process.pid) < before_mb + KEPT_MB, 5, "the memory returns")


# Requests of accounts that may only read, compressed, eight times at once on each of 40 connections.
READ = {
    "description": "/api/v1/openapi.json",
    "history": "/api/v1/history?since=1970-01-01T00:00:00Z&count=5000",
    "schema": "/api/v1/schema/snapshot.json",
    "page": "/developer/api",
}
READ_AT_ONCE = 8
READING = 40


class Reading:
    """Asks again for each answer, as fast as they come."""

    def __init__(self, server, readers, path):
        self.server, self.ended = server, threading.Event()
        host = f"Host: 127.0.0.1:{server.port}\r\nAccept-Encoding: br, gzip\r\n"
        self.asks = [f"GET {path} HTTP/1.1\r\n{host}Cookie: {it.cookie()}\r\n\r\n".encode() for it in readers]
        self.answers = 0
        self.thread = threading.Thread(target=self.read)
        self.thread.start()

    def connect(self, ask):
        it = socket.create_connection(("127.0.0.1", self.server.port), timeout=5)
        it.sendall(READ_AT_ONCE * ask)
        it.setblocking(False)
        self.selector.register(it, selectors.EVENT_READ, ask)

    def read(self):
        with selectors.DefaultSelector() as self.selector:
            for ask in READING * self.asks:
                self.connect(ask)
            while not self.ended.is_set():
                for key, _ in self.selector.select(0.1):
                    self.go_on(key.fileobj, key.data)
            for key in list(self.selector.get_map().values()):
                key.fileobj.close()

    def go_on(self, it, ask):
        try:
            read = it.recv(1 << 18)
            count = read.count(b"HTTP/1.1 200")
            self.answers += count
            it.send(max(count, read.count(b"HTTP/1.1 ")) * ask)
        except BlockingIOError:
            return
        except OSError:
            read = b""
        if not read:
            self.selector.unregister(it)
            it.close()
            self.connect(ask)

    def renew(self):
        """It goes on by itself."""

    def close(self):
        self.ended.set()
        self.thread.join()
        return self.answers


@pytest.mark.parametrize("read", READ)
def test_stops_are_answered_beside_accounts_that_read(server, driving, trouble, read):
    client = Client(server, *OPERATOR)
    client.stop()
    readers = []
    for name in ("carl", "cora"):
        server.add_user(name, "a long password", role="authority")
        readers.append(Client(server, name, "a long password"))
    answers = check_stops(client, Reading(server, readers, READ[read]), driving)
    assert answers > STOPS, "they are answered too"


FRAGMENTS = b"\x01\x80\0\0\0\0" + b"\0\x80\0\0\0\0" * 20_000


# Pings whose answers nobody reads.
PINGS = b"\x89\xfd\0\0\0\0" + 125 * b"p"


class Flood(Attack):
    """Sockets of somebody who may only read, which send empty fragments or pings without an end."""

    def __init__(self, server, begins, said):
        self.said = said
        super().__init__(server, begins)

    def connect(self, begin):
        it = super().connect(begin)
        it.setblocking(True)
        it.recv(4096)
        it.setblocking(False)
        try:
            it.send(self.said)
        except OSError:
            pass
        return it

    def close(self):
        """Each has sent more than one socket may: the server ends it."""
        for number, it in enumerate(self.open):
            it.settimeout(BACK_S)
            until(lambda: not has_more(it), BACK_S, f"socket {number} is ended")
        super().close()


def has_more(it):
    try:
        return it.recv(1 << 20) != b""
    except ConnectionError:
        return False


@pytest.mark.parametrize("said", [FRAGMENTS, 5_000 * PINGS], ids=["fragments", "pings"])
def test_stops_are_answered_beside_sockets_that_send_without_an_end(server, driving, trouble, said):
    server.add_user("carl", "a long password", role="authority")
    client = Client(server, *OPERATOR)
    client.stop()
    # One login may have 16 of them.
    readers = [Client(server, "carl", "a long password") for _ in range(3)]
    upgrades = [
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: {server.url}\r\nCookie: {reader.cookie()}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        for reader in readers
    ]
    check_stops(client, Flood(server, 16 * [upgrade.encode() for upgrade in upgrades], said), driving)


def test_a_stop_goes_over_the_socket_where_no_request_gets_through(driving, trouble):
    driving.route("**/vehicle/stop", lambda route: route.abort())
    step(driving, "stop").click()
    expect(driving.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    expect(driving.locator("body")).not_to_have_attribute("data-unanswered", "")
    expect(driving.locator("#notice")).to_be_hidden()
    trouble.expect("ERR_FAILED")


def test_a_stop_goes_over_http_where_the_socket_does_not_bring_it(driving, trouble):
    # Messages that the page sends over its socket are held back.
    driving.evaluate("() => { WebSocket.prototype.send = () => {}; }")
    with driving.expect_response("**/vehicle/stop") as stopped:
        step(driving, "stop").click()
    assert stopped.value.status == 200
    expect(driving.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()


SWELLS_S = 10
DDS_MEMORY_MB = 400
# The recorder's `memory`, by default.
RECORDER_MB = 256
# The program without its DDS processes, and with two of them at their limit.
PROGRAM_MB = 400 + RECORDER_MB
SWOLLEN_MB = 2 * DDS_MEMORY_MB + PROGRAM_MB


class Swell:
    """A publisher that says 256 values of 5 kB about one of 4,096 names after the other, as fast as it can, and an eye
    on the memory of the server."""

    def __init__(self, server):
        self.publisher = peer(server.domain, "--depth", "4", "swell", "--seconds", SWELLS_S)
        self.server, self.ended = server, threading.Event()
        self.program_mb, self.memory_mb = 0.0, 0.0
        self.thread = threading.Thread(target=self.weigh)
        self.thread.start()

    def weigh(self):
        while not self.ended.wait(0.1):
            self.program_mb = max(self.program_mb, megabytes(self.server.process.pid))
            self.memory_mb = max(self.memory_mb, self.server.memory_mb())

    def renew(self):
        """It goes on by itself."""

    def close(self):
        """Waits for its end, and returns what it said last."""
        try:
            self.publisher.ends(30)
        finally:
            self.publisher.kill()
            self.ended.set()
            self.thread.join()
        return json.loads(self.publisher.lines[-1])


# Alone, since the publisher takes all of the machine that it gets.
@pytest.mark.alone
@pytest.mark.parametrize("server", [{"flags": ["--dds-memory", str(DDS_MEMORY_MB)]}], indirect=True, ids=["limited"])
def test_stops_are_answered_beside_statuses_that_fill_the_memory(server, vehicle, driving, trouble):
    client = Client(server, *OPERATOR)
    client.stop()
    attack = Swell(server)
    sent = check_stops(client, attack, driving, 2 * SWELLS_S, replaced=True)
    client.stop()
    assert sent["bytes"] > 200e6, sent
    assert attack.program_mb < PROGRAM_MB, f"{attack.program_mb:.0f} MB after {sent}"
    assert attack.memory_mb < SWOLLEN_MB, f"{attack.memory_mb:.0f} MB after {sent}"

    def shown():
        modules = [it for group in client.snapshot()["groups"] for it in group["modules"]]
        return {it["id"].rsplit("/")[-1]: it["own"] for it in modules}

    until(lambda: shown()["velodyne_packet_alive"] == "ok", BACK_S, lambda: f"the vehicle is known again: {shown()}")
    assert shown()["memory"] == "warning"


SIZES = [(1024, 600), (1280, 800), (1920, 1080), (800, 1280)]


def test_the_drivers_page_says_that_somebody_takes_over_and_lets_them_stop(server, driving, trouble):
    server.add_user("bert", "864209")
    Client(server, "bert", "864209", take_over=1)
    said = time.monotonic()
    notice = driving.locator("#notice")
    expect(notice).to_contain_text("bert takes your place in 5 s. Until then both of you can stop the vehicle.")
    for width, height in SIZES:
        driving.set_viewport_size({"width": width, "height": height})
        assert step(driving, "stop").is_visible()
        fits = "it => it.scrollHeight <= it.clientHeight && it.getBoundingClientRect().bottom <= innerHeight"
        assert notice.evaluate(fits), (width, height)
        if SCREENS:
            driving.screenshot(path=f"{SCREENS}/handover-{width}x{height}.png")
    expect(driving).to_have_url(server.url + "/login")
    assert time.monotonic() - said > 3.5
