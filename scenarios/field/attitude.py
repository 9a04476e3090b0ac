"""The attitude of a device that reports none: by the complementary filter that such devices carry themselves."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sensor_model.attitude_filter import Fusion, fused_attitude
from sensor_model.geometry import wxyz_from_rotation

STILL_SAMPLES = 20


def attitude_without_device(stamps_ns: Int[np.ndarray, "n"], imu: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 4"]:
    """`q_world_imu_wxyz` from rates (rad/s) and specific force (m/s2); its heading starts at zero, and drifts."""
    step_s = float(np.median(np.diff(stamps_ns))) / 1e9
    gyro, force = np.ascontiguousarray(imu[:, :3]), np.ascontiguousarray(imu[:, 3:])
    up = force[:STILL_SAMPLES].mean(axis=0)
    if not up.any() or not np.linalg.norm(force, axis=1).all():
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(imu), 1))  # it feels nothing: health says so
    rotation = fused_attitude(gyro, force, np.zeros_like(gyro), step_s, _level(up / np.linalg.norm(up)), Fusion())
    return wxyz_from_rotation(rotation)


def _level(up_imu: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R_world_imu` with z up, and x of the world as near to the device's x as can be."""
    x = np.eye(3)[int(np.argmin(np.abs(up_imu)))]
    x = x - (x @ up_imu) * up_imu
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up_imu, x), up_imu])
