"""The linear model of the fused estimator: what it carries, how that moves on, and what each sensor says of it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.geometry import GRAVITY_M_S2
from sensor_model.settings import Settings

S, U, FORCE, ROLL, GYRO, BIAS_X, BIAS_Y, SLIP, COMMON = range(9)
"""Distance (mm), rolling speed of a middling wheel over the last frame (mm/s), accelerometer bias and slope along the
pipe (mm/s2), roll (rad), gyroscope bias about the pipe (rad/s), accelerometer biases across it in the camera's axes
(m/s2), slip that all wheels share (share of what they roll), scale that all wheels share: how much further they roll
than their diameters say (share)."""
SCALE = 9
"""From here on, one a wheel: its own scale beside the common one (share); then the marks, if any."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class InertialSettings(Settings):
    """What the filter holds of its IMU, under Kalibr's names and units; the biases are what they may be at the start.

    `vibration_m_s2` is how far the mean force of one frame strays across the pipe, `unfelt_m_s2` how far the robot's
    acceleration along it strays from the felt one.
    """

    gyroscope_noise_density: Positive = 2.4e-4
    gyroscope_random_walk: Positive = 5.0e-5
    gyroscope_bias_deg_s: Positive = 0.2
    accelerometer_noise_density: Positive = 1.5e-3
    accelerometer_random_walk: Positive = 5.0e-4
    accelerometer_bias_m_s2: Positive = 0.02
    vibration_m_s2: Positive = 0.05
    unfelt_m_s2: Positive = 0.05
    slope_deg: Positive = 45.0


class WheelSettings(Settings):
    """What the filter holds of the wheels.

    `scale_pct` is how much further each wheel rolls than its diameter says, as a calibration drive found it (empty:
    not at all); beyond that all may be wrong together by `common_scale_std_pct` (which encoders alone cannot show) and
    each by `scale_std_pct`. All may slip together by `slip_std_pct`, which comes and goes within `slip_length_mm`.
    """

    scale_pct: tuple[Annotated[float, Field(gt=-20, lt=20)], ...] = ()
    common_scale_std_pct: NotNegative = 1.0
    scale_std_pct: Positive = 0.5
    slip_std_pct: NotNegative = 0.3
    slip_length_mm: Positive = 1000.0
    noise_mm: Positive = 0.01
    noise_mm_per_sqrt_m: Positive = 0.1


def first_belief(
    wheels: int, inertial: InertialSettings, wheel: WheelSettings
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n n"]]:
    """State and covariance before anything is measured, at the launch.

    Raises:
        ValueError: when `scale_pct` speaks of another number of wheels.
    """
    if wheel.scale_pct and len(wheel.scale_pct) != wheels:
        raise ValueError(f"wheels.scale_pct has {len(wheel.scale_pct)} values; the rig has {wheels} encoder wheels")
    x, std = np.zeros(SCALE + wheels), np.zeros(SCALE + wheels)
    std[[S, U, ROLL]] = 1e-3, 100.0, np.pi
    std[FORCE] = 1e3 * GRAVITY_M_S2 * np.sin(np.radians(inertial.slope_deg))
    std[GYRO] = np.radians(inertial.gyroscope_bias_deg_s)
    std[[BIAS_X, BIAS_Y]] = inertial.accelerometer_bias_m_s2
    std[SLIP], std[COMMON] = wheel.slip_std_pct / 100, wheel.common_scale_std_pct / 100
    std[SCALE:] = wheel.scale_std_pct / 100
    if wheel.scale_pct:
        x[COMMON] = np.mean(wheel.scale_pct) / 100
        x[SCALE:] = np.array(wheel.scale_pct) / 100 - x[COMMON]
    return x, np.diag(std**2)


def transition(
    n: int, dt: float, rolled_mm: float, wheel: WheelSettings
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n 2"]]:
    """F of one frame, and B for the felt acceleration along the pipe (mm/s2) and the rate of turn about it (rad/s)."""
    F, B = np.eye(n), np.zeros((n, 2))
    F[U, FORCE] = -dt
    F[S, U], F[S, FORCE] = dt, -(dt**2)
    F[S, COMMON], F[S, SLIP] = rolled_mm, -rolled_mm
    F[ROLL, GYRO] = -dt
    F[SLIP, SLIP] = np.exp(-abs(rolled_mm) / wheel.slip_length_mm)
    B[[S, U], 0] = dt**2, dt
    B[ROLL, 1] = dt
    return F, B


def process_noise(
    n: int,
    dt: float,
    unfelt_mm_s2: float,
    unturned_rad: float,
    kept_slip: float,
    inertial: InertialSettings,
    wheel: WheelSettings,
) -> Float[np.ndarray, "n n"]:
    """Q of one frame: `unfelt_mm_s2` of acceleration and `unturned_rad` of roll that the IMU did not tell."""
    Q = np.zeros((n, n))
    speed = np.hypot(unfelt_mm_s2 * dt, 1e3 * inertial.accelerometer_noise_density * np.sqrt(dt))
    Q[np.ix_([S, U], [S, U])] = speed**2 * np.array([[dt**2, dt], [dt, 1.0]])
    Q[FORCE, FORCE] = (1e3 * inertial.accelerometer_random_walk) ** 2 * dt
    Q[ROLL, ROLL] = inertial.gyroscope_noise_density**2 * dt + unturned_rad**2
    Q[GYRO, GYRO] = inertial.gyroscope_random_walk**2 * dt
    Q[BIAS_X, BIAS_X] = Q[BIAS_Y, BIAS_Y] = inertial.accelerometer_random_walk**2 * dt
    Q[SLIP, SLIP] = (wheel.slip_std_pct / 100) ** 2 * (1 - kept_slip**2)
    return Q


def wheel_rows(
    n: int, speeds_mm_s: Float[np.ndarray, "wheels"], dt: float, wheel: WheelSettings
) -> tuple[Float[np.ndarray, "wheels n"], Float[np.ndarray, "wheels"]]:
    """H and variances of the wheels' rolling speeds; the middle one tells how much a scale makes of them."""
    count, middle = speeds_mm_s.size, float(np.median(speeds_mm_s))
    H = np.zeros((count, n))
    H[:, U] = 1.0
    H[np.arange(count), SCALE + np.arange(count)] = -middle
    rolled_m = np.abs(speeds_mm_s) * dt / 1e3
    return H, (wheel.noise_mm**2 + wheel.noise_mm_per_sqrt_m**2 * rolled_m) / dt**2
