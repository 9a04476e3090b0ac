"""A path out of a log: where the camera was at given times, how far each wheel slipped, and how all of it shook."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from sensor_model.settings import Settings
from twin.pipe import Pipe
from twin.robot import Robot
from twin.truth import Truth, from_path

NotNegative = Annotated[float, Field(ge=0)]
Row = tuple[float, float, float, float, float, float, float]
Axes = tuple[NotNegative, NotNegative, NotNegative]
LONGEST_S = 3600.0
STILL_MM_S, STILL_DEG_S = 2.0, 0.5  # what moves less does not shake
FADE_S = 0.2


class VibrationBand(Settings):
    """Shaking between two frequencies, RMS by axis (x, y, z) in the camera's frame: acceleration and rate of turn."""

    from_hz: Annotated[float, Field(ge=0.5, le=400)]
    to_hz: Annotated[float, Field(gt=0.5, le=400)]
    acceleration_m_s2: Axes = (0.0, 0.0, 0.0)
    rate_deg_s: Axes = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _is_a_band(self) -> VibrationBand:
        if self.to_hz <= self.from_hz:
            raise ValueError(f"to_hz must lie above from_hz, {self.from_hz:g}")
        return self


class RecordedDrive(Settings):
    """The camera on the path of a log, smooth between its rows; it shakes while it moves, as its bands say.

    A row is time (s, from 0), distance z (mm), offset x and y (mm), roll, tilt about x and about y (degrees; the tilt
    turns along with the roll). `slip_mm` has a row to each of these rows, with how far the rim of every encoder wheel
    has gone more than the robot since the start; left out, no wheel slips.
    """

    kind: Literal["recorded"] = "recorded"
    rows: Annotated[tuple[Row, ...], Field(min_length=4, max_length=20_000)]
    slip_mm: Annotated[tuple[tuple[float, ...], ...], Field(max_length=20_000)] = ()
    vibration: Annotated[tuple[VibrationBand, ...], Field(max_length=32)] = ()
    rate_hz: Annotated[float, Field(ge=500, le=2000)] = 1000.0

    @model_validator(mode="after")
    def _rows_fit_together(self) -> RecordedDrive:
        times = [row[0] for row in self.rows]
        if times[0] != 0 or any(b <= a for a, b in pairwise(times)) or times[-1] > LONGEST_S:
            raise ValueError(f"the times of rows must begin with 0, rise, and end within {LONGEST_S:g} s")
        if self.slip_mm and (len(self.slip_mm) != len(self.rows) or len({len(row) for row in self.slip_mm}) > 1):
            raise ValueError(f"slip_mm must have {len(self.rows)} rows, as rows has, each with a value for every wheel")
        if any(band.to_hz > self.rate_hz / 2 for band in self.vibration):
            raise ValueError(f"a band must end by half the rate, {self.rate_hz / 2:g} Hz")
        return self

    @property
    def start_mm(self) -> float:
        """Where the camera begins."""
        return self.rows[0][1]

    @property
    def end_mm(self) -> float:
        """Where the camera ends."""
        return self.rows[-1][1]

    @property
    def speed_mm_s(self) -> float:
        """The fastest that it goes between two rows, to a tenth."""
        return round(max(abs((b[1] - a[1]) / (b[0] - a[0])) for a, b in pairwise(self.rows)), 1)

    @property
    def span_mm(self) -> tuple[float, float]:
        """Lowest and highest place of the camera."""
        places = [row[1] for row in self.rows]
        return min(places), max(places)


def drive(pipe: Pipe, robot: Robot, settings: RecordedDrive, rng: np.random.Generator) -> Truth:
    """Follow the rows; what shakes comes from `rng`, which is left alone where nothing does.

    Raises:
        ValueError: when `slip_mm` speaks of another number of wheels than the robot has.
    """
    rows = np.array(settings.rows)
    times = np.arange(int(np.floor(rows[-1, 0] * settings.rate_hz + 1e-9)) + 1) / settings.rate_hz
    path = CubicSpline(rows[:, 0], rows[:, 1:])(times)
    z, offset, turns_deg = path[:, 0], path[:, 1:3], path[:, 3:6]
    turned = Rotation.from_euler("z", turns_deg[:, :1], degrees=True) * Rotation.from_euler(
        "xy", turns_deg[:, 1:], degrees=True
    )
    position = np.column_stack([offset, z])
    if settings.vibration:
        moving = _moving(path, settings.rate_hz)
        shift_mm, turn_rad = _shaken(settings, times.size, rng)
        position = position + turned.apply(moving[:, None] * shift_mm)
        turned = turned * Rotation.from_rotvec(moving[:, None] * turn_rad)
    slip_mm = _slip_mm(rows[:, 0], settings, robot, times)
    wheel = ((z - z[0])[:, None] + slip_mm) / robot.wheel_radius_mm
    truth = from_path(pipe, times, position, turned.as_quat()[:, [3, 0, 1, 2]], wheel)
    return replace(truth, slip_mm_s=np.gradient(slip_mm, times, axis=0)) if settings.slip_mm else truth


def _slip_mm(
    row_s: Float[np.ndarray, "rows"], settings: RecordedDrive, robot: Robot, times: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n wheels"]:
    """How far each wheel's rim has gone more than the robot; 0 at the start."""
    if not settings.slip_mm:
        return np.zeros((times.size, robot.leg_count))
    slip = np.array(settings.slip_mm)
    if slip.shape[1] != robot.leg_count:
        raise ValueError(
            f"slip_mm speaks of {slip.shape[1]} wheels; the robot has {robot.leg_count} legs with one each"
        )
    # a curve through steps would swing
    return PchipInterpolator(row_s, slip - slip[0])(times)


def _moving(path: Float[np.ndarray, "n 6"], rate_hz: float) -> Float[np.ndarray, "n"]:
    """1 while the robot travels or rolls and 0 at rest, with soft edges; 0 at the first sample."""
    speed = np.abs(np.gradient(path, 1 / rate_hz, axis=0))
    moves = ((speed[:, 0] > STILL_MM_S) | (speed[:, 3] > STILL_DEG_S)).astype(float)
    fade = np.hanning(2 * round(FADE_S * rate_hz) + 1)
    # later than the motion by the fade, so that it begins with nothing
    return np.convolve(moves, fade / fade.sum())[: moves.size]


def _shaken(
    settings: RecordedDrive, n: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Shift (mm) and turn (rad) of the camera: noise within each band, integrated twice and once."""
    frequency = np.fft.rfftfreq(n, 1 / settings.rate_hz)
    shift, turn = np.zeros((n, 3)), np.zeros((n, 3))
    for band in settings.vibration:
        inside = (frequency >= band.from_hz) & (frequency < band.to_hz)
        # as many draws as a band of white noise has, scaled to the band's own power
        gain = inside * np.sqrt(frequency.size / max(float(inside.sum()), 1.0))
        omega = 2 * np.pi * np.maximum(frequency, 0.5)
        for axis in range(3):
            felt, turned = (np.fft.rfft(rng.standard_normal(n)) * gain for _ in range(2))
            shift[:, axis] += 1e3 * band.acceleration_m_s2[axis] * np.fft.irfft(-felt / omega**2, n)
            turn[:, axis] += np.radians(band.rate_deg_s[axis]) * np.fft.irfft(turned / (1j * omega), n)
    return shift, turn
