"""Eclipse Cyclone DDS as `peer.py` uses it: samples pass as bytes, with their encapsulation."""

import argparse
import os
import struct
import sys
import time

# Without multicast, unless it is asked for, the peers find one another on the well-known ports of 127.0.0.1: it works
# where the loopback interface has no multicast flag, and nothing can leave the machine.
CONFIG = """
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface name="{interface}" multicast="{multicast}"/></Interfaces>
    <AllowMulticast>{multicast}</AllowMulticast>
    <MaxMessageSize>65500B</MaxMessageSize>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>
    <Peers>{peers}</Peers>
    <SPDPInterval>{announce_s}s</SPDPInterval>
    <LeaseDuration>{lease_s}s</LeaseDuration>
  </Discovery>
</Domain></CycloneDDS>
"""


def load(options):
    """Imports Cyclone late: its configuration is read then."""
    os.environ["CYCLONEDDS_URI"] = CONFIG.format(
        lease_s=options.lease_s,
        announce_s=options.announce_s,
        interface=options.interface,
        multicast=str(options.multicast).lower(),
        peers="" if options.multicast or options.interface != "lo" else '<Peer address="127.0.0.1"/>',
    )
    try:
        import cyclonedds._clayer as clayer
        from cyclonedds import core, domain, idl, pub, qos, sub, topic, util
    except ImportError as error:
        sys.exit(f"peer.py: {error}. Install it: pip install cyclonedds==11.0.1")
    return argparse.Namespace(
        clayer=clayer, core=core, domain=domain, idl=idl, pub=pub, qos=qos, sub=sub, topic=topic, util=util
    )


OPAQUE = {}


def opaque(lib, type_name):
    """A type whose samples pass as bytes: only its name matters. One for each name: each costs Cyclone many megabytes."""
    if type_name not in OPAQUE:
        from dataclasses import dataclass

        @dataclass
        class Opaque(lib.idl.IdlStruct, typename=type_name.replace("::", ".")):
            octet: lib.idl.types.uint8

        assert Opaque.__idl__.idl_transformed_typename == type_name
        OPAQUE[type_name] = Opaque
    return OPAQUE[type_name]


class Participant:
    def __init__(self, options):
        self.lib = load(options)
        self.dds = self.lib.domain.DomainParticipant(options.domain)
        self.guid = self.dds.guid.bytes
        self.qos = self.make_qos(options)

    def make_qos(self, options):
        policy, duration = self.lib.qos.Policy, self.lib.util.duration
        reliable, transient_local = options.reliability == "reliable", options.durability == "transient_local"
        return self.lib.qos.Qos(
            policy.Reliability.Reliable(duration(seconds=10)) if reliable else policy.Reliability.BestEffort,
            policy.Durability.TransientLocal if transient_local else policy.Durability.Volatile,
            policy.History.KeepLast(options.depth),
            # Only XCDR1 is offered, as every ROS 2 does.
            policy.DataRepresentation(use_cdrv0_representation=True),
        )

    def topic(self, name, type_name):
        return self.lib.topic.Topic(self.dds, name, opaque(self.lib, type_name))

    def writer(self, name, type_name):
        return Writer(self.lib, self.lib.pub.DataWriter(self.dds, self.topic(name, type_name), qos=self.qos))

    def receive(self, topics):
        """What comes on topics, pairs of a name and a type, for ever: their index, the bytes and
        when, on the monotonic clock. The first are the readers."""
        lib = self.lib
        state = lib.core
        any_state = state.SampleState.Any | state.ViewState.Any | state.InstanceState.Any
        readers = [lib.sub.DataReader(self.dds, self.topic(*topic), qos=self.qos) for topic in topics]
        waitset = lib.core.WaitSet(self.dds)
        for reader in readers:
            waitset.attach(lib.core.ReadCondition(reader, any_state))
        yield readers
        while True:
            waitset.wait(lib.util.duration(seconds=1))
            at_ns = time.monotonic_ns()
            for index, reader in enumerate(readers):
                taken = lib.clayer.ddspy_take(reader._ref, any_state, 100)
                for data, info in taken if isinstance(taken, list) else []:
                    if info.valid_data:
                        yield index, data, at_ns

    def client(self, requests, replies, newer):
        return Client(self, requests, replies)

    def server(self, requests, replies):
        return Server(self, requests, replies)

    def close(self):
        """Cyclone says goodbye by itself while the process ends."""


class Client:
    """A client of a service, as rmw_cyclonedds makes it: 16 bytes before the request say whose it is and its
    number, and stand before the reply again."""

    def __init__(self, participant, requests, replies):
        self.own = os.urandom(8)
        self.received = participant.receive([replies])
        (self.reader,) = next(self.received)
        self.writer = participant.writer(*requests)

    def matched(self):
        """How many servers are there, for its requests and their replies."""
        return min(self.writer.matched(), len(self.reader.get_matched_publications()))

    def request(self, data, sequence):
        """Returns the number of the request."""
        self.writer.write(data[:4] + self.own + struct.pack("<q", sequence) + data[4:], time.time_ns())
        return sequence

    def replies(self):
        """Replies for ever: whether each is ours, the number of its request, and its bytes."""
        for _, data, _ in self.received:
            (sequence,) = struct.unpack("<q", data[12:20])
            yield data[4:12] == self.own, sequence, data[:4] + data[20:]


class Server:
    """A server, as rmw_cyclonedds makes it: it repeats the first 16 bytes of each request."""

    def __init__(self, participant, requests, replies):
        self.writer = participant.writer(*replies)
        self.received = participant.receive([requests])
        next(self.received)

    def requests(self):
        for _, data, _ in self.received:
            assert len(data) >= 21, f"no request of a client of Cyclone: {data.hex()}"
            yield data[4:20]

    def reply(self, request, data):
        self.writer.write(data[:4] + request + data[4:], time.time_ns())


class Writer:
    def __init__(self, lib, dds):
        self.lib, self.dds = lib, dds

    def write(self, data, stamp_ns):
        code = self.lib.clayer.ddspy_write_ts(self.dds._ref, data, stamp_ns)
        if code < 0:
            raise self.lib.core.DDSException(code, "while writing")

    def matched(self):
        return len(self.dds.get_matched_subscriptions())

    def complaints(self):
        """How many readers asked for more than this writer offers."""
        return self.dds.get_offered_incompatible_qos_status().total_count

    def acknowledged(self):
        """False if the readers did not acknowledge all within 10 s."""
        try:
            return self.dds.wait_for_acks(self.lib.util.duration(seconds=10))
        except (self.lib.core.DDSException, AttributeError):
            # Cyclone's Python stumbles over a name of its own when the time is up.
            return False
