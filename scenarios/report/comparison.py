"""Each defect measured beside true, and the misses and false calls between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from algorithms.types import Defect, Trajectory
from scenarios.matching import is_obstacle, match
from scenarios.run import Run
from sensor_model.geometry import clock_position, wrap_rad
from twin.features.base import Feature, TrueSize

LOOK_AHEAD_RADII = 1.5  # the rings land about so many bore radii ahead of the camera


class Quantity(NamedTuple):
    """One measure of one defect; NaN where there is nothing to state."""

    name: str
    measured: float
    std: float
    true: float

    @property
    def error(self) -> float:
        """Measured less true."""
        return self.measured - self.true


@dataclass(frozen=True)
class Row:
    """One defect of the report; `number` labels it in table, map and profiles alike."""

    number: int
    kind: Literal["found", "missed", "false call", "part of the pipe", "measured"]
    feature: Feature | None
    defect: Defect | None

    @property
    def distance_mm(self) -> float:
        """Where its middle is, by the truth if there is one."""
        return _either(self.feature, self.defect).distance_mm

    @property
    def theta_rad(self) -> float:
        """Its middle around the wall, by the truth if there is one."""
        if self.feature is not None:
            return float(np.radians(self.feature.clock_deg))
        assert self.defect is not None  # noqa: S101  a row has at least one of the two
        return self.defect.theta_rad

    @property
    def clock(self) -> str:
        """Its clock position."""
        return clock_position(self.theta_rad)


def _either(feature: Feature | None, defect: Defect | None) -> Feature | Defect:
    either = feature if feature is not None else defect
    assert either is not None  # noqa: S101  a row has at least one of the two
    return either


def rows(run: Run) -> list[Row]:
    """Found, missed and falsely called defects in order of distance, numbered from 1."""
    features, defects = run.truth.pipe.features, run.found.defects
    pairs = match(run.truth.pipe, defects)
    paired_features, paired_defects = {i for i, _ in pairs}, {j for _, j in pairs}
    every = [Row(0, "found", features[i], defects[j]) for i, j in pairs]
    every += [Row(0, "missed", feature, None) for i, feature in enumerate(features) if i not in paired_features]
    unpaired = [defect for j, defect in enumerate(defects) if j not in paired_defects]
    every += [Row(0, _unpaired(run, defect), None, defect) for defect in unpaired]
    every.sort(key=lambda row: row.distance_mm)
    return [Row(number, row.kind, row.feature, row.defect) for number, row in enumerate(every, start=1)]


def _unpaired(run: Run, defect: Defect) -> Literal["false call", "part of the pipe"]:
    return "part of the pipe" if is_obstacle(run.truth.pipe, defect) else "false call"


def true_size(row: Row, run: Run) -> TrueSize | None:
    """The true size, where there is a true defect."""
    return None if row.feature is None else row.feature.size(run.truth.pipe.bore_radius_mm)


def quantities(row: Row, run: Run) -> list[Quantity]:
    """Distance, clock position (deg), length, width, depth and wall loss (%), measured and true.

    The middle of a defect is as uncertain as half its extent, and as the pose from which it was seen.
    """
    pipe, nothing = run.truth.pipe, float("nan")
    true, clock_deg = [nothing] * 5, nothing
    if row.feature is not None:
        length, width, depth = row.feature.size(pipe.bore_radius_mm)
        true, clock_deg = (
            [row.feature.distance_mm, length, width, depth, 0.0 if row.feature.inward else depth / pipe.wall_mm * 100],
            row.feature.clock_deg,
        )
    measured, std = [nothing] * 5, [nothing] * 5
    turn, turn_std = nothing, nothing
    if row.defect is not None:
        d = row.defect
        z_std, roll_std = pose_std(run.found.trajectory, d.distance_mm - LOOK_AHEAD_RADII * pipe.bore_radius_mm)
        measured = [d.distance_mm, d.length_mm, d.width_mm, d.depth_mm, d.wall_loss_pct]
        along_std = float(np.hypot(d.length_std_mm / 2, z_std))
        std = [along_std, d.length_std_mm, d.width_std_mm, d.depth_std_mm, d.wall_loss_std_pct]
        turn_std = float(np.degrees(np.hypot(d.width_std_mm / 2 / pipe.bore_radius_mm, roll_std)))
        turn = float(np.degrees(d.theta_rad))
        if row.feature is not None:  # so that 359 and 1 degrees differ by 2
            turn = clock_deg + float(np.degrees(wrap_rad(d.theta_rad - np.radians(clock_deg))))
    names = ("distance", "length", "width", "depth", "wall loss")
    every = [Quantity(*entry) for entry in zip(names, measured, std, true, strict=True)]
    return [every[0], Quantity("clock", turn, turn_std, clock_deg), *every[1:]]


def pose_std(path: Trajectory, z_mm: float) -> tuple[float, float]:
    """Stated standard deviations of distance (mm) and roll (rad) at the registered frame nearest to a place."""
    ok = np.flatnonzero(path.registered)
    if ok.size == 0:
        return float("nan"), float("nan")
    nearest = ok[np.argmin(np.abs(path.T_pipe_camera[ok, 2, 3] - z_mm))]
    variance = np.diag(path.covariance[nearest])
    return float(np.sqrt(variance[2])), float(np.sqrt(variance[5]))
