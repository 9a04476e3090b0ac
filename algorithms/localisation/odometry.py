"""Travel from the wheel encoders (section 3.3) and attitude from the IMU (section 3.2.2): the prior of every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import median
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.localisation.roll import RollFilterSettings, RollState, attitude, begin_roll, next_roll
from algorithms.localisation.upright import level_attitude
from algorithms.types import Alignment
from sensor_model.geometry import rotation_from_wxyz, transform
from sensor_model.recording import Frame
from sensor_model.rig import Rig
from sensor_model.settings import Settings


class OdometrySettings(Settings):
    """Where roll comes from, and what the prior is worth.

    `device` takes the IMU's own attitude, as the paper does (Eqs 21 to 24); `kalman` filters gyroscope and gravity.
    """

    roll: Literal["device", "kalman"] = "device"
    roll_filter: RollFilterSettings = RollFilterSettings()
    travel_std_share: Annotated[float, Field(gt=0)] = 0.002
    travel_std_floor_mm: Annotated[float, Field(gt=0)] = 0.05
    roll_std_deg: Annotated[float, Field(gt=0)] = 0.3


@dataclass(frozen=True)
class Odometry:
    """What is carried from frame to frame: the first attitudes, axis and centre as last seen, filtered roll, travel."""

    R_pipe_camera_1: Float[np.ndarray, "3 3"]
    R_world_camera_1: Float[np.ndarray, "3 3"]
    axis_camera: Float[np.ndarray, "3"]
    center_mm: Float[np.ndarray, "2"]
    roll: RollState | None
    distances_mm: Float[np.ndarray, "wheels"]
    launch_mm: float
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


def launch(
    frame: Frame, rig: Rig, launch_mm: float, axis_camera: Float[np.ndarray, "3"], settings: OdometrySettings
) -> Odometry:
    """The start of the log: roll by gravity, travel zero from where the operator launched."""
    R_world_camera = camera_attitude(frame, rig)
    return Odometry(
        R_pipe_camera_1=level_attitude(-R_world_camera[2], axis_camera),
        R_world_camera_1=R_world_camera,
        axis_camera=axis_camera,
        center_mm=np.zeros(2),
        roll=begin_roll(frame, rig, axis_camera, settings.roll_filter) if settings.roll == "kalman" else None,
        distances_mm=wheel_distances_mm(frame.counts, rig),
        launch_mm=launch_mm,
        travel_mm=0.0,
    )


def advance(odometry: Odometry, frame: Frame, rig: Rig, settings: OdometrySettings) -> Odometry:
    """One frame on: the median of what the wheels rolled since the last frame, and the roll since then."""
    distances = wheel_distances_mm(frame.counts, rig)
    step = median((distances - odometry.distances_mm).tolist())  # Eq. 26
    roll = odometry.roll
    if roll is not None:
        roll = next_roll(roll, frame, rig, odometry.axis_camera, settings.roll_filter)
    return replace(odometry, roll=roll, distances_mm=distances, travel_mm=odometry.travel_mm + step)


def settle(odometry: Odometry, alignment: Alignment) -> Odometry:
    """Remember the pipe's axis and the centre of a registered frame; they hardly change until the next."""
    T = alignment.T_pipe_camera
    return replace(odometry, axis_camera=T[2, :3].copy(), center_mm=T[:2, 3].copy())


def predict(odometry: Odometry, frame: Frame, rig: Rig, settings: OdometrySettings) -> Alignment:
    """The prior of a frame: travel and roll; centre and tilt are where to start from, and worth nothing."""
    if odometry.roll is not None:
        R_pipe_camera = attitude(odometry.roll, odometry.axis_camera)
        roll_std = max(float(np.sqrt(odometry.roll.P[0, 0])), np.radians(settings.roll_std_deg))
    else:
        R_cm = odometry.R_world_camera_1.T @ camera_attitude(frame, rig)  # Eq. 23, which as printed is the identity
        R_pipe_camera = odometry.R_pipe_camera_1 @ R_cm  # Eq. 24
        roll_std = np.radians(settings.roll_std_deg)
    travel_std = np.hypot(settings.travel_std_floor_mm, settings.travel_std_share * odometry.travel_mm)
    information = np.zeros((6, 6))
    information[2, 2] = travel_std**-2
    information[5, 5] = roll_std**-2
    return Alignment(
        transform(R_pipe_camera, np.append(odometry.center_mm, odometry.launch_mm + odometry.travel_mm)), information
    )
