"""What a program sees of the demo, and what it does there."""

import contextlib
import json
import time
import urllib.error

from websockets.sync.client import connect

OPERATOR = ("operator", "246810")
DEPARTURE_S = 30
# From a departure to the next stop, with a fault on the way.
A_LEG_S = 70


class Stream:
    """The snapshots of `/api/v1/stream`, each at the moment it came."""

    def __init__(self, server, client):
        url = server.url.replace("http", "ws", 1) + "/api/v1/stream"
        self.open = contextlib.ExitStack()
        headers = {"Cookie": client.cookie()}
        self.socket = self.open.enter_context(connect(url, additional_headers=headers, origin=server.url, max_size=2**22))

    def wait(self, condition, seconds, what):
        """All snapshots until the first that meets the condition, which is the last of them."""
        deadline, seen = time.monotonic() + seconds, []
        while True:
            left = deadline - time.monotonic()
            try:
                seen.append(json.loads(self.socket.recv(timeout=max(left, 0.001))))
            except TimeoutError:
                raise AssertionError(f"not within {seconds} s: {what}; last: {brief(seen[-1:])}") from None
            if condition(seen[-1]):
                return seen

    def close(self):
        self.open.close()


def brief(snapshots):
    return [(s["stage"], {g["id"]: g["state"] for g in s["groups"]}, roots(s)) for s in snapshots]


def group(snapshot, name):
    return next(group for group in snapshot["groups"] if group["id"] == name)


def state(snapshot, name):
    return group(snapshot, name)["state"]


def roots(snapshot):
    return [root["node"] for root in snapshot["roots"]]


def masked_by(snapshot, name):
    """The causes of a group, or of a module in one, that waits."""
    modules = (module for group in snapshot["groups"] for module in group["modules"])
    node = next(node for node in (*snapshot["groups"], *modules) if node["id"] == name)
    reason = node["reason"]
    return reason["by"] if reason and reason["kind"] == "masked" else None


def healthy(snapshot):
    # No group takes the statuses of `other`, so they do not count.
    shown = {group["id"]: group["state"] for group in snapshot["groups"] if group["id"] != "other"}
    planner = [shown.pop("planning"), shown.pop("execution")]
    driving = snapshot["stage"] == "active"
    return set(shown.values()) == {"ok"} and planner == (["ok"] * 2 if driving else ["ignore"] * 2) and not roots(snapshot)


class Faults:
    def __init__(self, client):
        self.client = client
        self.active = set()

    def set(self, name, active):
        (self.active.add if active else self.active.discard)(name)
        self.client.post("/demo/fault", name=name, active="true" if active else "false")

    def over(self, name, stream):
        """Ends the fault and releases the countermeasure that it led to: the shuttle drives on."""
        self.set(name, False)
        seen = stream.wait(healthy, 20, "all is well again")
        acknowledge_all(self.client)
        self.client.release()
        return seen


def acknowledge_all(client):
    for _ in range(10):
        snapshot = client.snapshot()
        try:
            for alarm in snapshot["alarms"]:
                client.post(f"/alarms/{alarm['id']}/acknowledge", version=snapshot["seq"])
            return
        except urllib.error.HTTPError as error:
            # It has changed or gone meanwhile.
            assert error.code in (404, 409), error.read()
    raise AssertionError(f"the alarms change all the time: {snapshot['alarms']}")


def wait_for_a_stop(stream, client):
    """A very busy machine may be late enough for a fault of its own: the shuttle goes on once it is over."""
    for _ in range(5):
        held = lambda s: any(it["request"] != "notify" for it in s["countermeasures"])
        reached = lambda s: healthy(s) and (s["stage"] == "standby" or held(s))
        if not held(stream.wait(reached, A_LEG_S, "all is well at a stop")[-1]):
            return
        client.release()
    raise AssertionError("the shuttle is stopped again and again")
