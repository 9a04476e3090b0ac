"""The paper's own figures of merit, Eqs 28 to 32."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba import njit


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
    middle_x, middle_y, xx, xy, yy, xs, ys = _circle_moments(xy_mm)
    # the normal equations about the points' middle, where they lose nothing
    center = np.array([yy * xs - xy * ys, xx * ys - xy * xs]) / (2 * (xx * yy - xy * xy))
    return np.array([middle_x, middle_y]) + center, float(np.sqrt(center @ center + xx + yy))


@njit(cache=True, error_model="numpy")
def _circle_moments(xy):
    """Mean x and y, and about them the means of xx, xy, yy, x (xx + yy) and y (xx + yy)."""
    n = xy.shape[0]
    middle_x, middle_y = np.sum(xy[:, 0]) / n, np.sum(xy[:, 1]) / n
    sum_xx, sum_xy, sum_yy, sum_xs, sum_ys = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x, y = xy[i, 0] - middle_x, xy[i, 1] - middle_y
        square = x * x + y * y
        sum_xx += x * x
        sum_xy += x * y
        sum_yy += y * y
        sum_xs += x * square
        sum_ys += y * square
    return middle_x, middle_y, sum_xx / n, sum_xy / n, sum_yy / n, sum_xs / n, sum_ys / n


def plane_normal(xyz_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Unit normal of the least-squares plane through a frame's points, pointing forward."""
    # rings close together in z make the plane; its normal is the direction of least spread
    normal = np.linalg.eigh(_spread(xyz_mm))[1][:, 0]
    return normal if normal[2] >= 0 else -normal


@njit(cache=True, error_model="numpy")
def _spread(xyz):
    """Second moments (3, 3) about the points' middle, summed."""
    middle = np.array([np.sum(xyz[:, 0]), np.sum(xyz[:, 1]), np.sum(xyz[:, 2])]) / xyz.shape[0]
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0] - middle[0], xyz[i, 1] - middle[1], xyz[i, 2] - middle[2]
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
