"""The IMU: angular rate and specific force at its mount, and the attitude that the device itself reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sensor_model.attitude_filter import Fusion, fused_attitude, measured_north
from sensor_model.geometry import GRAVITY_M_S2, wxyz_from_rotation
from sensor_model.rig import ImuMount
from sensor_model.settings import Settings
from twin.truth import Truth, gravity_along, gravity_direction

NonNegative = Annotated[float, Field(ge=0)]


class ImuNoise(Settings):
    """Errors of the IMU under Kalibr's names and units (continuous time); every one has a zero.

    Biases, scale errors and `*_misalignment_deg` (how far each axis leans towards each other one) are standard
    deviations of what one device has. A reading stops at its range and comes in whole steps; 0 is no limit, no step.
    A reading is the mean over `averaged_share` of the time since the last, as a device's low-pass makes it; with 0 it
    is that of one instant, and wheels that chatter as fast as it is read pass for a steady force.

    The device's own quaternion is the truth with `attitude_*` errors, white noise and a slow drift with a correlation
    time; with `fusion` it is instead what a filter makes of these very readings. `quaternion_rounding` is the step to
    which it is logged (0.01 in the real log; 0 for none). `rostopic` has no use here: it is in Kalibr's `imu.yaml`,
    which can so be pasted in.
    """

    update_rate: Annotated[float, Field(gt=1, le=1000)] = 100.0
    averaged_share: Annotated[float, Field(ge=0, le=1)] = 0.0
    gyroscope_noise_density: NonNegative = 2.4e-4
    gyroscope_random_walk: NonNegative = 5.0e-5
    gyroscope_bias_deg_s: NonNegative = 0.1
    accelerometer_noise_density: NonNegative = 1.5e-3
    accelerometer_random_walk: NonNegative = 5.0e-4
    accelerometer_bias_m_s2: NonNegative = 0.02
    gyroscope_scale_error_pct: NonNegative = 0.0
    gyroscope_misalignment_deg: NonNegative = 0.0
    gyroscope_range_deg_s: NonNegative = 0.0
    gyroscope_step_deg_s: NonNegative = 0.0
    accelerometer_scale_error_pct: NonNegative = 0.0
    accelerometer_misalignment_deg: NonNegative = 0.0
    accelerometer_range_g: NonNegative = 0.0
    accelerometer_step_mg: NonNegative = 0.0
    attitude_noise_deg: NonNegative = 0.05
    attitude_drift_deg: NonNegative = 0.2
    attitude_drift_time_s: Annotated[float, Field(gt=0)] = 20.0
    fusion: Fusion | None = None
    quaternion_rounding: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    rostopic: str = ""


NO_IMU_NOISE = ImuNoise(
    gyroscope_noise_density=0,
    gyroscope_random_walk=0,
    gyroscope_bias_deg_s=0,
    accelerometer_noise_density=0,
    accelerometer_random_walk=0,
    accelerometer_bias_m_s2=0,
    attitude_noise_deg=0,
    attitude_drift_deg=0,
)


@dataclass(frozen=True)
class ImuLog:
    """What the IMU wrote."""

    stamp_ns: Int[np.ndarray, "n"]
    gyro_rad_s: Float[np.ndarray, "n 3"]
    acceleration_m_s2: Float[np.ndarray, "n 3"]
    q_world_imu_wxyz: Float[np.ndarray, "n 4"]


def world_from_pipe(truth: Truth) -> Float[np.ndarray, "3 3"]:
    """`R_world_pipe` at the pipe's start: the device's world has z up; its heading is the pipe's, by choice."""
    up = -gravity_direction(truth.pipe)
    right = np.array([1.0, 0.0, 0.0])
    return np.stack([right, np.cross(up, right), up])


def measure_imu(
    truth: Truth, mount: ImuMount, noise: ImuNoise, rng: np.random.Generator, rng_attitude: np.random.Generator
) -> ImuLog:
    """The IMU's log over the whole drive."""
    time_s = truth.sample_times_s(noise.update_rate)
    T_pipe_camera = truth.pose_at(time_s)
    if noise.averaged_share > 0:
        gyro, force = _averaged(truth, mount, time_s, noise.averaged_share / noise.update_rate)
    else:
        gyro, force = _felt(truth, mount, time_s, T_pipe_camera)
    gyro_errors = _errors(
        rng,
        time_s,
        noise.gyroscope_noise_density,
        noise.gyroscope_random_walk,
        np.radians(noise.gyroscope_bias_deg_s),
    )
    force_errors = _errors(
        rng, time_s, noise.accelerometer_noise_density, noise.accelerometer_random_walk, noise.accelerometer_bias_m_s2
    )
    gyro = gyro @ _axes(rng, noise.gyroscope_scale_error_pct, noise.gyroscope_misalignment_deg) + gyro_errors
    force = force @ _axes(rng, noise.accelerometer_scale_error_pct, noise.accelerometer_misalignment_deg) + force_errors
    gyro = _read(gyro, np.radians(noise.gyroscope_range_deg_s), np.radians(noise.gyroscope_step_deg_s))
    force = _read(force, GRAVITY_M_S2 * noise.accelerometer_range_g, 1e-3 * GRAVITY_M_S2 * noise.accelerometer_step_mg)
    heading = truth.pipe.axis.frame(T_pipe_camera[:, 2, 3])[:, :3, :3] if truth.pipe.bends else np.eye(3)
    R_world_imu = world_from_pipe(truth) @ heading @ (T_pipe_camera[:, :3, :3] @ mount.R_camera_imu)
    if noise.fusion is None:
        attitude = _with_errors(R_world_imu, time_s, noise, rng_attitude)
    else:
        attitude = _fused(R_world_imu, gyro, force, time_s[1] - time_s[0], noise.fusion, rng_attitude)
    q = wxyz_from_rotation(attitude)
    if noise.quaternion_rounding > 0:
        q = np.round(q / noise.quaternion_rounding) * noise.quaternion_rounding
    return ImuLog(np.round(time_s * 1e9).astype(np.int64), gyro, force, q)


def _felt(
    truth: Truth, mount: ImuMount, time_s: np.ndarray, T_pipe_camera: np.ndarray
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Rate and specific force in the device's axes, instant by instant, without errors."""
    R_pipe_camera = T_pipe_camera[:, :3, :3]
    rate = CubicSpline(truth.time_s, truth.angular_velocity_camera_rad_s)
    omega, omega_dot = rate(time_s), rate(time_s, 1)
    lever_m = np.array(mount.position_camera_mm) / 1e3
    lever_acceleration = np.cross(omega_dot, lever_m) + np.cross(omega, np.cross(omega, lever_m))
    acceleration = CubicSpline(truth.time_s, truth.acceleration_mm_s2)(time_s) / 1e3
    acceleration += np.einsum("nij,nj->ni", R_pipe_camera, lever_acceleration)
    specific_force = acceleration - GRAVITY_M_S2 * gravity_along(truth.pipe, T_pipe_camera[:, 2, 3])
    force = np.einsum("nji,nj->ni", R_pipe_camera @ mount.R_camera_imu, specific_force)
    return omega @ mount.R_camera_imu, force


def _averaged(
    truth: Truth, mount: ImuMount, time_s: np.ndarray, window_s: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """`_felt` as means over a window that ends with each reading; the first is of its instant."""
    every = np.hstack(_felt(truth, mount, truth.time_s, truth.pose_at(truth.time_s)))
    steps = np.diff(truth.time_s)[:, None] * 0.5 * (every[1:] + every[:-1])
    total = np.vstack([np.zeros((1, 6)), np.cumsum(steps, axis=0)])
    begin = np.maximum(time_s - window_s, truth.time_s[0])
    ends = [np.stack([np.interp(t, truth.time_s, column) for column in total.T], axis=1) for t in (begin, time_s)]
    length = (time_s - begin)[:, None]
    mean = np.where(length > 0, (ends[1] - ends[0]) / np.where(length > 0, length, 1.0), every[:1])
    return mean[:, :3], mean[:, 3:]


def _errors(rng, time_s, density, walk, bias) -> np.ndarray:
    """White noise, bias walk and a constant bias of given spread, discretised at the sampling rate."""
    n, dt = time_s.size, time_s[1] - time_s[0]
    white = rng.standard_normal((n, 3)) * density / np.sqrt(dt)
    walked = np.cumsum(rng.standard_normal((n, 3)), axis=0) * walk * np.sqrt(dt)
    return white + walked + rng.standard_normal(3) * bias


def _axes(rng, scale_pct, misalignment_deg) -> np.ndarray:
    """What one device's axes make of a vector (rows times it): scale errors on the diagonal, leaning axes beside it."""
    scale = np.diag(rng.standard_normal(3) * scale_pct / 100)
    leaning = rng.standard_normal((3, 3)) * np.radians(misalignment_deg)
    return np.eye(3) + scale + leaning - np.diag(np.diag(leaning))


def _read(values: np.ndarray, limit: float, step: float) -> np.ndarray:
    """Readings cut at a range and in whole steps; zeros leave them as they are."""
    if limit > 0:
        values = np.clip(values, -limit, limit)
    return np.round(values / step) * step if step > 0 else values


def _with_errors(R_world_imu, time_s, noise: ImuNoise, rng) -> np.ndarray:
    """A small error in the world's frame: noise and a slow drift."""
    keep = np.exp(-(time_s[1] - time_s[0]) / noise.attitude_drift_time_s)
    drift = rng.standard_normal((time_s.size, 3))
    drift[1:] *= np.sqrt(1 - keep**2)
    for i in range(1, time_s.size):
        drift[i] += keep * drift[i - 1]
    error_deg = drift * noise.attitude_drift_deg + rng.standard_normal((time_s.size, 3)) * noise.attitude_noise_deg
    return Rotation.from_rotvec(np.radians(error_deg)).as_matrix() @ R_world_imu


def _fused(R_world_imu, gyro, force, dt_s, fusion: Fusion, rng) -> np.ndarray:
    """What the device's filter makes of its own readings."""
    north = np.zeros_like(gyro)
    if fusion.magnetometer is not None:
        north = measured_north(R_world_imu, float(dt_s), fusion.magnetometer, rng)
    return fused_attitude(gyro, force, north, float(dt_s), R_world_imu[0], fusion)
