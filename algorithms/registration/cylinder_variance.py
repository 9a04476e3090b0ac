"""Registration by the least variance of the radii (Eq. 7): the paper's direct fit, over all points."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float

from algorithms.registration.checks import unfit
from algorithms.registration.from_axis import all_points_alignment
from algorithms.registration.fusion import fuse
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.settings import Settings

TOLERANCE = 1e-12
MOST_EVALUATIONS = 100
LEVER_MM = 100.0  # a radian moves the wall by about as much


class CylinderVarianceSettings(Settings):
    """There is nothing to set: every point counts alike."""

    kind: Literal["cylinder-variance"] = "cylinder-variance"


def align(points: RingPoints, wall: Wall, prior: Alignment, _settings: CylinderVarianceSettings) -> Alignment:
    """Where the radii vary least about their mean; no point is left out, so a defect pulls the axis to its side."""
    n = points.sigma_mm.size
    if reason := unfit(points):
        return failed(prior, n, reason)
    R_prior, middle = prior.T_pipe_camera[:3, :3], points.xyz_mm.mean(axis=0)
    q = (points.xyz_mm - middle) @ R_prior.T
    parameters = least_variance(q, (R_prior @ middle + prior.T_pipe_camera[:3, 3])[:2])
    if parameters is None:
        return failed(prior, n, "the fit did not settle")
    R = R_prior.T @ np.linalg.multi_dot(_turns(parameters)[:2]).T
    axis, center = R[:, 2], middle - R @ np.append(parameters[2:], 0.0)
    own = all_points_alignment(points, axis, center, wall.pipe, prior)
    return fuse(prior, own) if own.converged else own


def least_variance(q_mm: Float[np.ndarray, "n 3"], start_mm: Float[np.ndarray, "2"]) -> Float[np.ndarray, "4"] | None:
    """phi_x, phi_y (rad), Tx, Ty (mm) of least variance, from no turn and `start_mm`; None where it will not settle."""
    from scipy.optimize import least_squares

    def residual(parameters: np.ndarray) -> np.ndarray:
        r, _ = _radii(q_mm, parameters)
        return r - r.mean()

    def jacobian(parameters: np.ndarray) -> np.ndarray:
        _, J = _radii(q_mm, parameters)
        return J - J.mean(axis=0)

    found = least_squares(  # Eq. 7: the sum of squares about the mean is n times the variance
        residual,
        np.array([0.0, 0.0, *start_mm]),
        jacobian,
        method="lm",
        x_scale=np.array([1 / LEVER_MM, 1 / LEVER_MM, 1.0, 1.0]),
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=MOST_EVALUATIONS,
    )
    return found.x if found.success else None


def _radii(q_mm: Float[np.ndarray, "n 3"], parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radii of the moved points (Eqs 4 to 6 and 8) and their derivatives by phi_x, phi_y, Tx, Ty."""
    R_x, R_y, dR_x, dR_y = _turns(parameters)
    xy = (q_mm @ (R_x @ R_y).T)[:, :2] + parameters[2:]
    r = np.hypot(xy[:, 0], xy[:, 1])  # Eq. 8
    normal = xy / np.maximum(r, 1e-300)[:, None]
    by_x, by_y = (q_mm @ (dR_x @ R_y).T)[:, :2], (q_mm @ (R_x @ dR_y).T)[:, :2]
    return r, np.column_stack([np.sum(normal * by_x, axis=1), np.sum(normal * by_y, axis=1), normal])


def _turns(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """R_x, R_y (Eq. 5) and their derivatives."""
    (c_x, c_y), (s_x, s_y) = np.cos(parameters[:2]), np.sin(parameters[:2])
    R_x = np.array([[1.0, 0.0, 0.0], [0.0, c_x, -s_x], [0.0, s_x, c_x]])
    R_y = np.array([[c_y, 0.0, s_y], [0.0, 1.0, 0.0], [-s_y, 0.0, c_y]])
    dR_x = np.array([[0.0, 0.0, 0.0], [0.0, -s_x, -c_x], [0.0, c_x, -s_x]])
    dR_y = np.array([[-s_y, 0.0, c_y], [0.0, 0.0, 0.0], [-c_y, 0.0, -s_y]])
    return R_x, R_y, dR_x, dR_y
