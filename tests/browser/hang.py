"""A part that hangs inside a server that runs on, mostly the engine: its next step is replaced by an endless loop."""

import contextlib
import platform
import re
import subprocess

from vehicle import TELLTALE

# A jump to itself.
ENDLESS = {"x86_64": b"\xeb\xfe", "aarch64": b"\x00\x00\x00\x14"}[platform.machine()]
# Every input of the engine passes this function, and so does its clock.
STEP = r"telltale_runtime.*4Loop.*6handle"
# Every frame of the operator's page is made by this function.
FRAMES = r"telltale_web4view9fragments"
# All that is sent to the vehicle is decided by this function.
SENDING = r"outputs6levels6Levels3due17h"


def place_of(function, server):
    """The place of the function in the memory of the server, which begins at the first page of its program."""
    symbols = subprocess.run(["nm", TELLTALE], text=True, capture_output=True, check=True).stdout
    offsets = re.findall(rf"^([0-9a-f]+) \w .*{function}", symbols, re.MULTILINE)
    assert len(offsets) == 1, f"{function} in {TELLTALE}: {offsets}"
    with open(f"/proc/{server.process.pid}/maps") as maps:
        return int(next(maps).split("-")[0], 16) + int(offsets[0], 16)


@contextlib.contextmanager
def hanging(server, function=STEP):
    """The engine, or another function, hangs from its next step on, and goes on at the end."""
    at = place_of(function, server)
    # The server is a child of this process, which may write its memory.
    with open(f"/proc/{server.process.pid}/mem", "r+b", buffering=0) as memory:
        memory.seek(at)
        code = memory.read(len(ENDLESS))
        write = lambda words: (memory.seek(at), memory.write(words))
        write(ENDLESS)
        try:
            yield
        finally:
            write(code)
