"""What the IMU says of one frame, in the camera's axes: force along the pipe, turn about it, and which way is down."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sensor_model.recording import Frame
from sensor_model.rig import Rig


def along_axis_mm_s2(frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"]) -> float | None:
    """Mean specific force along the pipe since the last frame; None without a sample."""
    if not len(frame.imu):
        return None
    return float(1e3 * np.mean(frame.imu[:, 3:], axis=0) @ rig.imu.R_camera_imu.T @ axis_camera)


def turning_rad_s(frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"]) -> Float[np.ndarray, "samples"]:
    """Rate of turn about the pipe's axis at each sample since the last frame."""
    return frame.imu[:, :3] @ rig.imu.R_camera_imu.T @ axis_camera


def force_camera_m_s2(frame: Frame, rig: Rig) -> Float[np.ndarray, "3"]:
    """Mean specific force since the last frame in the camera's axes."""
    return rig.imu.R_camera_imu @ frame.imu[:, 3:].mean(axis=0)
