"""A prescribed path, as on the gantry of section 4.1: straight moves, and turns on the spot in between."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from sensor_model.settings import Settings
from twin.pipe import Pipe
from twin.robot import Robot
from twin.truth import Truth, from_path


class Stage(Settings):
    """One part of the path: go to a place, then turn to a roll there."""

    to_mm: float
    roll_to_deg: float | None = None


class GantryDrive(Settings):
    """The camera on a prescribed path: exact offset and tilt, moves at constant speed and turns between them.

    The tilt is fixed to the sensor's carriage: it turns about the pipe's axis together with the roll.
    """

    kind: Literal["gantry"] = "gantry"
    start_mm: float = 0.0
    stages: tuple[Stage, ...] = Field(min_length=1, max_length=1000)
    speed_mm_s: Annotated[float, Field(gt=0, le=1000)] = 50.0
    turn_speed_deg_s: Annotated[float, Field(gt=0, le=360)] = 25.0
    offset_mm: tuple[float, float] = (0.0, 0.0)
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    ramp_s: Annotated[float, Field(gt=0, le=2)] = 0.2
    rate_hz: Annotated[float, Field(ge=50, le=2000)] = 500.0

    @property
    def end_mm(self) -> float:
        """Where the camera ends."""
        return self.stages[-1].to_mm

    @property
    def span_mm(self) -> tuple[float, float]:
        """Lowest and highest place of the camera."""
        places = [self.start_mm, *(stage.to_mm for stage in self.stages)]
        return min(places), max(places)


def drive(pipe: Pipe, robot: Robot, settings: GantryDrive, rng: np.random.Generator) -> Truth:  # noqa: ARG001
    """Follow the path; a wheel of the robot's size that never slips stands for the gantry's scale."""
    knots = [(0.0, settings.start_mm, 0.0)]
    for stage in settings.stages:
        at_s, from_mm, from_deg = knots[-1]
        at_s += abs(stage.to_mm - from_mm) / settings.speed_mm_s
        knots.append((at_s, stage.to_mm, from_deg))
        if stage.roll_to_deg is not None:
            at_s += abs(stage.roll_to_deg - from_deg) / settings.turn_speed_deg_s
            knots.append((at_s, stage.to_mm, stage.roll_to_deg))
    knot_time, knot_z, knot_roll = np.array(knots).T
    keep = np.concatenate([[True], np.diff(knot_time) > 0])
    times = np.arange(0, int(np.floor((knot_time[-1] + settings.ramp_s) * settings.rate_hz)) + 1) / settings.rate_hz
    z = _rounded(times, knot_time[keep], knot_z[keep], settings.ramp_s)
    roll = np.radians(_rounded(times, knot_time[keep], knot_roll[keep], settings.ramp_s))

    tilt = Rotation.from_euler("xy", settings.tilt_deg, degrees=True)
    turned = (Rotation.from_rotvec(roll[:, None] * [0.0, 0.0, 1.0]) * tilt).as_quat()[:, [3, 0, 1, 2]]
    offset = np.broadcast_to(settings.offset_mm, (times.size, 2))
    wheel = (z - z[0])[:, None] / robot.wheel_radius_mm * np.ones(robot.leg_count)
    return from_path(pipe, times, np.column_stack([offset, z]), turned, wheel)


def _rounded(times: np.ndarray, knot_time: np.ndarray, knot_value: np.ndarray, ramp_s: float) -> np.ndarray:
    """Piecewise linear motion averaged over `ramp_s`, so that speeds change smoothly; it ends one ramp late."""
    fine = np.concatenate([[knot_time[0] - ramp_s], knot_time, [knot_time[-1] + ramp_s]])
    value = np.concatenate([knot_value[:1], knot_value, knot_value[-1:]])
    area = np.concatenate([[0.0], np.cumsum(np.diff(fine) * 0.5 * (value[1:] + value[:-1]))])

    def integral(t: np.ndarray) -> np.ndarray:
        i = np.clip(np.searchsorted(fine, t, side="right") - 1, 0, fine.size - 2)
        dt = t - fine[i]
        slope = (value[i + 1] - value[i]) / (fine[i + 1] - fine[i])
        return area[i] + dt * (value[i] + 0.5 * slope * dt)

    return (integral(times) - integral(times - ramp_s)) / ramp_s
