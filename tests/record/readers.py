"""Prints what foreign programs read in a recording: one JSON object. Usage: readers.py FILE"""

import collections
import dataclasses
import hashlib
import json
import sys
from pathlib import Path

import fastjsonschema
from mcap.reader import make_reader
from mcap.records import Attachment, Footer
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader, AnyReaderError

LIST_MAX = 20


def plain(value):
    """A decoded message as JSON; a long array as its length and sum."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (bytes, bytearray, list, tuple)):
        values = [plain(one) for one in value]
        return values if len(values) <= LIST_MAX else {"length": len(values), "sum": sum(values)}
    if isinstance(value, (bool, int, float, str)):
        return value
    if dataclasses.is_dataclass(value):
        # Constants are fields, too.
        names = [field.name for field in dataclasses.fields(value) if not field.name.isupper()]
        names.remove("__msgtype__")
    else:
        names = value.__slots__ if hasattr(value, "__slots__") else vars(value)
    return {name: plain(getattr(value, name)) for name in names if name != "structure_needs_at_least_one_member"}


def digest(data):
    return hashlib.sha256(data).hexdigest()


def by_mcap(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header, summary = reader.get_header(), reader.get_summary()
        messages = [
            [channel.topic, schema.name, message.log_time, message.publish_time, message.sequence, digest(message.data)]
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
        statistics = summary.statistics
        counts = [statistics.message_count, statistics.attachment_count, statistics.metadata_count]
    with open(path, "rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
        assert isinstance(records[-1], Footer) and records[-1].summary_crc != 0
        attachments = {one.name: one.data.decode() for one in records if isinstance(one, Attachment)}
    return {
        "profile": header.profile,
        "messages": messages,
        "counts": counts,
        "attachments": attachments,
        "encodings": sorted({channel.message_encoding for channel in summary.channels.values()}),
        "without_schema": [channel.topic for channel in summary.channels.values() if channel.schema_id == 0],
    }


def by_mcap_ros2(path):
    return [
        [one.channel.topic, one.log_time_ns, one.publish_time_ns, plain(one.ros_msg)]
        for one in read_ros2_messages(path, log_time_order=False)
    ]


def by_rosbags(path):
    found = []
    with AnyReader([Path(path)]) as reader:
        for connection, time, data in reader.messages():
            try:
                value = plain(reader.deserialize(data, connection.msgtype))
            except AnyReaderError:
                value = None
            found.append([connection.topic, connection.msgtype, time, digest(data), value])
        return {"count": reader.message_count, "messages": found}


def by_schema(path):
    """The number of JSON documents of each channel. Each follows the schema in the channel's metadata."""
    counts, validators = collections.Counter(), {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(log_time_order=False):
            if channel.metadata.get("message_format") != "json":
                continue
            if channel.topic not in validators:
                schema = json.loads(channel.metadata["json_schema"])
                validators[channel.topic] = fastjsonschema.compile(schema)
            try:
                validators[channel.topic](json.loads(message.data))
            except fastjsonschema.JsonSchemaException as error:
                raise AssertionError(f"{channel.topic}: {error}: {message.data[:500]}") from error
            counts[channel.topic] += 1
    return counts


path = sys.argv[1]
json.dump({"schema": by_schema(path), "mcap": by_mcap(path), "mcap_ros2": by_mcap_ros2(path), "rosbags": by_rosbags(path)}, sys.stdout)
