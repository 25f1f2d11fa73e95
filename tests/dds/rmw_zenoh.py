"""ROS 2 over Zenoh as `peer.py` uses it: Eclipse Zenoh in Python, with the keys, tokens and attachments of rmw_zenoh.
No rmw_zenoh_cpp runs here. Names are given as on DDS, with `rt/`, `rq/` and `rr/`.

The session is a peer, as in rmw_zenoh, at the router that ZENOH_CONFIG_OVERRIDE names. `router` runs one, and `forge` says
what no node says."""

import itertools
import json
import os
import queue
import struct
import sys
import time

import xxhash
import zenoh
import zenoh.ext

zenoh.init_log_from_env_or("error")

NODE = "peer"
# Any hash: Telltale asks for none, and publishes on those of the readers.
HASH = "RIHS01_" + "5a" * 32


def config(mode, **settings):
    made = zenoh.Config()
    made.insert_json5("mode", json.dumps(mode))
    made.insert_json5("scouting/multicast/enabled", "false")
    for setting in filter(None, os.environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
        made.insert_json5(*setting.split("=", 1))
    for key, value in settings.items():
        made.insert_json5(key.replace("__", "/"), json.dumps(value))
    return made


def router(endpoint):
    """Runs a router at an endpoint until its input ends."""
    with zenoh.open(config("router", connect__endpoints=[], listen__endpoints=[endpoint])):
        print(json.dumps({"ready": True}), flush=True)
        sys.stdin.read()


def named(topic, type_name):
    """The ROS name and the type of a topic of DDS, and its prefix."""
    for before, behind, kind in (("rq/", "Request", "_Request_"), ("rr/", "Reply", "_Response_")):
        if topic.startswith(before):
            return topic.removeprefix(before).removesuffix(behind), type_name.removesuffix(kind) + "_", before
    return topic.removeprefix("rt/"), type_name, "rt/"


class Participant:
    def __init__(self, options):
        self.options, self.domain = options, options.domain
        self.session = zenoh.open(config(os.environ.get("PEER_MODE", "peer"), listen__endpoints=[]))
        self.guid = bytes(16)
        self.entities = itertools.count(1)
        self.held = [self.token("NN")]

    def token(self, kind, *channel):
        entity = 0 if kind == "NN" else next(self.entities)
        reliable = "" if self.options.reliability == "reliable" else "2"
        durable = "1" if self.options.durability == "transient_local" else ""
        parts = ["@ros2_lv", self.domain, self.session.zid(), 0, entity, kind, "%", "%", NODE]
        if channel:
            name, type_name = channel
            parts += ["%" + name.replace("/", "%"), type_name, HASH, f"{reliable}:{durable}:,{self.options.depth}:,:,:,,"]
        key = "/".join(map(str, parts))
        return key, self.session.liveliness().declare_token(key)

    def key(self, name, type_name, hash="*"):
        return f"{self.domain}/{name}/{type_name}/{hash}"

    def writer(self, topic, type_name):
        return Writer(self, *named(topic, type_name)[:2])

    def receive(self, topics):
        """What comes on topics for ever: their index, the bytes and when, on the monotonic clock. The first are the
        readers."""
        came = queue.SimpleQueue()
        readers = []
        for index, (topic, type_name) in enumerate(topics):
            name, type_name, _ = named(topic, type_name)

            def hear(sample, index=index):
                came.put((index, sample.payload.to_bytes(), time.monotonic_ns()))

            self.held.append(self.token("MS", name, type_name))
            late = self.options.durability == "transient_local"
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True) if late else None
            key = self.key(name, type_name, HASH)
            readers.append(zenoh.ext.declare_advanced_subscriber(self.session, key, hear, history=history))
        yield readers
        while True:
            yield came.get()

    def client(self, requests, replies, newer):
        return Client(self, *named(*requests)[:2])

    def server(self, requests, replies):
        return Server(self, *named(*requests)[:2])

    def close(self):
        self.session.close()


class Writer:
    def __init__(self, participant, name, type_name):
        self.participant, self.name, self.type_name = participant, name, type_name
        (self.token, _), options = participant.token("MP", name, type_name), participant.options
        participant.held.append(_)
        extra = {}
        if options.durability == "transient_local":
            extra = {
                "cache": zenoh.ext.CacheConfig(options.depth),
                "publisher_detection": True,
                "sample_miss_detection": zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
            }
        key = participant.key(name, type_name, HASH)
        self.publisher = zenoh.ext.declare_advanced_publisher(participant.session, key, **extra)
        self.numbers = itertools.count(1)

    def write(self, data, stamp_ns):
        self.publisher.put(data, attachment=attachment(next(self.numbers), stamp_ns, self.token))

    def matched(self):
        """How many subscribers are announced."""
        own, name = self.participant, "%" + self.name.replace("/", "%")
        tokens = own.session.liveliness().get(f"@ros2_lv/{own.domain}/*/*/*/MS/*/*/*/{name}/{self.type_name}/**")
        return sum(reply.ok is not None for reply in tokens)

    def complaints(self):
        return 0

    def acknowledged(self):
        return True


class Client:
    def __init__(self, participant, name, type_name):
        self.token, _ = participant.token("SC", name, type_name)
        self.participant, self.name, self.type_name = participant, name, type_name
        participant.held.append(_)
        self.came = queue.SimpleQueue()

    def server_hash(self):
        own, name = self.participant, "%" + self.name.replace("/", "%")
        tokens = own.session.liveliness().get(f"@ros2_lv/{own.domain}/*/*/*/SS/*/*/*/{name}/{self.type_name}/**")
        found = [str(reply.ok.key_expr).split("/")[-2] for reply in tokens if reply.ok]
        return found[0] if found else None

    def matched(self):
        return int(self.server_hash() is not None)

    def request(self, data, sequence):
        def hear(reply):
            if reply.ok:
                (number,) = struct.unpack_from("<q", reply.ok.attachment.to_bytes())
                self.came.put((number == sequence, number, reply.ok.payload.to_bytes()))

        own = self.participant
        key = own.key(self.name, self.type_name, self.server_hash())
        attached = attachment(sequence, time.time_ns(), self.token)
        own.session.get(key, hear, payload=data, attachment=attached, target=zenoh.QueryTarget.ALL_COMPLETE)
        return sequence

    def replies(self):
        while True:
            yield self.came.get()


class Server:
    def __init__(self, participant, name, type_name):
        self.came, key = queue.SimpleQueue(), participant.key(name, type_name, HASH)
        self.service = participant.session.declare_queryable(key, self.came.put, complete=True)
        self.token = participant.token("SS", name, type_name)

    def requests(self):
        while True:
            yield self.came.get()

    def reply(self, query, data):
        query.reply(query.key_expr, data, attachment=query.attachment)
        query.drop()


def attachment(number, stamp_ns, token):
    digest = xxhash.xxh3_128(token.encode()).intdigest()
    return struct.pack("<qqB", number, stamp_ns, 16) + digest.to_bytes(16, "little")


def forge():
    """Declares tokens and publishes as the JSON lines on standard input say, and answers each line:
    {"tokens": [key, ...]}            they are there
    {"flood": "a/{n}", "count": n, "sessions": m}   and so are these, numbered; {z} counts to m, and {y} to 256
    {"forget": true}                  all are gone
    {"find": "a/**"}                  says which are there
    {"key": k, "data": hex, "attachment": hex}"""
    with zenoh.open(config("client")) as session:
        held = []
        print(json.dumps({"ready": True}), flush=True)
        for line in sys.stdin:
            said = json.loads(line)
            refused = 0
            many = said.get("sessions", 1)
            flood = (said["flood"].format(n=n, z=n % many, y=n // many % 256) for n in range(said.get("count", 0)))
            for key in itertools.chain(said.get("tokens", ()), flood):
                try:
                    held.append(session.liveliness().declare_token(key))
                except zenoh.ZError:
                    refused += 1
            if "forget" in said:
                for token in held:
                    token.undeclare()
                held = []
            if "find" in said:
                there = [str(reply.ok.key_expr) for reply in session.liveliness().get(said["find"]) if reply.ok]
                print(json.dumps({"found": there}), flush=True)
            if "key" in said:
                attached = said.get("attachment")
                attached = None if attached is None else bytes.fromhex(attached)
                session.put(said["key"], bytes.fromhex(said["data"]), attachment=attached)
            print(json.dumps({"done": len(held), "refused": refused}), flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["forge"]:
        forge()
    elif sys.argv[1:2] == ["router"]:
        router(sys.argv[2])
