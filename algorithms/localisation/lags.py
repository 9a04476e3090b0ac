"""How far one ring's profile of the wall lies from another's, along and about the pipe: sub-cell, with its error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

REACH = 8.0  # mm along the pipe, or bins about it, that a profile may be off
STEPS = 4  # lags tried in one mm, or bin
LAGS = np.arange(-REACH, REACH + 0.5 / STEPS, 1.0 / STEPS)
FINE = np.arange(-REACH, REACH, 1 / 32)
CURVE = 2.0  # a profile that is off by so much must fit worse by so many sigmas squared, or it says nothing
LEAST_GAIN = 25.0
RISE_SHARE = 0.125  # and by such a share of itself: where the edge lies in shadow it wanders by less than a tenth
ALIKE = 0.35  # of the profile's power, left unexplained, at most
FEWEST = 12
LOOSEST = 1.0  # mm, or bins: less is no measurement, and not spread as a bell either
SHADE_MM = 0.4  # where the wall falls away by more from sample to sample, part of it lies in shadow

Span = tuple[float, float]


class Profile(NamedTuple):
    """Heights of the wall over the fitted cylinder, mm, a row a frame and a column a bin of angle; NaN where unseen."""

    z_mm: Float[np.ndarray, "frames bins"]
    height_mm: Float[np.ndarray, "frames bins"]


class Lag(NamedTuple):
    """How much further a profile lies than the other, and the standard deviation of that; infinite: nothing shows."""

    lag: float
    std: float


def lag_along_mm(reference: Profile, other: Profile, span_mm: Span, gap_mm: float, noise_mm: float) -> Lag:
    """How much further along the pipe `other` lies, by what both have between two places."""
    misfit = _both_ways(reference, other, span_mm, LAGS, np.zeros(LAGS.size), gap_mm)
    return _best(misfit, _bins(other, span_mm), noise_mm)


def lag_about_bins(
    reference: Profile, other: Profile, span_mm: Span, gap_mm: float, noise_mm: float, along_mm: float
) -> Lag:
    """How much further about the pipe `other` lies, in bins of angle."""
    misfit = _both_ways(reference, other, span_mm, np.full(LAGS.size, along_mm), LAGS, gap_mm)
    return _best(misfit, _bins(other, span_mm), noise_mm)


def _both_ways(
    one: Profile, other: Profile, span_mm: Span, along_mm: np.ndarray, about_bins: np.ndarray, gap_mm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each laid over the other: straight lines between samples round an edge off to one side, and so to neither."""
    there = misfits(*one, *within(other, *span_mm), along_mm, about_bins, gap_mm)
    back = misfits(*other, *within(one, *span_mm), -along_mm, -about_bins, gap_mm)
    square, power, count = (a + b for a, b in zip(there, back, strict=True))
    return square / np.maximum(count, 1), power / np.maximum(count, 1), count


def within(profile: Profile, low_mm: float, high_mm: float) -> Profile:
    """What a profile has between two places."""
    inside = (profile.z_mm >= low_mm) & (profile.z_mm <= high_mm)
    return Profile(np.where(inside, profile.z_mm, np.nan), np.where(inside, profile.height_mm, np.nan))


def _bins(profile: Profile, span_mm: Span) -> int:
    """Bins of angle in which a profile has something."""
    return int(np.isfinite(within(profile, *span_mm).height_mm).any(axis=0).sum())


def _best(misfit: tuple[np.ndarray, ...], bins: int, noise_mm: float) -> Lag:
    """The mean of the likely lags and their spread, unless that is wide or the misfit nearly as small elsewhere."""
    from scipy.interpolate import CubicSpline

    mean_square, power, count = misfit
    nothing = Lag(0.0, np.inf)
    usable = count >= FEWEST
    if not usable.all():
        return nothing
    k = int(np.argmin(mean_square))
    away = int(CURVE * STEPS)
    if not away <= k < LAGS.size - away or mean_square[k] > ALIKE * power[k]:
        return nothing
    # the lesser of both sides: a single edge beside a shadow bounds a lag, and does not fix it
    rise = min(mean_square[k - away], mean_square[k + away]) - mean_square[k]
    least = max(float(mean_square[k]), noise_mm**2)
    if rise < max(LEAST_GAIN / count[k], RISE_SHARE) * least:
        return nothing
    # what is left over the points' noise comes from sampling an edge coarsely, which all bins do together
    unsure = noise_mm**2 + max(float(mean_square[k]) - noise_mm**2, 0.0) * bins
    likely = np.exp(-0.5 * (CubicSpline(LAGS, mean_square)(FINE) - mean_square[k]) * count[k] / unsure)
    likely /= likely.sum()
    lag = float(likely @ FINE)
    std = float(np.sqrt(likely @ (FINE - lag) ** 2))
    return Lag(lag, std) if std < LOOSEST else nothing


@njit(cache=True, error_model="numpy")
def misfits(z_reference, reference, z_other, other, along_mm, about_bins, gap_mm):
    """Sum of squares of `other` less `reference` where both are, at each pair of lags; of the power; their number.

    The reference is taken by straight lines between samples of one bin that lie no further apart than `gap_mm`, and
    between which the wall does not fall away: there part of it is in shadow, more of it for one ring than for the next.
    """
    bins = reference.shape[1]
    square, power, count = np.zeros(along_mm.size), np.zeros(along_mm.size), np.zeros(along_mm.size)
    z_of, height_of, seen = _in_order(z_reference, reference)
    whole = np.floor(about_bins).astype(np.int64)
    part = about_bins - whole
    near = np.zeros(bins, dtype=np.int64)  # from lag to lag a place moves by a sample or less
    for i in range(other.shape[0]):
        for j in range(bins):
            h = other[i, j]
            if np.isnan(h):
                continue
            for k in range(along_mm.size):
                z, b = z_other[i, j] - along_mm[k], (j - whole[k]) % bins
                near[b] = _above(z_of[b], seen[b], z, near[b])
                low = height_at(z_of[b, : seen[b]], height_of[b], z, near[b], gap_mm)
                if part[k] > 0.0:
                    b = (b - 1) % bins
                    near[b] = _above(z_of[b], seen[b], z, near[b])
                    high = height_at(z_of[b, : seen[b]], height_of[b], z, near[b], gap_mm)
                    low = (1.0 - part[k]) * low + part[k] * high
                if np.isnan(low):
                    continue
                square[k] += (h - low) ** 2
                power[k] += 0.5 * (h * h + low * low)
                count[k] += 1
    return square, power, count


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
def _above(z_mm, count, z, near):
    """The first of the samples in order that does not lie below z, sought from a place near it."""
    while near > 0 and z_mm[near - 1] >= z:
        near -= 1
    while near < count and z_mm[near] < z:
        near += 1
    return near


@njit(cache=True, error_model="numpy")
def height_at(z_mm, height_mm, z, above, gap_mm):
    """The height between two samples, `above` the first not below z; NaN where none is close, or in their shade."""
    if above == z_mm.size:
        return np.nan
    if z_mm[above] == z:
        return height_mm[above]
    if above == 0 or z_mm[above] - z_mm[above - 1] > gap_mm:
        return np.nan
    below = above - 1
    if height_mm[above] - height_mm[below] > SHADE_MM:
        return np.nan
    share = (z - z_mm[below]) / (z_mm[above] - z_mm[below])
    return (1.0 - share) * height_mm[below] + share * height_mm[above]
