"""A recording in ROS 2's words: topics, message types, stamps and angles, for those who write bags and read them."""

from __future__ import annotations

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
TOPICS = {
    "/cam0/image/compressed": PICTURE,
    "/cam0/slit_pixels": SLITS,
    "/imu0": IMU,
    "/orientation0": ATTITUDE,
    "/encoders0": WHEELS,
    "/rig": TEXT,
    "/pipe": TEXT,
}
LARGEST_STAMP_NS = 2**31 * 10**9 - 1  # a ROS stamp has 31 bits for the seconds
INT32, FLOAT64 = 5, 8  # of sensor_msgs/PointField
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


def header(stamp_ns: int, frame: str) -> Any:
    """The header of a message."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    known = types().types
    return known["std_msgs/msg/Header"](known["builtin_interfaces/msg/Time"](sec, nanosec), frame)


def stamp_ns(message: Any) -> int:
    """When a message says it was measured."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def angles_rad(counts: Int[np.ndarray, "*k wheels"], counts_per_turn: int) -> Float[np.ndarray, "*k wheels"]:
    """What wheels have turned, by their counts."""
    return counts * (2 * np.pi / counts_per_turn)


def counts_of(angle_rad: Float[np.ndarray, "*k wheels"], counts_per_turn: int) -> Int[np.ndarray, "*k wheels"]:
    """The whole counts nearest to angles: those that `angles_rad` was given, as long as a double holds them."""
    return np.rint(angle_rad * (counts_per_turn / (2 * np.pi))).astype(np.int64)
