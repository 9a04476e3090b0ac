"""Photon and read noise of a camera, from the smooth parts of single pictures of known tone curve."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from algorithms.identification.estimate import Estimate, Quantity, Unknown, of_blocks, root_of
from algorithms.robust import MAD_TO_SIGMA

KERNEL = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0])  # blind to planes and to edges along rows and columns
KERNEL_GAIN = 36.0
LEAST_LIGHT, MOST_LIGHT = 0.004, 0.92  # below, the noise is cut at black; above, at white
BINS = 24
LEAST_IN_BIN = 400
SMOOTH_PX = 9
TEXTURE_SHARES = (0.03, 0.05)  # of both variances: what picture and file still add to them, in all parts alike
FLATTEST_SHARE = 0.5  # of the pixels of one brightness, those about which it changes least


def light_of(picture: UInt8[np.ndarray, "height width 3"], gamma: float) -> Float[np.ndarray, "height width 3"]:
    """Linear light, as shares of full scale."""
    return ((np.arange(256) / 255.0) ** gamma)[picture]


def noise_of(picture: UInt8[np.ndarray, "height width 3"], gamma: float, lost_bits: int = 0) -> Float[np.ndarray, "2"]:
    """Variances of photon noise at full scale and of read noise; not a number where the light varies too little.

    The variance of what no plane explains, bin by bin of brightness, is a line: photons' part in proportion, chip's
    part always. The steps of the file are taken off.
    """
    import cv2

    light = light_of(picture, gamma)
    mean = cv2.blur(light, (SMOOTH_PX, SMOOTH_PX))
    off = cv2.filter2D(light, -1, KERNEL)[1:-1, 1:-1]
    across, down = (
        cv2.filter2D(mean, -1, kernel) for kernel in (np.array([[-1.0, 0, 1]]), np.array([[-1.0], [0], [1]]))
    )
    steep = np.hypot(across, down)[1:-1, 1:-1].ravel()
    level, off = mean[1:-1, 1:-1].ravel(), off.ravel()
    edges = np.geomspace(LEAST_LIGHT, MOST_LIGHT, BINS + 1)
    which = np.digitize(level, edges) - 1
    rows = []
    for k in range(BINS):
        mine = np.flatnonzero(which == k)
        if mine.size < LEAST_IN_BIN / FLATTEST_SHARE:
            continue
        flat = mine[steep[mine] <= np.quantile(steep[mine], FLATTEST_SHARE)]
        at = float(level[flat].mean())
        variance = (MAD_TO_SIGMA * float(np.median(np.abs(off[flat])))) ** 2 / KERNEL_GAIN
        step = gamma * at ** (1 - 1 / gamma) * 2**lost_bits / 255.0
        rows.append((at, variance - step**2 / 12, variance / np.sqrt(flat.size)))
    if len(rows) < 4:
        return np.full(2, np.nan)
    at, variance, std = np.array(rows).T
    A = np.column_stack([at, np.ones(at.size)]) / std[:, None]
    return np.linalg.lstsq(A, variance / std, rcond=None)[0]


def quarters(picture: UInt8[np.ndarray, "height width 3"]) -> list[UInt8[np.ndarray, "h w 3"]]:
    """A picture in four parts, each with as much of every brightness."""
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    return [np.ascontiguousarray(picture[r : r + rows, c : c + columns]) for r in (0, rows) for c in (0, columns)]


def photon_and_read(variances: Float[np.ndarray, "parts 2"], gamma: float) -> tuple[Quantity, Quantity]:
    """Standard deviations at full scale, from the variances of parts of pictures."""
    words = f"smooth parts of pictures by brightness, with a tone curve of {gamma:g}"
    found = [
        of_blocks(column, words, share * abs(float(np.nanmean(column))))
        for column, share in zip(variances.T, TEXTURE_SHARES, strict=True)
    ]
    shot, read = (_unless_below_zero(one) for one in found)
    return shot, read


def _unless_below_zero(variance: Quantity) -> Quantity:
    """A standard deviation; none where the line through the variances ends below zero."""
    if isinstance(variance, Estimate) and variance.high < 0:
        return Unknown("the dark is quieter than the bright parts foretell: another tone curve, or smoothed pictures")
    return root_of(variance)
