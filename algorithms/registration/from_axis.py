"""From an axis through all points to an alignment: the pose across the pipe, and what the fit is worth (Eqs 4 to 6)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from algorithms.registration.checks import no_pipe
from algorithms.registration.cylinder_pose import pose_of
from algorithms.robust import spread
from algorithms.types import Alignment, Matrix6, RingPoints, failed
from sensor_model.recording import NominalPipe

LEAST_SCATTER_MM = 1e-6
MIN_ACROSS = 0.1  # light that grazes the wall is still worth something


def all_points_alignment(
    points: RingPoints,
    axis: Float[np.ndarray, "3"],
    center_mm: Float[np.ndarray, "3"],
    pipe: NominalPipe,
    prior: Alignment,
) -> Alignment:
    """The alignment of an axis that all points were given the same say in; their scatter about it is its noise.

    The camera is turned about the axis and moved along it as the prior says (Eqs 4 to 6). The information has rank 4:
    neither is measured.
    """
    n = points.sigma_mm.size
    downstream = axis if (prior.T_pipe_camera[:3, :3] @ axis)[2] > 0 else -axis
    radii = np.linalg.norm(np.cross(points.xyz_mm - center_mm, axis), axis=1)  # Eq. 9
    radius, scatter = float(radii.mean()), float(radii.std())
    if reason := no_pipe(radius, scatter, pipe):
        return failed(prior, n, reason)
    T_pipe_camera = pose_of(np.concatenate([center_mm, downstream, [radius, 0.0, 0.0]]), prior.T_pipe_camera)
    return Alignment(
        T_pipe_camera,
        radii_information(points.xyz_mm, np.full(n, max(scatter, LEAST_SCATTER_MM)), T_pipe_camera),
        np.ones(n, dtype=bool),
        radius_mm=radius,
        noise_scale=spread((radii - radius) / sigma_across_mm(points, axis)),
    )


def radii_information(
    xyz_mm: Float[np.ndarray, "n 3"], sigma_mm: Float[np.ndarray, "n"], T_pipe_camera: Float[np.ndarray, "4 4"]
) -> Matrix6:
    """Normal matrix of the radii's residuals (Eq. 8), in the order of `Alignment.information`, the radius free.

    `xyz_mm` are in the camera frame, `sigma_mm` across the wall.
    """
    lever = xyz_mm @ T_pipe_camera[:3, :3].T
    normal = lever + np.array([T_pipe_camera[0, 3], T_pipe_camera[1, 3], 0.0])
    normal[:, 2] = 0.0
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    J = np.hstack([normal, np.cross(lever, normal), np.full((normal.shape[0], 1), -1.0)]) / sigma_mm[:, None]
    N = J.T @ J
    return N[:6, :6] - np.outer(N[:6, 6], N[6, :6]) / N[6, 6]  # what the radius costs is taken off (Schur complement)


def sigma_across_mm(points: RingPoints, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
    """Standard deviation of each point across a wall about an axis: points slide along their light rays."""
    across = np.linalg.norm(np.cross(points.direction, axis), axis=1)
    return np.maximum(points.sigma_mm * np.maximum(across, MIN_ACROSS), 1e-6)
