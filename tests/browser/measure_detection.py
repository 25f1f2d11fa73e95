"""Measures how soon each kind of monitor notices, over real DDS, and prints a table: what the table in
docs/reference/detection-times.md states for the windows, limits and rates used here, and what passed between a fault
at the foreign publisher (Cyclone DDS) and the frame on `/api/v1/stream` that shows it. Every fault comes
at a random phase. Not a test, but it fails when a median is not as stated, or when a healthy vehicle
shows a WARNING or an ERROR after a start or a reload.

    TELLTALE=target/release/telltale python measure_detection.py [--times 20] [--starts 5] [--domain N]

A host that stops to answer is measured only in a network namespace that has nothing but `lo`, where that
can be brought about and concerns nobody else:

    unshare -n sh -c 'ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo; TELLTALE=... python ...'
"""

import argparse
import asyncio
import json
import os
import random
import signal
import socket
import statistics
import struct
import sys
import tempfile
import time
from pathlib import Path

from websockets.asyncio.client import connect

import programs
from programs import ROOT, TELLTALE
from vehicle import OPERATOR, Client, Server, own_domain

sys.path.insert(0, str(ROOT / "tests/dds"))
import cyclone
import peer
import wire

NUMBER, POSE = "std_msgs::msg::dds_::Float64_", "geometry_msgs::msg::dds_::PoseStamped_"
ROS_NAMES = {NUMBER: "std_msgs/msg/Float64", POSE: "geometry_msgs/msg/PoseStamped"}
# Discovery, and the first window after it.
SETTLED_S = 6
# From the bytes to the frame, on a shared machine.
WAY_S = 0.05
# A trial does not count if the machine delayed the peer by more.
LATE_S = 0.03


def number(value):
    return b"\x00\x01\x00\x00" + struct.pack("<d", value)


def pose(x, age_s=0.0):
    stamp_ns = time.time_ns() - int(age_s * 1e9)
    head = struct.pack("<iII4x", stamp_ns // 10**9, stamp_ns % 10**9, 1)
    return b"\x00\x01\x00\x00" + head + struct.pack("<7d", x, 0, 0, 0, 0, 0, 1)


def status(name, level=0, **values):
    values = {key: str(value) for key, value in values.items()}
    return wire.diagnostic_array([{"level": level, "name": name, "values": values}])


class Peer:
    """One participant of a foreign DDS with any number of writers."""

    OPTIONS = dict(reliability="reliable", durability="volatile", depth=1, lease_s=10, announce_s=0.5, interface="lo", multicast=False)

    def __init__(self, domain):
        self.domain = domain
        self.participant = cyclone.Participant(argparse.Namespace(domain=domain, **self.OPTIONS))
        self.topics = {}

    def writer(self, topic, type_name, durability="volatile"):
        participant, lib = self.participant, self.participant.lib
        if topic not in self.topics:
            self.topics[topic] = participant.topic(topic, type_name)
        qos = participant.make_qos(argparse.Namespace(**{**self.OPTIONS, "durability": durability}))
        return cyclone.Writer(lib, lib.pub.DataWriter(participant.dds, self.topics[topic], qos=qos))

    def write(self, writer, data):
        peer.write(writer, data)


class Stream:
    """Writes what `make()` gives, so many times a second, until it is told otherwise."""

    def __init__(self, publisher, topic, type_name, hz, make):
        self.publisher, self.topic, self.type_name = publisher, topic, type_name
        self.writer = publisher.writer(topic, type_name)
        self.hz, self.make, self.healthy = hz, make, (hz, make)
        self.next = time.monotonic() + random.random() / hz
        self.told = []

    @property
    def period(self):
        return 1 / self.hz

    async def run(self):
        while True:
            if self.hz == 0 or self.writer is None:
                await asyncio.sleep(0.005)
                self.next = time.monotonic()
                continue
            await asyncio.sleep(max(0, self.next - time.monotonic()))
            if self.hz == 0 or self.writer is None:
                continue
            data, at = self.make(), time.monotonic()
            self.publisher.write(self.writer, data)
            for told in self.told:
                told.set_result(at)
            self.told = []
            self.next = max(self.next + 1 / self.hz, at - 1)

    def written(self):
        """When the next message was written."""
        told = asyncio.get_running_loop().create_future()
        self.told.append(told)
        return told

    async def turn_bad(self, make):
        """The fault is the first bad message."""
        self.make = make
        return await self.written()

    async def turn_to(self, hz):
        """The fault is between two messages."""
        at = await self.written() + random.random() * self.period
        if hz == 0:
            self.hz = 0
            return at
        await asyncio.sleep(at - time.monotonic())
        self.hz, now = hz, time.monotonic()
        self.next = now + random.random() / hz
        return now

    async def leave(self):
        await asyncio.sleep(random.random() * self.period)
        # Cyclone deletes the entity with its last reference.
        self.writer = None
        return time.monotonic()

    def recover(self):
        self.hz, self.make = self.healthy
        if self.writer is None:
            self.writer = self.publisher.writer(self.topic, self.type_name)


class Port:
    """A TCP port that answers, until it does not."""

    def __init__(self):
        self.listener = None
        self.number = 0
        self.recover()

    def recover(self):
        self.listener = socket.create_server(("127.0.0.1", self.number))
        self.number = self.listener.getsockname()[1]
        asyncio.get_running_loop().add_reader(self.listener, lambda: self.listener.accept()[0].close())

    async def close(self):
        await asyncio.sleep(random.random())
        asyncio.get_running_loop().remove_reader(self.listener)
        self.listener.close()
        return time.monotonic()


class Deaf:
    """A TCP port that stops to answer at all: nobody accepts, and its queue is full."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=0)
        self.listener.setblocking(False)
        self.number = self.listener.getsockname()[1]
        self.waiting = []
        self.hear()

    def hear(self):
        asyncio.get_running_loop().add_reader(self.listener, lambda: self.listener.accept()[0].close())

    def recover(self):
        for one in self.waiting:
            one.close()
        self.hear()

    async def close(self):
        await asyncio.sleep(random.random())
        asyncio.get_running_loop().remove_reader(self.listener)
        self.waiting = [socket.socket() for _ in range(4)]
        for one in self.waiting:
            one.setblocking(False)
            one.connect_ex(("127.0.0.1", self.number))
        return time.monotonic()


class Host:
    """This machine as a host that answers ICMP echos, until it does not."""

    HERE = Path("/proc/sys/net/ipv4")

    @staticmethod
    def is_our_own():
        return [name for _, name in socket.if_nameindex()] == ["lo"]

    def __init__(self):
        (self.HERE / "ping_group_range").write_text("0 2147483647")
        self.recover()

    def recover(self):
        (self.HERE / "icmp_echo_ignore_all").write_text("0")

    async def end(self):
        await asyncio.sleep(random.random())
        (self.HERE / "icmp_echo_ignore_all").write_text("1")
        return time.monotonic()


class Nodes:
    """Which nodes the participant has, as an rmw announces them."""

    def __init__(self, publisher):
        self.publisher = publisher
        self.writer = publisher.writer("ros_discovery_info", wire.PARTICIPANT_ENTITIES_INFO, "transient_local")
        self.recover()

    def announce(self, *names):
        gid = self.publisher.participant.guid
        nodes = [("/", name, [], []) for name in names]
        self.publisher.write(self.writer, wire.participant_entities_info(gid, nodes, 16))

    def recover(self):
        self.announce("steady", "measured")

    async def end(self):
        await asyncio.sleep(random.random())
        self.announce("steady")
        return time.monotonic()


class Process:
    """A node in a process of its own, which is killed."""

    def __init__(self, domain):
        self.domain = domain
        self.process = None
        self.recover()

    def recover(self):
        words = ["--durability", "transient_local", "--depth", 1, "pub", "--topic", "ros_discovery_info"]
        self.process = programs.peer(self.domain, *words, "--type", "ParticipantEntitiesInfo")
        self.process.tell(info={"size": 16, "name": "crashing"})

    async def crash(self):
        await asyncio.sleep(random.random())
        self.process.kill()
        return time.monotonic()

    def close(self):
        self.process.kill()


class Case:
    """A monitor, its fault, and when it is to be seen: from `low` to `high` seconds after the fault."""

    def __init__(self, kind, fault, monitor, streams, cause, stated, shows="error", recover=None, times=1.0):
        self.kind, self.fault, self.monitor, self.streams = kind, fault, monitor, streams
        self.cause, self.shows = cause, shows
        self.low, self.high = stated
        self.recover, self.times = recover, times
        self.took, self.disturbed = [], 0

    def end(self):
        for stream in self.streams:
            stream.recover()
        if self.recover:
            self.recover()


def source(stream, field="data"):
    return f"topic: {stream.topic.removeprefix('rt')}, type: {ROS_NAMES[stream.type_name]}" + (f", field: {field}" if field else "")


def cases(publisher):
    """All of them, each with topics of its own."""
    count = 0

    def stream(hz=20, make=lambda: number(1.0), type_name=NUMBER):
        nonlocal count
        count += 1
        return Stream(publisher, f"rt/measured/t{count}", type_name, hz, make)

    def statuses(make):
        return Stream(publisher, "rt/diagnostics", wire.DIAGNOSTIC_ARRAY, 10, make)

    def bad(value):
        return lambda: number(value)

    window = 1.0
    # The paths of both: 5 m/s.
    travelled = lambda: 5 * time.monotonic()

    s = stream()
    yield Case("frequency", "20 Hz stop; 1 s, at least 10 Hz", f"frequency: {{ {source(s, None)}, window: 1s, error_below: 10 }}", [s],
               lambda s=s: s.turn_to(0), (window - 10 / 20, window - 9 / 20))
    s = stream()
    falls = window * (20 - 10) / (20 - 5)
    yield Case("frequency", "20 Hz fall to 5 Hz; 1 s, at least 10 Hz", f"frequency: {{ {source(s, None)}, window: 1s, error_below: 10 }}", [s],
               lambda s=s: s.turn_to(5), (falls - 1 / 20, falls + 1 / 5))
    s = stream(hz=10)
    rises = window * (20 - 10) / (40 - 10)
    yield Case("frequency", "10 Hz rise to 40 Hz; 1 s, at most 20 Hz", f"frequency: {{ {source(s, None)}, window: 1s, error_above: 20 }}", [s],
               lambda s=s: s.turn_to(40), (rises - 1 / 40, rises + 1 / 10))
    s = stream(make=lambda: pose(0), type_name=POSE)
    yield Case("latency", "a message 0.5 s late; at most 0.2 s", f"latency: {{ {source(s, None)}, window: 1s, error_above: 200ms }}", [s],
               lambda s=s: s.turn_bad(lambda: pose(0, 0.5)), (0, 0))
    s = stream(make=lambda: pose(0), type_name=POSE)

    async def late_and_well(s=s):
        await s.turn_bad(lambda: pose(0, 0.5))
        at = await s.written()
        s.recover()
        return at

    yield Case("latency", "the last late message leaves; 1 s", f"latency: {{ {source(s, None)}, window: 1s, error_above: 200ms }}", [s],
               late_and_well, (window * 255 / 256, window), shows="ok")
    s = stream()
    yield Case("value", "a bad message", f"value: {{ {source(s)}, error_above: 5 }}", [s], lambda s=s: s.turn_bad(bad(9)), (0, 0))
    s = statuses(lambda: status("measured key", 0, heat=1))
    yield Case("value", "a bad KeyValue of a status", "value: { status: measured key, key: heat, error_above: 5 }", [s],
               lambda s=s: s.turn_bad(lambda: status("measured key", 0, heat=9)), (0, 0))
    s = statuses(lambda: status("measured self"))
    yield Case("self_state", "a status with ERROR", "self_state: { status: measured self }", [s],
               lambda s=s: s.turn_bad(lambda: status("measured self", 2)), (0, 0))
    s = statuses(lambda: status("measured external"))
    yield Case("external", "a status with ERROR", "external: { status: measured external, class: { location: isolated, information: content } }",
               [s], lambda s=s: s.turn_bad(lambda: status("measured external", 2)), (0, 0))
    port = Port()
    yield Case("watchdog", "a TCP port closes; 2 misses every 0.2 s", f"watchdog: {{ tcp: '127.0.0.1:{port.number}', every: 200ms, misses: 2 }}",
               [], port.close, (0.2, 0.4), recover=port.recover)
    deaf = Deaf()
    yield Case("watchdog", "a TCP port is silent; 2 misses every 0.2 s", f"watchdog: {{ tcp: '127.0.0.1:{deaf.number}', every: 200ms, misses: 2 }}",
               [], deaf.close, (0.4, 0.6), recover=deaf.recover)
    if Host.is_our_own():
        host = Host()
        yield Case("watchdog", "a host answers no ICMP echo; 2 misses every 0.2 s", "watchdog: { icmp: 127.0.0.1, every: 200ms, misses: 2 }",
                   [], host.end, (0.4, 0.6), recover=host.recover)
    nodes = Nodes(publisher)
    yield Case("watchdog", "a node ends; 2 misses every 0.2 s", "watchdog: { node: /measured, every: 200ms, misses: 2 }",
               [], nodes.end, (0.2, 0.4), recover=nodes.recover)
    process = Process(publisher.domain)
    yield Case("watchdog", "a node's process is killed; lease of 10 s", "watchdog: { node: /crashing, every: 200ms, misses: 2 }",
               [], process.crash, (29, 34.5), recover=process.recover, times=0.2)
    a, b = stream(), stream()
    yield Case("rate_ratio", "the output stops; 1 s, at least 0.5", f"rate_ratio: {{ input: {{ {source(a, None)} }}, output: {{ {source(b, None)} }}, window: 1s, error_below: 0.5 }}",
               [a, b], lambda b=b: b.turn_to(0), (window * 0.5 - 1 / 20, window * 0.5 + 1 / 20))
    a, b = stream(), stream()
    yield Case("rate_ratio", "the input stops; 1 s", f"rate_ratio: {{ input: {{ {source(a, None)} }}, output: {{ {source(b, None)} }}, window: 1s, error_below: 0.5 }}",
               [a, b], lambda a=a: a.turn_to(0), (window - 1 / 20, window), shows="unknown")
    a, b = stream(), stream()
    yield Case("sequence", "a bad later value", f"sequence: {{ earlier: {{ {source(a)} }}, later: {{ {source(b)} }}, max_gap: 300ms, error_above: 5 }}",
               [a, b], lambda b=b: b.turn_bad(bad(9)), (0, 0))
    a, b = stream(), stream()
    yield Case("sequence", "the later stage ends; gap 0.3 s", f"sequence: {{ earlier: {{ {source(a)} }}, later: {{ {source(b)} }}, max_gap: 300ms, error_above: 5 }}",
               [a, b], lambda b=b: b.turn_to(0), (0.3 - 1 / 20, 0.3 + 1 / 20), shows="unknown")
    a, b = stream(), stream()
    yield Case("agreement", "a bad number", f"agreement: {{ a: {{ {source(a)} }}, b: {{ {source(b)} }}, max_age: 300ms, error_above: 5 }}",
               [a, b], lambda b=b: b.turn_bad(bad(9)), (0, 0))
    a, b = stream(), stream()
    yield Case("agreement", "an input ends; max_age 0.3 s", f"agreement: {{ a: {{ {source(a)} }}, b: {{ {source(b)} }}, max_age: 300ms, error_above: 5 }}",
               [a, b], lambda b=b: b.turn_to(0), (0.3 - 1 / 20, 0.3), shows="unknown")
    a, b = stream(make=lambda: pose(0), type_name=POSE), stream(make=lambda: pose(0), type_name=POSE)
    poses = lambda a, b: f"a: {{ {source(a, None)}, pose: pose }}, b: {{ {source(b, None)}, pose: pose }}, max_age: 300ms, translation: {{ error_above: 1 }}"
    yield Case("agreement", "a bad pose", f"agreement: {{ {poses(a, b)} }}", [a, b], lambda b=b: b.turn_bad(lambda: pose(3)), (0, 0))
    a, b = (stream(make=lambda: pose(travelled()), type_name=POSE) for _ in range(2))
    yield Case("agreement", "a jump in a motion over 0.5 s", f"agreement: {{ {poses(a, b)}, motion_over: 500ms }}", [a, b],
               lambda b=b: b.turn_bad(lambda: pose(travelled() + 3)), (0, 0))
    a, b = stream(), stream()
    yield Case("expression", "a bad message", f"expression: {{ inputs: {{ a: {{ {source(a)} }}, b: {{ {source(b)} }} }}, max_age: 300ms, error: a + b > 5.0 }}",
               [a, b], lambda b=b: b.turn_bad(bad(9)), (0, 0))
    a, b = stream(), stream()
    yield Case("expression", "an input ends; max_age 0.3 s", f"expression: {{ inputs: {{ a: {{ {source(a)} }}, b: {{ {source(b)} }} }}, max_age: 300ms, error: a + b > 5.0 }}",
               [a, b], lambda b=b: b.turn_to(0), (0.3 - 1 / 20, 0.3), shows="unknown")
    s = stream()
    yield Case("any other", "silence; timeout 0.5 s", f"value: {{ {source(s)}, error_above: 5 }}", [s],
               lambda s=s: s.turn_to(0), (0.5 - 1 / 20, 0.5), shows="unknown")
    s = stream()
    yield Case("any other", "the publisher leaves", f"value: {{ {source(s)}, error_above: 5 }}", [s], lambda s=s: s.leave(), (0, 0.05), shows="unknown")


def config(path, measured):
    lines = ["vehicle: { stages: none }", "defaults: { timeout: 500ms }", "groups:", "  - id: m", "    modules:"]
    lines += [f"      - {{ id: c{number}, monitor: {{ {case.monitor} }} }}" for number, case in enumerate(measured)]
    # Must be there before a reload adds the rest.
    lines += ["      - { id: first, status: first }"]
    path.write_text("\n".join(lines) + "\n")


class Shown:
    """What the newest frame shows of each module, and since when."""

    def __init__(self, server):
        self.server = server
        self.states = {}
        self.changed = asyncio.Condition()

    async def follow(self):
        client = await asyncio.to_thread(Client, self.server, *OPERATOR)
        url = self.server.url.replace("http", "ws", 1) + "/api/v1/stream"
        headers = {"Cookie": client.cookie()}
        async with connect(url, additional_headers=headers, origin=self.server.url, max_size=2**22) as frames:
            async for frame in frames:
                at = time.monotonic()
                (group,) = [group for group in json.loads(frame)["groups"] if group["id"] == "m"]
                async with self.changed:
                    for module in group["modules"]:
                        name, state = module["id"].removeprefix("m/"), module["state"]
                        if self.states.get(name, (None, 0))[0] != state:
                            self.states[name] = (state, at, module["message"])
                    self.changed.notify_all()

    async def wait(self, name, state, seconds=30):
        async with self.changed:
            try:
                fits = lambda: self.states.get(name, (None,))[0] == state
                await asyncio.wait_for(self.changed.wait_for(fits), seconds)
            except TimeoutError:
                raise AssertionError(f"{name} is not {state} within {seconds} s but {self.states.get(name)}") from None
            return self.states[name][1]


class Pulse:
    """Knows when this process was last late: what it published and received then tells nothing."""

    def __init__(self):
        self.late_at = 0

    async def run(self):
        while True:
            due = time.monotonic() + 0.005
            await asyncio.sleep(0.005)
            if time.monotonic() - due > LATE_S:
                self.late_at = time.monotonic()


async def measure(number, case, shown, pulse, times):
    name = f"c{number}"
    # Until then a node that is missing may not have been discovered.
    await asyncio.sleep(SETTLED_S)
    wanted = max(2, round(times * case.times))
    while len(case.took) < wanted:
        await shown.wait(name, "ok")
        await asyncio.sleep(1.2 + random.random() * 0.3)
        began = time.monotonic() - 1
        at = await case.cause()
        if case.shows == "ok":
            await shown.wait(name, "error")
        took = await shown.wait(name, case.shows, seconds=case.high + 30) - at
        case.end()
        if pulse.late_at < began or case.disturbed >= 2 * wanted:
            case.took.append(took)
        else:
            case.disturbed += 1


async def starts(measured, server, count, full):
    """Starts and reloads beside a healthy vehicle. Returns what was worse than UNKNOWN, and how many
    runs tell nothing because the peer was late."""
    all_false, disturbed = [], 0
    pulse = Pulse()
    beating = asyncio.create_task(pulse.run())
    for number in range(2 * count):
        false = []
        reload = number % 2 == 1
        config(server.config, [] if reload else measured)
        await asyncio.to_thread(server.start)
        shown = Shown(server)
        following = asyncio.create_task(shown.follow())
        if reload:
            await asyncio.sleep(2)
            config(server.config, measured)
            server.send(signal.SIGHUP)
        until = time.monotonic() + SETTLED_S
        while time.monotonic() < until:
            async with shown.changed:
                try:
                    await asyncio.wait_for(shown.changed.wait(), 1)
                except TimeoutError:
                    continue
                for name, (state, _, message) in shown.states.items():
                    if state in ("warning", "error") and name != "first":
                        case = measured[int(name.removeprefix("c"))]
                        false.append(("reload" if reload else "start", number, case.kind, case.fault, state, message))
        unsettled = [measured[int(name[1:])].fault for name, (state, *_) in shown.states.items() if state != "ok" and name != "first"]
        if unsettled or len(shown.states) < full:
            false.append(("reload" if reload else "start", number, "not OK within", SETTLED_S, unsettled, len(shown.states)))
        following.cancel()
        await asyncio.to_thread(server.stop)
        if pulse.late_at < until - SETTLED_S:
            all_false += false
        else:
            disturbed += 1
    beating.cancel()
    return sorted({repr(one) for one in all_false}), disturbed


def milliseconds(seconds):
    return f"{seconds * 1000:.0f}"


def report(measured):
    """The table, and whether every median is as stated."""
    print(f"{'kind':<12} {'fault':<44} {'stated, ms':>14} {'min':>7} {'median':>7} {'max':>7} {'n':>4}")
    good = True
    for case in measured:
        middle = statistics.median(case.took)
        as_stated = case.low - 0.01 <= middle <= case.high + WAY_S
        good &= as_stated
        stated = milliseconds(case.low) if case.low == case.high else f"{milliseconds(case.low)} to {milliseconds(case.high)}"
        figures = " ".join(f"{milliseconds(one):>7}" for one in (min(case.took), middle, max(case.took)))
        print(f"{case.kind:<12} {case.fault:<44} {stated:>14} {figures} {len(case.took):>4}{'' if as_stated else '  NOT AS STATED'}")
    return good


async def run(options, folder):
    publisher = Peer(options.domain)
    measured = list(cases(publisher))
    server = Server(folder, options.domain, config=folder / "measure.yaml")
    await asyncio.to_thread(server.add_user, *OPERATOR)
    config(server.config, measured)
    publishing = [asyncio.create_task(stream.run()) for case in measured for stream in case.streams]
    try:
        await asyncio.to_thread(server.start)
        shown, pulse = Shown(server), Pulse()
        beside = [asyncio.create_task(shown.follow()), asyncio.create_task(pulse.run())]
        await asyncio.gather(*(measure(number, case, shown, pulse, options.times) for number, case in enumerate(measured)))
        for task in beside:
            task.cancel()
        await asyncio.to_thread(server.stop)
        conditions = f"load {os.getloadavg()[0]:.1f}, measured again because the peer was late: {sum(case.disturbed for case in measured)}"
        print(f"{TELLTALE}, {os.cpu_count()} cores, {conditions}")
        good = report(measured)
        false, disturbed = await starts(measured, server, options.starts, len(measured) + 1)
        runs = f"{options.starts} starts and {options.starts} reloads beside a healthy vehicle"
        print(f"\n{runs}: {len(false)} false states; in {disturbed} of them the peer was late, and they do not count")
        print("".join(f"  {one}\n" for one in false), end="")
        for task in publishing:
            if task.done():
                task.result()
        return good and not false
    finally:
        server.stop()
        for task in publishing:
            task.cancel()
        for case in measured:
            if isinstance(owner := getattr(case.cause, "__self__", None), Process):
                owner.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=20, help="each fault")
    parser.add_argument("--starts", type=int, default=5, help="and as many reloads")
    parser.add_argument("--domain", type=int, default=own_domain())
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="telltale-") as folder:
        return 0 if asyncio.run(run(options, Path(folder))) else 1


if __name__ == "__main__":
    sys.exit(main())
