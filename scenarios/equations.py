"""The paper's own figures of merit, Eqs 28 to 32."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def radius_closeness_pct(radii_mm: Float[np.ndarray, "frames"], true_radius_mm: float) -> float:
    """How near the mean of the frames' circle radii comes to the true one, Eq. 28."""
    return float(abs(np.mean(radii_mm) - true_radius_mm) / true_radius_mm * 100)  # Eq. 28


def err_pct(length_mm: float, width_mm: float, true_length_mm: float, true_width_mm: float) -> float:
    """Error of the size in plan, Eq. 29."""
    relative = np.array([length_mm / true_length_mm - 1, width_mm / true_width_mm - 1])
    return float(0.5 * np.sqrt(np.sum(relative**2)) * 100)  # Eq. 29


def error_pct(size_mm: Float[np.ndarray, "3"], true_size_mm: Float[np.ndarray, "3"]) -> float:
    """Error of length, width and depth together, Eq. 30; its divisor of 3 makes it a third of their norm."""
    relative = np.asarray(size_mm) / np.asarray(true_size_mm) - 1
    return float(np.sqrt(np.sum(relative**2)) / 3 * 100)  # Eq. 30


def depth_quality_pct(depths_mm: Float[np.ndarray, "n"], true_depths_mm: Float[np.ndarray, "n"]) -> float:
    """Quality of the depths, Eq. 32."""
    return float((1 - np.mean(np.abs(np.asarray(depths_mm) / np.asarray(true_depths_mm) - 1))) * 100)  # Eq. 32


def circle(xy_mm: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "2"], float]:
    """Centre and radius of the algebraic least-squares circle, as drawn in Fig. 11c."""
    A = np.column_stack([xy_mm, np.ones(len(xy_mm))])
    a, b, c = np.linalg.lstsq(A, -np.sum(xy_mm**2, axis=1), rcond=None)[0]
    center = np.array([-a / 2, -b / 2])
    return center, float(np.sqrt(center @ center - c))


def plane_normal(xyz_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Unit normal of the least-squares plane through a frame's points, pointing forward."""
    moments = np.cov(xyz_mm.T)
    # rings close together in z make the plane; its normal is the direction of least spread
    normal = np.linalg.eigh(moments)[1][:, 0]
    return normal if normal[2] >= 0 else -normal
