"""ROS 2 messages as Cyclone DDS encodes them from their types: independent of what is written by hand
in `wire.py` and of the program's own decoder.

`encode("Odometry", {"pose": {"pose": {"position": {"x": 1.5}}}})` gives the bytes with their
encapsulation. Omitted fields are zero or empty.
"""

from dataclasses import dataclass, fields, is_dataclass
from typing import get_type_hints

from cyclonedds.idl import IdlStruct
from cyclonedds.idl._support import Endianness
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32


def message(name):
    """A final struct under the name that ROS 2 gives it on the wire."""
    package, _, word = name.partition("/")
    return lambda kind: dataclass(type(kind.__name__, (IdlStruct,), dict(kind.__dict__), typename=f"{package}.msg.dds_.{word}_"))


@message("builtin_interfaces/Time")
class Time:
    sec: int32
    nanosec: uint32


@message("std_msgs/Header")
class Header:
    stamp: Time
    frame_id: str


@message("geometry_msgs/Vector3")
class Vector3:
    x: float64
    y: float64
    z: float64


@message("geometry_msgs/Quaternion")
class Quaternion:
    x: float64
    y: float64
    z: float64
    w: float64


@message("geometry_msgs/Pose")
class Pose:
    position: Vector3
    orientation: Quaternion


@message("geometry_msgs/PoseStamped")
class PoseStamped:
    header: Header
    pose: Pose


@message("geometry_msgs/Twist")
class Twist:
    linear: Vector3
    angular: Vector3


@message("geometry_msgs/TwistStamped")
class TwistStamped:
    header: Header
    twist: Twist


@message("geometry_msgs/PoseWithCovariance")
class PoseWithCovariance:
    pose: Pose
    covariance: array[float64, 36]


@message("geometry_msgs/TwistWithCovariance")
class TwistWithCovariance:
    twist: Twist
    covariance: array[float64, 36]


@message("nav_msgs/Odometry")
class Odometry:
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@message("geometry_msgs/Transform")
class Transform:
    translation: Vector3
    rotation: Quaternion


@message("geometry_msgs/TransformStamped")
class TransformStamped:
    header: Header
    child_frame_id: str
    transform: Transform


@message("tf2_msgs/TFMessage")
class TFMessage:
    transforms: sequence[TransformStamped]


@message("sensor_msgs/PointField")
class PointField:
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@message("sensor_msgs/PointCloud2")
class PointCloud2:
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


def make(kind, value):
    """`value` in the type; lists become arrays and sequences, `{"zeros": n}` is that many zeros."""
    if is_dataclass(kind):
        hints = get_type_hints(kind, include_extras=True)
        value = value or {}
        return kind(**{field.name: make(hints[field.name], value.get(field.name)) for field in fields(kind)})
    for mark in getattr(kind, "__metadata__", ()):
        if hasattr(mark, "length"):
            return (value or []) + [0] * (mark.length - len(value or []))
        if hasattr(mark, "subtype"):
            if isinstance(value, dict):
                return [0] * value["zeros"]
            return [make(mark.subtype, one) for one in value or []]
    if kind is str:
        return value or ""
    return value or 0


def encode(name, value):
    data = make(globals()[name], value).serialize(endianness=Endianness.Little, use_version_2=False)
    return bytes(data) + bytes(-len(data) % 4)
