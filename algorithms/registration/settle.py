"""From a cylinder nearby to the likeliest one: reweighed steps over many points, and a last one over all."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.registration.ray_fit import TRUNCATED_SHARE, moved, normal_matrix, pack, pull, residuals, solve
from algorithms.registration.wall_cells import find_cells, is_wall, keep_wall, reach

WORKING, BLOCK = 12_000, 4096
CUT_SIGMAS, INLIER_SIGMAS = 4.0, 3.0
SMALLEST_SCALE, SCALE_PASSES = 1e-3, 2
STEPS, JUDGED_STEPS, CLOSE, CHANGED_PART = 12, 8, 0.1, 0.02
NEWTON = 1.09  # expected weight over expected slope of the influence, for a normal distribution
NEVER = STEPS  # the step from which on cells are judged, where they never are

DONE, NOT_FINITE, UNDETERMINED, UNSETTLED = range(4)
REASONS = {
    NOT_FINITE: "points that are not finite",
    UNDETERMINED: "the points do not fix a cylinder",
    UNSETTLED: "the fit did not settle",
}


@njit(cache=True)
def solved(cylinder, start, known, variance, H, g, step):
    """Solve for a step, with what was known before weighed against points of such a variance; False if singular."""
    terms = g.size
    gap = np.zeros(known.shape[0])
    gap[:5] = pull(cylinder, start)
    for a in range(5, terms):
        gap[a] = -cylinder[a + 2]
    both, right = H.copy(), g.copy()
    for a in range(terms):
        for b in range(terms):
            both[a, b] += variance * known[a, b]
            right[a] += variance * known[a, b] * gap[b]
    return solve(both, right, 0.0, step)


@njit(cache=True)
def settled(packed, cylinder, scale, start, known, first_judged, close, H):
    """Steps over the points in cells of wall until one is `close`: so short beside its own uncertainty.

    The cells are judged anew before each of the first steps, the scale before all.
    """
    n, terms = packed.shape[1], known.shape[0]
    g, step = np.empty(terms), np.empty(terms)
    residual, cell = np.empty(n), np.empty(n, dtype=np.int32)
    around, along = max(min(48, n // 200), 6), max(min(6, n // 300), 2)
    frame, wall, weight = cylinder, np.ones(around * along, dtype=np.bool_), 0.0
    low, high = reach(packed, frame)
    cells = (frame, low, high, around, along, wall)
    for k in range(STEPS):
        residuals(packed, cylinder, residual)
        changed = 0
        if first_judged <= k < JUDGED_STEPS:
            frame, before = cylinder, wall
            find_cells(packed, frame, low, high, around, along, cell)
            wall = is_wall(cell, residual, scale, wall.size)
            keep_wall(packed, cell, wall)
            changed = (wall != before).sum()
        scale = max(_scale_of_kept(packed, residual, scale), SMALLEST_SCALE)
        weight = normal_matrix(packed, cylinder, CUT_SIGMAS * scale, H, g, residual)
        cells = (frame, low, high, around, along, wall)
        if not weight > 0.0 or not solved(cylinder, start, known, scale * scale, H, g, step):
            return cylinder, scale, weight, cells, UNDETERMINED
        cylinder = moved(cylinder, NEWTON * step)
        if not (cylinder[5] > 0.2 and cylinder[6] > 0.0):
            return cylinder, scale, weight, cells, UNDETERMINED
        length2 = 0.0
        for a in range(terms):
            for b in range(terms):
                length2 += step[a] * H[a, b] * step[b]
        if k > 0 and length2 < (close * scale) ** 2 and changed <= CHANGED_PART * wall.size:
            return cylinder, scale, weight, cells, DONE
    return cylinder, scale, weight, cells, UNSETTLED


@njit(cache=True)
def label(packed, residual, scale, kept):
    """Label the points that lie on the cylinder, in cells of wall."""
    for i in range(kept.size):
        kept[i] = (abs(residual[i]) <= INLIER_SIGMAS * scale) & (packed[7, i] > 0.0)


@njit(cache=True, fastmath=True)
def _scale_of_kept(packed, residual, scale):
    """Standard deviation of what counts, from what lies within 2.5 of the last one: all points, in any order."""
    for _ in range(SCALE_PASSES):
        count, squares = 0.0, 0.0
        for i in range(residual.size):
            near = packed[7, i] if abs(residual[i]) <= 2.5 * scale else 0.0
            count += near
            squares += near * residual[i] * residual[i]
        scale = np.sqrt(squares / max(count, 1.0)) / TRUNCATED_SHARE
    return scale


@njit(cache=True)
def finished(xyz, direction, sigma, cylinder, scale, cells, start, known, H, kept):
    """One more step with every point, block by block; labels them and fills in what they say."""
    frame, low, high, around, along, wall = cells
    n, terms = xyz.shape[0], known.shape[0]
    here, g, right, step = np.empty((terms, terms)), np.empty(terms), np.zeros(terms), np.empty(terms)
    cell, residual, weight = np.empty(BLOCK, dtype=np.int32), np.empty(BLOCK), 0.0
    H[:] = 0.0
    for first in range(0, n, BLOCK):
        last = min(first + BLOCK, n)
        block, _ = pack(xyz, direction, sigma, first, last, 1)
        find_cells(block, frame, low, high, around, along, cell[: last - first])
        keep_wall(block, cell[: last - first], wall)
        weight += normal_matrix(block, cylinder, CUT_SIGMAS * scale, here, g, residual[: last - first])
        H += here
        right += g
        label(block, residual[: last - first], scale, kept[first:last])
    if solved(cylinder, start, known, scale * scale, H, right, step):
        cylinder = moved(cylinder, NEWTON * step)
    return cylinder, weight


@njit(cache=True)
def settle(xyz, direction, sigma, packed, cylinder, scale, start, known, first_judged):
    """Settle on the packed points, which are all or every so-manieth, then take one step with all.

    Returns the cylinder, what the points say of it (normal matrix), which are on it, their scale, and a status.
    """
    n, terms = xyz.shape[0], known.shape[0]
    H, kept = np.zeros((terms, terms)), np.zeros(n, dtype=np.bool_)
    share = packed.shape[1] / n
    cylinder, scale, weight, cells, status = settled(
        packed, cylinder, scale, start, known * share, first_judged, CLOSE, H
    )
    if status == DONE and packed.shape[1] < n:
        cylinder, weight = finished(xyz, direction, sigma, cylinder, scale, cells, start, known, H, kept)
    elif status == DONE:
        residual = np.empty(n)
        residuals(packed, cylinder, residual)
        label(packed, residual, scale, kept)
    H *= kept.sum() / max(weight, 1e-300) / (scale * scale)  # every inlier counts as one, not by its weight
    return cylinder, H, kept, scale, status
