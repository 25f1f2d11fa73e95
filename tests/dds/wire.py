"""The wire format of the ROS 2 messages that the tests speak, written by hand.

By hand, because the tests need what no proper type support would ever send: text that is not
UTF-8, messages that are cut, lengths that lie. A Python string carries a byte that is no UTF-8
as a lone surrogate (U+DC80..U+DCFF), as `os.fsdecode` does; in JSON that is `"\\udcff"`.
"""

import struct

DIAGNOSTIC_ARRAY = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
BOOL = "std_msgs::msg::dds_::Bool_"
STRING = "std_msgs::msg::dds_::String_"
STATUS = "diagnostic_msgs::msg::dds_::DiagnosticStatus_"
TWIST_STAMPED = "geometry_msgs::msg::dds_::TwistStamped_"
ACCEL_STAMPED = "geometry_msgs::msg::dds_::AccelStamped_"
POSE_WITH_COVARIANCE_STAMPED = "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"
LOG = "rcl_interfaces::msg::dds_::Log_"
PARTICIPANT_ENTITIES_INFO = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"


class Writer:
    """XCDR1 in little endian, with the four bytes of encapsulation in front."""

    def __init__(self):
        self.out = bytearray(b"\x00\x01\x00\x00")

    def align(self, size):
        self.out.extend(bytes(-(len(self.out) - 4) % size))

    def u8(self, value):
        self.out.append(value & 0xFF)

    def u32(self, value):
        self.align(4)
        self.out.extend(struct.pack("<I", value & 0xFFFFFFFF))

    def string(self, text):
        raw = text.encode("utf-8", "surrogateescape")
        self.u32(len(raw) + 1)
        self.out.extend(raw)
        self.out.append(0)

    def finish(self):
        self.align(4)
        return bytes(self.out)


class Reader:
    def __init__(self, data):
        self.order = "<" if data[1] & 1 else ">"
        self.data = data[4:]
        self.at = 0

    def u8(self):
        self.at += 1
        return self.data[self.at - 1]

    def u32(self):
        self.at += -self.at % 4
        (value,) = struct.unpack_from(self.order + "I", self.data, self.at)
        self.at += 4
        return value

    def string(self):
        length = self.u32()
        raw = self.data[self.at : self.at + length]
        if len(raw) != length or raw[-1:] != b"\x00":
            raise ValueError(f"string of {length} bytes at {self.at} is cut or not terminated")
        self.at += length
        return raw[:-1].decode("utf-8", "surrogateescape")

    def octets(self, count):
        self.at += count
        return bytes(self.data[self.at - count : self.at])

    def f64s(self, count):
        self.at += -self.at % 8
        values = struct.unpack_from(f"{self.order}{count}d", self.data, self.at)
        self.at += 8 * count
        return list(values)

    def header(self):
        return {"stamp": [self.u32(), self.u32()], "frame_id": self.string()}


def pairs(values):
    return list(values.items()) if isinstance(values, dict) else [tuple(pair) for pair in values or []]


def diagnostic_array(statuses, stamp=(0, 0), frame_id=""):
    out = Writer()
    out.u32(stamp[0])
    out.u32(stamp[1])
    out.string(frame_id)
    out.u32(len(statuses))
    for status in statuses:
        out.u8(status.get("level", 0))
        out.string(status.get("name", ""))
        out.string(status.get("message", ""))
        out.string(status.get("hardware_id", ""))
        values = pairs(status.get("values"))
        out.u32(len(values))
        for key, value in values:
            out.string(key)
            out.string(value)
    return out.finish()


def read_diagnostic_array(data):
    source = Reader(data)
    header = source.header()
    return header | {"statuses": [status(source) for _ in range(source.u32())]}


def status(source):
    found = {
        "level": source.u8(),
        "name": source.string(),
        "message": source.string(),
        "hardware_id": source.string(),
    }
    return found | {"values": [[source.string(), source.string()] for _ in range(source.u32())]}


def read_status(data):
    return status(Reader(data))


def read_motion(data):
    """TwistStamped and AccelStamped alike."""
    source = Reader(data)
    return source.header() | {"linear": source.f64s(3), "angular": source.f64s(3)}


def read_pose(data):
    source = Reader(data)
    return source.header() | {"position": source.f64s(3), "orientation": source.f64s(4)}


def boolean(value):
    out = Writer()
    out.u8(1 if value else 0)
    return out.finish()


def read_boolean(data):
    return {"data": bool(Reader(data).u8())}


def text(value):
    out = Writer()
    out.string(value)
    return out.finish()


def read_text(data):
    return {"data": Reader(data).string()}


def participant_entities_info(gid, nodes, size):
    """`gid` and those in `nodes` are bytes; `size` is 16 (Iron and later) or 24 (Humble)."""

    def put(value):
        out.out.extend(value[:size].ljust(size, b"\x00"))

    out = Writer()
    put(gid)
    out.u32(len(nodes))
    for namespace, name, readers, writers in nodes:
        out.string(namespace)
        out.string(name)
        for gids in (readers, writers):
            out.u32(len(gids))
            for one in gids:
                put(one)
    return out.finish()


def read_participant_entities_info(data):
    """Tries both sizes of a gid; the right one leaves nothing but padding."""
    for size in (16, 24):
        source = Reader(data)
        try:
            info = {"gid_size": size, "gid": source.octets(size).hex(), "nodes": []}
            for _ in range(source.u32()):
                node = {"namespace": source.string(), "name": source.string()}
                for kind in ("readers", "writers"):
                    node[kind] = [source.octets(size).hex() for _ in range(source.u32())]
                info["nodes"].append(node)
        except (ValueError, struct.error, IndexError):
            continue
        if 0 <= len(source.data) - source.at < 4:
            return info
    return {"undecodable": data.hex()}


def service_request(command):
    """Of std_srvs/srv/Trigger, or of diagnostic_msgs/srv/AddDiagnostics with its text. Cyclone puts its 16 bytes
    behind the encapsulation."""
    if "raw" in command:
        return bytes.fromhex(command["raw"])
    out = Writer()
    if "text" in command:
        out.string(command["text"])
    else:
        # An empty structure has one byte.
        out.u8(0)
    return bytes(out.out)


GET_STATE_REQUEST = "lifecycle_msgs::srv::dds_::GetState_Request_"


def lifecycle_state(answer):
    """The reply of lifecycle_msgs/srv/GetState."""
    out = Writer()
    out.u8(answer["state"])
    out.string(answer["label"])
    return bytes(out.out)


def read_service_reply(data):
    source = Reader(data)
    return {"success": bool(source.u8()), "message": source.string()}


def read_log(data):
    source = Reader(data)
    stamp = [source.u32(), source.u32()]
    found = {"stamp": stamp, "level": source.u8(), "name": source.string(), "msg": source.string()}
    return found | {"file": source.string(), "function": source.string(), "line": source.u32()}


READ = {
    GET_STATE_REQUEST: bytes.hex,
    LOG: read_log,
    DIAGNOSTIC_ARRAY: read_diagnostic_array,
    BOOL: read_boolean,
    STRING: read_text,
    STATUS: read_status,
    TWIST_STAMPED: read_motion,
    ACCEL_STAMPED: read_motion,
    POSE_WITH_COVARIANCE_STAMPED: read_pose,
    PARTICIPANT_ENTITIES_INFO: read_participant_entities_info,
}
