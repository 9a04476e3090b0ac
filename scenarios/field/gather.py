"""What a bag's messages hold, gathered into a recording: pictures go to disk as they come, numbers are kept flat."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scenarios.document import BadInput
from scenarios.field import ros
from scenarios.field.attitude import attitude_without_device
from scenarios.field.pictures import png_of, rgb_of
from sensor_model.recording import NominalPipe, SlitPixels, write_frame_list, write_logs, write_slit_pixels
from sensor_model.rig import Rig
from sensor_model.sense import png

LARGEST_ANGLE_RAD = 1e9
LEAST_QUATERNION = 0.5  # a device without attitude often sends zeros


@dataclass(frozen=True)
class Series:
    """Stamps, and so many numbers to each."""

    stamps_ns: array = field(default_factory=lambda: array("q"))
    values: array = field(default_factory=lambda: array("d"))

    def take(self, stamp_ns: int, values: list[float], where: str) -> None:
        """Put one measurement behind the others.

        Raises:
            BadInput: when it does not come after them, or is no number.
        """
        if not np.isfinite(values).all():
            raise BadInput([f"{where}: got {values}; finite numbers are expected"])
        self.stamps_ns.append(next_stamp(stamp_ns, self.stamps_ns, where))
        self.values.extend(values)

    def arrays(self) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n values"]]:
        """Stamps and rows."""
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        return stamps, np.array(self.values, dtype=float).reshape(stamps.size, -1)


@dataclass
class Gathered:
    """What was read so far; `attitude_apart`: a topic of its own has the attitude, not the IMU's."""

    folder: Path
    rig: Rig
    wheels: tuple[str, ...]
    attitude_apart: bool
    frames: array = field(default_factory=lambda: array("q"))
    suffix: str = ""
    imu: Series = field(default_factory=Series)
    attitude: Series = field(default_factory=Series)
    encoders: Series = field(default_factory=Series)


def next_stamp(stamp_ns: int, before: array, where: str) -> int:
    """A stamp that comes after the last one.

    Raises:
        BadInput: when it does not.
    """
    if stamp_ns < 0 or (before and stamp_ns <= before[-1]):
        after = f"it does not come after {before[-1]}" if before else "it lies before the clock's beginning"
        raise BadInput([f"{where}: stamp {stamp_ns} ns: {after}; the clock jumped back, or a message stands twice"])
    return stamp_ns


def _take_picture(gathered: Gathered, message: Any, where: str) -> None:
    stamp = next_stamp(ros.stamp_ns(message), gathered.frames, where)
    try:
        data = (
            png(rgb_of(message))
            if hasattr(message, "encoding")
            else png_of(message.data.tobytes(), gathered.rig.camera)
        )
    except ValueError as error:
        raise BadInput([f"{where}: {error}"]) from error
    gathered.suffix = ".png"
    (gathered.folder / "cam0" / "data" / f"{stamp}.png").write_bytes(data)
    gathered.frames.append(stamp)


def _take_slits(gathered: Gathered, message: Any, where: str) -> None:
    stamp = next_stamp(ros.stamp_ns(message), gathered.frames, where)
    fields, step = tuple((part.name, part.offset, part.datatype) for part in message.fields), ros.SLIT_POINT.itemsize
    data = message.data.tobytes()
    if fields != ros.SLIT_FIELDS or message.point_step != step or message.is_bigendian or len(data) % step:
        has = ", ".join(part[0] for part in fields[:9])
        raise BadInput([f"{where}: got points of {has}; x, y, z, slit, sigma_px in {step} bytes are expected"])
    rows = np.frombuffer(data, dtype=ros.SLIT_POINT)
    seen = SlitPixels(rows["pixel"].copy(), rows["slit"].astype(np.int64), rows["sigma_px"].copy())
    gathered.suffix = ".npy"
    write_slit_pixels(gathered.folder / "cam0" / "data" / f"{stamp}.npy", seen)
    gathered.frames.append(stamp)


def _take_imu(gathered: Gathered, message: Any, where: str) -> None:
    stamp, rate, force = ros.stamp_ns(message), message.angular_velocity, message.linear_acceleration
    gathered.imu.take(stamp, [rate.x, rate.y, rate.z, force.x, force.y, force.z], where)
    if not gathered.attitude_apart and message.orientation_covariance[0] >= 0:
        _take_quaternion(gathered, stamp, message.orientation, where)


def _take_attitude(gathered: Gathered, message: Any, where: str) -> None:
    _take_quaternion(gathered, ros.stamp_ns(message), message.quaternion, where)


def _take_quaternion(gathered: Gathered, stamp: int, q: Any, where: str) -> None:
    wxyz = [q.w, q.x, q.y, q.z]
    if np.linalg.norm(wxyz) >= LEAST_QUATERNION or not np.isfinite(wxyz).all():
        gathered.attitude.take(stamp, wxyz, where)


def _take_encoders(gathered: Gathered, message: Any, where: str) -> None:
    gathered.wheels = gathered.wheels or tuple(message.name)
    turned = dict(zip(message.name, message.position.tolist(), strict=False))
    wheels = len(gathered.rig.wheels.diameters_mm)
    if len(gathered.wheels) != wheels or not set(gathered.wheels) <= set(turned):
        has = f"the joints {', '.join(message.name)[:200]}"
        raise BadInput([f"{where}: got {has}; the rig's {wheels} wheels are expected, named by --topics (wheels)"])
    angles = [turned[name] for name in gathered.wheels]
    if any(abs(angle) > LARGEST_ANGLE_RAD for angle in angles):
        raise BadInput([f"{where}: got positions of {angles} rad; at most {LARGEST_ANGLE_RAD:g}"])
    gathered.encoders.take(ros.stamp_ns(message), angles, where)


TAKERS: dict[str, Callable[[Gathered, Any, str], None]] = {
    "picture": _take_picture,
    "slit_pixels": _take_slits,
    "imu": _take_imu,
    "attitude": _take_attitude,
    "encoders": _take_encoders,
}


def write_gathered(gathered: Gathered, pipe: NominalPipe, log: Path) -> list[str]:
    """Write the recording's tables; returns remarks on what the log does not hold.

    Raises:
        BadInput: when there is too little.
    """
    for name, series in (("IMU", gathered.imu), ("encoders", gathered.encoders)):
        if len(series.stamps_ns) < 2:
            raise BadInput([f"{log}: {len(series.stamps_ns)} messages of the {name}; at least 2 are needed"])
    (imu_stamps, imu), (encoder_stamps, angles) = gathered.imu.arrays(), gathered.encoders.arrays()
    remarks = []
    if len(gathered.attitude.stamps_ns) < 2:
        attitude_stamps, attitude = imu_stamps, attitude_without_device(imu_stamps, imu)
        remarks.append("no attitude in the log: made from gyroscope and accelerometer, so its heading drifts")
    else:
        attitude_stamps, attitude = gathered.attitude.arrays()
    counts = ros.counts_of(angles, gathered.rig.wheels.counts_per_turn)
    write_logs(gathered.folder, gathered.rig, pipe, imu_stamps, imu, attitude, encoder_stamps, counts, attitude_stamps)
    write_frame_list(gathered.folder, np.array(gathered.frames, dtype=np.int64), gathered.suffix)
    return remarks
