#!/usr/bin/env python3
"""A foreign peer for the tests: Eclipse Cyclone DDS, eProsima Fast DDS or Eclipse Zenoh in a process of its own,
on the loopback interface where no other is named, which speaks the ROS 2 wire format (`wire.py`).

    peer.py --domain 7 pub                    writes what the JSON lines on standard input say
    peer.py --domain 7 sub --topic rt/x ...   prints what it receives, as JSON lines
    peer.py --domain 7 load --statuses 1000 --rate 800 --seconds 5
    peer.py --domain 7 swell --names 4096 --values 256 --bytes 5000 --seconds 10
    peer.py --domain 7 crowd --participants 100 --endpoints 20

It needs PyPI `cyclonedds` 11; with `--dds fastdds` the library that `tests/run.sh` makes of `fastdds.cpp`, named by
TELLTALE_PEER_FASTDDS. Every command prints {"ready": true} first.

`pub` reads one command a line:
    {"statuses": [{"level": 2, "name": "a", "message": "b", "hardware_id": "c", "values": {"k": "v"}}]}
    {"count": 10000}                  that many made-up statuses
    {"bool": true}   {"text": "x"}    for --type Bool and String
    {"info": {"size": 24, "name": "n"}}   a node announcement with gids of that size; no name: no node
    {"message": "Odometry", "fields": {...}}   one of `interfaces.py`
    {"raw": "000100..."}              these very bytes, the encapsulation included
    {"wait_matched": 1, "timeout": 10}    until that many readers match; prints {"matched": n}
    {"complaints": true}              prints {"complaints": n}: readers that asked for more than is offered
Any of them may have `"cut": n` (only the first n bytes), `"times": n` and `"age_s": n` (stamped so long ago). Each
write prints {"written": bytes, "at_ns": when, on the monotonic clock, "stamp_ns": its last stamp}; `sub` prints when it received. With Cyclone
the byte order is always that of this machine: it writes the encapsulation. At the end of input it waits until all was
acknowledged and prints {"done": true}.
"""

import argparse
import importlib
import json
import os
import sys
import threading
import time

import wire

TYPES = {
    "DiagnosticArray": wire.DIAGNOSTIC_ARRAY,
    "Bool": wire.BOOL,
    "String": wire.STRING,
    "DiagnosticStatus": wire.STATUS,
    "TwistStamped": wire.TWIST_STAMPED,
    "AccelStamped": wire.ACCEL_STAMPED,
    "PoseWithCovarianceStamped": wire.POSE_WITH_COVARIANCE_STAMPED,
    "Log": wire.LOG,
    "ParticipantEntitiesInfo": wire.PARTICIPANT_ENTITIES_INFO,
}

SPEAKING = threading.Lock()


def say(**words):
    """A line at once: several threads may speak."""
    with SPEAKING:
        print(json.dumps(words), flush=True)


def write(writer, data, age_s=0):
    """Returns the stamp."""
    stamp_ns = time.time_ns() - int(age_s * 1e9)
    writer.write(data, stamp_ns)
    return stamp_ns


def wait_matched(writer, count, timeout):
    end = time.monotonic() + timeout
    while writer.matched() < count:
        if time.monotonic() > end:
            sys.exit(f"peer.py: no {count} readers within {timeout} s")
        time.sleep(0.01)
    return writer.matched()


def made_up(count):
    """About 100 bytes a status on the wire."""
    return [
        {
            "level": i % 3,
            "name": f"/load/node_{i:05}: rate",
            "message": "within its limits",
            "hardware_id": "unit",
            "values": {"hz": "10.0"},
        }
        for i in range(count)
    ]


def encode(command, gid):
    if "raw" in command:
        data = bytes.fromhex(command["raw"])
    elif "bool" in command:
        data = wire.boolean(command["bool"])
    elif "text" in command:
        data = wire.text(command["text"])
    elif "message" in command:
        # Imported late: it needs Cyclone, which reads its configuration then.
        import interfaces

        data = interfaces.encode(command["message"], command.get("fields"))
    elif "info" in command:
        info = command["info"]
        nodes = [("/", info["name"], [], [])] if "name" in info else []
        data = wire.participant_entities_info(gid, nodes, info["size"])
    else:
        statuses = made_up(command["count"]) if "count" in command else command["statuses"]
        data = wire.diagnostic_array(statuses)
    return data[: command["cut"]] if "cut" in command else data


def publish(participant, options):
    writer = participant.writer(options.topic[0], TYPES.get(options.type, options.type))
    say(ready=True)
    for line in sys.stdin:
        command = json.loads(line)
        if "wait_matched" in command:
            say(matched=wait_matched(writer, command["wait_matched"], command.get("timeout", 20)))
            continue
        if "complaints" in command:
            say(complaints=writer.complaints())
            continue
        data = encode(command, participant.guid)
        at_ns = time.monotonic_ns()
        for _ in range(command.get("times", 1)):
            stamp_ns = write(writer, data, command.get("age_s", 0))
        say(written=len(data), at_ns=at_ns, stamp_ns=stamp_ns)
    say(done=writer.acknowledged())


def subscribe(participant, options):
    topics = []
    for name in options.topic or ["rt/diagnostics=DiagnosticArray"]:
        name, _, type_name = name.partition("=")
        topics.append((name, TYPES.get(type_name, type_name) or wire.DIAGNOSTIC_ARRAY))
    received = participant.receive(topics)
    next(received)
    say(ready=True)
    for index, data, at_ns in received:
        name, type_name = topics[index]
        say(topic=name, bytes=len(data), value=wire.READ[type_name](data), at_ns=at_ns)


def serve(participant, options):
    """Reads the requests of a service and writes its replies, as a server of ROS 2 does, until its
    input ends. It answers what the last JSON line on standard input says, and nobody before the first:
        {"state": 3, "label": "active"}     as lifecycle_msgs/srv/GetState does   {}    nobody
    It prints {"told": true} for each line."""
    type_name = f"{options.type}_{{}}_"
    replies = (f"rr{options.service}Reply", type_name.format("Response"))
    requests = (f"rq{options.service}Request", type_name.format("Request"))
    serving = participant.server(requests, replies)
    answer = {}

    def answer_all():
        for request in serving.requests():
            if "state" in answer:
                serving.reply(request, wire.lifecycle_state(answer))

    answering = threading.Thread(target=answer_all, daemon=True)
    say(ready=True)
    for line in sys.stdin:
        answer = json.loads(line)
        if not answering.is_alive():
            answering.start()
        say(told=True)
    say(done=True)
    if answering.is_alive():
        # The thread above reads on, so the participant is not taken from under it.
        sys.stdout.flush()
        os._exit(0)


def client(participant, options):
    """Calls a service with what the JSON lines on standard input say:
        {"text": "a"}     a request with one string   {}   an empty one   {"raw": "0001..."}   these very bytes
        {"wait_matched": 1}   until requests and replies have so many servers, as a client of ROS waits for a service
    With Cyclone, "sequence" is the number of the request, the next one by default: the same number again is the
    same request. "times" sends it so often. It prints {"asked": number} of the last, and for each reply {"reply":
    {...}, "sequence": number, "mine": whether it replies to a request of this client}."""
    type_name = f"{options.type}_{{}}_"
    requests = (f"rq{options.service}Request", type_name.format("Request"))
    replies = (f"rr{options.service}Reply", type_name.format("Response"))
    asking = participant.client(requests, replies, not options.older)

    def print_replies():
        for mine, sequence, data in asking.replies():
            say(reply=wire.read_service_reply(data), sequence=sequence, mine=mine)

    threading.Thread(target=print_replies, daemon=True).start()
    say(ready=True)
    number = 0
    for line in sys.stdin:
        command = json.loads(line)
        if "wait_matched" in command:
            say(matched=wait_matched(asking, command["wait_matched"], command.get("timeout", 20)))
            continue
        for _ in range(command.get("times", 1)):
            number = command.get("sequence", number + 1)
            asked = asking.request(wire.service_request(command), number)
        say(asked=asked)
    say(done=True)
    # The thread above reads on, so the participant is not taken from under it.
    sys.stdout.flush()
    os._exit(0)


def load(participant, options):
    """Sends arrays of `--statuses` at `--rate` a second. Only the first status differs: its values
    `sequence` and `sent_ns` (CLOCK_MONOTONIC) are patched into the ready-made bytes, with `--say` its
    message too, and with `--flip` its level."""
    writer = participant.writer("rt/diagnostics", wire.DIAGNOSTIC_ARRAY)
    statuses = made_up(options.statuses)
    if options.levels == "ok":
        for status in statuses:
            status["level"] = 0
    statuses[0]["name"] = (options.name or statuses[0]["name"]).replace("~", " ")
    statuses[0]["values"] = {"sequence": "S" * 12, "sent_ns": "N" * 20}
    if options.say:
        statuses[0]["message"] = "N" * 20
    data = bytearray(wire.diagnostic_array(statuses))
    # The level that differs shows where it stands in the bytes.
    other = wire.diagnostic_array([{**statuses[0], "level": statuses[0].get("level", 0) + 1}] + statuses[1:])
    level_at = next(at for at, (a, b) in enumerate(zip(data, other)) if a != b)
    level = data[level_at]
    sequence_at, sent_at, said_at = data.index(b"S" * 12), data.rindex(b"N" * 20), data.index(b"N" * 20)
    say(ready=True)
    wait_matched(writer, 1, 30)
    say(matched=1, bytes=len(data))
    # A pause for the reader that has just matched to be ready on its side too.
    time.sleep(1)

    clock = time.CLOCK_MONOTONIC
    start = time.clock_gettime_ns(clock)
    total = int(options.rate * options.seconds)
    interval_ns = 1e9 / options.rate
    sent = 0
    while sent < total:
        now = time.clock_gettime_ns(clock)
        ahead = start + int(sent * interval_ns) - now
        if ahead > 0:
            time.sleep(ahead / 1e9)
            continue
        if now - start > options.seconds * 2e9:
            break
        data[sequence_at : sequence_at + 12] = b"%012d" % sent
        if options.flip:
            data[level_at] = level + sent % 2
        sent_ns = options.mark + b"%019d" % time.clock_gettime_ns(clock)
        data[sent_at : sent_at + 20] = data[said_at : said_at + 20] = sent_ns
        write(writer, bytes(data))
        sent += 1
    took = (time.clock_gettime_ns(clock) - start) / 1e9
    say(done=writer.acknowledged(), arrays=sent, statuses=sent * options.statuses, seconds=took, statuses_per_s=sent * options.statuses / took)


def swell(participant, options):
    """Sends status after status as fast as they are taken, each of the next name, with `--values` of
    `--bytes` each."""
    writer = participant.writer("rt/diagnostics", wire.DIAGNOSTIC_ARRAY)
    values = {f"key {number:03}": "9" * options.bytes for number in range(options.values)}
    status = {"level": 0, "name": "swell NNNNN", "message": "large", "hardware_id": "unit", "values": values}
    data = bytearray(wire.diagnostic_array([status]))
    at = data.index(b"NNNNN")
    say(ready=True)
    wait_matched(writer, 1, 30)
    ends = time.monotonic() + options.seconds
    sent = 0
    while time.monotonic() < ends:
        data[at : at + 5] = b"%05d" % (sent % options.names)
        write(writer, bytes(data))
        sent += 1
    say(done=True, statuses=sent, bytes=sent * len(data))


def crowd(participant, options):
    """Many participants in one process, each with many endpoints; one of these says twice a second that it is well:
    `crowd 0`, `crowd 1` and so on."""
    others = [type(participant)(options) for _ in range(options.participants - 1)]
    speaking, silent = [], []
    for number, one in enumerate([participant, *others]):
        silent += [one.writer(f"rt/crowd_{number}_{it}", wire.STRING) for it in range(options.endpoints - 1)]
        statuses = [{"level": 0, "name": f"crowd {number}", "message": "well"}]
        speaking.append((one.writer("rt/diagnostics", wire.DIAGNOSTIC_ARRAY), wire.diagnostic_array(statuses)))
    say(ready=True, held=len(silent))
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(0.5):
        for writer, data in speaking:
            write(writer, data)
    say(done=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("--dds", choices=["cyclone", "fastdds", "rmw_zenoh", "pyzeros_node"], default="cyclone")
    parser.add_argument("--interface", default="lo", help="of Cyclone; it finds nobody by itself on any but lo")
    parser.add_argument("--lease-s", type=float, default=10.0, help="a peer that was killed is gone after so long")
    parser.add_argument("--announce-s", type=float, default=0.5, help="how often a peer announces itself")
    parser.add_argument("--multicast", action="store_true", help="Cyclone speaks to the group, as it does by default")
    parser.add_argument("--reliability", choices=["reliable", "best_effort"], default="reliable")
    parser.add_argument("--durability", choices=["volatile", "transient_local"], default="volatile")
    parser.add_argument("--depth", type=int, default=1000)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("pub")
    one.add_argument("--topic", nargs=1, default=["rt/diagnostics"])
    one.add_argument("--type", default="DiagnosticArray", help=", ".join(TYPES) + " or a whole DDS type name")
    one.set_defaults(run=publish)
    one = commands.add_parser("sub")
    one.add_argument("--topic", nargs="+", action="extend", metavar="NAME=TYPE", help="default: rt/diagnostics=DiagnosticArray")
    one.set_defaults(run=subscribe)
    one = commands.add_parser("serve")
    one.add_argument("--service", required=True, help="with its namespace: /map/get")
    one.add_argument("--type", default="std_srvs::srv::dds_::Trigger")
    one.set_defaults(run=serve)
    one = commands.add_parser("client")
    one.add_argument("--service", required=True, help="with its namespace: /telltale/reload")
    one.add_argument("--type", default="std_srvs::srv::dds_::Trigger")
    one.add_argument("--older", action="store_true", help="as Fast DDS of before Foxy: it does not name its reader of replies")
    one.set_defaults(run=client)
    one = commands.add_parser("load")
    one.add_argument("--statuses", type=int, default=1000)
    one.add_argument("--rate", type=float, default=100.0)
    one.add_argument("--seconds", type=float, default=5.0)
    one.add_argument("--levels", choices=["mixed", "ok"], default="mixed")
    one.add_argument("--name", help="of the first status; ~ stands for a blank")
    one.add_argument("--mark", type=str.encode, default=b"0", help="first digit of sent_ns: tells loads apart")
    one.add_argument("--say", action="store_true", help="the first status says sent_ns in its message too")
    one.add_argument("--flip", action="store_true", help="the first status changes its level every time")
    one.set_defaults(run=load)
    one = commands.add_parser("swell")
    one.add_argument("--names", type=int, default=4096)
    one.add_argument("--values", type=int, default=256, help="of each status")
    one.add_argument("--bytes", type=int, default=5000, help="of each value")
    one.add_argument("--seconds", type=float, default=10.0)
    one.set_defaults(run=swell)
    one = commands.add_parser("crowd")
    one.add_argument("--participants", type=int, default=100)
    one.add_argument("--endpoints", type=int, default=20, help="of each participant")
    one.set_defaults(run=crowd)
    options = parser.parse_args()
    participant = importlib.import_module(options.dds).Participant(options)
    options.run(participant, options)
    participant.close()


if __name__ == "__main__":
    try:
        main()
    except (KeyboardInterrupt, BrokenPipeError):
        pass
