"""The fit of the projector's cones to where slits were seen, on boards or in a pipe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from algorithms.calibration.cones import Cones, excess_and_slopes, excess_rad
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.surfaces import Surface
from algorithms.robust import spread
from sensor_model.geometry import cone_frame, projector_azimuth_rad

STEPS, SETTLED = 40, 1e-6  # of the likelihood
ROUNDS = 3  # of measuring how many points err alike
CUT_SIGMAS, LEAST_SIGMA_RAD = 3.0, 2e-5
LEAST_POINTS = 20  # of one slit
WORST_CONDITION = 1e10
ALIKE_CELLS = 36  # around the slide: what errs alike there is its print, on whatever it is seen
TURN_RAD = 1e-5
FIRST_APEX_MM = (0.0, 0.0, -50.0)


class Sight(NamedTuple):
    """Slit pixels of one picture: unit rays (camera frame), their slits, and what they were seen on.

    `sigma_rad` is the standard deviation of a ray's angle to the optical axis, `jag_rad` what the slide is known to add
    to the half angle.
    """

    ray: Float[np.ndarray, "n 3"]
    slit: Int[np.ndarray, "n"]
    on: Surface
    sigma_rad: Float[np.ndarray, "n"]
    jag_rad: Float[np.ndarray, "n"] | float = 0.0


@dataclass(frozen=True)
class ConeFit:
    """The cones of least squares, and their evidence.

    `covariance` is of the unknowns in their order: apex, two tilts of the axis, half angles, common unknowns of the
    surfaces. `own` are the changes of each picture's surface. `excess_rad` is how much further out than its cone a
    point's light goes; `inliers` what had a say. `alike` is how many points err alike, as measured.
    """

    cones: Cones
    covariance: Float[np.ndarray, "unknowns unknowns"]
    own: tuple[Float[np.ndarray, "_"], ...]
    common: Float[np.ndarray, "common"]
    xyz_mm: Float[np.ndarray, "n 3"]
    slit: Int[np.ndarray, "n"]
    picture: Int[np.ndarray, "n"]
    excess_rad: Float[np.ndarray, "n"]
    inliers: Bool[np.ndarray, "n"]
    alike: float

    @property
    def std(self) -> Float[np.ndarray, "unknowns"]:
        """Standard deviations of the unknowns."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def distance_mm(self) -> Float[np.ndarray, "n"]:
        """How far each point lies outside its cone."""
        return self.excess_rad * np.linalg.norm(self.xyz_mm - self.cones.apex_mm[self.slit], axis=1)

    def rms_mm(self, slit: int | None = None) -> float:
        """RMS distance of the inliers, of all slits or one, from their cones."""
        mine = self.inliers if slit is None else self.inliers & (self.slit == slit)
        return float(np.sqrt(np.mean(self.distance_mm[mine] ** 2)))


class _Part(NamedTuple):
    """One picture, linearised: points, excess, its variance by the rays' noise, slopes by shared and own unknowns."""

    xyz_mm: Float[np.ndarray, "n 3"]
    excess_rad: Float[np.ndarray, "n"]
    noise2: Float[np.ndarray, "n"]
    by_shared: Float[np.ndarray, "n shared"]
    by_own: Float[np.ndarray, "n own"]


class _State(NamedTuple):
    cones: Cones
    own: list[np.ndarray]
    common: np.ndarray


def first_cones(sights: Sequence[Sight], slits: int) -> Cones:
    """A start for boards whose places are roughly known: the light comes from behind the camera, straight ahead."""
    apex, axis = np.tile(FIRST_APEX_MM, (slits, 1)), np.array([0.0, 0.0, 1.0])
    nothing = Cones(apex, axis, np.zeros(slits))
    angle = [excess_rad(points_mm(one, np.zeros(len(one.on.held)), np.zeros(0)), one.slit, nothing) for one in sights]
    slit, each = np.concatenate([one.slit for one in sights]), np.concatenate(angle)
    return replace(nothing, half_angle_rad=np.array([np.median(each[slit == j]) if (slit == j).any() else np.nan
                                                     for j in range(slits)]))  # fmt: skip


def fit_cones(
    sights: Sequence[Sight],
    start: Cones,
    prior: Float[np.ndarray, "cones cones"] | None = None,
    common: Float[np.ndarray, "common"] | None = None,
    own_apex: bool = False,
) -> ConeFit:
    """Gauss-Newton on the angles by which points leave their cones, together with what the points lie on.

    A point counts by the noise of its ray and the roughness of its slit, as measured; what lies far off is cut. Points
    of one place on the slide err alike, whatever they are seen on; by how much more than chance the fit measures, and
    counts them for so much less. `prior` is what is known of apex, axis and half angles: information about `start`.
    Without it the half angle of a slit that is not seen is NaN.

    Raises:
        CannotCalibrate: where the points leave the cones open.
    """
    common = np.zeros(0) if common is None else common
    _check(sights, start)
    slits = start.half_angle_rad.size
    shared = _angles_from(slits, own_apex) + slits + common.size
    information = np.zeros((shared, shared))
    if prior is not None:
        information[: len(prior), : len(prior)] = prior
    slit = np.concatenate([one.slit for one in sights])
    if prior is None:
        unseen = np.bincount(slit, minlength=slits) == 0
        start = replace(start, half_angle_rad=np.where(unseen, np.nan, start.half_angle_rad))
        open_ones = _angles_from(slits, own_apex) + np.flatnonzero(unseen)
        information[open_ones, open_ones] = 1.0
    state = _State(start, [np.zeros(len(one.on.held)) for one in sights], common)
    moved, kept, alike, rough = np.zeros(shared), np.ones(slit.size, dtype=bool), 1.0, np.full(slits, np.inf)
    for _ in range(ROUNDS):
        for _ in range(STEPS):
            parts = [
                _where_likely(one, own, state, own_apex, rough) for one, own in zip(sights, state.own, strict=True)
            ]
            excess = np.concatenate([part.excess_rad for part in parts])
            noise2 = np.concatenate([part.noise2 for part in parts])
            rough = _roughness(excess, noise2, slit, kept, slits)
            variance = rough[slit] ** 2 + noise2
            kept = _inliers(excess / np.sqrt(variance), slit, kept, slits)
            weight = kept / (alike * variance)
            H, step, own_steps, levers = _solved(sights, parts, weight, state, information, moved)
            state = _stepped(state, step, own_steps, own_apex)
            moved = moved + step
            if float(step @ H @ step) < SETTLED:
                break
        by_cell = _by_cell(state.cones, parts, slit, levers * (weight * excess)[:, None])
        stated = levers.T @ (weight[:, None] * levers)
        alike = max(alike * _share(by_cell, stated), 1.0)
    xyz = np.concatenate([part.xyz_mm for part in parts])
    picture = np.repeat(np.arange(len(sights)), [one.slit.size for one in sights])
    inverse = np.linalg.inv(H)  # as if points erred by themselves and all alike; Huber's sandwich needs neither
    covariance = inverse + inverse @ (by_cell.T @ by_cell - stated) @ inverse
    return ConeFit(state.cones, covariance, tuple(state.own), state.common, xyz, slit, picture, excess, kept, alike)


def _check(sights: Sequence[Sight], start: Cones) -> None:
    slit = np.concatenate([one.slit for one in sights])
    count = np.bincount(slit, minlength=start.half_angle_rad.size)
    if count.size > start.half_angle_rad.size:
        raise CannotCalibrate(f"points of {count.size} slits; the rig has {start.half_angle_rad.size}")
    if not all(np.isfinite(one.ray).all() for one in sights):
        raise CannotCalibrate("rays that are not finite")
    few = np.flatnonzero((count < LEAST_POINTS) & (count > 0))
    if few.size or not count.any():
        j = int(few[0]) if few.size else 0
        raise CannotCalibrate(f"slit {j + 1}: {count[j]} points; at least {LEAST_POINTS} are needed")


def _angles_from(slits: int, own_apex: bool) -> int:
    """Where the half angles begin among the unknowns: after the apexes and two tilts."""
    return (3 * slits if own_apex else 3) + 2


def points_mm(one: Sight, own: Float[np.ndarray, "own"], common: Float[np.ndarray, "common"]) -> np.ndarray:
    """Where the rays meet the surface, camera frame."""
    return one.on.range_mm(one.ray, own, common)[:, None] * one.ray


def _where_likely(one: Sight, own: np.ndarray, state: _State, own_apex: bool, rough: np.ndarray) -> _Part:
    """The picture linearised where its points likely are, not where noise puts them.

    Slopes taken at a noisy place go along with its noise, which bends a fit of many points away from the truth. Of what
    a point lies off its cone, its ray has that share which its noise has beside the roughness of its slit.
    """
    xyz = points_mm(one, own, state.common)
    excess = excess_rad(xyz, one.slit, state.cones) - one.jag_rad
    beside = one._replace(ray=_turned_out(one.ray, np.full(len(one.ray), TURN_RAD)))
    further = excess_rad(points_mm(beside, own, state.common), one.slit, state.cones) - one.jag_rad
    lever = (further - excess) / TURN_RAD
    noise2 = (lever * one.sigma_rad) ** 2
    turn = -excess * lever * one.sigma_rad**2 / (rough[one.slit] ** 2 + noise2)
    part = _linear(one._replace(ray=_turned_out(one.ray, turn)), own, state, own_apex)
    return part._replace(xyz_mm=xyz, excess_rad=part.excess_rad - lever * turn, noise2=noise2)


def _turned_out(ray: Float[np.ndarray, "n 3"], turn_rad: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """Rays turned away from the optical axis."""
    aside = np.hypot(ray[:, 0], ray[:, 1])
    out = np.column_stack([ray[:, :2] * (ray[:, 2] / aside)[:, None], -aside])
    return np.cos(turn_rad)[:, None] * ray + np.sin(turn_rad)[:, None] * out


def _linear(one: Sight, own: np.ndarray, state: _State, own_apex: bool) -> _Part:
    range_mm = one.on.range_mm(one.ray, own, state.common)
    range_by_own, range_by_common = one.on.slopes(one.ray, range_mm, own, state.common)
    xyz = range_mm[:, None] * one.ray
    excess, by_point, outward = excess_and_slopes(xyz, one.slit, state.cones)
    slits, n = state.cones.half_angle_rad.size, one.slit.size
    by_shared = np.zeros((n, _angles_from(slits, own_apex) + slits + state.common.size))
    first = 3 * one.slit if own_apex else np.zeros(n, dtype=np.int64)
    np.put_along_axis(by_shared, first[:, None] + np.arange(3), -by_point, axis=1)
    angles = _angles_from(slits, own_apex)
    # the axis turns towards the point: the angle between them becomes smaller by as much
    by_shared[:, angles - 2 : angles] = -outward @ cone_frame(state.cones.axis)[:, :2]
    by_shared[np.arange(n), angles + one.slit] = -1.0
    by_range = np.einsum("ni,ni->n", by_point, one.ray)[:, None]
    by_shared[:, angles + slits :] = by_range * range_by_common
    return _Part(xyz, excess - one.jag_rad, np.zeros(n), by_shared, by_range * range_by_own)


def _roughness(
    excess: np.ndarray, noise2: np.ndarray, slit: np.ndarray, kept: np.ndarray, slits: int
) -> Float[np.ndarray, "slits"]:
    """How far the points of each slit scatter beyond the noise of their rays."""
    out = np.full(slits, LEAST_SIGMA_RAD)
    for j in range(slits):
        mine = (slit == j) & kept
        if mine.any():
            out[j] = max(spread(excess[mine]) ** 2 - float(np.median(noise2[mine])), LEAST_SIGMA_RAD**2) ** 0.5
    return out


def _inliers(sigmas: np.ndarray, slit: np.ndarray, kept: np.ndarray, slits: int) -> Bool[np.ndarray, "n"]:
    """What lies near its slit's own middle; `sigmas` are standard deviations off the cone."""
    out = np.zeros(slit.size, dtype=bool)
    for j in range(slits):
        mine = slit == j
        if (mine & kept).any():
            out[mine] = np.abs(sigmas[mine] - np.median(sigmas[mine & kept])) < CUT_SIGMAS
    return out


def _solved(
    sights: Sequence[Sight],
    parts: Sequence[_Part],
    weight: np.ndarray,
    state: _State,
    information: np.ndarray,
    moved: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], np.ndarray]:
    """Information on the shared unknowns with each surface's own solved for, the steps, and the levers that remain.

    Raises:
        CannotCalibrate: where it leaves one of them open.
    """
    H, g = information.copy(), information @ moved
    solved, levers, first = [], [], 0
    for one, part, own in zip(sights, parts, state.own, strict=True):
        w = weight[first : first + part.excess_rad.size, None]
        first += part.excess_rad.size
        D, d = part.by_own.T @ (w * part.by_own) + one.on.held, part.by_own.T @ (w[:, 0] * part.excess_rad)
        B = part.by_shared.T @ (w * part.by_own)
        share = np.linalg.solve(D, B.T) if len(D) else np.zeros((0, len(H)))
        d = d + one.on.held @ own
        H += part.by_shared.T @ (w * part.by_shared) - B @ share
        g = g + part.by_shared.T @ (w[:, 0] * part.excess_rad) - share.T @ d
        solved.append((D, d, share))
        levers.append(part.by_shared - part.by_own @ share)
    scale = np.sqrt(np.diag(H))
    if not (scale > 0).all() or np.linalg.cond(H / np.outer(scale, scale)) > WORST_CONDITION:
        raise CannotCalibrate("the boards leave the cones open: put the board nearer and further, and tilt it")
    step = -np.linalg.solve(H, g)
    own_steps = [-np.linalg.solve(D, d) - share @ step if len(D) else d for D, d, share in solved]
    return H, step, own_steps, np.concatenate(levers)


def _stepped(state: _State, step: np.ndarray, own_steps: list[np.ndarray], own_apex: bool) -> _State:
    cones = state.cones
    slits = cones.half_angle_rad.size
    angles = _angles_from(slits, own_apex)
    tilted = cone_frame(cones.axis) @ np.array([step[angles - 2], step[angles - 1], 1.0])
    moved = Cones(
        cones.apex_mm + step[: angles - 2].reshape(-1, 3),
        tilted / np.linalg.norm(tilted),
        cones.half_angle_rad + step[angles : angles + slits],
    )
    own = [before + change for before, change in zip(state.own, own_steps, strict=True)]
    return _State(moved, own, state.common + step[angles + slits :])


def _by_cell(
    cones: Cones, parts: Sequence[_Part], slit: np.ndarray, pull: Float[np.ndarray, "n shared"]
) -> Float[np.ndarray, "cells shared"]:
    """The points' pull on the shared unknowns, summed over each place on the slide."""
    azimuth = projector_azimuth_rad(np.concatenate([part.xyz_mm for part in parts]), cones.T_camera_projector)
    cell = slit * ALIKE_CELLS + (azimuth / (2 * np.pi) * ALIKE_CELLS).astype(np.int64) % ALIKE_CELLS
    return np.stack([np.bincount(cell, weights=column) for column in pull.T], axis=1)


def _share(by_cell: Float[np.ndarray, "cells shared"], stated: Float[np.ndarray, "shared shared"]) -> float:
    """How many times more that scatters than it is stated to: the mean of the unknowns."""
    chance = np.diag(stated)
    return float(np.mean(np.sum(by_cell[:, chance > 0] ** 2, axis=0) / chance[chance > 0]))
