"""What every fit asks of its points before it starts, and of its cylinder when it is done."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba import njit

from algorithms.types import RingPoints
from sensor_model.recording import NominalPipe

MIN_POINTS, ENOUGH = 30, 500
FLAT_SHARE = 1e-4
FLAT_SIGMAS = 3.0
RADIUS_SHARES = (0.5, 1.5)
MOST_SCATTER_SHARE = 0.3  # a defect as deep as the wall scatters the radii of a whole frame by 4 % of the radius


def unfit(points: RingPoints) -> str:
    """Why no pose can come from these points, or nothing: too few, not finite, on a line, or on a plane.

    One ring seen square on is a plane too.
    """
    n = points.sigma_mm.size
    if n < MIN_POINTS:
        return f"{n} points; at least {MIN_POINTS} are needed"
    if not (np.isfinite(points.xyz_mm).all() and np.isfinite(points.sigma_mm).all()):
        return "points that are not finite"
    return flat(points.xyz_mm, points.sigma_mm)


def flat(xyz_mm: Float[np.ndarray, "n 3"], sigma_mm: Float[np.ndarray, "n"]) -> str:
    """Whether points lie on a line or a plane, give or take their noise; a few hundred of them tell."""
    extent, noise = _extent(xyz_mm, sigma_mm)
    if extent[1] <= noise:
        return "the points lie on a line"
    if extent[0] <= noise:
        return "the points lie on a plane"
    return ""


@njit(cache=True)
def _extent(xyz, sigma):
    """Standard deviations along the principal axes, the smallest first, and below which a cloud counts as thin."""
    step = max(sigma.size // ENOUGH, 1)
    n = (sigma.size + step - 1) // step
    middle, scatter = np.zeros(3), np.zeros((3, 3))
    for i in range(0, sigma.size, step):
        for a in range(3):
            middle[a] += xyz[i, a] / n
    for i in range(0, sigma.size, step):
        for a in range(3):
            for b in range(3):
                scatter[a, b] += (xyz[i, a] - middle[a]) * (xyz[i, b] - middle[b]) / n
    extent = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter), 0.0))
    return extent, max(FLAT_SHARE * extent[2], FLAT_SIGMAS * np.median(sigma[::step]))


def no_pipe(radius_mm: float, scatter_mm: float, pipe: NominalPipe) -> str:
    """Why a fitted cylinder cannot be this pipe, or nothing: its radius, or how far its points scatter about it."""
    nominal = pipe.inner_radius_mm
    if not RADIUS_SHARES[0] < radius_mm / nominal < RADIUS_SHARES[1]:
        return f"radius {radius_mm:.1f} mm in a pipe of {nominal:.1f} mm"
    if not scatter_mm < MOST_SCATTER_SHARE * nominal:
        return f"the points scatter by {scatter_mm:.1f} mm about the fitted wall"
    return ""
