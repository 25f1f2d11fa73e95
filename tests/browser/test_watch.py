"""`telltale watch` beside the real server: in a real terminal, as lines, as JSON, over TLS, with a login or a token."""

import contextlib
import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import threading

import pytest

from vehicle import CONFIG, TELLTALE, Client, Server, Vehicle, own_domain, serving, until

COLUMNS, LINES = 120, 40
AUTHORITY = ("vera", "a long password")


class Screen:
    """A program in a pseudo terminal, and what stands on its screen: cursor moves are obeyed, colours are kept apart."""

    def __init__(self, words, **environment):
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            for name in ("NO_COLOR", "TELLTALE_TOKEN"):
                os.environ.pop(name, None)
            os.environ.update(TERM="xterm-256color", **environment)
            os.execv(TELLTALE, [TELLTALE, *words])
        fcntl.ioctl(self.terminal, termios.TIOCSWINSZ, struct.pack("HHHH", LINES, COLUMNS, 0, 0))
        self.rows, self.row, self.column, self.received = {}, 0, 0, ""
        self.lock = threading.Lock()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        rest = ""
        while True:
            try:
                piece = os.read(self.terminal, 65536).decode(errors="replace")
            except OSError:
                return
            if not piece:
                return
            with self.lock:
                self.received += piece
                rest = self.obey(rest + piece)

    def obey(self, text):
        """Draws the text; returns the beginning of an escape sequence that is not complete."""
        at = 0
        while at < len(text):
            if text[at] == "\x1b":
                found = re.compile(r"\x1b(?:\[([0-9;?]*)([@-~])|[()][A-Z0-9]|[=>78])").match(text, at)
                if not found:
                    return text[at:]
                if found[2] == "H":
                    row, column = ([int(it or 1) for it in (found[1] or "1;1").split(";")] + [1])[:2]
                    self.row, self.column = row - 1, column - 1
                elif found[2] == "J":
                    self.rows.clear()
                at = found.end()
            else:
                if text[at] == "\n":
                    self.row += 1
                elif text[at] == "\r":
                    self.column = 0
                else:
                    self.rows[self.row, self.column] = text[at]
                    self.column += 1
                at += 1
        return ""

    def text(self):
        with self.lock:
            return "\n".join("".join(self.rows.get((row, column), " ") for column in range(COLUMNS)) for row in range(LINES))

    def type(self, text):
        os.write(self.terminal, text.encode())

    def shows(self, *words, seconds=20):
        until(lambda: all(word in self.text() for word in words), seconds, lambda: f"{words}\n{self.text()}")

    def ends(self):
        _, status = os.waitpid(self.pid, 0)
        self.pid = None
        return os.waitstatus_to_exitcode(status)

    def close(self):
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self.terminal)


def start(server, *flags, **more):
    words = [TELLTALE, "watch", server.url, *flags]
    pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return subprocess.Popen(words, **pipes, env={**os.environ, **more})


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("server")) as server:
        server.add_user(*AUTHORITY, role="authority")
        yield server


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    server = Server(tmp_path_factory.mktemp("demo"), own_domain() + 41, "demo", ["--robot"]).start()
    yield server
    assert server.stop() == 0


def test_a_terminal_sees_a_fault_come_and_go(demo):
    """It also says that it is old when the server stands still, and is live again when that goes on."""
    client = Client(demo, "developer", "demo-developer")
    with contextlib.closing(Screen(["watch", demo.url])) as screen:
        screen.shows("Name:")
        screen.type("authority\n")
        screen.shows("Secret:")
        screen.type("demo-authority\n")
        screen.shows("live", "no causes", "✓ OK", seconds=40)
        assert "demo-authority" not in screen.text()
        client.post("/demo/fault", name="lidar_outage", active="true")
        screen.shows("cause:", "waits for")
        assert "\x1b[38;5;" in screen.received or "\x1b[3" in screen.received
        client.post("/demo/fault", name="lidar_outage", active="false")
        screen.shows("no causes", seconds=40)
        os.kill(demo.process.pid, signal.SIGSTOP)
        try:
            screen.shows("NO DATA", "? was OK")
        finally:
            os.kill(demo.process.pid, signal.SIGCONT)
        screen.shows("live", "✓ OK")
        screen.type("q")
        assert screen.ends() == 0


def test_lines_and_json_say_what_changes(server):
    """With a login from standard input. The reader of a pipe may end it, and so may a signal."""
    Client(server, "anna", "975310")
    with contextlib.closing(Vehicle(server.domain, server.folder)):
        lines = start(server, "--plain")
        lines.stdin.write("\n".join(AUTHORITY) + "\n")
        lines.stdin.close()
        seen = []
        threading.Thread(target=lambda: seen.extend(lines.stdout), daemon=True).start()
        until(lambda: any("group sensors:" in line for line in seen), 30, lambda: seen)
        lines.terminate()
        assert lines.wait(timeout=20) == 0
        json_lines = start(server, "--json", "--name", AUTHORITY[0])
        json_lines.stdin.write(AUTHORITY[1] + "\n")
        json_lines.stdin.close()
        snapshot = json.loads(json_lines.stdout.readline())
        assert [group["id"] for group in snapshot["groups"]][0] == "sensors" and "base" not in snapshot
        json_lines.stdout.close()
        assert json_lines.wait(timeout=20) == 0


def test_a_token_opens_it_and_a_server_that_restarts_is_found_again(server):
    words = [TELLTALE, "user", "token", AUTHORITY[0], "--label", "watch", "--data", str(server.folder)]
    token = subprocess.run(words, check=True, capture_output=True, text=True, timeout=30).stdout.strip()
    lines = start(server, "--plain", TELLTALE_TOKEN=token)
    seen = []
    threading.Thread(target=lambda: seen.extend(lines.stdout), daemon=True).start()
    said = lambda words: any(words in line for line in seen)
    until(lambda: said("stage:"), 30, lambda: seen)
    assert server.stop() == 0
    until(lambda: said("NOT CONNECTED"), 20, lambda: seen)
    server.start()
    until(lambda: said("live again"), 30, lambda: seen)
    number = re.search(r"^ *(\d+)", subprocess.run(
        [TELLTALE, "user", "tokens", "--data", str(server.folder)], check=True, capture_output=True, text=True, timeout=30).stdout)[1]
    subprocess.run([TELLTALE, "user", "revoke", number, "--data", str(server.folder)], check=True, capture_output=True, timeout=30)
    assert lines.wait(timeout=20) == 1, "the session has ended"
    assert "ended the session" in lines.stderr.read()


@pytest.mark.parametrize("flags, secrets, code, said", [
    (["--plain"], "vera\nwrong\n", 1, "the login is refused"),
    (["--plain", "--token", "f" * 64], "", 1, "not, or no longer, valid"),
    ([], "", 2, "give --plain or --json"),
    (["--plain", "--json"], "", 2, "cannot be used with"),
    (["--plain"], "vera\n", 2, "standard input ends before the line with the secret"),
])
def test_a_refusal_says_why(server, flags, secrets, code, said):
    refused = start(server, *flags)
    _, error = refused.communicate(secrets, timeout=30)
    assert (refused.returncode, said in error) == (code, True), error


@pytest.mark.parametrize("url, code, said", [
    ("http://shuttle-1.example:8080", 2, "--insecure-http"),
    ("http://127.0.0.1:9", 1, "cannot be reached"),
    ("127.0.0.1:8080", 2, "write for example http://127.0.0.1:8080"),
])
def test_a_wrong_address_says_what_to_write(url, code, said):
    refused = subprocess.run([TELLTALE, "watch", url, "--plain"], input="a\nb\n", capture_output=True, text=True, timeout=30)
    assert (refused.returncode, said in refused.stderr) == (code, True), refused.stderr


def test_over_tls_the_certificate_has_to_be_one_that_is_believed(tmp_path):
    subprocess.run([TELLTALE, "tls", "self-signed", "--name", "localhost", "--data", str(tmp_path)], check=True, capture_output=True, timeout=30)
    certificate, key = tmp_path / "tls-cert.pem", tmp_path / "tls-key.pem"
    flags = ["--tls-cert", str(certificate), "--tls-key", str(key)]
    server = Server(tmp_path, own_domain() + 42, "serve", flags, config=CONFIG)
    server.url = f"https://localhost:{server.port}"
    server.answers = lambda: f"https://" in server.read_log()
    server.add_user(*AUTHORITY, role="authority")
    server.start()
    try:
        doubted = start(server, "--json")
        _, error = doubted.communicate("\n".join(AUTHORITY) + "\n", timeout=30)
        assert doubted.returncode == 1 and "--ca FILE" in error
        believed = start(server, "--json", "--ca", str(certificate))
        believed.stdin.write("\n".join(AUTHORITY) + "\n")
        believed.stdin.flush()
        assert json.loads(believed.stdout.readline())["stage"] == "locked"
        believed.terminate()
        assert believed.wait(timeout=20) == 0
    finally:
        assert server.stop() == 0
