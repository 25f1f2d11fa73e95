"""A server whose wall clock can be set while it runs, and no other clock of the machine."""

import contextlib
import os
import struct
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("clock.cpp")


class Hand:
    """Sets the wall clock of the processes that run with these variables."""

    def __init__(self, folder):
        library, self.path = folder / "clock.so", folder / "clock"
        self.path.write_bytes(bytes(8))
        words = ["g++", "-std=c++17", "-O1", "-Wall", "-shared", "-fPIC", SOURCE, "-o", library, "-ldl"]
        subprocess.run(words, check=True, timeout=60)
        self.variables = {"LD_PRELOAD": str(library), "TELLTALE_TEST_CLOCK": str(self.path)}

    def set(self, ahead_s):
        """Ahead of the machine's clock from now on."""
        with open(self.path, "r+b") as file:
            file.write(struct.pack("<q", ahead_s * 10**9))

    @contextlib.contextmanager
    def held(self):
        """Processes that are started meanwhile have this clock."""
        before = {name: os.environ.get(name) for name in self.variables}
        os.environ.update(self.variables)
        try:
            yield
        finally:
            for name, value in before.items():
                os.environ.pop(name)
                if value is not None:
                    os.environ[name] = value
