"""The slide's jaggedness, learned from pictures of clean pipe: what each half angle has beyond its mean, by azimuth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import WRONG_MM, PipeView, fit_cylinder, radial_mm
from algorithms.robust import spread
from algorithms.triangulate import triangulate
from sensor_model.geometry import apply, projector_azimuth_rad
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

PROBE_RAD = 1e-3
OUTLIER_MM = 4.0
LEAST_GAIN = 0.98  # a correction is kept that takes the left-out residual below this share
JAG_CELLS = 360  # of the correction's table around the slide
LEAST_JAG_COUNT, JAG_PRIOR_COUNT = 2, 0.5


@dataclass(frozen=True)
class SlideCalibration:
    """The correction learned from all pictures, and what corrections learned from the others do to each left out."""

    table_rad: Float[np.ndarray, "slits cells"]
    plain_mm: Float[np.ndarray, "pictures"]
    corrected_mm: Float[np.ndarray, "pictures"]

    @property
    def helps(self) -> bool:
        """Whether it is worth keeping."""
        return bool(np.mean(self.corrected_mm) < LEAST_GAIN * np.mean(self.plain_mm))


def learn_slide(views: Sequence[PipeView], rig: Rig) -> SlideCalibration:
    """Learn the correction; judge it on each picture by what the others taught.

    Raises:
        CannotCalibrate: for fewer than two pictures with a cylinder.
    """
    if len(views) < 2:
        raise CannotCalibrate(f"{len(views)} pictures with a pipe in them; at least 2 are needed")
    excess = [_excess_rad(view, rig) for view in views]
    plain, corrected = [], []
    for i, view in enumerate(views):
        others = [k for k in range(len(views)) if k != i]
        taught = with_jag(rig, _table(views, excess, others, rig))
        plain.append(spread(view.residual_mm[view.right]))
        corrected.append(corrected_residual_mm(view, taught))
    return SlideCalibration(_table(views, excess, range(len(views)), rig), np.array(plain), np.array(corrected))


def with_jag(rig: Rig, table_rad: Float[np.ndarray, "slits cells"]) -> Rig:
    """The rig with this correction; NaN: not known."""
    degrees = [[None if np.isnan(jag) else round(jag, 5) for jag in row] for row in np.degrees(table_rad).tolist()]
    slits = tuple(
        slit.model_copy(update={"jag_deg": tuple(row)}) for slit, row in zip(rig.projector.slits, degrees, strict=True)
    )
    return rig.model_copy(update={"projector": rig.projector.model_copy(update={"slits": slits})})


def excess_table_rad(
    excess_rad: Float[np.ndarray, "n"], slit: Int[np.ndarray, "n"], azimuth_rad: Float[np.ndarray, "n"], slits: int
) -> Float[np.ndarray, "slits cells"]:
    """Mean excess by slit and azimuth, drawn towards nothing where few points speak."""
    cell = (azimuth_rad / (2 * np.pi) * JAG_CELLS).astype(np.int64) % JAG_CELLS
    place = slit * JAG_CELLS + cell
    count = np.bincount(place, minlength=slits * JAG_CELLS)
    total = np.bincount(place, weights=excess_rad, minlength=slits * JAG_CELLS)
    mean = np.where(count >= LEAST_JAG_COUNT, total / (count + JAG_PRIOR_COUNT), 0.0)
    return mean.reshape(slits, JAG_CELLS)


def corrected_residual_mm(view: PipeView, rig: Rig) -> float:
    """Robust residual of a picture's points, triangulated again with a rig, about the cylinder refitted to them."""
    points = triangulate(pixels_of(view), rig)
    alignment = fit_cylinder(points)
    residual = radial_mm(points.xyz_mm, alignment if alignment.converged else view.alignment)
    return spread(residual[np.abs(residual) < WRONG_MM])


def pixels_of(view: PipeView) -> SlitPixels:
    """A picture's slit pixels."""
    return SlitPixels(view.points.pixel, view.points.ring, np.full(view.points.ring.size, 0.2))


def _excess_rad(view: PipeView, rig: Rig) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """What each point's half angle has to be beyond its slit's for the point to lie on the cylinder; which to use."""
    more, less = (_radial_at(rig, view, probe) for probe in (PROBE_RAD, -PROBE_RAD))
    per_rad = (more - less) / (2 * PROBE_RAD)
    good = np.isfinite(per_rad) & (np.abs(per_rad) > 1.0) & (np.abs(view.residual_mm) < OUTLIER_MM)
    return np.where(good, -view.residual_mm / np.where(good, per_rad, 1.0), 0.0), good


def _radial_at(rig: Rig, view: PipeView, more_rad: float) -> Float[np.ndarray, "n"]:
    """Distance from the pipe's axis of the points, were each slit's half angle larger by so much."""
    moved = triangulate(pixels_of(view), with_jag(rig, np.full((len(rig.projector.slits), 1), more_rad)))
    x, y, _ = apply(view.alignment.T_pipe_camera, moved.xyz_mm).T
    return np.hypot(x, y)


def _table(
    views: Sequence[PipeView], excess: Sequence[tuple[np.ndarray, np.ndarray]], chosen: Sequence[int], rig: Rig
) -> Float[np.ndarray, "slits cells"]:
    T = rig.projector.T_camera_projector
    amount = np.concatenate([excess[i][0][excess[i][1]] for i in chosen])
    slit = np.concatenate([views[i].points.ring[excess[i][1]] for i in chosen])
    azimuth = np.concatenate([projector_azimuth_rad(views[i].points.xyz_mm[excess[i][1]], T) for i in chosen])
    return excess_table_rad(amount, slit, azimuth, len(rig.projector.slits))
