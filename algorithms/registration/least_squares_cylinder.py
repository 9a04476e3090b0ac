"""The plain least-squares cylinder through points of any attitude: for reference data, gauges and calibration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from sensor_model.geometry import swing_onto

STARTS, STEPS = 60, 200
SETTLED = 1e-13


class CylinderFit(NamedTuple):
    """An infinite cylinder in the points' own frame: `axis` through `center_mm`."""

    center_mm: np.ndarray
    axis: np.ndarray
    radius_mm: float
    rms_mm: float


def fit_cylinder(xyz_mm: Float[np.ndarray, "n 3"]) -> CylinderFit:
    """Least-squares cylinder through all points: the best over starts spread over the half sphere.

    Raises:
        ValueError: when no start settles (too few points, or points on a line or a plane).
    """
    middle = xyz_mm.mean(axis=0)
    found = []
    for k in range(STARTS):
        cosine, turn = (k + 0.5) / STARTS, np.pi * (1 + 5**0.5) * k
        sine = np.sqrt(1 - cosine**2)
        R = swing_onto(np.array([np.cos(turn) * sine, np.sin(turn) * sine, cosine]), np.array([0.0, 0.0, 1.0]))
        local = (xyz_mm - middle) @ R.T
        fit = _settled(local)
        if fit is not None:
            found.append(fit._replace(center_mm=fit.center_mm @ R + middle, axis=fit.axis @ R))
    if not found:
        raise ValueError(f"no cylinder through these {xyz_mm.shape[0]} points")
    return min(found, key=lambda fit: fit.rms_mm)


def _settled(xyz: Float[np.ndarray, "n 3"]) -> CylinderFit | None:
    """Gauss-Newton from an axis along z; None where it does not settle."""
    center, axis = np.zeros(3), np.array([0.0, 0.0, 1.0])
    radius = float(np.hypot(xyz[:, 0], xyz[:, 1]).mean())
    for _ in range(STEPS):
        R = swing_onto(axis, np.array([0.0, 0.0, 1.0]))  # its rows are two directions across the axis, and the axis
        x, y, z = ((xyz - center) @ R.T).T
        rho = np.hypot(x, y)
        if not rho.all():
            return None
        n = np.column_stack([x, y]) / rho[:, None]
        J = np.column_stack([n, z[:, None] * n, np.ones(z.size)])
        size = np.linalg.norm(J, axis=0)
        if not size.all() or np.linalg.matrix_rank(J / size, tol=1e-9) < 5:
            return None
        step = np.linalg.lstsq(J / size, rho - radius, rcond=None)[0] / size  # Eq. 8
        center = center + step[0] * R[0] + step[1] * R[1]
        axis = axis + step[2] * R[0] + step[3] * R[1]
        axis = axis / np.linalg.norm(axis)
        radius += float(step[4])
        reach = np.abs(xyz).max()
        if not np.isfinite(radius) or not axis[2] > 0.1:
            return None
        if np.linalg.norm(step * [1, 1, reach, reach, 1]) < SETTLED * reach:
            return CylinderFit(center, axis, radius, float(np.sqrt(np.mean((rho - radius) ** 2))))
    return None
