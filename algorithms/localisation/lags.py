"""How far one ring's profile of the wall lies from another's, along and about the pipe: sub-cell, with its error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

REACH = 8.0  # mm along the pipe, or bins about it, that a profile may be off
STEPS = 4  # lags tried in one mm, or bin
CURVE = 2.0  # a profile that is off by so much must fit worse by so many sigmas squared, or it says nothing
LEAST_GAIN = 25.0
ALIKE = 0.35  # of the profile's power, left unexplained, at most
FEWEST = 12


class Profile(NamedTuple):
    """Heights of the wall over the fitted cylinder, mm, a row a frame and a column a bin of angle; NaN where unseen."""

    z_mm: Float[np.ndarray, "frames bins"]
    height_mm: Float[np.ndarray, "frames bins"]


class Lag(NamedTuple):
    """How much further a profile lies than the other, and the standard deviation of that; infinite: nothing shows."""

    lag: float
    std: float


def lag_along_mm(reference: Profile, other: Profile, gap_mm: float, noise_mm: float) -> Lag:
    """How much further along the pipe `other` lies."""
    lags = np.arange(-REACH, REACH + 0.5 / STEPS, 1.0 / STEPS)
    return _best(lags, misfits(*reference, *other, lags, np.zeros(lags.size), gap_mm), _bins(other), noise_mm)


def lag_about_bins(reference: Profile, other: Profile, gap_mm: float, noise_mm: float, along_mm: float) -> Lag:
    """How much further about the pipe `other` lies, in bins of angle."""
    lags = np.arange(-REACH, REACH + 0.5 / STEPS, 1.0 / STEPS)
    return _best(lags, misfits(*reference, *other, np.full(lags.size, along_mm), lags, gap_mm), _bins(other), noise_mm)


def _bins(profile: Profile) -> int:
    """Bins of angle in which a profile has something."""
    return int(np.isfinite(profile.height_mm).any(axis=0).sum())


def _best(lags: np.ndarray, misfit: tuple[np.ndarray, ...], bins: int, noise_mm: float) -> Lag:
    """The lag of the least misfit, refined by a parabola, unless the misfit is nearly as small elsewhere."""
    mean_square, power, count = misfit
    nothing = Lag(0.0, np.inf)
    usable = count >= FEWEST
    if not usable.all():
        return nothing
    k = int(np.argmin(mean_square))
    away = int(CURVE * STEPS)
    if not away <= k < lags.size - away or mean_square[k] > ALIKE * power[k]:
        return nothing
    # the lesser of both sides: a single edge beside a shadow bounds a lag, and does not fix it
    rise = min(mean_square[k - away], mean_square[k + away]) - mean_square[k]
    if rise * count[k] < LEAST_GAIN * max(float(mean_square[k]), noise_mm**2):
        return nothing
    # what is left over the points' noise comes from sampling an edge coarsely, which all bins do together
    unsure = noise_mm**2 + max(float(mean_square[k]) - noise_mm**2, 0.0) * bins
    left, middle, right = mean_square[k - 1], mean_square[k], mean_square[k + 1]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
    curvature = 2 * rise / CURVE**2
    return Lag(float(lags[k] + shift / STEPS), float(np.sqrt(2 * unsure / (curvature * count[k]))))


@njit(cache=True, error_model="numpy")
def misfits(z_reference, reference, z_other, other, along_mm, about_bins, gap_mm):
    """Mean square of `other` less `reference` where both are, at each pair of lags; the power of both; their number.

    The reference is taken by straight lines between samples of one bin that lie no further apart than `gap_mm`.
    """
    bins = reference.shape[1]
    mean_square, power, count = np.full(along_mm.size, np.inf), np.zeros(along_mm.size), np.zeros(along_mm.size)
    z_of, height_of, seen = _in_order(z_reference, reference)
    for k in range(along_mm.size):
        square, all_power, n = 0.0, 0.0, 0
        whole = int(np.floor(about_bins[k]))
        part = about_bins[k] - whole
        for i in range(other.shape[0]):
            for j in range(bins):
                h, z = other[i, j], z_other[i, j] - along_mm[k]
                if np.isnan(h):
                    continue
                b = (j - whole) % bins
                low = height_at(z_of[b, : seen[b]], height_of[b], z, gap_mm)
                if part > 0.0:
                    b = (j - whole - 1) % bins
                    high = height_at(z_of[b, : seen[b]], height_of[b], z, gap_mm)
                    low = (1.0 - part) * low + part * high
                if np.isnan(low):
                    continue
                square += (h - low) ** 2
                all_power += 0.5 * (h * h + low * low)
                n += 1
        if n > 0:
            mean_square[k], power[k], count[k] = square / n, all_power / n, n
    return mean_square, power, count


@njit(cache=True, error_model="numpy")
def _in_order(z_mm, height_mm):
    """Each bin's samples by their place along the pipe, a bin a row, and how many it has."""
    frames, bins = z_mm.shape
    z_of, height_of, seen = np.empty((bins, frames)), np.empty((bins, frames)), np.zeros(bins, dtype=np.int64)
    for b in range(bins):
        for i in range(frames):
            if np.isnan(height_mm[i, b]):
                continue
            k = seen[b]
            while k > 0 and z_of[b, k - 1] > z_mm[i, b]:
                z_of[b, k], height_of[b, k] = z_of[b, k - 1], height_of[b, k - 1]
                k -= 1
            z_of[b, k], height_of[b, k] = z_mm[i, b], height_mm[i, b]
            seen[b] += 1
    return z_of, height_of, seen


@njit(cache=True, error_model="numpy")
def height_at(z_mm, height_mm, z, gap_mm):
    """The height at a place between two of the samples in order; NaN where it has none close by."""
    above = np.searchsorted(z_mm, z)
    if above == z_mm.size:
        return np.nan
    if z_mm[above] == z:
        return height_mm[above]
    if above == 0 or z_mm[above] - z_mm[above - 1] > gap_mm:
        return np.nan
    below = above - 1
    share = (z - z_mm[below]) / (z_mm[above] - z_mm[below])
    return (1.0 - share) * height_mm[below] + share * height_mm[above]
