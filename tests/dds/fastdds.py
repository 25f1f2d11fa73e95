"""eProsima Fast DDS as `peer.py` uses it, through the library that `fastdds.cpp` makes."""

import ctypes
import os
import sys
import time

POINTER, NUMBER, TEXT, FLAG = ctypes.c_void_p, ctypes.c_int32, ctypes.c_char_p, ctypes.c_bool
FUNCTIONS = {
    "fast_open": (POINTER, ctypes.c_uint32, NUMBER, NUMBER),
    "fast_guid": (None, POINTER, POINTER),
    "fast_writer": (POINTER, POINTER, TEXT, TEXT, FLAG, FLAG, NUMBER),
    "fast_write": (FLAG, POINTER, TEXT, ctypes.c_size_t, ctypes.c_int64),
    "fast_matched": (NUMBER, POINTER),
    "fast_writers": (NUMBER, POINTER),
    "fast_complaints": (NUMBER, POINTER),
    "fast_acknowledged": (FLAG, POINTER, NUMBER),
    "fast_reader": (POINTER, POINTER, ctypes.c_uint32, TEXT, TEXT, FLAG, FLAG, NUMBER),
    "fast_take": (POINTER, POINTER, NUMBER, POINTER, POINTER),
    "fast_related": (ctypes.c_int64, POINTER, POINTER),
    "fast_request": (ctypes.c_int64, POINTER, POINTER, TEXT, ctypes.c_size_t, POINTER),
    "fast_asked": (ctypes.c_int64, POINTER, POINTER),
    "fast_reply": (FLAG, POINTER, TEXT, ctypes.c_size_t, TEXT, ctypes.c_int64),
    "fast_close": (None, POINTER),
}


def load():
    path = os.environ.get("TELLTALE_PEER_FASTDDS")
    if not path:
        sys.exit("peer.py: TELLTALE_PEER_FASTDDS is not set: it names the library that tests/run.sh makes of fastdds.cpp")
    lib = ctypes.CDLL(path)
    for name, (result, *arguments) in FUNCTIONS.items():
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


def there(value, what):
    return value or sys.exit(f"peer.py: Fast DDS: {what}; see its errors above")


class Participant:
    def __init__(self, options):
        self.lib = load()
        self.dds = there(self.lib.fast_open(options.domain, int(options.lease_s * 1000), int(options.announce_s * 1000)), "no participant")
        guid = ctypes.create_string_buffer(16)
        self.lib.fast_guid(self.dds, guid)
        self.guid = guid.raw
        self.qos = (options.reliability == "reliable", options.durability == "transient_local", options.depth)

    def writer(self, name, type_name):
        made = self.lib.fast_writer(self.dds, name.encode(), type_name.encode(), *self.qos)
        return Writer(self.lib, there(made, f"no writer of {name}"))

    def receive(self, topics):
        """What comes on topics, pairs of a name and a type, for ever: their index, the bytes and
        when, on the monotonic clock. The first is None: the readers are there."""
        for index, (name, type_name) in enumerate(topics):
            made = self.lib.fast_reader(self.dds, index, name.encode(), type_name.encode(), *self.qos)
            there(made, f"no reader of {name}")
        yield None
        index, size = ctypes.c_uint32(), ctypes.c_size_t()
        while True:
            taken = self.lib.fast_take(self.dds, 1000, ctypes.byref(index), ctypes.byref(size))
            if taken:
                yield index.value, ctypes.string_at(taken, size.value), time.monotonic_ns()

    def client(self, requests, replies, newer):
        return Client(self, requests, replies, newer)

    def server(self, requests, replies):
        return Server(self, requests, replies)

    def close(self):
        self.lib.fast_close(self.dds)


class Client:
    """A client of a service, as rmw_fastrtps makes it: the protocol says which reply is whose. Newer versions
    name their reader of replies in each request."""

    def __init__(self, participant, requests, replies, newer):
        self.lib, self.dds = participant.lib, participant.dds
        name, type_name = replies
        made = self.lib.fast_reader(self.dds, 0, name.encode(), type_name.encode(), *participant.qos)
        self.reader, self.newer = there(made, f"no reader of {name}"), newer
        self.writer = participant.writer(*requests)
        self.own = ctypes.create_string_buffer(16)

    def matched(self):
        """How many servers are there, for its requests and their replies."""
        return min(self.writer.matched(), self.lib.fast_writers(self.reader))

    def request(self, data, sequence):
        """Returns the number of the request; the library chooses it."""
        return there(self.lib.fast_request(self.writer.dds, self.reader if self.newer else None, data, len(data), self.own), "no request is written")

    def replies(self):
        """Replies for ever: whether each is ours, the number of its request, and its bytes."""
        index, size, related = ctypes.c_uint32(), ctypes.c_size_t(), ctypes.create_string_buffer(16)
        while True:
            taken = self.lib.fast_take(self.dds, 1000, ctypes.byref(index), ctypes.byref(size))
            if taken:
                data = ctypes.string_at(taken, size.value)
                sequence = self.lib.fast_related(self.dds, related)
                yield related.raw == self.own.raw, sequence, data


class Server:
    """A server, as rmw_fastrtps makes it: the protocol says to which request it replies."""

    def __init__(self, participant, requests, replies):
        self.lib, self.dds = participant.lib, participant.dds
        self.writer = participant.writer(*replies)
        self.received = participant.receive([requests])
        next(self.received)

    def requests(self):
        asked = ctypes.create_string_buffer(16)
        for _, data, _ in self.received:
            assert len(data) < 12, f"no request of a client of Fast DDS: {data.hex()}"
            yield self.lib.fast_asked(self.dds, asked), asked.raw

    def reply(self, request, data):
        sequence, asked = request
        there(self.lib.fast_reply(self.writer.dds, data, len(data), asked, sequence), "no reply is written")


class Writer:
    def __init__(self, lib, dds):
        self.lib, self.dds = lib, dds

    def write(self, data, stamp_ns):
        there(self.lib.fast_write(self.dds, data, len(data), stamp_ns), "a sample is not written")

    def matched(self):
        return self.lib.fast_matched(self.dds)

    def complaints(self):
        """How many readers asked for more than this writer offers."""
        return self.lib.fast_complaints(self.dds)

    def acknowledged(self):
        """False if the readers did not acknowledge all within 10 s."""
        return self.lib.fast_acknowledged(self.dds, 10)
