#!/usr/bin/env python3
"""Stands for the command `ros2` where ROS 2 is not installed: `ros2 topic pub`, by Cyclone DDS on the loopback
interface. The tests of the documentation run the commands of its pages with it.

    ros2 topic pub [--once | --rate HZ] TOPIC PACKAGE/msg/NAME YAML

It knows the messages of `interfaces.py`, DiagnosticArray and Bool. `--once` waits for a reader, as the real one does.
"""

import argparse
import os
import sys
import time

import ruamel.yaml

import cyclone
import interfaces
import wire


def encode(kind, fields):
    name = kind.rpartition("/")[2]
    if name == "DiagnosticArray":
        statuses = [status | {"values": {it["key"]: it["value"] for it in status.get("values", [])}} for status in fields["status"]]
        return wire.diagnostic_array(statuses)
    if name == "Bool":
        return wire.boolean(fields["data"])
    return interfaces.encode(name, fields)


def main():
    parser = argparse.ArgumentParser(prog="ros2")
    parser.add_argument("command", nargs=2, help="topic pub")
    parser.add_argument("-1", "--once", action="store_true")
    parser.add_argument("-r", "--rate", type=float, default=1.0)
    parser.add_argument("topic")
    parser.add_argument("type")
    parser.add_argument("fields")
    options = parser.parse_args()
    if options.command != ["topic", "pub"]:
        parser.error("only `ros2 topic pub` is known here")
    package, _, name = options.type.partition("/msg/")
    data = encode(options.type, ruamel.yaml.YAML(typ="safe").load(options.fields))
    settings = {"interface": "lo", "multicast": False, "lease_s": 2.0, "announce_s": 0.5, "reliability": "reliable", "durability": "volatile", "depth": 1}
    domain = int(os.environ.get("ROS_DOMAIN_ID", "0"))
    participant = cyclone.Participant(argparse.Namespace(domain=domain, **settings))
    writer = participant.writer("rt" + options.topic, f"{package}::msg::dds_::{name}_")
    if options.once:
        end = time.monotonic() + 30
        while not writer.matched():
            if time.monotonic() > end:
                sys.exit("ros2: nobody listens")
            time.sleep(0.01)
        writer.write(data, time.time_ns())
        writer.acknowledged()
        # Like the real one it stays a moment, so that readers take the message before its writer goes.
        time.sleep(0.1)
    else:
        while True:
            writer.write(data, time.time_ns())
            time.sleep(1 / options.rate)
    participant.close()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
