"""Other programs at the database while the server runs: sqlite3, Python's module, `telltale user`.

In whatever order they come and go, no acknowledged data are lost, and changes of users take effect.
"""

import base64
import os
import signal
import socket
import sqlite3
import subprocess
import threading
import time
import urllib.error
import urllib.request

import pytest

from vehicle import OPERATOR, TELLTALE, Client, until

# A probe every five seconds, and a margin.
NOTICE_S = 12
PASSWORD = "a long password"
FILES = ("telltale.db", "telltale.db-wal", "telltale.db-shm")


def database(server):
    return server.folder / "telltale.db"


class Shell:
    """`sqlite3` with the database open, a statement at a time."""

    def __init__(self, path):
        words = ["sqlite3", "-batch", "-bail", "-cmd", ".timeout 10000", str(path)]
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)

    def run(self, statement):
        self.process.stdin.write(f"{statement};\nSELECT 'done';\n")
        lines = iter(self.process.stdout.readline, "done\n")
        return [line.strip() for line in lines if line or pytest.fail(f"sqlite3 ended at {statement}")]

    def close(self):
        self.process.stdin.close()
        assert self.process.wait(timeout=10) == 0
        self.process.stdout.close()


class Module:
    """Python's module, in this process."""

    def __init__(self, path):
        self.connection = sqlite3.connect(path, timeout=10, isolation_level=None)

    def run(self, statement):
        return [str(row[0]) for row in self.connection.execute(statement)]

    def close(self):
        self.connection.close()


PROGRAMS = [Shell, Module]


def user(server, *words, secret=""):
    """`telltale user`, which must do it."""
    done = run_user(server, *words, secret=secret)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done


def run_user(server, *words, secret=""):
    words = [TELLTALE, "user", *words, "--data", str(server.folder)]
    return subprocess.run(words, input=f"{secret}\n{secret}\n", text=True, capture_output=True, timeout=60)


def beats(server, program=Module):
    """How often the server has looked after its storage."""
    reader = program(database(server))
    try:
        return int(reader.run("SELECT count FROM beat")[0])
    finally:
        reader.close()


def looked_after(server, program=Module):
    """Waits until the server has looked after its storage, as a program sees that comes and goes."""
    before = beats(server, program)
    until(lambda: beats(server, program) > before, NOTICE_S, "the server looks after its storage")


def locks(server, name="telltale.db"):
    """The locks of the server on a file, as the kernel knows them."""
    inode = os.stat(server.folder / name).st_ino
    rows = [line.split() for line in open("/proc/locks")]
    return [row for row in rows if str(server.process.pid) in row and any(it.endswith(f":{inode}") for it in row)]


def status(server, path, **headers):
    request = urllib.request.Request(server.url + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def storage(client):
    """The message of the WARNING, if there is one."""
    groups = [group for group in client.snapshot()["groups"] if group["id"] == "telltale"]
    modules = [module for group in groups for module in group["modules"] if module["id"] == "telltale/storage"]
    return next((module["message"] for module in modules if module["state"] == "warning"), None)


class Socket:
    """A display's socket, without a browser."""

    def __init__(self, server, cookie):
        self.socket = socket.create_connection(("127.0.0.1", server.port), timeout=10)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            "GET /api/v1/stream HTTP/1.1", f"Host: 127.0.0.1:{server.port}", "Connection: Upgrade", "Upgrade: websocket",
            "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {key}", f"Origin: {server.url}", f"Cookie: {cookie}",
        ]
        self.socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self.reader = self.socket.makefile("rb")
        assert b" 101 " in self.reader.readline()
        for line in iter(self.reader.readline, b"\r\n"):
            assert line, "the connection ended within its head"
        self.closed = threading.Event()
        self.code = self.closed_at = None
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        while head := self.reader.read(2):
            length = head[1] & 0x7F
            if length > 125:
                length = int.from_bytes(self.reader.read(2 if length == 126 else 8), "big")
            payload = self.reader.read(length)
            if head[0] & 0x0F == 9:
                # A client that answers no ping is taken for one that does not read.
                self.socket.sendall(b"\x8a\x80\0\0\0\0")
            if head[0] & 0x0F == 8:
                self.code = int.from_bytes(payload[:2], "big")
                break
        self.closed_at = time.monotonic()
        self.closed.set()

    def ended_with(self, since, within_s):
        assert self.closed.wait(within_s), "the socket lives on"
        assert self.closed_at - since < within_s
        return self.code


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_server_keeps_its_lock_while_others_come_and_go(server, program):
    server.stop()
    before = program(database(server))
    assert before.run("SELECT name FROM users") == [OPERATOR[0]]
    server.start()
    assert locks(server)
    during = program(database(server))
    during.run("BEGIN")
    during.run("SELECT count(*) FROM audit")
    for _ in range(2):
        looked_after(server, program)
        program(server.folder / "history.db").close()
        for name in ("telltale.db", "history.db"):
            assert locks(server, name), f"the next program that closes {name} deletes its log"
    user(server, "add", "dora", "--role", "developer", secret=PASSWORD)
    during.close()
    before.close()
    assert locks(server)
    program(database(server)).close()
    assert locks(server) and all((server.folder / name).exists() for name in FILES)


class Adding(threading.Thread):
    """Adds users, one after the other, until it is told to end."""

    def __init__(self, server, prefix):
        super().__init__(daemon=True)
        self.server, self.prefix, self.users, self.over = server, prefix, [], threading.Event()
        self.start()

    def run(self):
        while not self.over.is_set():
            name = f"{self.prefix}-{len(self.users)}"
            if run_user(self.server, "add", name, "--role", "authority", secret=PASSWORD).returncode == 0:
                self.users.append(name)

    def end(self):
        self.over.set()
        self.join(timeout=60)
        assert not self.is_alive()
        return self.users


WRITING = ["CREATE TABLE IF NOT EXISTS notes (text)", "INSERT INTO notes VALUES ('seen')", "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"]


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("order", ["before", "during", "after", "writing"])
def test_nothing_acknowledged_is_lost_with_another_program_beside_it(server, program, order):
    for name in ("dora", "dirk", "dana"):
        server.add_user(name, PASSWORD, role="developer")
    server.stop()
    if order in ("before", "during"):
        other = program(database(server))
        other.run("SELECT count(*) FROM users")
    if order == "before":
        other.close()
    server.start()
    if order == "during":
        other.close()
    looked_after(server, program)
    adding = [Adding(server, prefix) for prefix in ("one", "two") if order == "writing"]
    cookies = []
    for count in range(18):
        cookies.append(Client(server, ("dora", "dirk", "dana")[count % 3], PASSWORD).cookie())
        visitor = program(database(server))
        assert int(visitor.run("SELECT count(*) FROM sessions")[0]) >= count + 1, "it sees what is acknowledged"
        for statement in WRITING if order == "writing" and count % 6 == 3 else ():
            visitor.run(statement)
        visitor.close()
    if order == "writing":
        until(lambda: all(len(it.users) > 2 for it in adding), 60, "users were added")
    looked_after(server, program)
    assert storage(Client(server, *OPERATOR)) is None
    server.kill()
    users = [name for it in adding for name in it.end()]
    server.start()
    assert [status(server, "/api/v1/snapshot", Cookie=cookie) for cookie in cookies] == [200] * len(cookies), server.read_log()
    reader = program(database(server))
    assert set(users) <= set(reader.run("SELECT name FROM users"))
    assert reader.run("PRAGMA integrity_check") == ["ok"]
    reader.close()


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("how", ["remove", "passwd", "role"])
def test_what_is_taken_from_a_user_is_in_force_within_a_second_while_others_read(server, program, how):
    server.add_user("dora", PASSWORD, role="developer")
    server.add_user("dirk", PASSWORD, role="developer")
    token = user(server, "token", "dirk").stdout.strip()
    bearer = {"Authorization": f"Bearer {token}"}
    until(lambda: status(server, "/api/v1/snapshot", **bearer) == 200, 5, "the token works")
    cookie = Client(server, "dora", PASSWORD).cookie()
    display = Socket(server, cookie)
    looked_after(server, program)
    reading = program(database(server))
    reading.run("BEGIN")
    assert "dora" in reading.run("SELECT name FROM users")
    words = {"remove": [], "passwd": [], "role": ["--role", "authority"]}[how]
    done = user(server, how, "dora", *words, secret="another long password")
    since = time.monotonic()
    assert display.ended_with(since, 1) == 1008
    assert status(server, "/api/v1/snapshot", Cookie=cookie) == 401
    assert "has taken the change in" in done.stderr, done.stderr
    user(server, "revoke", "1")
    assert status(server, "/api/v1/snapshot", **bearer) == 401
    assert "dora" in reading.run("SELECT name FROM users"), "it reads what was when it began"
    reading.close()


def test_a_command_says_whether_the_server_has_taken_a_change_in(server):
    server.add_user("dora", PASSWORD, role="developer")
    cookie = Client(server, "dora", PASSWORD).cookie()
    server.send(signal.SIGSTOP)
    done = run_user(server, "remove", "dora")
    server.send(signal.SIGCONT)
    assert done.returncode == 1 and done.stdout == "removed dora\n", done
    assert "has not taken it in" in done.stderr and str(server.folder) in done.stderr, done.stderr
    until(lambda: status(server, "/api/v1/snapshot", Cookie=cookie) == 401, 5, "it takes it in later")
    done = user(server, "add", "dirk", "--role", "developer", secret=PASSWORD)
    assert done.stdout == "added dirk\n" and "has taken the change in" in done.stderr, done
    server.kill()
    done = user(server, "remove", "dirk")
    assert "no server runs" in done.stderr, done.stderr
    server.start()


def test_a_command_ends_when_its_disk_hangs(server):
    """The head of the log is written into a pipe that nobody reads."""
    server.add_user("dora", PASSWORD, role="developer")
    script = f'cd {server.folder}; mkfifo audit.head.$$; exec {TELLTALE} user remove dora --data .'
    done = subprocess.run(["sh", "-c", script], text=True, capture_output=True, timeout=60)
    assert done.returncode == 1 and "has not answered" in done.stderr, done


def test_a_command_says_that_the_disk_of_the_server_hangs(server):
    server.add_user("dora", PASSWORD, role="developer")
    client = Client(server, *OPERATOR)
    pipe = server.folder / f"audit.head.{server.process.pid}"
    # The head may be written right now, under this name.
    until(lambda: subprocess.run(["mkfifo", pipe], capture_output=True).returncode == 0, 5, "a pipe")
    with pytest.raises(urllib.error.HTTPError):
        client.post("/vehicle/clearance/withdraw", version=client.snapshot()["seq"])
    done = run_user(server, "remove", "dora")
    assert done.returncode == 1 and "has not taken it in" in done.stderr, done
    assert "has not answered" in until(lambda: storage(client), NOTICE_S, "a warning")
    reader = os.open(pipe, os.O_RDWR)
    pipe.unlink()
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
    os.close(reader)


@pytest.mark.parametrize("name, how", [(name, how) for name in FILES for how in ("removed", "replaced")] + [(FILES[1], "cut")])
def test_a_file_of_the_database_that_vanishes_is_a_fault_that_is_shown(server, name, how):
    server.add_user("dora", PASSWORD, role="developer")
    cookies = [Client(server, *who).cookie() for who in (OPERATOR, ("dora", PASSWORD)) for _ in range(3)]
    client = Client(server, *OPERATOR)
    path, kept = server.folder / name, server.folder / "kept"
    if how == "cut":
        os.truncate(path, 0)
    else:
        path.rename(kept)
        if how == "replaced":
            subprocess.run(["cp", kept, path], check=True)
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert how == "cut" or name in message, message
    with pytest.raises(urllib.error.HTTPError) as refused:
        client.post("/vehicle/localize", version=client.snapshot()["seq"], stop="depot")
    assert refused.value.code == 503 and "nothing was changed" in refused.value.read().decode()
    first = client.snapshot()["at"]
    until(lambda: client.snapshot()["at"] > first, 5, "the snapshots go on")
    if how == "removed" and name != FILES[0]:
        # Acknowledged data are in the database file itself by now.
        server.kill()
        server.start()
        assert [status(server, "/api/v1/snapshot", Cookie=cookie) for cookie in cookies] == [200] * len(cookies), server.read_log()
        assert storage(client) is None
    elif how != "cut":
        kept.rename(path)
        until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
