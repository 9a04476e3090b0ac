"""Wheels, gyroscope, gravity and fitted cylinder in one Kalman filter; wheels that slip are outvoted and named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field

from algorithms.localisation.alarm import AlarmSettings, Watch, begin_watch, watch
from algorithms.localisation.fused_model import (
    GYRO,
    ROLL,
    SCALE,
    SLIP,
    InertialSettings,
    S,
    U,
    WheelSettings,
    first_belief,
    process_noise,
    transition,
    wheel_rows,
)
from algorithms.localisation.gaps import IMU_GAP_S, imu_gaps
from algorithms.localisation.imu import along_axis_mm_s2, turning_rad_s
from algorithms.localisation.inclined import gravity_row
from algorithms.localisation.smoothing import Past, smoothed
from algorithms.localisation.upright import rolled_attitude
from algorithms.localisation.voting import VotingSettings, outvoted, slipping
from algorithms.localisation.wheels import wheel_distances_mm
from algorithms.types import Alignment, Episode, LookedBack
from sensor_model.geometry import transform, wrap_rad
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig
from sensor_model.settings import Settings

Positive = Annotated[float, Field(gt=0)]
ACROSS = [0, 1, 3, 4]  # of an alignment's six, those that the cylinder fit measures
UNFELT_M_S2 = 1.0  # acceleration that a silent accelerometer may have missed
UNTURNED_RAD_S = np.radians(20.0)
AT_REST_MM = 0.02
AT_REST_SIGMAS = 3.0


class FilterSettings(Settings):
    """What the filter holds of IMU and wheels, of slip, and of how far tilt and offset move in a second."""

    inertial: InertialSettings = InertialSettings()
    wheels: WheelSettings = WheelSettings()
    voting: VotingSettings = VotingSettings()
    alarm: AlarmSettings = AlarmSettings()
    offset_walk_mm: Positive = 4.0
    tilt_walk_deg: Positive = 2.0


class FusedSettings(FilterSettings):
    """The filter alone: the picture gives it tilt and offset, and nothing along the pipe."""

    kind: Literal["fused"] = "fused"


@dataclass(frozen=True)
class Fused:
    """State and covariance at a frame, and what is remembered: the last samples, slips, the way back."""

    x: Float[np.ndarray, "n"]
    P: Float[np.ndarray, "n n"]
    stamp_ns: int
    launch_mm: float
    distances_mm: Float[np.ndarray, "wheels"]
    turn: tuple[int, float] | None
    force_mm_s2: float | None
    axis_camera: Float[np.ndarray, "3"]
    center_mm: Float[np.ndarray, "2"]
    across: Float[np.ndarray, "4 4"]
    slips: Bool[np.ndarray, "wheels"]
    watch: Watch
    gaps: tuple[Episode, ...]
    past: list[Past]
    """Shared by the states of one log: each only adds to it."""
    marks: tuple[Any, ...] = ()
    """What stands in the state behind the wheels, two numbers each; `leaving` are those that go with the next step."""
    leaving: tuple[int, ...] = ()
    all_for_s: float = 0.0


def launch(
    frame: Frame, rig: Rig, pipe: NominalPipe, axis_camera: Float[np.ndarray, "3"], settings: FilterSettings
) -> Fused:
    """The start of the log: roll by gravity, the camera's own upright where that says nothing."""
    x, P = first_belief(len(rig.wheels.diameters_mm), settings.inertial, settings.wheels)
    row = gravity_row(frame, rig, axis_camera, x.size, 0.0, settings.inertial)
    if row is None:
        P[ROLL, ROLL] = 1e-12  # a datum, not a measurement
    else:
        x, P = corrected(x, P, np.array([row.seen]), row.H, np.array([row.variance]))
    rate = turning_rad_s(frame, rig, axis_camera)
    return Fused(
        x=x,
        P=P,
        stamp_ns=frame.stamp_ns,
        launch_mm=pipe.launch_mm,
        distances_mm=wheel_distances_mm(frame.counts, rig),
        turn=(int(frame.imu_stamps_ns[-1]), float(rate[-1])) if rate.size else None,
        force_mm_s2=along_axis_mm_s2(frame, rig, axis_camera),
        axis_camera=axis_camera,
        center_mm=np.zeros(2),
        across=np.zeros((4, 4)),
        slips=np.zeros(len(rig.wheels.diameters_mm), dtype=bool),
        watch=begin_watch(len(rig.wheels.diameters_mm)),
        gaps=(),
        past=[],
    )


class Felt(NamedTuple):
    """What the IMU says of one frame's motion, and how much of it it did not feel."""

    force_mm_s2: float
    unfelt_mm_s2: float
    turned_rad: float
    unturned_rad: float
    gaps: tuple[Episode, ...]


def advance(before: Fused, frame: Frame, rig: Rig, settings: FilterSettings) -> Fused:
    """One frame on: carried by the IMU, then corrected by the wheels that do not slip, by gravity and by rest."""
    dt = (frame.stamp_ns - before.stamp_ns) / 1e9
    distances = wheel_distances_mm(frame.counts, rig)
    rolled = distances - before.distances_mm
    rate = turning_rad_s(frame, rig, before.axis_camera)
    force = along_axis_mm_s2(frame, rig, before.axis_camera)
    felt = _felt(before, frame, rate, force, settings)
    x, P = _carried(before, dt, float(np.median(rolled)), felt, settings)
    x, P, slips = _by_wheels(before, x, P, rolled, dt, settings)
    x, P = _by_gravity(x, P, frame, rig, before.axis_camera, felt.turned_rad / dt, settings)
    if rate.size and np.abs(rolled).max() < AT_REST_MM:
        x, P = _by_rest(x, P, felt.turned_rad / dt, dt, settings)
    slipped = rolled * (1 + x[SCALE : SCALE + rolled.size]) - x[U] * dt
    watched = watch(before.watch, frame.stamp_ns, slipped, float(x[U] * dt), bool(slips.all()), settings.alarm)
    return replace(
        before,
        x=x,
        P=P,
        stamp_ns=frame.stamp_ns,
        distances_mm=distances,
        turn=(int(frame.imu_stamps_ns[-1]), float(rate[-1])) if rate.size else before.turn,
        force_mm_s2=force,
        across=_loosened(before.across, dt, settings),
        slips=slips,
        all_for_s=before.all_for_s + dt if slips.all() else 0.0,
        watch=watched,
        gaps=(*(gap for gap in before.gaps if gap.start_ns not in {new.start_ns for new in felt.gaps}), *felt.gaps),
        marks=tuple(mark for k, mark in enumerate(before.marks) if k not in before.leaving),
        leaving=(),
    )


def _felt(before: Fused, frame: Frame, rate: np.ndarray, force: float | None, settings: FilterSettings) -> Felt:
    """Acceleration along the pipe between the middles of two frames, and the turn of this one by trapezoids."""
    forces = [value for value in (before.force_mm_s2, force) if value is not None]
    unfelt = 1e3 * (settings.inertial.unfelt_m_s2 if forces else UNFELT_M_S2)
    stamps, rates = frame.imu_stamps_ns, rate
    if before.turn is not None:
        stamps, rates = np.append(before.turn[0], stamps), np.append(before.turn[1], rates)
    silent = imu_gaps(int(stamps[0]) if stamps.size else before.stamp_ns, frame.stamp_ns, frame.imu_stamps_ns)
    unturned = UNTURNED_RAD_S * float(np.sqrt(sum(_silence2_s2(gap, before.stamp_ns) for gap in silent)))
    turned = 0.0
    if rate.size:
        inside = (stamps > before.stamp_ns) & (stamps < frame.stamp_ns)
        knots = np.concatenate([[before.stamp_ns], stamps[inside], [frame.stamp_ns]])
        turned = float(np.trapezoid(np.interp(knots, stamps, rates), knots) / 1e9)
    return Felt(float(np.mean(forces)) if forces else 0.0, unfelt, turned, unturned, silent)


def _silence2_s2(gap: Episode, since_ns: int) -> float:
    """By how much the square of a silence has grown: a robot that rolls in it goes on rolling."""
    before = max((since_ns - gap.start_ns) / 1e9, 0.0)
    return gap.amount**2 - (before**2 if before > IMU_GAP_S else 0.0)


def _carried(
    before: Fused, dt: float, rolled_mm: float, felt: Felt, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray]:
    """The state a frame later, and the step remembered for the way back."""
    from filterpy.kalman import predict

    n = before.x.size
    F, B = transition(n, dt, rolled_mm, settings.wheels)
    kept_slip = float(F[SLIP, SLIP])
    Q = process_noise(n, dt, felt.unfelt_mm_s2, felt.unturned_rad, kept_slip, settings.inertial, settings.wheels)
    stays = _staying(before)
    F, B, Q = F[stays], B[stays], Q[np.ix_(stays, stays)]
    x, P = predict(before.x, before.P, F=F, Q=Q, u=np.array([felt.force_mm_s2, felt.turned_rad / dt]), B=B)
    before.past.append(Past(before.x, before.P, F, x, P))
    return x, P


def _staying(before: Fused) -> Int[np.ndarray, "m"]:
    """Rows of the state without those of the marks that leave."""
    first = SCALE + before.distances_mm.size
    gone = [first + 2 * k + i for k in before.leaving for i in (0, 1)]
    return np.setdiff1d(np.arange(before.x.size), gone)


def _by_wheels(
    before: Fused, x: np.ndarray, P: np.ndarray, rolled_mm: np.ndarray, dt: float, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corrected by each wheel's own rolling speed, but those of the wheels that slip."""
    speeds = rolled_mm / dt
    H, variance = wheel_rows(x.size, speeds, dt, settings.wheels)
    # a wheel under alarm is not asked; all of them must be, or nobody would notice that they grip again
    named = before.watch.named[:-1]
    all_may = before.all_for_s < settings.voting.all_at_most_s
    slips = slipping(speeds - H @ x, H @ P @ H.T, variance, before.slips, named, settings.voting, all_may)
    x, P = corrected(x, P, speeds, H, outvoted(slips, variance, settings.voting))
    return x, P, slips


def _by_gravity(
    x: np.ndarray, P: np.ndarray, frame: Frame, rig: Rig, axis: np.ndarray, rate_rad_s: float, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray]:
    row = gravity_row(frame, rig, axis, x.size, rate_rad_s, settings.inertial)
    if row is None:
        return x, P
    # the nearest turn of what is seen, so that passing 12 o'clock is no jump
    expected = (row.H @ x)[0]
    seen = expected + float(wrap_rad(row.seen - expected))
    return corrected(x, P, np.array([seen]), row.H, np.array([row.variance]))


def _by_rest(
    x: np.ndarray, P: np.ndarray, rate_rad_s: float, dt: float, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Wheels that stand: what the gyroscope then says is its bias, unless it is so much that the robot must roll."""
    variance = settings.inertial.gyroscope_noise_density**2 / dt
    if abs(rate_rad_s - x[GYRO]) > AT_REST_SIGMAS * np.sqrt(P[GYRO, GYRO] + variance):
        return x, P
    H = np.zeros((1, x.size))
    H[0, GYRO] = 1.0
    return corrected(x, P, np.array([rate_rad_s]), H, np.array([variance]))


def corrected(
    x: np.ndarray, P: np.ndarray, seen: np.ndarray, H: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance with a measurement taken in, its errors independent."""
    from filterpy.kalman import update

    x, P = update(x, P, seen, np.diag(variance), H)
    return x, (P + P.T) / 2


def _loosened(across: np.ndarray, dt: float, settings: FilterSettings) -> np.ndarray:
    """Information on offset and tilt a while later; what was not known stays unknown."""
    walk = np.array([settings.offset_walk_mm] * 2 + [np.radians(settings.tilt_walk_deg)] * 2) ** 2 * dt
    return across - across @ np.linalg.inv(across + np.diag(1 / walk)) @ across


def predict(fused: Fused) -> Alignment:
    """The prior of a frame: distance and roll with their covariance, and offset and tilt as last fitted."""
    information = np.zeros((6, 6))
    information[np.ix_([2, 5], [2, 5])] = np.linalg.inv(fused.P[np.ix_([S, ROLL], [S, ROLL])])
    information[np.ix_(ACROSS, ACROSS)] = fused.across
    R = rolled_attitude(float(fused.x[ROLL]), fused.axis_camera)
    return Alignment(transform(R, np.append(fused.center_mm, fused.launch_mm + fused.x[S])), information)


def settle(fused: Fused, alignment: Alignment) -> Fused:
    """Remember the pipe's axis, the centre of a registered frame, and what they are worth."""
    T = alignment.T_pipe_camera
    across = alignment.information[np.ix_(ACROSS, ACROSS)]
    return replace(fused, axis_camera=T[2, :3].copy(), center_mm=T[:2, 3].copy(), across=across)


def look_back(fused: Fused) -> LookedBack:
    """The whole path by what came before and after each frame."""
    x, P = smoothed(fused.past, fused.x, fused.P, ROLL + 1)
    both = [S, ROLL]
    return LookedBack(fused.launch_mm + x[:, S], x[:, ROLL], P[:, both][:, :, both])


def episodes(fused: Fused) -> tuple[Episode, ...]:
    """Slips and silences so far."""
    return fused.watch.episodes + fused.gaps
