"""The first frame of a method that registers against what was seen before, and one beyond all that was seen."""

from __future__ import annotations

from typing import Literal

import numpy as np

from algorithms.registration import cylinder
from algorithms.registration.checks import unfit
from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.from_axis import all_points_alignment
from algorithms.registration.fusion import fuse
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import swing_onto

Start = Literal["cylinder", "plane"]
BEYOND_SHARE = 0.05  # fewer points near the map than this: the frame looks where nothing was seen yet, after a gap say


def place_first(points: RingPoints, wall: Wall, prior: Alignment, start: Start) -> Alignment:
    """The pose of the first frame by the cylinder fit, or as in the paper by a fitted plane."""
    if start == "cylinder":
        return cylinder.align(points, wall, prior, CylinderSettings())
    return _on_plane(points, wall, prior)


def _on_plane(points: RingPoints, wall: Wall, prior: Alignment) -> Alignment:
    """Section 4.2: the normal of the plane through all points is the axis, and their circle's centre its place."""
    n = points.sigma_mm.size
    if reason := unfit(points):
        return failed(prior, n, reason)
    middle = points.xyz_mm.mean(axis=0)
    normal = np.linalg.eigh(np.cov(points.xyz_mm.T))[1][:, 0].copy()
    normal *= 1.0 if (prior.T_pipe_camera[:3, :3] @ normal)[2] > 0 else -1.0
    R = swing_onto(normal, np.array([0.0, 0.0, 1.0]))
    x, y, _ = ((points.xyz_mm - middle) @ R.T).T
    circle = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(n)]), x**2 + y**2, rcond=None)[0]
    center = middle + R.T @ np.array([circle[0], circle[1], 0.0])
    own = all_points_alignment(points, normal, center, wall.pipe, prior)
    return fuse(prior, own) if own.converged else own
