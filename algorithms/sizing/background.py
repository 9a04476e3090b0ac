"""The local undamaged bore, from which depth is counted: the paper's background (Fig. 15), robust and smooth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from algorithms.large_arrays import pieces, room
from algorithms.robust import MAD_TO_SIGMA
from algorithms.types import WallMap

BLOCK_MM = 200.0
NOISE_WINDOW_MM = 10.0
ROWS_WINDOW_MM = 100.0  # twice the longest groove around the pipe that rows do not take for their own scatter
HARMONICS = 2
ROUNDS = 10


def deviation_mm(wall: WallMap) -> Float[np.ndarray, "around along"]:
    """Radius less the undamaged bore around it, smoothed by a 3 x 3 median; NaN where nothing was seen.

    The bore is a circle and an oval (two harmonics around the wall), fitted robustly in overlapping blocks along z, so
    that neither a defect nor a slightly wrong calibration is taken for the other.
    """
    deviation = room(wall.radius_mm.shape, np.float64)
    cell_mm = wall.cell_z_mm
    half, step = round(BLOCK_MM / cell_mm / 2), max(round(BLOCK_MM / cell_mm / 4), 1)
    shape = _shape(wall.theta_rad)
    for part in pieces(wall.radius_mm, deviation, rows=step):
        deviation[:, part] = np.nan
        for first in range(part.start, part.stop, step):
            last, middle = min(first + step, part.stop), first + step // 2
            bore = _bore(shape, seen_medians(wall.radius_mm, max(middle - half, 0), middle + half))
            smooth_from(wall.radius_mm, bore, first, last, deviation)
    return deviation


def _shape(theta: np.ndarray) -> Float[np.ndarray, "around terms"]:
    """What a bore is made of: a circle, and an oval's harmonics around the wall."""
    orders = theta[:, None] * np.arange(1, HARMONICS + 1)
    return np.hstack([np.ones((theta.size, 1)), np.cos(orders), np.sin(orders)])


def _bore(shape: Float[np.ndarray, "around terms"], column: Float[np.ndarray, "around"]) -> Float[np.ndarray, "around"]:
    """Circle plus oval through the medians of one block, by least squares reweighted with Tukey's biweight."""
    known = np.isfinite(column)  # the strut's columns may be empty
    if known.sum() < 4 * shape.shape[1]:
        return np.full(column.size, np.nan)
    A, seen = shape[known], column[known]
    # the median start keeps a wide defect from bending the first fit
    bore = np.full(seen.size, np.median(seen))
    for _ in range(ROUNDS):
        residual = seen - bore
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
        weight = np.clip(1 - (residual / (4.685 * scale)) ** 2, 0, None) ** 2 + 1e-12
        weighted = A.T * weight
        # the median taken off first, or the normal equations would lose half of the digits
        terms = np.linalg.solve(weighted @ A, weighted @ residual)
        bore = bore + A @ terms
    return shape @ np.linalg.lstsq(A, bore, rcond=None)[0]


@njit(cache=True, error_model="numpy")
def seen_medians(radius, first, last):
    """Median of what was seen in each of (around, along) lines between two columns, NaN of nothing."""
    out, some = np.full(radius.shape[0], np.nan), np.empty(radius.shape[1])
    for i in range(radius.shape[0]):
        n = 0
        for j in range(first, min(last, radius.shape[1])):
            if np.isfinite(radius[i, j]):
                some[n] = radius[i, j]
                n += 1
        if n > 0:
            out[i] = np.median(some[:n])
    return out


@njit(cache=True, error_model="numpy")
def smooth_from(radius, bore, first, last, out):
    """Median of the seen cells among nine of radius less bore, where the middle one was seen; columns first .. last."""
    around, along = radius.shape
    begin, end = max(first - 1, 0), min(last + 1, along)
    low, middle, high, some = np.empty(along), np.empty(along), np.empty(along), np.empty(9)
    for i in range(around):
        before, after = i - 1, i + 1 if i + 1 < around else 0
        # three around are put in order once for all three columns beside them
        for j in range(begin, end):
            a, b, c = radius[before, j] - bore[before], radius[i, j] - bore[i], radius[after, j] - bore[after]
            low[j], high[j] = _least(_least(a, b), c), _most(_most(a, b), c)
            middle[j] = _middle(a, b, c) + 0.0 * (a + b + c)
        for j in range(first, last):
            if not np.isfinite(radius[i, j] - bore[i]):
                continue
            west, east = j - 1, j + 1
            if west < 0 or east == along or not np.isfinite(middle[west] + middle[j] + middle[east]):
                out[i, j] = _median_of_seen(radius, bore, (before, i, after), j, some)
                continue
            out[i, j] = _middle(
                _most(_most(low[west], low[j]), low[east]),
                _middle(middle[west], middle[j], middle[east]),
                _least(_least(high[west], high[j]), high[east]),
            )


@njit(cache=True, error_model="numpy", forceinline=True)
def _middle(a, b, c):
    return _most(_least(a, b), _least(_most(a, b), c))


@njit(cache=True, error_model="numpy", forceinline=True)
def _least(a, b):
    return a if a < b else b  # one instruction, unlike `min`, which minds NaN


@njit(cache=True, error_model="numpy", forceinline=True)
def _most(a, b):
    return a if a > b else b


@njit(cache=True, error_model="numpy")
def _median_of_seen(radius, bore, lines, j, some):
    """Median of the seen cells in three columns of three lines, of which one was seen; `some` has room for them."""
    n = 0
    for k in lines:
        for m in range(max(j - 1, 0), min(j + 2, radius.shape[1])):
            value = radius[k, m] - bore[k]
            if not np.isfinite(value):
                continue
            place = n
            while place > 0 and some[place - 1] > value:
                some[place] = some[place - 1]
                place -= 1
            some[place] = value
            n += 1
    return 0.5 * (some[(n - 1) // 2] + some[n // 2])


class RowNoise(NamedTuple):
    """Of every row of the map: how far its cells scatter, in their own sigmas, and rows among each other, in mm."""

    within: Float[np.ndarray, "along"]
    among_mm: Float[np.ndarray, "along"]


def noise_of_rows(wall: WallMap, deviation: Float[np.ndarray, "around along"]) -> RowNoise:
    """How noisy the undamaged wall is, row by row.

    How cells differ is known from the rings that saw them: the innermost is the least sharp, and sees alone where a
    scan ends or the strut passed. How large it all is, is not: that is taken from the map, by how far the cells of a
    row scatter around the wall (its own, or as in the rows near it, whichever is more), and rows among each other. A
    row that is deep as a whole, or for any part of it, is no noisier for that: a groove runs around the pipe.
    """
    half, far = (max(round(window / wall.cell_z_mm / 2), 1) for window in (NOISE_WINDOW_MM, ROWS_WINDOW_MM))
    middle, wide = np.empty((2, wall.z_mm.size))
    for part in pieces(deviation, wall.sigma_mm):
        middle[part], wide[part] = rows_of(deviation[:, part].T.copy(), wall.sigma_mm[:, part].T.copy())
    return RowNoise(np.fmax(wide, spreads_near(wide, half)[0]), spreads_near(middle, far)[1])


def noise_mm(
    noise: RowNoise, sigma_mm: Float[np.ndarray, "*cells"], rows: slice | Int[np.ndarray, "n"]
) -> Float[np.ndarray, "*cells"]:
    """Standard deviation of the undamaged wall in cells that lie in these rows; NaN where nothing was seen."""
    return np.hypot(noise.within[rows] * sigma_mm, noise.among_mm[rows])


@njit(cache=True, error_model="numpy")
def rows_of(deviation, sigma):
    """Of each of (along, around) rows its level, and how far its cells scatter about it, in their sigmas; NaN of none.

    Both are of the shortest half: where a row has two levels it lies in one of them, and knows of no step between them.
    """
    along = deviation.shape[0]
    middle, wide = np.full(along, np.nan), np.full(along, np.nan)
    for row in range(along):
        seen = np.isfinite(deviation[row])
        if not seen.any():
            continue
        low, high = shortest_half(deviation[row][seen])
        middle[row] = 0.5 * (low + high)
        low, high = shortest_half((deviation[row][seen] - middle[row]) / sigma[row][seen])
        wide[row] = MAD_TO_SIGMA * 0.5 * (high - low)
    return middle, wide


@njit(cache=True, error_model="numpy")
def shortest_half(values):
    """The ends of the shortest stretch that holds half of the values."""
    ordered, half = np.sort(values), values.size // 2
    first = np.argmin(ordered[half:] - ordered[: values.size - half])
    return ordered[first], ordered[first + half]


@njit(cache=True, error_model="numpy")
def spreads_near(values, half):
    """Median of what is known among so many values on either side of each, and their spread about it; or NaN."""
    middle, wide = np.full(values.size, np.nan), np.full(values.size, np.nan)
    for k in range(values.size):
        near = values[max(k - half, 0) : k + half + 1]
        near = near[np.isfinite(near)]
        if near.size:
            middle[k] = np.median(near)
            wide[k] = MAD_TO_SIGMA * np.median(np.abs(near - middle[k]))
    return middle, wide
