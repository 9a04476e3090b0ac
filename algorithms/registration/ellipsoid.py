"""Registration by an ellipsoid fitted to a frame (reference [13] of the paper): its long axis is the pipe's."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from algorithms.registration.checks import unfit
from algorithms.registration.from_axis import all_points_alignment
from algorithms.registration.fusion import fuse
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.settings import Settings

LEAST_ROUND = 0.5  # of the two short semi-axes' squares, the lesser over the larger
MOST_CURVED_ALONG = 0.5  # of the curvature along the axis, over the lesser one around it


class EllipsoidSettings(Settings):
    """There is nothing to set: every point counts alike."""

    kind: Literal["ellipsoid"] = "ellipsoid"


def align(points: RingPoints, wall: Wall, prior: Alignment, _settings: EllipsoidSettings) -> Alignment:
    """The pipe's axis is the quadric's: the direction it bends least in, through its centre.

    A straight tube is an ellipsoid of endless length, and noise tips its fit over into a hyperboloid of one sheet as
    often as not. The paper does not say what [13] then does; here both are taken, as long as the quadric is round
    about one axis and long along it, which is the reading that serves the method best.
    """
    n = points.sigma_mm.size
    if reason := unfit(points):
        return failed(prior, n, reason)
    Q, b, c, middle = fit_quadric(points.xyz_mm)
    bend, directions = np.linalg.eigh(Q)
    weak, low, high = np.argsort(np.abs(bend))
    if not (bend[low] > LEAST_ROUND * bend[high] > 0 and abs(bend[weak]) < MOST_CURVED_ALONG * bend[low]):
        return failed(prior, n, "the fitted quadric is no long round body")
    short = [low, high]
    center = -(directions[:, short].T @ b) / bend[short]
    level = float(np.sum(bend[short] * center**2)) - c
    if level <= 0:
        return failed(prior, n, "the fitted quadric has no points")
    radius = float(np.sqrt(level / bend[short]).mean())  # of the section through the middle of the points
    axis, center_mm = directions[:, weak].copy(), middle + directions[:, short] @ center
    own = all_points_alignment(points, axis, center_mm, wall.pipe, prior)
    return fuse(prior, replace(own, radius_mm=radius)) if own.converged else own


def fit_quadric(
    xyz_mm: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], float, Float[np.ndarray, "3"]]:
    """Q, b, c and m of the quadric x'Qx + 2b'x + c = 0 (x from the points' middle m, mm) of least algebraic error.

    Bookstein's constraint, Q's eigenvalues of unit square sum, is the one that turning and moving the points leaves
    as it is; their sum is made positive.
    """
    middle = xyz_mm.mean(axis=0)
    scale = float(np.sqrt(np.mean((xyz_mm - middle) ** 2)))
    x, y, z = ((xyz_mm - middle) / scale).T
    root2 = np.sqrt(2.0)
    columns = [2 * x, 2 * y, 2 * z, np.ones_like(x), x * x, y * y, z * z, root2 * x * y, root2 * x * z, root2 * y * z]
    R = np.asarray(np.linalg.qr(np.column_stack(columns), mode="r"))
    q = np.linalg.svd(R[4:, 4:])[2][-1]
    q *= 1.0 if q[:3].sum() > 0 else -1.0
    b_and_c = -np.linalg.solve(R[:4, :4], R[:4, 4:] @ q)
    xy, xz, yz = q[3:] / root2
    Q = np.array([[q[0], xy, xz], [xy, q[1], yz], [xz, yz, q[2]]])
    return Q / scale**2, b_and_c[:3] / scale, float(b_and_c[3]), middle
