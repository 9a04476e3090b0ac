"""The projector from a pipe's own wall: cones that put all slits of all frames on one bore, from what boards know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from algorithms.calibration.cone_fit import ConeFit, Sight, fit_cones
from algorithms.calibration.cones import cones_of, with_cones
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import WRONG_MM, axis_of, fit_cylinder, radial_mm
from algorithms.calibration.slide import LEAST_GAIN, with_jag
from algorithms.calibration.surfaces import Bore
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, RingPoints
from sensor_model.geometry import fisheye_rays, jag_rad, projector_azimuth_rad
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

LEAST_FRAMES = 8  # of a scan
MOST_POINTS = 1500  # of a frame
LEAST_CELL = 20  # points of a place on the slide, over all frames
PATTERN_CELLS = 36
OVAL_STD_MM, ROUND_STD_MM = 0.5, 1e-3  # a few pictures cannot tell an oval from the projector's tilt
OPEN_RATIO = 0.7  # a direction that stays at this share of the boards' standard deviation has not been seen
# how far a seat may be from the calibrated one after the projector was mounted anew; the baseline is the boards'
SEAT_STD = (1.0, 1.0, 1e-3, 0.01, 0.01)  # apex, mm, and two tilts, rad
SEAT_ANGLE_STD_RAD = np.radians(0.1)


@dataclass(frozen=True)
class Direction:
    """Unknowns that move together by so much (one standard deviation of the boards), and what share of it is left."""

    by: Float[np.ndarray, "unknowns"]
    left: float


@dataclass(frozen=True)
class PipeCalibration:
    """The rig that all frames together give, what it is worth, and what either half's rig does to the other half.

    `plain_mm` and `adjusted_mm` are RMS patterns: what places on the slide have in common, over left-out frames, beyond
    each frame's cylinder. `stayed` are the directions in which the scan added little to what was known.
    """

    rig: Rig
    covariance: Float[np.ndarray, "unknowns unknowns"]
    radius_mm: float
    plain_mm: float
    adjusted_mm: float
    stayed: tuple[Direction, ...]
    frames: int

    @property
    def helps(self) -> bool:
        """Whether it is worth keeping."""
        return self.adjusted_mm < LEAST_GAIN * self.plain_mm


def seat_prior(slits: int) -> Float[np.ndarray, "unknowns unknowns"]:
    """What is known of a projector that was mounted anew since its calibration, as a covariance."""
    return np.diag(np.array([*SEAT_STD, *[SEAT_ANGLE_STD_RAD] * slits]) ** 2)


def calibrate_in_pipe(
    frames: Sequence[SlitPixels], rig: Rig, covariance: Float[np.ndarray, "unknowns unknowns"], radius_mm: float | None
) -> PipeCalibration:
    """Fit to all frames; judge on each half of the scan by what the other half gave.

    `covariance` is what the boards leave open of apex, two tilts of the axis and half angles. With a radius that is
    known the pipe is a gauge; else it gives everything but the scale.

    Raises:
        CannotCalibrate: for too few frames with a cylinder.
    """
    usable = [seen for seen in frames if fit_cylinder(triangulate(seen, rig)).converged]
    if len(usable) < LEAST_FRAMES:
        raise CannotCalibrate(f"{len(usable)} frames with a pipe in them; at least {LEAST_FRAMES} are needed")
    middle = len(usable) // 2
    halves = usable[:middle], usable[middle:]
    adjusted = [
        pattern_mm(judged, fit_pipe(teaching, rig, covariance, radius_mm)[0], radius_mm)
        for teaching, judged in (halves, halves[::-1])
    ]
    found, fit = fit_pipe(usable, rig, covariance, radius_mm)
    after = fit.covariance[: len(covariance), : len(covariance)]
    return PipeCalibration(
        found,
        after,
        radius_mm or _mean_radius_mm(usable, rig) + float(fit.common.sum()),
        float(np.mean([pattern_mm(half, rig, radius_mm) for half in halves])),
        float(np.mean(adjusted)),
        _stayed(covariance, after),
        len(usable),
    )


def fit_pipe(
    frames: Sequence[SlitPixels], rig: Rig, covariance: Float[np.ndarray, "unknowns unknowns"], radius_mm: float | None
) -> tuple[Rig, ConeFit]:
    """The rig whose cones make one bore of all frames, each in its own place and a little oval; and the fit.

    Raises:
        CannotCalibrate: for fewer than two frames: one pipe seen from one place leaves the axis open.
    """
    if len(frames) < 2:
        raise CannotCalibrate(f"{len(frames)} pictures with a pipe in them; at least 2 are needed, from unlike places")
    bore_mm = radius_mm or _mean_radius_mm(frames, rig)
    oval_std_mm = OVAL_STD_MM if len(frames) >= LEAST_FRAMES else ROUND_STD_MM
    sights = [_sight(seen, rig, bore_mm, oval_std_mm) for seen in frames]
    common = np.zeros(1 if radius_mm is None else 0)
    fit = fit_cones(sights, cones_of(rig.projector), np.linalg.inv(covariance), common)
    moved = rig.model_copy(update={"projector": with_cones(rig.projector, fit.cones)})
    return with_jag(moved, rig.projector.jag_table_rad), fit


def _cylinder(seen: SlitPixels, rig: Rig) -> tuple[RingPoints, Alignment]:
    points = triangulate(seen, rig)
    return points, fit_cylinder(points)


def _mean_radius_mm(frames: Sequence[SlitPixels], rig: Rig) -> float:
    return float(np.mean([_cylinder(seen, rig)[1].radius_mm for seen in frames]))


def _sight(seen: SlitPixels, rig: Rig, radius_mm: float, oval_std_mm: float) -> Sight:
    """Points of a frame near its cylinder, evenly fewer where there are many."""
    points, alignment = _cylinder(seen, rig)
    near = np.flatnonzero(np.abs(radial_mm(points.xyz_mm, alignment)) < WRONG_MM)
    near = near[:: max(near.size // MOST_POINTS, 1)]
    slit, table = points.ring[near].astype(np.int64), rig.projector.jag_table_rad
    azimuth = projector_azimuth_rad(points.xyz_mm[near], rig.projector.T_camera_projector)
    jag = jag_rad(table, slit, azimuth) if table.size else 0.0
    rays, bore = (
        fisheye_rays(points.pixel[near], rig.camera.intrinsics),
        Bore(axis_of(alignment), radius_mm, oval_std_mm),
    )
    typical_px = [
        np.median(seen.sigma_px[seen.slit == j]) if (seen.slit == j).any() else 0.0 for j in range(len(table))
    ]
    return Sight(rays, slit, bore, np.array(typical_px)[slit] / rig.camera.fx_px, jag)


def pattern_mm(frames: Sequence[SlitPixels], rig: Rig, radius_mm: float | None) -> float:
    """What the points of a place on the slide have in common over the frames, about each frame's cylinder: RMS.

    With a known radius, what the cylinders are too wide or too narrow counts too.
    """
    off, place = [], []
    for seen in frames:
        points, alignment = _cylinder(seen, rig)
        if not alignment.converged:
            continue
        azimuth = projector_azimuth_rad(points.xyz_mm, rig.projector.T_camera_projector)
        cell = (azimuth / (2 * np.pi) * PATTERN_CELLS).astype(np.int64) % PATTERN_CELLS
        off.append(radial_mm(points.xyz_mm, alignment) + (alignment.radius_mm - radius_mm if radius_mm else 0.0))
        place.append(points.ring * PATTERN_CELLS + cell)
    each, where = np.concatenate(off), np.concatenate(place)
    count = np.bincount(where)
    middles = [np.median(each[where == k]) for k in np.flatnonzero(count >= LEAST_CELL)]
    return float(np.sqrt(np.mean(np.square(middles))))


def _stayed(before: Float[np.ndarray, "n n"], after: Float[np.ndarray, "n n"]) -> tuple[Direction, ...]:
    """Directions, independent by what was known before, whose standard deviation the scan hardly lowered."""
    root = np.linalg.cholesky(before)
    white = np.linalg.solve(root, np.linalg.solve(root, after).T)
    share, vectors = np.linalg.eigh(0.5 * (white + white.T))
    left = np.sqrt(np.clip(share, 0.0, None))
    return tuple(Direction(root @ vectors[:, k], float(left[k])) for k in np.argsort(-left) if left[k] > OPEN_RATIO)
