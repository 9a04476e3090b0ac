"""Registration by a cylinder fit with RANSAC (section 3.1, Eqs 4 to 10): the paper's method."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field

from algorithms.registration.checks import MIN_POINTS, flat
from algorithms.registration.cylinder_pose import information_of_pose, pose_of, start_of, without
from algorithms.registration.fusion import fuse
from algorithms.registration.ray_fit import moved, normal_matrix, pack, residuals, scale_about_zero, solve
from algorithms.registration.settle import (
    DONE,
    INLIER_SIGMAS,
    NEVER,
    NOT_FINITE,
    REASONS,
    SMALLEST_SCALE,
    WORKING,
    settle,
)
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.settings import Settings

SAMPLE, SAMPLE_STEPS, SAMPLE_DAMPING = 6, 3, 1e-3
SUBSAMPLE = 512
MISSED = 1e-3  # chance that no sample was free of outliers
EVERYTHING = 1e9
PROMISING = 3.0  # a sample's cylinder is this much looser than the one it leads to
NEARLY_BEST = 1.5  # the best sample does not always lead to the best cylinder
LEAST_RADIUS, MOST_RADIUS = 0.5, 1.5


class CylinderSettings(Settings):
    """Settings of the cylinder fit: how many samples it may draw, and which share of inliers it must find."""

    kind: Literal["cylinder"] = "cylinder"
    hypotheses: Annotated[int, Field(ge=1, le=100_000)] = 500
    min_inlier_share: Annotated[float, Field(gt=0, lt=1)] = 0.3


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: CylinderSettings) -> Alignment:
    """Where the camera is across the pipe and how it is tilted; travel and roll are taken from the prior.

    The residual is Eq. 10's distance between a point and where its ray meets the cylinder, in standard deviations of
    the point. The ray is the light's, along which the sensor's error lies; the camera's gives the same to first order.
    """
    n, nominal = points.sigma_mm.size, wall.pipe.inner_radius_mm
    if n < MIN_POINTS:
        return failed(prior, n, f"{n} points; at least {MIN_POINTS} are needed")
    xyz, direction, sigma = points.xyz_mm, points.direction, points.sigma_mm
    packed, finite = pack(xyz, direction, sigma, 0, n, -(-n // WORKING))
    if not finite:
        return failed(prior, n, REASONS[NOT_FINITE])
    if shape := flat(xyz, sigma):
        return failed(prior, n, shape)
    start, nothing = start_of(xyz, prior.T_pipe_camera, nominal), np.zeros((5, 5))
    cylinder, scale = _consensus(packed, start, settings.hypotheses)
    cylinder, H, inliers, scale, status = settle(xyz, direction, sigma, packed, cylinder, scale, start, nothing, NEVER)
    if status != DONE:
        return failed(prior, n, REASONS[status])
    share, radius = np.count_nonzero(inliers) / n, float(cylinder[6])
    if share < settings.min_inlier_share:
        return failed(prior, n, f"only {share:.0%} of the points lie on one cylinder")
    if not LEAST_RADIUS < radius / nominal < MOST_RADIUS:
        return failed(prior, n, f"radius {radius:.1f} mm in a pipe of {nominal:.1f} mm")
    T_pipe_camera = pose_of(cylinder, prior.T_pipe_camera)
    information = information_of_pose(without(H, 4, 5), cylinder, T_pipe_camera)
    own = Alignment(T_pipe_camera, information, inliers, radius_mm=radius, noise_scale=scale)
    return fuse(prior, own)


@njit(cache=True)
def _consensus(packed, start, hypotheses):
    """RANSAC: of the cylinders through a few points each, the one that most points agree with, and their scale.

    Agreement is a truncated square of the residuals in the points' own standard deviations (MSAC); a new best one is
    refitted to those that agree (LO-RANSAC). Samples are drawn until one without outliers is as good as sure.
    """
    m = min(packed.shape[1], SUBSAMPLE)
    some = np.ascontiguousarray(packed[:, :: packed.shape[1] // m][:, :m])
    residual, sample = np.empty(m), np.ones((8, SAMPLE))
    best, best_cost, best_loose = start.copy(), np.inf, np.inf
    H, g, step = np.empty((5, 5)), np.empty(5), np.empty(5)
    state = np.uint64(20230139)  # the sampling is part of the method: the same points give the same pose
    needed, drawn = float(hypotheses), 0
    while drawn < needed:
        candidate = start.copy()
        if drawn == 0:  # the first hypothesis is the fit to all
            fitted = _fitted(some, candidate, EVERYTHING, H, g, step, residual)
        else:
            for k in range(SAMPLE):
                state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
                sample[:, k] = some[:, int((state >> np.uint64(33)) % np.uint64(m))]
            fitted = _fitted(sample, candidate, EVERYTHING, H, g, step, residual)
        drawn += 1
        if not fitted:
            continue
        residuals(some, candidate, residual)
        loose = _cost(residual, PROMISING * INLIER_SIGMAS)
        if not loose < NEARLY_BEST * best_loose:
            continue
        best_loose = min(loose, best_loose)
        refitted = candidate.copy()
        if _fitted(some, refitted, PROMISING * INLIER_SIGMAS, H, g, step, residual):
            candidate = refitted
        residuals(some, candidate, residual)
        cost = _cost(residual, INLIER_SIGMAS)
        if cost < best_cost:
            best, best_cost = candidate, cost
            dirty = 1.0 - np.mean(np.abs(residual) < INLIER_SIGMAS) ** SAMPLE
            needed = min(float(hypotheses), _draws(dirty))
    residuals(some, best, residual)
    return best, max(scale_about_zero(residual), SMALLEST_SCALE)


@njit(cache=True)
def _draws(dirty):
    """How many samples it takes until one without outliers is as good as sure, if so many of them have some."""
    if dirty <= MISSED:
        return 1.0
    return np.log(MISSED) / np.log(dirty) if dirty < 1.0 else np.inf


@njit(cache=True, fastmath=True)
def _cost(residual, threshold):
    total = 0.0
    for i in range(residual.size):
        u = residual[i] / threshold
        total += min(u * u, 1.0)
    return total


@njit(cache=True)
def _fitted(packed, cylinder, cut, H, g, step, residual):
    """Fit a cylinder in place to what lies within the cut: damped, for a few points may hardly fix a tilt."""
    for _ in range(SAMPLE_STEPS):
        normal_matrix(packed, cylinder, cut, H, g, residual[: packed.shape[1]])
        if not solve(H, g, SAMPLE_DAMPING, step):
            return False
        cylinder[:] = moved(cylinder, step)
        if not (cylinder[5] > 0.2 and cylinder[6] > 0.0):
            return False
    return True
