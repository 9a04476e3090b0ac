"""What the wheel encoders say: the way that each wheel rolled (Eq. 25), and its error by drives of known length."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from sensor_model.rig import Rig

LEAST_SPREAD_PCT = 0.02


def wheel_distances_mm(counts: Float[np.ndarray, "*n wheels"], rig: Rig) -> Float[np.ndarray, "*n wheels"]:
    """Distance rolled by each wheel since the start of the log."""
    turns = counts / rig.wheels.counts_per_turn
    return turns * np.pi * np.array(rig.wheels.diameters_mm)  # Eq. 25


def count_mm(rig: Rig) -> float:
    """Way of one count of a middling wheel."""
    return float(np.pi * np.mean(rig.wheels.diameters_mm) / rig.wheels.counts_per_turn)


class WheelCalibration(NamedTuple):
    """What `WheelSettings` of the fused estimator want, by their names there."""

    scale_pct: tuple[float, ...]
    common_scale_std_pct: float


def calibrate_wheels(
    rolled_mm: Float[np.ndarray, "drives wheels"], length_mm: Float[np.ndarray, "drives"]
) -> WheelCalibration:
    """How much further each wheel goes than it rolls, slip and all, by drives of known length.

    What differs from drive to drive, slip above all, is what the next drive may be off by.

    Raises:
        ValueError: for fewer than two drives, from which nothing can be learnt of their spread.
    """
    if length_mm.size < 2:
        raise ValueError(f"{length_mm.size} calibration drive; at least 2 are needed to know their spread")
    further_pct = 100 * (length_mm[:, None] / rolled_mm - 1)
    # each drive by its middle wheel, so that a stall on the way does not pass for scale
    own = np.median(further_pct - np.median(further_pct, axis=1, keepdims=True), axis=0)
    drive = np.median(further_pct - own, axis=1)
    spread = float(np.std(drive, ddof=1) * np.sqrt(1 + 1 / drive.size))
    return WheelCalibration(tuple((drive.mean() + own).tolist()), max(spread, LEAST_SPREAD_PCT))
