"""Slip as a linear function of the rolling speed (Eq. 27), fitted on drives of known length."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.localisation.paper import Odometry, RollSettings, median_step_mm, moved
from sensor_model.recording import Frame
from sensor_model.rig import Rig

AT_REST_MM = 0.02  # what rolls less in a frame stands: there the line's intercept says nothing


class SlipSettings(RollSettings):
    """The line V_s = slope V_r + intercept of Eq. 27 and the spread U about it, per frame; as it is, no slip."""

    kind: Literal["slip"] = "slip"
    slope: Annotated[float, Field(gt=0.5, lt=1.5)] = 1.0
    intercept_mm_s: Annotated[float, Field(gt=-50, lt=50)] = 0.0
    slope_std: Annotated[float, Field(ge=0)] = 0.005
    spread_mm_s: Annotated[float, Field(gt=0)] = 0.5


class Line(NamedTuple):
    """Eq. 27 as fitted: what `SlipSettings` wants."""

    slope: float
    intercept_mm_s: float
    slope_std: float
    spread_mm_s: float


def fit_line(rolled_mm_s: Float[np.ndarray, "n"], travelled_mm_s: Float[np.ndarray, "n"]) -> Line:
    """The line through speeds over ground against rolling speeds of calibration drives, by least squares.

    With rolling speeds that hardly differ an intercept cannot be told from a slope: the line then goes through zero.

    Raises:
        ValueError: for fewer than ten moving frames.
    """
    moving = np.abs(rolled_mm_s) > 1.0
    if np.count_nonzero(moving) < 10:
        raise ValueError(f"{np.count_nonzero(moving)} frames in motion; at least 10 are needed")
    # a drive back is the same line mirrored
    rolled, travelled = np.abs(rolled_mm_s[moving]), (np.sign(rolled_mm_s) * travelled_mm_s)[moving]
    both = np.ptp(rolled) > 0.2 * rolled.mean()
    A = np.column_stack([rolled, np.ones(rolled.size)]) if both else rolled[:, None]
    line = np.linalg.lstsq(A, travelled, rcond=None)[0]
    spread = float(np.std(travelled - A @ line, ddof=line.size))
    slope_std = spread * np.sqrt(np.linalg.inv(A.T @ A)[0, 0])
    return Line(float(line[0]), float(line[1]) if both else 0.0, float(slope_std), max(spread, 1e-6))


def advance(odometry: Odometry, frame: Frame, rig: Rig, settings: SlipSettings) -> Odometry:
    """One frame on: the median rolling speed, and from it the speed over ground."""
    rolled, dt = median_step_mm(odometry, frame, rig), (frame.stamp_ns - odometry.stamp_ns) / 1e9
    step, spread = rolled, 0.0
    if abs(rolled) > AT_REST_MM:
        step = settings.slope * rolled + np.sign(rolled) * settings.intercept_mm_s * dt  # Eq. 27, T_ods = V_s dt
        spread = settings.spread_mm_s * dt
    before = odometry.travel_std_mm**2 - (settings.slope_std * odometry.travel_mm) ** 2
    travel = odometry.travel_mm + float(step)
    variance = before + spread**2 + (settings.slope_std * travel) ** 2
    return replace(moved(odometry, frame, rig, settings, travel, float(np.sqrt(variance))))
