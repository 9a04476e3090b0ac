"""The paper's odometry: median of the wheels (section 3.3) and the IMU's own attitude (section 3.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import median
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.localisation.roll import RollFilterSettings, RollState, attitude, begin_roll, next_roll
from algorithms.localisation.upright import level_attitude
from algorithms.localisation.wheels import wheel_distances_mm
from algorithms.types import Alignment
from sensor_model.geometry import rotation_from_wxyz, transform
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig
from sensor_model.settings import Settings

LAUNCH_STD_MM = 0.05  # how exactly the launch is what the distances begin at: by definition, but for rounding


class RollSettings(Settings):
    """Where roll comes from, and what it is worth.

    `device` takes the IMU's own attitude, as the paper does (Eqs 21 to 24); `kalman` filters gyroscope and gravity.
    """

    roll: Literal["device", "kalman"] = "device"
    roll_filter: RollFilterSettings = RollFilterSettings()
    roll_std_deg: Annotated[float, Field(gt=0)] = 0.3


class PaperSettings(RollSettings):
    """The paper's odometry, and what its travel is worth."""

    kind: Literal["paper"] = "paper"
    travel_std_share: Annotated[float, Field(gt=0)] = 0.002
    travel_std_floor_mm: Annotated[float, Field(gt=0)] = 0.05


@dataclass(frozen=True)
class Odometry:
    """What is carried from frame to frame: the first attitudes, axis and centre as last seen, filtered roll, travel."""

    R_pipe_camera_1: Float[np.ndarray, "3 3"]
    R_world_camera_1: Float[np.ndarray, "3 3"]
    axis_camera: Float[np.ndarray, "3"]
    center_mm: Float[np.ndarray, "2"]
    roll: RollState | None
    R_pipe_camera: Float[np.ndarray, "3 3"]
    roll_std_rad: float
    distances_mm: Float[np.ndarray, "wheels"]
    launch_mm: float
    travel_mm: float
    travel_std_mm: float
    stamp_ns: int


def camera_attitude(frame: Frame, rig: Rig) -> Float[np.ndarray, "3 3"]:
    """`R_world_camera` from the IMU's own attitude and its mount.

    Eqs 21 and 22 in the convention R_c = R_cal R_m R_cal^T of Eqs 12 and 13; the left R_cal only turns the world.
    """
    return rotation_from_wxyz(frame.q_world_imu_wxyz) @ rig.imu.R_camera_imu.T


def launch(
    frame: Frame, rig: Rig, pipe: NominalPipe, axis_camera: Float[np.ndarray, "3"], settings: RollSettings
) -> Odometry:
    """The start of the log: roll by gravity, travel zero from where the operator launched."""
    R_world_camera = camera_attitude(frame, rig)
    level = level_attitude(-R_world_camera[2], axis_camera)
    roll = begin_roll(frame, rig, axis_camera, settings.roll_filter) if settings.roll == "kalman" else None
    R, roll_std = attitude_now(level, R_world_camera, frame, rig, axis_camera, roll, settings)
    return Odometry(
        R_pipe_camera_1=level,
        R_world_camera_1=R_world_camera,
        axis_camera=axis_camera,
        center_mm=np.zeros(2),
        roll=roll,
        R_pipe_camera=R,
        roll_std_rad=roll_std,
        distances_mm=wheel_distances_mm(frame.counts, rig),
        launch_mm=pipe.launch_mm,
        travel_mm=0.0,
        travel_std_mm=LAUNCH_STD_MM,
        stamp_ns=frame.stamp_ns,
    )


def advance(odometry: Odometry, frame: Frame, rig: Rig, settings: PaperSettings) -> Odometry:
    """One frame on: the median of what the wheels rolled since the last frame, and the roll since then."""
    travel = odometry.travel_mm + median_step_mm(odometry, frame, rig)
    std = float(np.hypot(settings.travel_std_floor_mm, settings.travel_std_share * travel))
    return moved(odometry, frame, rig, settings, travel, std)


def median_step_mm(odometry: Odometry, frame: Frame, rig: Rig) -> float:
    """What the middle one of the wheels rolled since the last frame."""
    return median((wheel_distances_mm(frame.counts, rig) - odometry.distances_mm).tolist())  # Eq. 26


def moved(
    odometry: Odometry, frame: Frame, rig: Rig, settings: RollSettings, travel_mm: float, travel_std_mm: float
) -> Odometry:
    """The odometry of a frame that stands at a given travel; its roll is carried on from the last frame."""
    roll = odometry.roll
    if roll is not None:
        roll = next_roll(roll, frame, rig, odometry.axis_camera, settings.roll_filter)
    first, first_world, axis = odometry.R_pipe_camera_1, odometry.R_world_camera_1, odometry.axis_camera
    R, roll_std = attitude_now(first, first_world, frame, rig, axis, roll, settings)
    return replace(
        odometry,
        roll=roll,
        R_pipe_camera=R,
        roll_std_rad=roll_std,
        distances_mm=wheel_distances_mm(frame.counts, rig),
        travel_mm=travel_mm,
        travel_std_mm=travel_std_mm,
        stamp_ns=frame.stamp_ns,
    )


def attitude_now(
    R_pipe_camera_1: Float[np.ndarray, "3 3"],
    R_world_camera_1: Float[np.ndarray, "3 3"],
    frame: Frame,
    rig: Rig,
    axis_camera: Float[np.ndarray, "3"],
    roll: RollState | None,
    settings: RollSettings,
) -> tuple[Float[np.ndarray, "3 3"], float]:
    """`R_pipe_camera` by the device's own attitude or by the filtered roll, and the roll's standard deviation."""
    std = float(np.radians(settings.roll_std_deg))
    if roll is not None:
        return attitude(roll, axis_camera), max(float(np.sqrt(roll.P[0, 0])), std)
    R_cm = R_world_camera_1.T @ camera_attitude(frame, rig)  # Eq. 23, which as printed is the identity
    return R_pipe_camera_1 @ R_cm, std  # Eq. 24


def settle(odometry: Odometry, alignment: Alignment) -> Odometry:
    """Remember the pipe's axis and the centre of a registered frame; they hardly change until the next."""
    T = alignment.T_pipe_camera
    return replace(odometry, axis_camera=T[2, :3].copy(), center_mm=T[:2, 3].copy())


def predict(odometry: Odometry) -> Alignment:
    """The prior of a frame: travel and roll; centre and tilt are where to start from, and worth nothing."""
    information = np.zeros((6, 6))
    information[2, 2] = odometry.travel_std_mm**-2
    information[5, 5] = odometry.roll_std_rad**-2
    place = np.append(odometry.center_mm, odometry.launch_mm + odometry.travel_mm)
    return Alignment(transform(odometry.R_pipe_camera, place), information)
