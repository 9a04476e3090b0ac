"""The local undamaged bore, from which depth is counted: the paper's background (Fig. 15), robust and smooth."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Float

from algorithms.robust import MAD_TO_SIGMA, spread
from algorithms.types import WallMap

BLOCK_MM = 200.0
NOISE_WINDOW_MM = 10.0
HARMONICS = 2
ROUNDS = 10


def deviation_mm(wall: WallMap) -> Float[np.ndarray, "around along"]:
    """Radius less the undamaged bore around it, smoothed by a 3 x 3 median; NaN where nothing was seen.

    The bore is a circle and an oval (two harmonics around the wall), fitted robustly in overlapping blocks along z, so
    that neither a defect nor a slightly wrong calibration is taken for the other.
    """
    deviation = np.full(wall.radius_mm.shape, np.nan)
    cell_mm = wall.z_mm[1] - wall.z_mm[0] if wall.z_mm.size > 1 else 1.0
    half, step = round(BLOCK_MM / cell_mm / 2), max(round(BLOCK_MM / cell_mm / 4), 1)
    for first in range(0, wall.z_mm.size, step):
        block = slice(max(first + step // 2 - half, 0), first + step // 2 + half)
        bore = _bore(wall.theta_rad, wall.radius_mm[:, block])[:, None]
        # with a row of neighbours on either side; block by block, so that memory does not grow with the pipe
        wider = slice(max(first - 1, 0), first + step + 1)
        smooth = _median3x3(wall.radius_mm[:, wider] - bore)
        deviation[:, first : first + step] = smooth[:, first - wider.start :][
            :, : deviation[:, first : first + step].shape[1]
        ]
    return deviation


def _bore(theta: np.ndarray, radius: np.ndarray) -> Float[np.ndarray, "around"]:
    """Circle plus oval through one block, by least squares reweighted with Tukey's biweight."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all-NaN columns: the strut's, dealt with below
        column = np.nanmedian(radius, axis=1)
    known = np.isfinite(column)
    orders = np.arange(1, HARMONICS + 1)
    A = np.hstack([np.ones((theta.size, 1)), np.cos(theta[:, None] * orders), np.sin(theta[:, None] * orders)])
    if known.sum() < 4 * A.shape[1]:
        return np.full(theta.size, np.nan)
    weight = np.ones(int(known.sum()))
    # the median start keeps a wide defect from bending the first fit
    bore = np.full(theta.size, np.median(column[known]))
    for _ in range(ROUNDS):
        residual = column[known] - bore[known]
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
        weight = np.clip(1 - (residual / (4.685 * scale)) ** 2, 0, None) ** 2 + 1e-12
        root = np.sqrt(weight)[:, None]
        bore = A @ np.linalg.lstsq(A[known] * root, column[known] * root[:, 0], rcond=None)[0]
    return bore


def _median3x3(values: np.ndarray) -> np.ndarray:
    """Median of the seen cells among nine, around the wall and along it, where the middle one was seen."""
    shifted = np.stack(
        [_shift_along(np.roll(values, turn, axis=0), move) for turn in (-1, 0, 1) for move in (-1, 0, 1)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # cells without any seen neighbour stay NaN
        smooth = np.nanmedian(shifted, axis=0)
    return np.where(np.isfinite(values), smooth, np.nan)


def _shift_along(values: np.ndarray, move: int) -> np.ndarray:
    out = np.full(values.shape, np.nan)
    if move == 0:
        return values
    out[:, max(move, 0) : values.shape[1] + min(move, 0)] = values[:, max(-move, 0) : values.shape[1] - max(move, 0)]
    return out


def noise_mm(wall: WallMap, deviation: Float[np.ndarray, "around along"]) -> Float[np.ndarray, "around along"]:
    """Standard deviation of the undamaged wall in every cell; NaN where nothing was seen.

    How cells differ is known from the rings that saw them: the innermost is the least sharp, and sees alone where a
    scan ends or the strut passed. How large it all is, is not: that is taken from the map, robustly around the wall and
    in a window along it.
    """
    cell_mm = wall.z_mm[1] - wall.z_mm[0] if wall.z_mm.size > 1 else 1.0
    half = max(round(NOISE_WINDOW_MM / cell_mm / 2), 1)
    relative = deviation / wall.sigma_mm
    out = np.full(deviation.shape, np.nan)
    for row in range(wall.z_mm.size):
        near = relative[:, max(row - half, 0) : row + half + 1]
        seen = near[np.isfinite(near)]
        if seen.size:
            out[:, row] = spread(seen) * wall.sigma_mm[:, row]
    return out
