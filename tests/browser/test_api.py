"""The examples of docs/api.md, each as it stands there, against the real server."""

import os
import re
import subprocess
import sys

from vehicle import OPERATOR, ROOT, TELLTALE, Client, until

PAGE = (ROOT / "docs/api.md").read_text()
# A command and the status that the page states.
COMMANDS = re.findall(r"^(curl .+?)  # ([0-9]{3})$", PAGE, re.MULTILINE)
PROGRAMS = re.findall(r"^```python\n(.+?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def token(server):
    """Of a developer."""
    server.add_user("dora", "a long enough secret", "developer")
    words = [TELLTALE, "user", "token", "dora", "--data", str(server.folder)]
    printed = subprocess.run(words, text=True, check=True, capture_output=True, timeout=30).stdout
    return re.search(r"^[0-9a-f]{32,}$", printed, re.MULTILINE).group()


def test_each_example_is_answered_as_the_page_says(server, tmp_path):
    lines = [line for line in PAGE.splitlines() if line.startswith("curl ")]
    assert len(COMMANDS) == len(lines) > 30 and PROGRAMS, "each line with the status behind it"
    environment = {**os.environ, "URL": server.url, "TOKEN": token(server), "SESSION": str(tmp_path / "session")}

    def run(command):
        """The status, and the answer."""
        asked = command.replace("curl ", "curl -sS -o answer -w '%{http_code}' ", 1).replace(" -O ", " ")
        done = subprocess.run(["sh", "-c", asked], cwd=tmp_path, env=environment, text=True, capture_output=True, timeout=60)
        return done.stdout + done.stderr, (tmp_path / "answer").read_text(errors="replace")

    operator = Client(server, *OPERATOR)
    for command, status in COMMANDS:
        # A token works, and a recording is complete, some time later.
        until(lambda: run("curl -H \"Authorization: Bearer $TOKEN\" \"$URL/api/v1/snapshot\"")[0] == "200", 10, "the token works")
        if "/incidents/1" in command:
            until(lambda: run(command)[0] == status, 60, lambda: f"{command}: {run(command)}")
            continue
        if command.endswith('/login"') and operator:
            operator.post("/logout")
            operator = None
        said = run(command)
        assert said[0] == status, f"{command} is to answer {status}: {said}"
    for program in PROGRAMS:
        words = [sys.executable, "-c", program]
        done = subprocess.run(words, env=environment, text=True, capture_output=True, timeout=60)
        assert done.returncode == 0 and done.stdout.startswith("locked"), done.stdout + done.stderr
