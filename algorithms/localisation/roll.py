"""Roll from gyroscope and gravity by a Kalman filter: for an IMU whose own attitude is coarse or drifts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.localisation.upright import is_vertical, level_attitude, rolled_attitude
from sensor_model.geometry import GRAVITY_M_S2, twist_about_z_rad, wrap_rad
from sensor_model.recording import Frame
from sensor_model.rig import Rig
from sensor_model.settings import Settings

SHORTEST_S = 0.01  # one sample says as much as an average over this
Positive = Annotated[float, Field(gt=0)]


class RollFilterSettings(Settings):
    """What the filter holds of its IMU, under Kalibr's names and units, and of the robot's vibration."""

    gyroscope_noise_density: Positive = 2.4e-4
    gyroscope_random_walk: Positive = 5.0e-5
    gyroscope_bias_deg_s: Positive = 0.2
    accelerometer_noise_density: Positive = 1.5e-3
    vibration_m_s2: Positive = 0.05


@dataclass(frozen=True)
class RollState:
    """Roll (rad) and the gyroscope's bias about the pipe's axis (rad/s), with their covariance, at a stamp."""

    x: Float[np.ndarray, "2"]
    P: Float[np.ndarray, "2 2"]
    stamp_ns: int


def begin_roll(frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"], settings: RollFilterSettings) -> RollState:
    """The first roll, by gravity alone.

    Raises:
        ValueError: when there is no IMU sample up to the first frame.
    """
    if not len(frame.imu):
        raise ValueError(f"no IMU sample up to frame {frame.index}: roll has no start")
    spread = _gravity_std_rad(frame, settings)
    bias = np.radians(settings.gyroscope_bias_deg_s)
    return RollState(
        np.array([_roll_by_gravity(frame, rig, axis_camera), 0.0]), np.diag([spread**2, bias**2]), frame.stamp_ns
    )


def next_roll(
    state: RollState, frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"], settings: RollFilterSettings
) -> RollState:
    """One frame on: turned by the gyroscope, corrected by gravity."""
    from filterpy.kalman import predict, update

    dt = (frame.stamp_ns - state.stamp_ns) / 1e9
    rate = float(np.mean(frame.imu[:, :3] @ rig.imu.R_camera_imu.T @ axis_camera)) if len(frame.imu) else 0.0
    F = np.array([[1.0, -dt], [0.0, 1.0]])
    Q = np.diag([settings.gyroscope_noise_density**2 * dt, settings.gyroscope_random_walk**2 * dt])
    x, P = predict(state.x, state.P, F=F, Q=Q, u=np.array([rate * dt, 0.0]), B=np.eye(2))
    if len(frame.imu) and not is_vertical(_down_camera(frame, rig), axis_camera):
        # the samples' mean is that of their middle, and the nearest turn of it, so that passing 12 o'clock is no jump
        late_s = (frame.stamp_ns - float(frame.imu_stamps_ns.mean())) / 1e9
        seen = _roll_by_gravity(frame, rig, axis_camera) + (rate - x[1]) * late_s
        seen = x[0] + float(wrap_rad(seen - x[0]))
        x, P = update(x, P, np.array([seen]), np.array([[_gravity_std_rad(frame, settings) ** 2]]), H=np.eye(1, 2))
    return RollState(np.asarray(x), np.asarray(P), frame.stamp_ns)


def attitude(state: RollState, axis_camera: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R_pipe_camera` with the filter's roll, about the pipe's axis as the camera sees it."""
    return rolled_attitude(float(state.x[0]), axis_camera)


def _roll_by_gravity(frame: Frame, rig: Rig, axis_camera: np.ndarray) -> float:
    """Roll at which the specific force points up; acceleration along the pipe does not enter."""
    return float(twist_about_z_rad(level_attitude(_down_camera(frame, rig), axis_camera)))


def _down_camera(frame: Frame, rig: Rig) -> Float[np.ndarray, "3"]:
    down = -rig.imu.R_camera_imu @ frame.imu[:, 3:].mean(axis=0)
    return down / np.linalg.norm(down)


def _gravity_std_rad(frame: Frame, settings: RollFilterSettings) -> float:
    stamps = frame.imu_stamps_ns
    seconds = max((stamps[-1] - stamps[0]) / 1e9, SHORTEST_S)
    spread = np.hypot(settings.accelerometer_noise_density / np.sqrt(seconds), settings.vibration_m_s2)
    return float(spread / GRAVITY_M_S2)
