"""A cylinder near the likeliest, whatever lies beside the wall: annealed from the prior, or searched cell by cell."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.registration.ray_fit import moved, normal_matrix, residuals, scale_about_zero, tightest_half
from algorithms.registration.settle import CUT_SIGMAS, DONE, INLIER_SIGMAS, SMALLEST_SCALE, settled, solved
from algorithms.registration.wall_cells import search

FEW, SEARCH_POINTS = 512, 5000
FAR_SIGMAS = 40.0  # while the cut is wider than this it is halved without a look at the scale
LONGEST_STEP_MM, LEVER_MM = 25.0, 60.0
CONVINCING_SHARE, CONVINCING_SCALE = 0.85, 1.3
WORTH_IT, MODEL_ERROR_SCALE = 3.0, 12.0
ROUGHLY = 1.0  # where a coarse fit ends, in its own standard deviations
WIDEST_RADIUS = 0.02


@njit(cache=True)
def begun(packed, start, known, nominal):
    """A cylinder near the likeliest, from a few points; where that does not convince, from a search over the wall."""
    few = thinned(packed, FEW)
    cylinder, scale, near = annealed(few, start, known * (few.shape[1] / packed.shape[1]))
    residual, alike = np.empty(few.shape[1]), False
    if near:
        residuals(few, cylinder, residual)
        alike = np.mean(np.abs(residual) < INLIER_SIGMAS * scale) >= CONVINCING_SHARE
        if alike and scale < CONVINCING_SCALE:
            return cylinder, scale, False
    noise_mm = 0.0
    for i in range(few.shape[1]):
        along = few[3, i] * start[3] + few[4, i] * start[4] + few[5, i] * start[5]
        noise_mm += np.sqrt(max(1.0 - along * along, 0.0)) / few[6, i] / few.shape[1]
    radius_std = min(known[4, 4] ** -0.5 if known[4, 4] > 0.0 else np.inf, WIDEST_RADIUS * nominal)
    many = thinned(packed, SEARCH_POINTS)
    best, smallest, searched = cylinder, scale if near else np.inf, False
    H = np.empty(known.shape)
    for k in range(3):  # from what the points drew it to, and if that leads nowhere, from the prior, ever harder
        base = cylinder if k == 0 and near else start
        found, enough = search(many, base, nominal, radius_std, noise_mm, known.shape[0], 2**k)
        if enough:
            residuals(few, found, residual)
            scale = tightest_half(residual)[1]
            share = many.shape[1] / packed.shape[1]
            found, scale, _, _, status = settled(many, found, scale, start, known * share, 0, ROUGHLY, H)
            # a little less scatter over a part of the wall is what a wrong rig or an oval pipe offers: not worth it
            worth_it = searched or not alike or scale < CONVINCING_SCALE or WORTH_IT * scale < smallest
            if status == DONE and scale < smallest and worth_it:
                best, smallest, searched = found, scale, True
        if smallest < CONVINCING_SCALE or (k > 0 and alike and not searched and smallest < MODEL_ERROR_SCALE):
            break
    return best, smallest, searched


@njit(cache=True)
def thinned(packed, most):
    """Every so-manieth point, so that at most so many are left."""
    step = (packed.shape[1] + most - 1) // most
    return np.ascontiguousarray(packed[:, ::step])


@njit(cache=True)
def annealed(packed, start, known):
    """From the prior with a cut that falls: first every point counts, at the end what lies near."""
    terms = 5
    H, g, step = np.empty((terms, terms)), np.empty(terms), np.empty(terms)
    residual = np.empty(packed.shape[1])
    cylinder = start.copy()
    residuals(packed, cylinder, residual)
    cut = CUT_SIGMAS * np.median(np.abs(residual)) + SMALLEST_SCALE
    scale = np.inf
    for _ in range(30):
        normal_matrix(packed, cylinder, cut, H, g, residual)
        if not solved(cylinder, start, known, (cut / CUT_SIGMAS) ** 2, H, g, step):
            return cylinder, np.inf, False
        longest = max(abs(step[0]), abs(step[1]), LEVER_MM * abs(step[2]), LEVER_MM * abs(step[3]), abs(step[4]))
        if longest > LONGEST_STEP_MM:
            step *= LONGEST_STEP_MM / longest
        cylinder = moved(cylinder, step)
        if not (cylinder[5] > 0.2 and 0.3 * start[6] < cylinder[6] < 3.0 * start[6]):
            return cylinder, np.inf, False
        if cut > FAR_SIGMAS:
            cut *= 0.5
            continue
        residuals(packed, cylinder, residual)
        scale = max(scale_about_zero(residual), SMALLEST_SCALE)
        if cut <= 1.05 * CUT_SIGMAS * scale:
            break
        cut = max(0.5 * cut, CUT_SIGMAS * scale)
    return cylinder, scale, True
