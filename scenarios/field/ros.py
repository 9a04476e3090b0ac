"""A recording in ROS 2's words: topics, message types, stamps and angles, for those who write bags and read them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scenarios.document import BadInput

PICTURE = "sensor_msgs/msg/CompressedImage"
IMAGE = "sensor_msgs/msg/Image"
SLITS = "sensor_msgs/msg/PointCloud2"
IMU = "sensor_msgs/msg/Imu"
ATTITUDE = "geometry_msgs/msg/QuaternionStamped"
WHEELS = "sensor_msgs/msg/JointState"
TEXT = "std_msgs/msg/String"
POSE = "geometry_msgs/msg/PoseStamped"
TRANSFORM, TRANSFORMS = "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage"
MARKERS = "visualization_msgs/msg/MarkerArray"
TOPICS = {
    "/cam0/image/compressed": PICTURE,
    "/cam0/slit_pixels": SLITS,
    "/imu0": IMU,
    "/orientation0": ATTITUDE,
    "/encoders0": WHEELS,
    "/rig": TEXT,
    "/pipe": TEXT,
    "/pose": POSE,
    "/tf": TRANSFORMS,
    "/wall": SLITS,
    "/defects": MARKERS,
}
OURS = ("/cam0/image/compressed", "/cam0/slit_pixels", "/imu0", "/orientation0", "/encoders0")
LARGEST_STAMP_NS = 2**31 * 10**9 - 1  # a ROS stamp has 31 bits for the seconds
INT32, FLOAT32, FLOAT64 = 5, 7, 8  # of sensor_msgs/PointField
SLIT_FIELDS = (("x", 0, FLOAT64), ("y", 8, FLOAT64), ("z", 16, FLOAT64), ("slit", 24, INT32), ("sigma_px", 28, FLOAT64))
SLIT_POINT = np.dtype([("pixel", "<f8", (2,)), ("z", "<f8"), ("slit", "<i4"), ("sigma_px", "<f8")])


@cache
def types() -> Any:
    """The messages of a ROS 2 distribution, which later ones have unchanged.

    Raises:
        BadInput: when the package that knows them is not there.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise BadInput(["bags need the package rosbags; pip install 'pipetwin[field]'"]) from error
    return get_typestore(Stores.ROS2_HUMBLE)


def new(kind: str, **fields: Any) -> Any:
    """A message of a kind."""
    return types().types[kind](**fields)


def header(stamp_ns: int, frame: str) -> Any:
    """The header of a message."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def cloud(rows: np.ndarray, fields: Iterable[tuple[str, int, int]], head: Any) -> Any:
    """A cloud of the rows of a structured array; each field with its name, its place in a row and its kind."""
    named = [new("sensor_msgs/msg/PointField", name=n, offset=at, datatype=kind, count=1) for n, at, kind in fields]
    step, data = rows.dtype.itemsize, np.frombuffer(rows.tobytes(), dtype=np.uint8)
    about = {"height": 1, "width": rows.size, "is_bigendian": False, "is_dense": True}
    return new(SLITS, header=head, fields=named, point_step=step, row_step=step * rows.size, data=data, **about)


def box(head: Any, group: str, number: int, pose: Any, scale: Any, color: Any) -> Any:
    """A marker that is a box and stays."""
    none: dict[str, Any] = {name: [] for name in ("points", "colors", "uv_coordinates")}
    none |= dict.fromkeys(("texture_resource", "text", "mesh_resource"), "")
    kind = types().types["visualization_msgs/msg/Marker"]
    return kind(
        header=head,
        ns=group,
        id=number,
        type=kind.CUBE,
        action=kind.ADD,
        pose=pose,
        scale=scale,
        color=color,
        lifetime=new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        texture=new(PICTURE, header=head, format="", data=np.zeros(0, np.uint8)),
        mesh_file=new("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
        **none,
    )


def stamp_ns(message: Any) -> int:
    """When a message says it was measured."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def angles_rad(counts: Int[np.ndarray, "*k wheels"], counts_per_turn: int) -> Float[np.ndarray, "*k wheels"]:
    """What wheels have turned, by their counts."""
    return counts * (2 * np.pi / counts_per_turn)


def counts_of(angle_rad: Float[np.ndarray, "*k wheels"], counts_per_turn: int) -> Int[np.ndarray, "*k wheels"]:
    """The whole counts nearest to angles: those that `angles_rad` was given, as long as a double holds them."""
    return np.rint(angle_rad * (counts_per_turn / (2 * np.pi))).astype(np.int64)
