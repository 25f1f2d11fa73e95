"""ROS 2 over Zenoh as `peer.py` uses it, by pyzeros: a second library, with its own keys, tokens, hashes, attachments and
types. It writes and reads topics, and has no transient-local publishers.

pyzeros compiles the code for its attachments at their first use, for up to a minute: `pyzeros_node.py` alone does that."""

import asyncio
import importlib
import os
import queue
import sys
import time

os.environ.setdefault("CYDR_CACHE_DIR", sys.prefix + "/cydr")

import pyzeros
from pyzeros import sub
import rmw_zenoh
import zenoh


def message(type_name):
    """`std_msgs::msg::dds_::Bool_` as pyzeros has it."""
    package, kind, _, name = type_name.split("::")
    return getattr(importlib.import_module(f"ros2_pyterfaces.cyclone.{package}.{kind}"), name.removesuffix("_"))


class Participant:
    def __init__(self, options):
        # pyzeros makes futures, which want a loop.
        asyncio.set_event_loop(asyncio.new_event_loop())
        session = zenoh.open(rmw_zenoh.config(os.environ.get("PEER_MODE", "peer"), listen__endpoints=[]))
        self.guid, self.held = bytes(16), []
        self.node = pyzeros.Session("peer", zenoh_session=session, domain_id=options.domain)

    def writer(self, topic, type_name):
        return Writer(self, *rmw_zenoh.named(topic, type_name)[:2])

    def receive(self, topics):
        came = queue.SimpleQueue()
        readers = []
        for index, (topic, type_name) in enumerate(topics):
            name, type_name, _ = rmw_zenoh.named(topic, type_name)

            def hear(sample, index=index):
                came.put((index, sample.payload.to_bytes(), time.monotonic_ns()))

            readers.append(sub.RawSub(message(type_name), "/" + name, hear, session=self.node))
        yield readers
        while True:
            yield came.get()

    def close(self):
        self.node.session.close()


class Writer:
    def __init__(self, participant, name, type_name):
        self.type, self.participant = message(type_name), participant
        self.publisher = pyzeros.Pub(self.type, "/" + name, session=participant.node)

    def write(self, data, stamp_ns):
        self.publisher.publish(self.type.deserialize(data))

    def complaints(self):
        return 0

    def acknowledged(self):
        return True


if __name__ == "__main__":
    attachment = pyzeros.builtin_msgs.Attachment
    attachment.deserialize(attachment().serialize())
