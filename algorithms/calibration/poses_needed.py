"""How good a projector's calibration is by the number of board poses: many random subsets of a session's, refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.calibration.cone_fit import ConeFit, Sight
from algorithms.calibration.cones import with_cones
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import on_cylinder
from algorithms.calibration.projector import fit_boards
from algorithms.triangulate import triangulate
from algorithms.types import Alignment
from sensor_model.geometry import fisheye_project
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

COUNTS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
SUBSETS = 10  # of each count
POINTS = 400  # of a board are enough: neighbours err alike
GAUGE_RADIUS_MM = 76.2
GAUGE_AZIMUTHS = 180
SIGMA_PX = 0.2
NINE_OF_TEN = 0.9


class Off(NamedTuple):
    """How far one projector is from another: worst half angle, axis, distance of apex and camera, radius it gives."""

    half_angle_deg: float
    axis_deg: float
    baseline_mm: float
    radius_mm: float


LIMITS = Off(0.02, 0.02, 0.05, 0.1)


@dataclass(frozen=True)
class PoseCurve:
    """Errors (or spreads) of subsets by how many poses they have: the middle one, and what nine of ten stay below.

    `needed` is the least number of poses from which on nine of ten stay below the limit; None where none does.
    """

    poses: tuple[int, ...]
    refused: tuple[int, ...]
    middle: tuple[Off, ...]
    nine_of_ten: tuple[Off, ...]

    @property
    def needed(self) -> dict[str, int | None]:
        """By figure."""
        out: dict[str, int | None] = {}
        for name in Off._fields:
            out[name] = None
            for poses, worst in zip(self.poses[::-1], self.nine_of_ten[::-1], strict=True):
                if not getattr(worst, name) <= getattr(LIMITS, name):
                    break
                out[name] = poses
        return out


def off_from(found: Rig, true: Rig) -> Off:
    """How far a rig's projector, and with its camera the radius of a pipe of 6 inches, are from another's."""
    one, other = found.projector, true.projector
    axes = one.T_camera_projector[:3, 2], other.T_camera_projector[:3, 2]
    return Off(
        float(np.degrees(np.abs(one.slit_half_angles_rad - other.slit_half_angles_rad).max())),
        float(np.degrees(np.linalg.norm(np.cross(*axes)))),
        abs(float(np.linalg.norm(one.apex_mm) - np.linalg.norm(other.apex_mm))),
        abs(radius_bias_mm(found, true)),
    )


def radius_bias_mm(found: Rig, true: Rig) -> float:
    """What a rig makes of a pipe's radius that another rig sees from its middle, without noise.

    Over whole rings a pipe found a little aside or aslant has the same mean radius.
    """
    azimuth = np.arange(GAUGE_AZIMUTHS) * 2 * np.pi / GAUGE_AZIMUTHS
    pipe, corner = Alignment(np.eye(4), np.zeros((6, 6)), radius_mm=GAUGE_RADIUS_MM), true.camera
    radii = []
    for slit, half in enumerate(true.projector.slit_half_angles_rad):
        pixel = fisheye_project(on_cylinder(true, pipe, azimuth, float(half)), true.camera.intrinsics)
        if ((pixel > 0) & (pixel < [corner.width_px - 1, corner.height_px - 1])).all():
            seen = SlitPixels(pixel, np.full(azimuth.size, slit), np.full(azimuth.size, SIGMA_PX))
            radii.append(np.mean(np.hypot(*triangulate(seen, found).xyz_mm[:, :2].T)))
    return float(np.mean(radii)) - GAUGE_RADIUS_MM


def pose_curve(
    sights: Sequence[Sight], fit: ConeFit, rig: Rig, true: Rig | None, rng: np.random.Generator
) -> PoseCurve:
    """Refit random subsets of the boards, and compare with the true rig, or else with the fit of all boards.

    Without the truth it is a delete-d jackknife: subsets of n of N boards share boards with the whole, so that their
    spread about it is too small by sqrt(1 - n / N); that is put right, and the last row is what follows for all.
    """
    thinned = [_thinned(one) for one in sights]
    whole, boards = _rig(rig, fit), len(sights)
    counts = [count for count in COUNTS if count < boards]
    refused, middle, worst = [], [], []
    for count in counts:
        offs = []
        chosen = _subsets(boards, count, rng)
        for subset in chosen:
            try:
                part = fit_boards([thinned[i] for i in subset], len(rig.projector.slits), fit.cones)
                offs.append(off_from(_rig(rig, part), true or whole))
            except CannotCalibrate:
                continue
        scale = 1.0 if true else float(np.sqrt(boards / (boards - count)))
        refused.append(len(chosen) - len(offs))
        middle.append(_quantile(offs, 0.5, scale))
        worst.append(_quantile(offs, NINE_OF_TEN, scale))
    if true:
        last = off_from(whole, true)
        middle, worst = [*middle, last], [*worst, last]
    elif counts:
        less = float(np.sqrt(counts[-1] / boards))
        middle, worst = ([*rows, Off(*(less * value for value in rows[-1]))] for rows in (middle, worst))
    return PoseCurve((*counts, boards) if middle else (), (*refused, 0), tuple(middle), tuple(worst))


def _thinned(one: Sight) -> Sight:
    every = max(one.slit.size // POINTS, 1)
    return one._replace(ray=one.ray[::every], slit=one.slit[::every], sigma_rad=one.sigma_rad[::every])


def _rig(rig: Rig, fit: ConeFit) -> Rig:
    """The rig with a subset's cones.

    Raises:
        CannotCalibrate: where the subset does not show every slit.
    """
    if not np.isfinite(fit.cones.half_angle_rad).all():
        raise CannotCalibrate("a slit is not seen")
    return rig.model_copy(update={"projector": with_cones(rig.projector, fit.cones)})


def _subsets(boards: int, count: int, rng: np.random.Generator) -> list[tuple[int, ...]]:
    """All subsets where there are few, else as many at random."""
    if comb(boards, count) <= SUBSETS:
        return list(combinations(range(boards), count))
    return [tuple(sorted(rng.choice(boards, count, replace=False).tolist())) for _ in range(SUBSETS)]


def _quantile(offs: Sequence[Off], share: float, scale: float) -> Off:
    """Figure by figure; NaN of nothing."""
    table: Float[np.ndarray, "subsets 4"] = np.array(offs).reshape(-1, len(Off._fields))
    return Off(*(scale * np.quantile(table, share, axis=0)).tolist()) if offs else Off(*[float("nan")] * 4)
