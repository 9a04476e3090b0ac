"""Registration by a cylinder fit with RANSAC (section 3.1, Eqs 4 to 10): the paper's method."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field

from algorithms.registration.fusion import fuse
from algorithms.robust import MAD_TO_SIGMA
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import swing_onto, transform
from sensor_model.settings import Settings

SAMPLE = 10
SAMPLE_STEPS, SAMPLE_DAMPING = 4, 1e-3
SUBSAMPLE = 600
REFINEMENTS = 20
MIN_POINTS = 30
SEED = 20230139  # the sampling is part of the method: the same points give the same pose


class CylinderSettings(Settings):
    """Settings of the cylinder fit."""

    kind: Literal["cylinder"] = "cylinder"
    radius: Literal["free", "held"] = "free"
    hypotheses: Annotated[int, Field(ge=1, le=10_000)] = 60
    inlier_sigmas: Annotated[float, Field(gt=1, le=10)] = 3.0
    min_inlier_share: Annotated[float, Field(gt=0, lt=1)] = 0.3


class CylinderFit(NamedTuple):
    """An infinite cylinder in the points' own frame: `axis` through `center_mm`, and how it was fitted.

    `sigma_scale` says by how much the points scatter more than their stated standard deviations.
    """

    center_mm: np.ndarray
    axis: np.ndarray
    radius_mm: float
    inliers: np.ndarray
    sigma_scale: float
    converged: bool


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: CylinderSettings) -> Alignment:
    """Where the camera is across the pipe and how it is tilted; travel and roll are taken from the prior.

    The residual is the distance of a point from the cylinder, in units of its standard deviation across the wall. To
    first order this is Eq. 10, whose distance runs along the ray: both are the same range error over the same slope.
    """
    n, pipe = points.sigma_mm.size, wall.pipe
    if n < MIN_POINTS:
        return failed(prior, n, f"{n} points; at least {MIN_POINTS} are needed")
    if not np.isfinite(points.xyz_mm).all():
        return failed(prior, n, "points that are not finite")
    across = np.linalg.norm(points.direction[:, :2], axis=1)
    sigma = np.maximum(points.sigma_mm * np.maximum(across, 0.1), 1e-6)
    held = pipe.inner_radius_mm if settings.radius == "held" else 0.0
    start = np.array([0.0, 0.0, 0.0, 0.0, pipe.inner_radius_mm])
    thinned = slice(None, None, max(n // SUBSAMPLE, 1))
    some, some_sigma = np.ascontiguousarray(points.xyz_mm[thinned]), np.ascontiguousarray(sigma[thinned])
    samples = np.random.default_rng(SEED).integers(some_sigma.size, size=(settings.hypotheses, SAMPLE))
    parameters, z_mid = _consensus(some, some_sigma, start, held > 0, samples)
    fit = refine(points.xyz_mm, sigma, parameters, z_mid, held > 0, settings.inlier_sigmas)
    share = fit.inliers.mean()
    if not fit.converged:
        return failed(prior, n, "the fit did not settle")
    if share < settings.min_inlier_share:
        return failed(prior, n, f"only {share:.0%} of the points lie on one cylinder")
    if not 0.5 < fit.radius_mm / pipe.inner_radius_mm < 1.5:
        return failed(prior, n, f"radius {fit.radius_mm:.1f} mm in a pipe of {pipe.inner_radius_mm:.1f} mm")
    return fuse(prior, _alignment(points, sigma, fit, prior, held > 0))


def _alignment(points: RingPoints, sigma: np.ndarray, fit: CylinderFit, prior: Alignment, held: bool) -> Alignment:
    """The pose whose axis is the fitted one, turned and moved along it as the prior says (Eqs 4 to 6)."""
    R_prior = prior.T_pipe_camera[:3, :3]
    z = np.array([0.0, 0.0, 1.0])
    axis = fit.axis if (R_prior @ fit.axis)[2] > 0 else -fit.axis
    R_pipe_camera = swing_onto(R_prior @ axis, z) @ R_prior
    shift = -R_pipe_camera @ fit.center_mm
    T_pipe_camera = transform(R_pipe_camera, np.array([shift[0], shift[1], prior.T_pipe_camera[2, 3]]))

    lever = points.xyz_mm[fit.inliers] @ R_pipe_camera.T
    normal = lever + np.array([shift[0], shift[1], 0.0])
    normal[:, 2] = 0.0
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ones = np.ones((normal.shape[0], 1))
    J = np.hstack([normal, np.cross(lever, normal), -ones]) / (sigma[fit.inliers, None] * fit.sigma_scale)
    information = J.T @ J
    if not held:  # the radius is estimated too: what it costs is taken off (Schur complement)
        information[:6, :6] -= np.outer(information[:6, 6], information[6, :6]) / information[6, 6]
    return Alignment(
        T_pipe_camera, information[:6, :6], fit.inliers, radius_mm=fit.radius_mm, noise_scale=fit.sigma_scale
    )


def refine(
    xyz_mm: Float[np.ndarray, "n 3"],
    sigma_mm: Float[np.ndarray, "n"],
    start: Float[np.ndarray, "5"],
    z_mid: float,
    hold_radius: bool,
    inlier_sigmas: float,
) -> CylinderFit:
    """Gauss-Newton on the inliers, which are chosen anew at every step by a scale taken from the data."""
    parameters, inliers, scale, converged = _refine(xyz_mm, sigma_mm, start, z_mid, hold_radius, inlier_sigmas)
    axis = np.array([parameters[2], parameters[3], 1.0])
    center = np.array([parameters[0], parameters[1], z_mid])
    return CylinderFit(
        center, axis / np.linalg.norm(axis), float(parameters[4]), inliers, float(scale), bool(converged)
    )


def fit_cylinder(xyz_mm: Float[np.ndarray, "n 3"], directions: int = 60) -> CylinderFit:
    """Least-squares cylinder of any attitude through all points: the best over starts spread over the half sphere.

    Raises:
        ValueError: when no start settles (too few points, or points on a line or a plane).
    """
    middle = xyz_mm.mean(axis=0)
    sigma, everything = np.ones(xyz_mm.shape[0]), np.inf
    best, best_cost, best_turn = None, np.inf, np.eye(3)
    for k in range(directions):
        cosine = (k + 0.5) / directions
        turn = np.pi * (1 + 5**0.5) * k
        axis = np.array([np.cos(turn) * np.sqrt(1 - cosine**2), np.sin(turn) * np.sqrt(1 - cosine**2), cosine])
        R = swing_onto(axis, np.array([0.0, 0.0, 1.0]))
        local = (xyz_mm - middle) @ R.T
        reach = float(np.hypot(local[:, 0], local[:, 1]).mean())
        fit = refine(local, sigma, np.array([0.0, 0.0, 0.0, 0.0, reach]), 0.0, False, everything)
        if fit.converged:
            cost = float(np.sum(_distances(local, fit.center_mm, fit.axis, fit.radius_mm) ** 2))
            if cost < best_cost * (1 - 1e-9):
                best, best_cost, best_turn = fit, cost, R
    if best is None:
        raise ValueError(f"no cylinder through these {xyz_mm.shape[0]} points")
    return best._replace(center_mm=best.center_mm @ best_turn + middle, axis=best.axis @ best_turn)


def _distances(xyz: np.ndarray, center: np.ndarray, axis: np.ndarray, radius: float) -> np.ndarray:
    """Signed distance of each point from a cylinder (Eq. 8 about any axis)."""
    return np.linalg.norm(np.cross(xyz - center, axis), axis=1) - radius


@njit(cache=True)
def _consensus(xyz, sigma, start, hold_radius, samples):
    """RANSAC: of the cylinders through sampled points (rows of indices), the one with the smallest median residual."""
    z_mid = np.mean(xyz[:, 2])
    residual = np.empty(sigma.size)
    weight = np.ones(samples.shape[1])
    _residuals(xyz, sigma, start, z_mid, residual)
    best, best_cost = start, np.median(np.abs(residual))
    for h in range(samples.shape[0]):
        candidate = best.copy()
        for _ in range(SAMPLE_STEPS):
            # damped: ten points may hardly fix a tilt
            candidate, _length = _step(
                xyz[samples[h]], sigma[samples[h]], weight, candidate, z_mid, hold_radius, SAMPLE_DAMPING
            )
        _residuals(xyz, sigma, candidate, z_mid, residual)
        cost = np.median(np.abs(residual))
        if cost < best_cost:
            best, best_cost = candidate, cost
    return best, z_mid


@njit(cache=True)
def _refine(xyz, sigma, start, z_mid, hold_radius, inlier_sigmas):
    n = xyz.shape[0]
    parameters = start.copy()
    residual, weight = np.empty(n), np.ones(n)
    scale, converged = 1.0, False
    for _ in range(REFINEMENTS if inlier_sigmas < np.inf else 200):
        _residuals(xyz, sigma, parameters, z_mid, residual)
        if inlier_sigmas < np.inf:
            scale = max(MAD_TO_SIGMA * np.median(np.abs(residual)), 1e-9)
            # a second look at the scale, without what is surely no wall, keeps it true under many outliers
            scale = max(MAD_TO_SIGMA * np.median(np.abs(residual[np.abs(residual) < inlier_sigmas * scale])), 1e-9)
            for i in range(n):
                u = residual[i] / (inlier_sigmas * 1.5 * scale)
                weight[i] = (1.0 - u * u) ** 2 if abs(u) < 1.0 else 0.0  # Tukey's biweight
        parameters, length = _step(xyz, sigma, weight, parameters, z_mid, hold_radius, 0.0)
        if not np.isfinite(length):
            break
        if length < 1e-7 if inlier_sigmas < np.inf else length < 1e-12 * (1.0 + abs(parameters[4])):
            converged = True
            break
    _residuals(xyz, sigma, parameters, z_mid, residual)
    return parameters, np.abs(residual) < inlier_sigmas * scale, scale, converged


@njit(cache=True)
def _residuals(xyz, sigma, parameters, z_mid, out):
    """Distance from the cylinder in standard deviations (Eqs 8 and 10)."""
    cx, cy, ax, ay, radius = parameters
    norm2 = 1.0 + ax * ax + ay * ay
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0] - cx, xyz[i, 1] - cy, xyz[i, 2] - z_mid
        along = (x * ax + y * ay + z) / norm2
        dx, dy, dz = x - along * ax, y - along * ay, z - along
        out[i] = (np.sqrt(dx * dx + dy * dy + dz * dz) - radius) / sigma[i]


@njit(cache=True)
def _step(xyz, sigma, weight, parameters, z_mid, hold_radius, damping):
    """One Gauss-Newton step in centre (x, y), axis slope (x, y) and radius; its length is NaN where singular."""
    cx, cy, ax, ay, radius = parameters
    norm2 = 1.0 + ax * ax + ay * ay
    H, g = np.zeros((5, 5)), np.zeros(5)
    J = np.empty(5)
    for i in range(xyz.shape[0]):
        if weight[i] == 0.0:
            continue
        x, y, z = xyz[i, 0] - cx, xyz[i, 1] - cy, xyz[i, 2] - z_mid
        along = (x * ax + y * ay + z) / norm2
        dx, dy, dz = x - along * ax, y - along * ay, z - along
        rho = np.sqrt(dx * dx + dy * dy + dz * dz)
        if rho == 0.0:
            continue
        nx, ny = dx / rho, dy / rho
        J[0], J[1], J[2], J[3], J[4] = -nx, -ny, -along * nx, -along * ny, -1.0
        w = weight[i] / (sigma[i] * sigma[i])
        for a in range(5):
            g[a] += w * J[a] * (rho - radius)
            for b in range(a + 1):
                H[a, b] += w * J[a] * J[b]
    for a in range(5):
        for b in range(a):
            H[b, a] = H[a, b]
    size = 5
    if hold_radius:
        size = 4
    scale = np.empty(size)
    for a in range(size):
        if H[a, a] <= 0.0:
            return parameters, np.nan
        scale[a] = 1.0 / np.sqrt(H[a, a])
    A = np.empty((size, size))
    for a in range(size):
        for b in range(size):
            A[a, b] = H[a, b] * scale[a] * scale[b]
        A[a, a] += damping
    if abs(np.linalg.det(A)) < 1e-14:
        return parameters, np.nan
    delta = -np.linalg.solve(A, g[:size] * scale) * scale
    out = parameters.copy()
    out[:size] += delta
    reach = 100.0  # the slope counts by how far it moves a wall point
    length = np.sqrt(delta[0] ** 2 + delta[1] ** 2 + (reach * delta[2]) ** 2 + (reach * delta[3]) ** 2)
    return out, length
