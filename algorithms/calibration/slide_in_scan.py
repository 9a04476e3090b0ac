"""The slide's jaggedness, learned from a scan's own clean wall: what goes along with the slide is not the pipe's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import WRONG_MM, fit_cylinder, radial_mm
from algorithms.calibration.slide import LEAST_GAIN, OUTLIER_MM, with_jag
from algorithms.robust import MAD_TO_SIGMA, spread
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, RingPoints
from sensor_model.geometry import apply, projector_azimuth_rad, wall_angle_rad
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

if TYPE_CHECKING:
    from scipy.sparse import csr_array

LEAST_FRAMES = 16
CELLS = 720  # around the slide: a real one's jags are 1 degree wide, and between wider cells their tips are lost
LEAST_SIGHTS = 8  # of a place on the slide
ROUNDS = 3  # what is cut, and the cylinders, change with the table
BENT_SHARE = 0.3  # of how far a table bends from cell to cell: what its cells' means are open by
CUT_SIGMAS = 3.0
LEAST_PER_RAD = 1.0
BORE_ROUNDS = 5
TUKEY = 4.685
ALIKE_SIGMAS = 5.0
ALIKE_MARGIN = 6  # cells on either side


@dataclass(frozen=True)
class ScanSlide:
    """The correction learned from a whole scan, and what the one learned from either half does to the other half.

    It is NaN where too few frames saw a place of the slide, as at the strut's edge. `plain_mm` and `corrected_mm` are
    the robust residuals of the points of left-out frames about each one's cylinder. `alike_mm` is where all slits see
    the wall stand off alike, as on a groove along the pipe: no part of the correction, and 0 elsewhere.
    """

    table_rad: Float[np.ndarray, "slits cells"]
    plain_mm: float
    corrected_mm: float
    frames: int
    unused_share: float
    alike_mm: Float[np.ndarray, "cells"]

    @property
    def helps(self) -> bool:
        """Whether it is worth keeping."""
        return self.corrected_mm < LEAST_GAIN * self.plain_mm


class _Lesson(NamedTuple):
    table_rad: Float[np.ndarray, "slits cells"]
    unused_share: float
    alike_mm: Float[np.ndarray, "cells"]


class _Sights(NamedTuple):
    """Points near the wall: what the half angle of each lacks to lie on the bore, and its place on the slide.

    A place is a slit's cell; `beside` is how far from its middle, in cells, clockwise. `per_rad_mm` is how far the half
    angle moves the point outward, `weight` what the fit of a cylinder gives it.
    """

    excess_rad: Float[np.ndarray, "n"]
    place: Int[np.ndarray, "n"]
    beside: Float[np.ndarray, "n"]
    per_rad_mm: Float[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    ahead_mm: Float[np.ndarray, "n"]


def learn_slide_from_scan(frames: Sequence[SlitPixels], rig: Rig) -> ScanSlide:
    """Learn the correction from frames along a pipe; judge it on each half of the scan by what the other half taught.

    What stays in the pipe is no part of it: each place of the slide passes a defect or a joint in few frames and is
    learned from the others, and an oval bore is fitted frame by frame.

    Raises:
        CannotCalibrate: for too few frames with a cylinder.
    """
    smooth = with_jag(rig, np.zeros((len(rig.projector.slits), 0)))
    usable = [seen for seen in frames if fit_cylinder(triangulate(seen, smooth)).converged]
    if len(usable) < LEAST_FRAMES:
        raise CannotCalibrate(f"{len(usable)} frames with a pipe in them; at least {LEAST_FRAMES} are needed")
    middle = len(usable) // 2
    halves = usable[:middle], usable[middle:]
    corrected = [
        residual_mm(judged, with_jag(smooth, _taught(teaching, smooth).table_rad))
        for teaching, judged in (halves, halves[::-1])
    ]
    lesson = _taught(usable, smooth)
    plain = [residual_mm(half, rig) for half in halves]
    return ScanSlide(
        lesson.table_rad,
        float(np.mean(plain)),
        float(np.mean(corrected)),
        len(usable),
        lesson.unused_share,
        lesson.alike_mm,
    )


def residual_mm(frames: Sequence[SlitPixels], rig: Rig) -> float:
    """Robust residual of the frames' points, with a rig, about the cylinder fitted to each frame."""
    residuals = []
    for seen in frames:
        points = triangulate(seen, rig)
        alignment = fit_cylinder(points)
        if alignment.converged:
            residuals.append(radial_mm(points.xyz_mm, alignment))
    all_mm = np.concatenate(residuals) if residuals else np.zeros(0)
    return spread(all_mm[np.abs(all_mm) < WRONG_MM])


def _taught(frames: Sequence[SlitPixels], smooth: Rig) -> _Lesson:
    shape = len(smooth.projector.slits), CELLS
    table, unused_share, lever, known = np.zeros(shape), 0.0, np.zeros(shape), np.zeros(shape, dtype=bool)
    for _ in range(ROUNDS):
        sights = _all_sights(frames, with_jag(smooth, table))
        means, clean, seen = clean_means(sights.excess_rad, sights.place, table.size)
        beside = _means(sights.beside[clean], sights.place[clean], table.size)
        step, known = _between(means.reshape(shape), beside.reshape(shape), seen.reshape(shape))
        lever, weight, ahead = (
            _filled(_means(values, sights.place, table.size).reshape(shape), known)
            for values in (sights.per_rad_mm, sights.weight, sights.ahead_mm)
        )
        table = _without_pose(table + step, lever, weight, ahead)
        unused_share = 1 - np.count_nonzero(clean) / clean.size
    alike = _alike_mm(table * lever)
    table = table - _over(np.broadcast_to(alike, shape), lever)
    return _Lesson(np.where(known, table, np.nan), unused_share, alike)


def _all_sights(frames: Sequence[SlitPixels], rig: Rig) -> _Sights:
    each = []
    for seen in frames:
        points = triangulate(seen, rig)
        alignment = fit_cylinder(points)
        if alignment.converged:
            each.append(_sights(points, alignment, rig))
    return _Sights(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def _sights(points: RingPoints, alignment: Alignment, rig: Rig) -> _Sights:
    residual, per_rad = _off_the_bore_mm(points, alignment), radius_per_rad(points, alignment, rig)
    right = (np.abs(residual) < OUTLIER_MM) & (np.abs(per_rad) > LEAST_PER_RAD)
    azimuth = projector_azimuth_rad(points.xyz_mm, rig.projector.T_camera_projector)
    around = azimuth / (2 * np.pi) * CELLS
    cell = around.astype(np.int64)
    across = np.sum(points.direction * _outward(points, alignment), axis=1) * points.sigma_mm
    return _Sights(
        -residual[right] / per_rad[right],
        (points.ring * CELLS + cell % CELLS)[right],
        (around - cell - 0.5)[right],
        per_rad[right],
        across[right] ** -2,
        points.xyz_mm[right, 2],
    )


def _between(
    means: Float[np.ndarray, "slits cells"],
    beside: Float[np.ndarray, "slits cells"],
    seen: Bool[np.ndarray, "slits cells"],
) -> tuple[Float[np.ndarray, "slits cells"], Bool[np.ndarray, "slits cells"]]:
    """Tables that, straight between the middles of their cells, go through what was seen beside these; what is known.

    What goes to and fro from cell to cell is hardly seen by lines that all pass midway between two middles, so a table
    bends no more than it has to. A cell that nothing was seen in is known between two that are.
    """
    from scipy.sparse.linalg import spsolve

    bend = BENT_SHARE * _ring(np.full(CELLS, -2.0), np.ones((2, CELLS)))
    stiff = bend.T @ bend
    table = np.zeros(means.shape)
    for j in np.flatnonzero(seen.any(axis=1)):
        toward = np.maximum([-beside[j], beside[j]], 0)
        A = _ring(1 - np.abs(beside[j]), toward)[seen[j]]
        table[j] = spsolve((A.T @ A + stiff).tocsc(), A.T @ means[j, seen[j]])
    known = seen | (np.roll(seen, 1, axis=1) & np.roll(seen, -1, axis=1))
    return np.where(known, table, 0.0), known


def _ring(own: Float[np.ndarray, "n"], beside: Float[np.ndarray, "2 n"]) -> csr_array:
    """The matrix of these shares of each in a ring, and of the one before and after it."""
    from scipy.sparse import csr_array

    each = np.arange(own.size)
    columns = np.concatenate([each, each - 1, each + 1]) % own.size
    return csr_array((np.concatenate([own, *beside]), (np.tile(each, 3), columns)), shape=(own.size, own.size))


def _without_pose(
    table: Float[np.ndarray, "slits cells"],
    lever: Float[np.ndarray, "slits cells"],
    weight: Float[np.ndarray, "slits cells"],
    ahead_mm: Float[np.ndarray, "slits cells"],
) -> Float[np.ndarray, "slits cells"]:
    """The table without what is as well another place, tilt or radius of the pipe: a wall alone cannot tell them."""
    azimuth = np.broadcast_to((np.arange(table.shape[1]) + 0.5) * 2 * np.pi / table.shape[1], table.shape)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    A = np.stack([np.ones(table.shape), cosine, sine, ahead_mm * cosine, ahead_mm * sine], axis=-1)
    root = np.sqrt(weight)
    moved = A @ np.linalg.lstsq((A * root[..., None]).reshape(-1, 5), (table * lever * root).ravel(), rcond=None)[0]
    return table - _over(moved, lever)


def _over(radial_mm: Float[np.ndarray, "slits cells"], lever: Float[np.ndarray, "slits cells"]) -> np.ndarray:
    """Movements of the wall as half angles; 0 where nothing was seen."""
    return np.where(lever != 0, radial_mm / np.where(lever != 0, lever, 1.0), 0.0)


def radius_per_rad(points: RingPoints, alignment: Alignment, rig: Rig) -> Float[np.ndarray, "n"]:
    """How much further from the pipe's axis a point moves, along its camera ray, per rad more of its half angle."""
    axis = rig.projector.T_camera_projector[:3, 2]
    off = points.xyz_mm - np.array(rig.projector.apex_mm)
    along = off @ axis
    across = off - along[:, None] * axis
    width, range_mm = np.linalg.norm(across, axis=1), np.linalg.norm(off, axis=1)
    # the half angle grows fastest outward across the light, by 1 / range
    outward = (along / width)[:, None] * across - width[:, None] * axis
    ray = points.xyz_mm / np.linalg.norm(points.xyz_mm, axis=1)[:, None]
    travel = range_mm**2 / np.sum(outward * ray, axis=1)
    return travel * np.sum(ray * _outward(points, alignment), axis=1)


def _outward(points: RingPoints, alignment: Alignment) -> Float[np.ndarray, "n 3"]:
    """Unit vectors away from the pipe's axis at each point, camera frame."""
    x, y, _ = apply(alignment.T_pipe_camera, points.xyz_mm).T
    return np.stack([x, y], axis=1) / np.hypot(x, y)[:, None] @ alignment.T_pipe_camera[:2, :3]


def _off_the_bore_mm(points: RingPoints, alignment: Alignment) -> Float[np.ndarray, "n"]:
    """How far points lie outside the bore: the cylinder, and what little the frame shows it to be oval."""
    residual = radial_mm(points.xyz_mm, alignment)
    x, y, _ = apply(alignment.T_pipe_camera, points.xyz_mm).T
    twice = 2 * wall_angle_rad(x, y)
    # an oval alone: a circle fitted again, with other weights, would let the pose creep from round to round
    A = np.stack([np.cos(twice), np.sin(twice)], axis=1)
    off = residual
    for _ in range(BORE_ROUNDS):
        weight = np.clip(1 - (off / (TUKEY * max(spread(off), 1e-6))) ** 2, 0, None) ** 2
        weighted = A.T * weight
        off = residual - A @ np.linalg.lstsq(weighted @ A, weighted @ residual, rcond=None)[0]
    return off


def clean_means(
    excess: Float[np.ndarray, "n"], place: Int[np.ndarray, "n"], places: int
) -> tuple[Float[np.ndarray, "places"], Bool[np.ndarray, "n"], Bool[np.ndarray, "places"]]:
    """Mean at each place of what is left once defects and joints are cut, which is told by the median; what is left.

    The mean is 0 where too few are left, which the last array tells apart.
    """
    off = np.abs(excess - _medians(excess, place, places)[place])
    slit, scale = place // CELLS, np.zeros(places // CELLS)
    for j in range(scale.size):
        mine = off[slit == j]
        scale[j] = MAD_TO_SIGMA * float(np.median(mine)) if mine.size else 0.0
    clean = off <= CUT_SIGMAS * scale[slit]
    known = np.bincount(place[clean], minlength=places) >= LEAST_SIGHTS
    return np.where(known, _means(excess[clean], place[clean], places), 0.0), clean, known


def _medians(values: Float[np.ndarray, "n"], place: Int[np.ndarray, "n"], places: int) -> Float[np.ndarray, "places"]:
    """Median of the values at each place; 0 where there are none."""
    ordered = values[np.lexsort((values, place))]
    count = np.bincount(place, minlength=places)
    first, some = np.cumsum(count) - count, count > 0
    out = np.zeros(places)
    out[some] = 0.5 * (ordered[(first + (count - 1) // 2)[some]] + ordered[(first + count // 2)[some]])
    return out


def _filled(means: Float[np.ndarray, "slits cells"], known: Bool[np.ndarray, "slits cells"]) -> np.ndarray:
    """The means of the known cells, of one that nothing was seen in as beside it; 0 elsewhere."""
    beside = (np.roll(means, 1, axis=1) + np.roll(means, -1, axis=1)) / 2
    return np.where(known, np.where(means != 0, means, beside), 0.0)


def _means(values: Float[np.ndarray, "n"], place: Int[np.ndarray, "n"], places: int) -> Float[np.ndarray, "places"]:
    """Mean of the values at each place; 0 where there are none."""
    total = np.bincount(place, weights=values, minlength=places)
    return total / np.maximum(np.bincount(place, minlength=places), 1)


def _alike_mm(pattern_mm: Float[np.ndarray, "slits cells"]) -> Float[np.ndarray, "cells"]:
    """What all slits have alike, where it stands out of what chance gives slits that know nothing of each other.

    A groove along the whole pipe looks like this to a sensor that does not roll; a slide's lines are printed apart.
    """
    seen = pattern_mm != 0
    several = seen.sum(axis=0) >= len(pattern_mm) / 2
    alike = np.where(several, np.sum(pattern_mm, axis=0) / np.maximum(seen.sum(axis=0), 1), 0.0)
    out = np.abs(alike) > ALIKE_SIGMAS * max(spread(alike[several]), 1e-9)
    near = np.convolve(np.tile(out, 3), np.ones(2 * ALIKE_MARGIN + 1), "same")[alike.size : 2 * alike.size] > 0
    return np.where(near & out.any(), alike, 0.0)
