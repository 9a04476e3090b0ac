"""The wheel encoders: whole counts of wheels whose diameter is not quite what the rig believes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Int
from pydantic import Field
from scipy.interpolate import CubicSpline

from sensor_model.rig import Wheels
from sensor_model.settings import Settings
from twin.truth import Truth


class EncoderNoise(Settings):
    """Errors of the encoders: how much larger each wheel really rolls than its stated diameter, and edges they miss.

    `wheel_diameter_error_pct` changes what is counted alone, for a path that has no robot; wheels that really are of
    another size, and so slip against each other, are the robot's setting of that name.
    """

    update_rate: Annotated[float, Field(gt=1, le=1000)] = 100.0
    wheel_diameter_error_pct: tuple[float, ...] = (0.0, 0.0, 0.0)
    missed_share: Annotated[float, Field(ge=0, le=1)] = 0.0


@dataclass(frozen=True)
class EncoderLog:
    """What the encoders wrote: counts since the start, one column a wheel."""

    stamp_ns: Int[np.ndarray, "n"]
    counts: Int[np.ndarray, "n wheels"]


def measure_encoders(truth: Truth, wheels: Wheels, noise: EncoderNoise) -> EncoderLog:
    """The encoders' log over the whole drive.

    Raises:
        ValueError: when the settings speak of another number of wheels than the robot has.
    """
    n_wheels = truth.wheel_angle_rad.shape[1]
    if len(noise.wheel_diameter_error_pct) != n_wheels or len(wheels.diameters_mm) != n_wheels:
        raise ValueError(
            f"the robot has {n_wheels} encoder wheels, the rig {len(wheels.diameters_mm)}, "
            f"wheel_diameter_error_pct {len(noise.wheel_diameter_error_pct)}"
        )
    time_s = truth.sample_times_s(noise.update_rate)
    angle = CubicSpline(truth.time_s, truth.wheel_angle_rad)(time_s)
    turns = angle / (2 * np.pi) / (1 + np.array(noise.wheel_diameter_error_pct) / 100)
    counts = np.floor(turns * wheels.counts_per_turn + 0.5).astype(np.int64)
    return EncoderLog(np.round(time_s * 1e9).astype(np.int64), counts)


def with_missed_counts(
    counts: Int[np.ndarray, "n wheels"], missed_share: float, rng: np.random.Generator
) -> Int[np.ndarray, "n wheels"]:
    """The counts of encoders that miss this share of their edges, each by chance, whichever way they turn."""
    steps = np.diff(counts, axis=0, prepend=counts[:1])
    return counts[:1] + np.cumsum(steps - np.sign(steps) * rng.binomial(np.abs(steps), missed_share), axis=0)
