"""No acknowledged data are lost, whenever the program is killed.

TELLTALE_CRASH_ROUNDS sets how often it is killed: 20 by default, 200 for a long run.
"""

import json
import os
import random
import sqlite3
import subprocess
import threading
import time
import urllib.request

from vehicle import OPERATOR, TELLTALE, Client, until

ROUNDS = int(os.environ.get("TELLTALE_CRASH_ROUNDS", "20"))
RESTART_S = 3
DEVELOPER = ("dora", "a long password")
# A user's oldest sessions end when there are more.
LOGINS_MAX = 8
# A machine may be busy: a round ends after a number of acknowledged actions, not after a time.
ROUND_S_MAX = 30


class Round:
    """What was acknowledged between a start and a kill."""

    def __init__(self, server, number):
        self.server, self.number = server, number
        self.cookies, self.users = [], []
        self.killed = threading.Event()
        self.threads = [threading.Thread(target=target, daemon=True) for target in (self.log_in, self.add_users)]

    def log_in(self):
        while not self.killed.is_set() and len(self.cookies) < LOGINS_MAX:
            try:
                self.cookies.append(Client(self.server, *DEVELOPER).cookie())
            except OSError:
                return

    def add_users(self):
        for count in range(100):
            if self.killed.is_set():
                return
            name = f"user-{self.number}-{count}"
            words = [TELLTALE, "user", "add", name, "--role", "authority", "--data", str(self.server.folder)]
            added = subprocess.run(words, input="a long password\n" * 2, text=True, capture_output=True, timeout=60)
            if added.returncode == 0:
                self.users.append(name)

    def acknowledged(self):
        return len(self.cookies) + len(self.users)

    def until_killed(self, count, after_s):
        for thread in self.threads:
            thread.start()
        until(lambda: self.acknowledged() >= count, ROUND_S_MAX, lambda: f"{self.acknowledged()} of {count}")
        time.sleep(after_s)
        self.server.kill()
        self.killed.set()
        for thread in self.threads:
            thread.join(timeout=60)
            assert not thread.is_alive()


def get(server, path, cookie):
    request = urllib.request.Request(server.url + path, headers={"Cookie": cookie})
    with urllib.request.urlopen(request, timeout=10) as answer:
        return answer.read()


def telltale(server, *words):
    done = subprocess.run(
        [TELLTALE, *words, "--data", str(server.folder)], text=True, capture_output=True, timeout=60
    )
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


def test_nothing_acknowledged_is_lost_when_the_program_is_killed(server):
    chance = random.Random(1)
    server.add_user(*DEVELOPER, role="developer")
    operator = Client(server, *OPERATOR).cookie()
    logins, users = 1, {OPERATOR[0], DEVELOPER[0]}
    for number in range(ROUNDS):
        stage = json.loads(get(server, "/api/v1/snapshot", operator))["stage"]
        current = Round(server, number)
        current.until_killed(chance.randrange(6), chance.uniform(0, 0.2))
        logins += len(current.cookies)
        users |= set(current.users)

        started = time.monotonic()
        server.start()
        took_s = time.monotonic() - started
        assert took_s < RESTART_S, f"round {number}: the restart took {took_s:.1f} s"
        for cookie in [operator, *current.cookies]:
            snapshot = json.loads(get(server, "/api/v1/snapshot", cookie))
            assert (snapshot["stage"], snapshot["operator"]) == (stage, OPERATOR[0]), f"round {number}: {snapshot}"
        states = {group["state"] for group in snapshot["groups"] if group["id"] != "telltale"}
        assert states <= {"unknown", "ignore"}, f"round {number}: {states}"
        listed = {line.split()[-1] for line in telltale(server, "user", "list").splitlines()}
        assert users <= listed, f"round {number}: lost {users - listed}"
        assert telltale(server, "audit", "verify").startswith("ok"), f"round {number}"
    assert server.stop() == 0
    records = int(telltale(server, "audit", "verify").split()[1])
    assert records >= logins + len(users), f"{records} records for {logins} logins and {len(users)} users"


def alarms_on_disk(server):
    database = sqlite3.connect(f"file:{server.folder}/telltale.db?mode=ro", uri=True)
    try:
        return database.execute("SELECT id, node FROM alarms ORDER BY id").fetchall()
    finally:
        database.close()


def test_a_drive_goes_on_after_a_kill_and_nothing_is_known_of_the_components(server, vehicle):
    operator = Client(server, *OPERATOR)
    vehicle.drive(True)
    until(lambda: operator.snapshot()["stage"] == "active", 10, "the vehicle drives")
    vehicle.set("velodyne_packet_alive", 2, "no packets")
    node = "sensors/velodyne_packet_alive"
    until(lambda: node in [alarm["node"] for alarm in operator.snapshot()["alarms"]], 10, "an alarm")
    until(lambda: node in [name for _, name in alarms_on_disk(server)], 10, "the alarm is kept")
    kept = {node: number for number, node in alarms_on_disk(server)}
    vehicle.close()
    server.kill()
    server.start()
    snapshot = operator.snapshot()
    assert (snapshot["stage"], snapshot["operator"]) == ("active", OPERATOR[0]), snapshot["stage"]
    assert not any(group["state"] == "ok" for group in snapshot["groups"] if group["id"] != "telltale")
    found = {alarm["node"]: alarm["id"] for alarm in snapshot["alarms"]}
    assert found.get(node) == kept[node], f"kept {kept}, found {found}"
