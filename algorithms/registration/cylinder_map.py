"""Registration by the likeliest cylinder, given each point's own error and the prior; it says how sure it is."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numba import njit
from pydantic import Field

from algorithms.registration.checks import MIN_POINTS, flat
from algorithms.registration.cylinder_pose import (
    ahead_mm,
    information_of_axis,
    information_of_pose,
    looseness,
    pose_of,
    start_of,
    without,
)
from algorithms.registration.ray_fit import normal_matrix, pack, pull, solve
from algorithms.registration.robust_start import begun
from algorithms.registration.settle import CUT_SIGMAS, DONE, NOT_FINITE, REASONS, UNDETERMINED, WORKING, settle
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.settings import Settings

WEAK_SHARE, WEAK_SCALE = 0.5, 10.0
CHI2_4_999 = 18.47  # of four degrees of freedom, exceeded once in a thousand
LEAST_SHARE = 0.3
LOOSEST_MM, LOOSEST_RAD = 1.0, np.radians(1.0)
WEAK_PART = 1 / 3
DISBELIEF_SIGMAS = 3.0
LEAST_RADIUS, MOST_RADIUS = 0.7, 1.4
CHI2_2_999 = 13.8  # of two degrees of freedom, exceeded once in a thousand
LEAST_OVAL = 5e-4  # of the radius
ASKED = 1000  # inliers are enough to tell


class CylinderMapSettings(Settings):
    """Settings of the likeliest cylinder.

    `radius_std_pct` says how well the nominal radius is known (None: not at all); a radius that the points contradict
    is let go, and said. A round wall that they contradict is let be oval, by about `ovality_std_pct` of its radius (0:
    never).
    """

    kind: Literal["cylinder-map"] = "cylinder-map"
    radius_std_pct: Annotated[float, Field(gt=0, le=20)] | None = 1.0
    ovality_std_pct: Annotated[float, Field(ge=0, le=10)] = 1.0


class Fit(NamedTuple):
    """A cylinder in the camera's frame, what the points alone say of it, which they are, and how they scatter."""

    cylinder: Float[np.ndarray, "9"]
    H: Float[np.ndarray, "terms terms"]
    inliers: Bool[np.ndarray, "n"]
    scale: float
    status: int


class Worth(NamedTuple):
    """What the posterior pose is worth; `alone` are the same without the prior, `chi2` how the prior disagrees."""

    center_std_mm: float
    tilt_std_rad: float
    center_std_alone_mm: float
    tilt_std_alone_rad: float
    chi2: float


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: CylinderMapSettings) -> Alignment:
    """The posterior: where prior and points together put the camera; travel and roll are the prior's alone."""
    n, nominal = points.sigma_mm.size, wall.pipe.inner_radius_mm
    if n < MIN_POINTS:
        return failed(prior, n, f"{n} points; at least {MIN_POINTS} are needed")
    measured = points.xyz_mm, points.direction, points.sigma_mm
    start = start_of(points.xyz_mm, prior.T_pipe_camera, nominal)
    known = _known(prior, start, settings)
    fit = Fit(*_fit(*measured, start, known, nominal))
    may_be_oval = fit.status == DONE and settings.ovality_std_pct > 0
    if may_be_oval and _is_oval(*measured, fit.cylinder, fit.inliers, fit.scale):
        known = _with_oval(known, settings.ovality_std_pct / 100 * start[6])
        fit = Fit(*_fit(*measured, start, known, nominal))
    doubts = []
    if fit.status == DONE and _contradicted(fit, known, nominal):
        known[4, 4] = 0.0
        fit = Fit(*_fit(*measured, start, known, nominal))
        doubts.append(f"the radius is {fit.cylinder[6]:.2f} mm, not near the nominal {nominal:g} mm")
    share = np.count_nonzero(fit.inliers) / n
    wrong = _what_is_wrong(fit, share, nominal) or flat(points.xyz_mm, points.sigma_mm)
    if wrong:
        return failed(prior, n, wrong)
    T_pipe_camera, information, worth = _posed(fit.cylinder, fit.H, known, start, prior.T_pipe_camera)
    worth = Worth(*worth)
    if worth.center_std_mm > LOOSEST_MM or worth.tilt_std_rad > LOOSEST_RAD:
        return failed(prior, n, _loose(worth))
    return Alignment(
        T_pipe_camera,
        prior.information + information,
        fit.inliers,
        reason="; ".join(doubts + _doubts(fit, share, worth)),
        radius_mm=float(fit.cylinder[6]),
        noise_scale=fit.scale,
    )


def _what_is_wrong(fit: Fit, share: float, nominal: float) -> str:
    if fit.status != DONE:
        return REASONS[fit.status]
    if share < LEAST_SHARE:
        return f"only {share:.0%} of the points lie on one cylinder"
    if not LEAST_RADIUS < fit.cylinder[6] / nominal < MOST_RADIUS:
        return f"radius {fit.cylinder[6]:.1f} mm in a pipe of {nominal:.1f} mm"
    return ""


def _known(prior: Alignment, start: np.ndarray, settings: CylinderMapSettings) -> np.ndarray:
    """What is known before the points: information on centre, slope and radius."""
    known = np.zeros((5, 5))
    known[:4, :4] = information_of_axis(prior.information, start, prior.T_pipe_camera)
    if settings.radius_std_pct is not None:
        known[4, 4] = (settings.radius_std_pct / 100 * start[6]) ** -2
    return known


def _with_oval(known: np.ndarray, std_mm: float) -> np.ndarray:
    """The same, and of an oval how large it may be."""
    return np.block([[known, np.zeros((5, 2))], [np.zeros((2, 5)), np.eye(2) / std_mm**2]])


@njit(cache=True)
def _is_oval(xyz, direction, sigma, cylinder, inliers, scale):
    """Whether the inliers of a round wall would lie on an oval one by more than chance, and more than is worth it."""
    every = max(np.count_nonzero(inliers) // ASKED, 1)
    packed, _ = pack(xyz, direction, sigma, 0, inliers.size, every)
    packed[7] = inliers[::every]
    H, g, step, residual = np.zeros((7, 7)), np.empty(7), np.empty(7), np.empty(packed.shape[1])
    normal_matrix(packed, cylinder, CUT_SIGMAS * scale, H, g, residual)
    if not solve(H, g, 0.0, step):
        return False
    own, oval = without(H, 0, 5), step[5:]
    chi2 = (own[0, 0] * oval[0] ** 2 + 2 * own[0, 1] * oval[0] * oval[1] + own[1, 1] * oval[1] ** 2) / scale**2
    return chi2 > CHI2_2_999 and np.hypot(oval[0], oval[1]) > LEAST_OVAL * cylinder[6]


@njit(cache=True)
def _contradicted(fit, known, nominal):
    """Whether the points alone put the radius further from the nominal one than both together allow."""
    others = known.copy()
    others[4, 4] = 0.0
    alone = without(without(fit.H + others, 5, known.shape[0]), 0, 4)[0, 0]
    if known[4, 4] == 0.0 or not alone > 0.0:
        return False
    gap = (fit.cylinder[6] - nominal) * (1.0 + known[4, 4] / alone)
    return abs(gap) > DISBELIEF_SIGMAS * np.sqrt(1.0 / alone + 1.0 / known[4, 4])


def _loose(worth: Worth) -> str:
    tilt_deg = np.degrees(worth.tilt_std_rad)
    return f"the centre is fixed only to {worth.center_std_mm:.2g} mm and the axis to {tilt_deg:.2g} deg"


def _doubts(fit: Fit, share: float, worth: Worth) -> list[str]:
    """What makes a settled fit weak: each in words."""
    doubts = []
    if worth.center_std_mm > WEAK_PART * LOOSEST_MM or worth.tilt_std_rad > WEAK_PART * LOOSEST_RAD:
        doubts.append(_loose(worth))
    if share < WEAK_SHARE:
        doubts.append(f"only {share:.0%} of the points lie on the wall")
    if fit.scale > WEAK_SCALE:
        doubts.append(f"the points scatter {fit.scale:.1f} times as much as they state")
    if worth.center_std_alone_mm > LOOSEST_MM or worth.tilt_std_alone_rad > LOOSEST_RAD:
        doubts.append("the pose rests on its prior")
    if worth.chi2 > CHI2_4_999:
        doubts.append("the prior's centre and tilt lie further away than it states")
    return doubts


@njit(cache=True)
def _posed(cylinder, H, known, start, T_prior):
    """The pose, what the points alone say of it, and the fields of `Worth`."""
    both = H.copy()
    for i in range(4, H.shape[0]):
        both[i, i] += known[i, i]
    axis = without(both, 4, H.shape[0])
    T = pose_of(cylinder, T_prior)
    ahead = ahead_mm(cylinder, T)
    center, tilt = looseness(axis + known[:4, :4], ahead)
    center_alone, tilt_alone = looseness(axis, ahead)
    gap, chi2 = pull(cylinder, start), 0.0
    for i in range(4):
        for j in range(4):
            chi2 += gap[i] * known[i, j] * gap[j]
    return T, information_of_pose(axis, cylinder, T), (center, tilt, center_alone, tilt_alone, chi2)


@njit(cache=True)
def _fit(xyz, direction, sigma, start, known, nominal):
    """The likeliest cylinder, what the points say of it, which they are, their scale, and a status."""
    n, terms = xyz.shape[0], known.shape[0]
    packed, finite = pack(xyz, direction, sigma, 0, n, (n + WORKING - 1) // WORKING)
    H, kept = np.zeros((terms, terms)), np.zeros(n, dtype=np.bool_)
    if not finite:
        return start, H, kept, np.nan, NOT_FINITE
    share = packed.shape[1] / n
    cylinder, scale, searched = begun(packed, start, known * share, nominal)
    if not scale < np.inf:
        return start, H, kept, np.nan, UNDETERMINED
    return settle(xyz, direction, sigma, packed, cylinder, scale, start, known, 0 if searched else 1)
