"""Drive logs in closed form, without physics or pictures: for statistics of estimators over many seeds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.hindsight import about
from algorithms.localisation import ESTIMATORS
from algorithms.localisation.fused_model import InertialSettings, WheelSettings
from algorithms.triangulate import triangulate
from algorithms.types import Episode, RingPoints
from sensor_model.geometry import GRAVITY_M_S2, transform, wrap_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig
from twin.pipe import Pipe

RAMP_S = 0.5
IMU_PER_FRAME = 4
FORWARD = np.array([0.0, 0.0, 1.0])
PIPE = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)


@dataclass(frozen=True)
class SlipEpisode:
    """A wheel (None: all) whose rim goes `speed_mm_s` more than the robot, from `start_s` on for `duration_s`."""

    wheel: int | None
    start_s: float
    duration_s: float
    speed_mm_s: float


@dataclass(frozen=True)
class Drive:
    """How a made-up robot drives, level unless it stands upright: up and down to its speed, rolling to and fro."""

    seconds: float = 20.0
    speed_mm_s: float = 50.0
    frame_rate_hz: float = 15.0
    roll_deg: float = 10.0
    roll_period_s: float = 15.0
    upright: bool = False
    slips: tuple[SlipEpisode, ...] = ()


@dataclass(frozen=True)
class DriveLog:
    """The frames without pictures, and where the robot really was at each."""

    frames: tuple[Frame, ...]
    z_mm: Float[np.ndarray, "frames"]
    roll_rad: Float[np.ndarray, "frames"]


def make_log(
    drive: Drive, rig: Rig, inertial: InertialSettings, wheels: WheelSettings, rng: np.random.Generator
) -> DriveLog:
    """One drive whose errors are drawn as the settings say that they are spread."""
    per_s = drive.frame_rate_hz * IMU_PER_FRAME
    t = np.arange(round(drive.seconds * per_s) + 1) / per_s
    up = np.clip(np.minimum(t, drive.seconds - t) / RAMP_S, 0, 1)
    speed = drive.speed_mm_s * up**2 * (3 - 2 * up)
    acceleration = drive.speed_mm_s * 6 * up * (1 - up) / RAMP_S * np.sign(drive.seconds / 2 - t)
    z = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / per_s)])
    turn = 2 * np.pi / drive.roll_period_s
    roll = np.radians(drive.roll_deg) * (1 - np.cos(turn * t))
    rate = np.radians(drive.roll_deg) * turn * np.sin(turn * t)
    at = np.arange(0, t.size, IMU_PER_FRAME)
    counts = _counts(drive, rig, wheels, t[at], z[at], rng)
    imu = _imu(drive, rig, inertial, acceleration / 1e3, roll, rate, per_s, rng)
    stamps = np.round(t * 1e9).astype(np.int64)
    frames = []
    for k, i in enumerate(at.tolist()):
        since = slice(max(i - IMU_PER_FRAME, -1) + 1, i + 1)
        attitude = np.array([np.cos(roll[i] / 2), 0.0, 0.0, np.sin(roll[i] / 2)])
        frames.append(Frame(k, int(stamps[i]), None, None, attitude, counts[k], stamps[since], imu[since]))
    return DriveLog(tuple(frames), z[at], roll[at])


def _counts(
    drive: Drive, rig: Rig, wheels: WheelSettings, t: np.ndarray, z: np.ndarray, rng: np.random.Generator
) -> Float[np.ndarray, "frames wheels"]:
    """Whole counts of wheels with scale errors, a slip that all share, noise, and the episodes."""
    n, way = len(rig.wheels.diameters_mm), np.diff(z)
    scale = rng.standard_normal() * wheels.common_scale_std_pct + rng.standard_normal(n) * wheels.scale_std_pct
    shared, slip = np.empty(way.size), rng.standard_normal() * wheels.slip_std_pct
    for k, step in enumerate(np.abs(way)):
        keep = np.exp(-step / wheels.slip_length_mm)
        slip = keep * slip + np.sqrt(1 - keep**2) * wheels.slip_std_pct * rng.standard_normal()
        shared[k] = slip
    std = np.sqrt(wheels.noise_mm**2 + wheels.noise_mm_per_sqrt_m**2 * np.abs(way) / 1e3)
    noise = rng.standard_normal((way.size, n)) * std[:, None]
    rolled = way[:, None] / (1 + (scale[None, :] - shared[:, None]) / 100) + noise
    for one in drive.slips:
        inside = np.clip(np.minimum(t[1:], one.start_s + one.duration_s) - np.maximum(t[:-1], one.start_s), 0, None)
        rolled[:, list(range(n)) if one.wheel is None else [one.wheel]] += one.speed_mm_s * inside[:, None]
    per_mm = rig.wheels.counts_per_turn / (np.pi * np.array(rig.wheels.diameters_mm))
    return np.rint(np.vstack([np.zeros(n), np.cumsum(rolled, axis=0)]) * per_mm)


def _imu(
    drive: Drive,
    rig: Rig,
    inertial: InertialSettings,
    acceleration_m_s2: np.ndarray,
    roll: np.ndarray,
    rate: np.ndarray,
    per_s: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 6"]:
    """Rate about the pipe and specific force, with biases, walks, noise, and what shakes for one frame at a time."""
    n, dt = roll.size, 1 / per_s
    gyro = np.zeros((n, 3))
    gyro[:, 2] = rate
    gyro += rng.standard_normal((n, 3)) * inertial.gyroscope_noise_density / np.sqrt(dt)
    gyro += np.cumsum(rng.standard_normal((n, 3)), axis=0) * inertial.gyroscope_random_walk * np.sqrt(dt)
    gyro += rng.standard_normal(3) * np.radians(inertial.gyroscope_bias_deg_s)
    down = 0.0 if drive.upright else GRAVITY_M_S2
    force = np.column_stack([-down * np.sin(roll), -down * np.cos(roll), acceleration_m_s2])
    force[:, 2] += GRAVITY_M_S2 if drive.upright else 0.0
    force += rng.standard_normal((n, 3)) * inertial.accelerometer_noise_density / np.sqrt(dt)
    force += np.cumsum(rng.standard_normal((n, 3)), axis=0) * inertial.accelerometer_random_walk * np.sqrt(dt)
    force += rng.standard_normal(3) * inertial.accelerometer_bias_m_s2
    shaken = np.array([inertial.vibration_m_s2, inertial.vibration_m_s2, inertial.unfelt_m_s2])
    frame = (np.arange(n) + IMU_PER_FRAME - 1) // IMU_PER_FRAME
    force += (rng.standard_normal((frame[-1] + 1, 3)) * shaken)[frame]
    return np.hstack([gyro @ rig.imu.R_camera_imu, force @ rig.imu.R_camera_imu])


@dataclass(frozen=True)
class Estimated:
    """What an estimator made of a log: errors of distance and roll with covariance, as it went and looking back."""

    error: Float[np.ndarray, "frames 2"]
    covariance: Float[np.ndarray, "frames 2 2"]
    back_error: Float[np.ndarray, "frames 2"] | None
    back_covariance: Float[np.ndarray, "frames 2 2"] | None
    episodes: tuple[Episode, ...]


class Sights(NamedTuple):
    """The points of every frame, and the radius of the wall that they lie on."""

    points: tuple[RingPoints, ...]
    radius_mm: float


def look_at(pipe: Pipe, log: DriveLog, rig: Rig, noise: PointNoise, rng: np.random.Generator) -> Sights:
    """What the sensor sees of a pipe on the way, from the axis."""
    poses = (transform(about(roll), np.array([0.0, 0.0, z])) for z, roll in zip(log.z_mm, log.roll_rad, strict=True))
    points = (triangulate(see_slits(pipe, T, rig, noise, rng, frame_index=k), rig) for k, T in enumerate(poses))
    return Sights(tuple(points), pipe.bore_radius_mm)


def estimate(log: DriveLog, rig: Rig, settings: object, sights: Sights | None = None) -> Estimated:
    """Run an estimator over a log as if every frame's fit were perfect: the pipe's axis is the camera's."""
    estimator = ESTIMATORS[settings.kind]  # type: ignore[attr-defined]
    z, roll, covariance, state = [], [], [], None
    for frame in log.frames:
        if state is None:
            state = estimator.launch(frame, rig, PIPE, FORWARD, settings)
        else:
            state = estimator.advance(state, frame, rig, settings)
        prior = estimator.predict(state)
        if estimator.look and sights:
            fitted = replace(prior, radius_mm=sights.radius_mm)
            state, prior = estimator.look(state, sights.points[frame.index], fitted, settings)
        R = prior.T_pipe_camera
        z.append(R[2, 3])
        roll.append(np.arctan2(R[1, 0], R[0, 0]))
        covariance.append(np.linalg.inv(prior.information[np.ix_([2, 5], [2, 5])]))
    error = _errors(log, np.array(z), np.array(roll))
    back = estimator.look_back(state) if estimator.look_back else None
    return Estimated(
        error,
        np.array(covariance),
        _errors(log, back.z_mm, back.roll_rad) if back else None,
        back.covariance if back else None,
        estimator.episodes(state) if estimator.episodes else (),
    )


def _errors(log: DriveLog, z_mm: np.ndarray, roll_rad: np.ndarray) -> Float[np.ndarray, "frames 2"]:
    return np.column_stack([z_mm - log.z_mm, wrap_rad(roll_rad - log.roll_rad)])


def nees(error: Float[np.ndarray, "frames 2"], covariance: Float[np.ndarray, "frames 2 2"]) -> np.ndarray:
    """Normalised squared error of distance and roll, a frame each: chi-square of two degrees of freedom if honest."""
    return np.einsum("fi,fij,fj->f", error, np.linalg.inv(covariance), error)
