"""Travel from the wheel encoders (section 3.3) and attitude from the IMU (section 3.2.2): the prior of every frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.types import Alignment
from sensor_model.geometry import rotation_from_wxyz, transform
from sensor_model.recording import Frame
from sensor_model.rig import Rig
from sensor_model.settings import Settings

VERTICAL_COSINE = 0.98


class OdometrySettings(Settings):
    """What the prior is worth."""

    kind: Literal["paper"] = "paper"
    travel_std_share: Annotated[float, Field(gt=0)] = 0.002
    travel_std_floor_mm: Annotated[float, Field(gt=0)] = 0.05
    roll_std_deg: Annotated[float, Field(gt=0)] = 0.3


@dataclass(frozen=True)
class Odometry:
    """What is carried from frame to frame: the first frame's attitudes, and the travel so far."""

    R_pipe_camera_1: Float[np.ndarray, "3 3"]
    R_world_camera_1: Float[np.ndarray, "3 3"]
    distances_mm: Float[np.ndarray, "wheels"]
    travel_mm: float


def wheel_distances_mm(counts: Float[np.ndarray, "wheels"], rig: Rig) -> Float[np.ndarray, "wheels"]:
    """Distance rolled by each wheel since the start of the log."""
    turns = counts / rig.wheels.counts_per_turn
    return turns * np.pi * np.array(rig.wheels.diameters_mm)  # Eq. 25


def camera_attitude(frame: Frame, rig: Rig) -> Float[np.ndarray, "3 3"]:
    """`R_world_camera` from the IMU's own attitude and its mount.

    Eqs 21 and 22 in the convention R_c = R_cal R_m R_cal^T of Eqs 12 and 13; the left R_cal only turns the world.
    """
    return rotation_from_wxyz(frame.q_world_imu_wxyz) @ rig.imu.R_camera_imu.T


def level_attitude(
    R_world_camera: Float[np.ndarray, "3 3"], axis_camera: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """`R_pipe_camera` from gravity and the pipe's axis, as the camera sees them: 12 o'clock is up.

    In a vertical pipe gravity says nothing of roll; there the camera's own upright is the datum.
    """
    down = -R_world_camera[2]
    if abs(down @ axis_camera) > VERTICAL_COSINE:
        down = np.array([0.0, 1.0, 0.0])
    y = down - (down @ axis_camera) * axis_camera
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, axis_camera), y, axis_camera])


def launch(frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"]) -> Odometry:
    """The start of the log: roll by gravity, travel zero."""
    R_world_camera = camera_attitude(frame, rig)
    return Odometry(
        level_attitude(R_world_camera, axis_camera), R_world_camera, wheel_distances_mm(frame.counts, rig), 0.0
    )


def advance(odometry: Odometry, frame: Frame, rig: Rig) -> Odometry:
    """One frame on: the median of what the wheels rolled since the last frame."""
    distances = wheel_distances_mm(frame.counts, rig)
    step = float(np.median(distances - odometry.distances_mm))  # Eq. 26
    return Odometry(odometry.R_pipe_camera_1, odometry.R_world_camera_1, distances, odometry.travel_mm + step)


def predict(odometry: Odometry, frame: Frame, rig: Rig, settings: OdometrySettings) -> Alignment:
    """The prior of a frame: travel and roll, with nothing said of centre and tilt."""
    R_cm = odometry.R_world_camera_1.T @ camera_attitude(frame, rig)  # Eq. 23, which as printed is the identity
    R_pipe_camera = odometry.R_pipe_camera_1 @ R_cm  # Eq. 24
    travel_std = np.hypot(settings.travel_std_floor_mm, settings.travel_std_share * odometry.travel_mm)
    information = np.zeros((6, 6))
    information[2, 2] = travel_std**-2
    information[5, 5] = np.radians(settings.roll_std_deg) ** -2
    return Alignment(transform(R_pipe_camera, np.array([0.0, 0.0, odometry.travel_mm])), information)
