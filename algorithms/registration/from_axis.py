"""From a fitted pipe axis to an alignment: the pose across the pipe, and what the fit is worth (Eqs 4 to 6)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from algorithms.registration.checks import no_pipe
from algorithms.robust import spread
from algorithms.types import Alignment, RingPoints, failed
from sensor_model.geometry import swing_onto, transform
from sensor_model.recording import NominalPipe

LEAST_SCATTER_MM = 1e-6
MIN_ACROSS = 0.1  # light that grazes the wall is still worth something


class AxisFit(NamedTuple):
    """A pipe in the camera frame: its `axis` through `center_mm`, its radius, and the points that say so.

    `noise_scale` says by how much the points scatter more than their stated standard deviations.
    """

    center_mm: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius_mm: float
    inliers: Bool[np.ndarray, "n"]
    noise_scale: float


def axis_alignment(
    points: RingPoints,
    sigma_mm: Float[np.ndarray, "n"],
    fit: AxisFit,
    prior: Alignment,
    radius_is_free: bool,
) -> Alignment:
    """The pose whose axis is the fitted one, turned and moved along it as the prior says (Eqs 4 to 6).

    `sigma_mm` is each point's standard deviation across the wall. The information has rank 4: moving along the pipe's
    axis and turning about it are not measured.
    """
    T_pipe_camera = pose_on_axis(fit.axis, fit.center_mm, prior)
    sigma = sigma_mm[fit.inliers] * fit.noise_scale
    information = axis_information(points.xyz_mm[fit.inliers], sigma, T_pipe_camera, radius_is_free)
    return Alignment(
        T_pipe_camera, information, fit.inliers, radius_mm=float(fit.radius_mm), noise_scale=float(fit.noise_scale)
    )


def all_points_alignment(
    points: RingPoints,
    axis: Float[np.ndarray, "3"],
    center_mm: Float[np.ndarray, "3"],
    pipe: NominalPipe,
    prior: Alignment,
) -> Alignment:
    """The alignment of an axis that all points were given the same say in; their scatter about it is its noise."""
    n = points.sigma_mm.size
    radii = np.linalg.norm(np.cross(points.xyz_mm - center_mm, axis), axis=1)  # Eq. 9
    radius, scatter = float(radii.mean()), float(radii.std())
    if reason := no_pipe(radius, scatter, pipe):
        return failed(prior, n, reason)
    alike = np.full(n, max(scatter, LEAST_SCATTER_MM))
    own = axis_alignment(points, alike, AxisFit(center_mm, axis, radius, np.ones(n, dtype=bool), 1.0), prior, True)
    noise_scale = spread((radii - radius) / sigma_across_mm(points, axis))
    return replace(own, noise_scale=noise_scale)


def pose_on_axis(
    axis: Float[np.ndarray, "3"], center_mm: Float[np.ndarray, "3"], prior: Alignment
) -> Float[np.ndarray, "4 4"]:
    """`T_pipe_camera` with the pipe's axis where it was seen from the camera; z and roll are the prior's."""
    R_prior = prior.T_pipe_camera[:3, :3]
    downstream = axis if (R_prior @ axis)[2] > 0 else -axis
    R_pipe_camera = swing_onto(R_prior @ downstream, np.array([0.0, 0.0, 1.0])) @ R_prior  # Eq. 5
    shift = -R_pipe_camera @ center_mm  # Eq. 6
    return transform(R_pipe_camera, np.array([shift[0], shift[1], prior.T_pipe_camera[2, 3]]))


def axis_information(
    xyz_mm: Float[np.ndarray, "n 3"],
    sigma_mm: Float[np.ndarray, "n"],
    T_pipe_camera: Float[np.ndarray, "4 4"],
    radius_is_free: bool,
) -> Float[np.ndarray, "6 6"]:
    """Normal matrix of the radii's residuals (Eq. 8) in the order of `Alignment.information`, camera points given."""
    lever = xyz_mm @ T_pipe_camera[:3, :3].T
    normal = lever + np.array([T_pipe_camera[0, 3], T_pipe_camera[1, 3], 0.0])
    normal[:, 2] = 0.0
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    J = np.hstack([normal, np.cross(lever, normal), np.full((normal.shape[0], 1), -1.0)]) / sigma_mm[:, None]
    N = J.T @ J
    if radius_is_free:  # it is estimated too: what it costs is taken off (Schur complement)
        return N[:6, :6] - np.outer(N[:6, 6], N[6, :6]) / N[6, 6]
    return N[:6, :6]


def sigma_across_mm(points: RingPoints, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
    """Standard deviation of each point across a wall about an axis: points slide along their light rays."""
    across = np.linalg.norm(np.cross(points.direction, axis), axis=1)
    return np.maximum(points.sigma_mm * np.maximum(across, MIN_ACROSS), 1e-6)
