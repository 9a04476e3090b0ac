"""The IMU's own attitude: a complementary filter over its gyroscope, accelerometer and, if it has one, magnetometer."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field

from sensor_model.settings import Settings

NORTH_DIP_RAD = np.radians(60.0)  # how steeply the magnetic field falls into the ground, as in Central Europe
NonNegative = Annotated[float, Field(ge=0)]


class Magnetometer(Settings):
    """A magnetometer by its errors, as shares of the earth's field; in and near steel they are large.

    `hard_iron` turns with the device (motors, batteries); `disturbance` is the pipe's surroundings, which change over
    `disturbance_time_s`.
    """

    noise: NonNegative = 0.01
    hard_iron: NonNegative = 0.0
    disturbance: NonNegative = 0.0
    disturbance_time_s: Annotated[float, Field(gt=0)] = 5.0


class Fusion(Settings):
    """Mahony's complementary filter as devices carry it: how fast gravity and north pull at the integrated gyroscope.

    It starts at the true attitude; without a magnetometer its heading drifts as the gyroscope's bias has it.
    """

    gravity_gain_per_s: NonNegative = 0.5
    bias_gain_per_s2: NonNegative = 0.02
    north_gain_per_s: NonNegative = 0.2
    magnetometer: Magnetometer | None = None


def fused_attitude(
    gyro_rad_s: Float[np.ndarray, "n 3"],
    force_m_s2: Float[np.ndarray, "n 3"],
    north: Float[np.ndarray, "n 3"],
    dt_s: float,
    R_world_imu_start: Float[np.ndarray, "3 3"],
    fusion: Fusion,
) -> Float[np.ndarray, "n 3 3"]:
    """`R_world_imu` by the filter (Mahony, Hamel and Pflimlin 2008), z of the world up.

    `north` is the magnetic field in the device's axes, zeros without a magnetometer.
    """
    field = field_world() if fusion.magnetometer else np.zeros(3)
    gains = (fusion.gravity_gain_per_s, fusion.bias_gain_per_s2, fusion.north_gain_per_s)
    return _mahony(gyro_rad_s, force_m_s2, north, dt_s, np.ascontiguousarray(R_world_imu_start), field, gains)


def field_world() -> Float[np.ndarray, "3"]:
    """The earth's magnetic field, of length 1, along the pipe's heading and into the ground."""
    return np.array([0.0, np.cos(NORTH_DIP_RAD), -np.sin(NORTH_DIP_RAD)])


def measured_north(
    R_world_imu: Float[np.ndarray, "n 3 3"], dt_s: float, settings: Magnetometer, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """What the magnetometer reads, in the device's axes."""
    n, keep = len(R_world_imu), np.exp(-dt_s / settings.disturbance_time_s)
    around = rng.standard_normal((n, 3))
    around[1:] *= np.sqrt(1 - keep**2)
    for i in range(1, n):
        around[i] += keep * around[i - 1]
    field = np.einsum("nji,nj->ni", R_world_imu, field_world() + settings.disturbance * around)
    return field + settings.hard_iron * rng.standard_normal(3) + settings.noise * rng.standard_normal((n, 3))


@njit(cache=True, error_model="numpy")
def _mahony(gyro, force, north, dt, start, field, gains):
    out, R, bias = np.empty((gyro.shape[0], 3, 3)), start.copy(), np.zeros(3)
    for i in range(gyro.shape[0]):
        error = np.cross(force[i] / np.sqrt(np.dot(force[i], force[i])), R[2])
        length = np.sqrt(np.dot(north[i], north[i]))
        turn = gains[0] * error
        if length > 0.0:
            turn += gains[2] * np.cross(north[i] / length, field @ R)
        out[i] = R
        bias -= gains[1] * error * dt
        R = _turned(R, (gyro[i] - bias + turn) * dt)
    return out


@njit(cache=True, error_model="numpy")
def _turned(R, step):
    """R times the rotation by a small vector, made orthogonal again."""
    angle = np.sqrt(np.dot(step, step))
    K = np.array([[0.0, -step[2], step[1]], [step[2], 0.0, -step[0]], [-step[1], step[0], 0.0]])
    one, two = (np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2) if angle > 1e-9 else (1.0, 0.5)
    R = R @ (np.eye(3) + one * K + two * (K @ K))
    x = R[0] / np.sqrt(np.dot(R[0], R[0]))
    y = R[1] - np.dot(R[1], x) * x
    y /= np.sqrt(np.dot(y, y))
    out = np.empty((3, 3))
    out[0], out[1], out[2] = x, y, np.cross(x, y)
    return out
