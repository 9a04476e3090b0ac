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
from algorithms.registration.ray_fit import pack, pull
from algorithms.registration.robust_start import begun
from algorithms.registration.settle import DONE, NOT_FINITE, REASONS, UNDETERMINED, WORKING, settle
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.settings import Settings

WEAK_SHARE, WEAK_SCALE = 0.5, 10.0
CHI2_4_999 = 18.47  # of four degrees of freedom, exceeded once in a thousand
LEAST_SHARE = 0.3
LOOSEST_MM, LOOSEST_RAD = 1.0, np.radians(1.0)
WEAK_PART = 1 / 3
DISBELIEF_SIGMAS = 3.0
LEAST_RADIUS, MOST_RADIUS = 0.7, 1.4


class CylinderMapSettings(Settings):
    """Settings of the likeliest cylinder.

    `radius_std_pct` says how well the nominal radius is known (None: not at all); a radius that the points contradict
    is let go, and said. `ovality_std_pct` above 0 lets the pipe be oval by about so much of its radius.
    """

    kind: Literal["cylinder-map"] = "cylinder-map"
    radius_std_pct: Annotated[float, Field(gt=0, le=20)] | None = 1.0
    ovality_std_pct: Annotated[float, Field(ge=0, le=10)] = 0.0


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
    """What is known before the points: information on centre, slope, radius and, where the pipe may be oval, that."""
    known = np.zeros((7, 7) if settings.ovality_std_pct > 0 else (5, 5))
    known[:4, :4] = information_of_axis(prior.information, start, prior.T_pipe_camera)
    if settings.radius_std_pct is not None:
        known[4, 4] = (settings.radius_std_pct / 100 * start[6]) ** -2
    if settings.ovality_std_pct > 0:
        known[5, 5] = known[6, 6] = (settings.ovality_std_pct / 100 * start[6]) ** -2
    return known


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
