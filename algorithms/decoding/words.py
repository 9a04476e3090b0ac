"""Which slit each dip is: the code that the colours spell, and what is no slit by its look or stands alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.ndimage import uniform_filter1d

from algorithms.decoding.dips import Dips
from algorithms.decoding.settings import DecodeSettings
from algorithms.robust import MAD_TO_SIGMA
from sensor_model.rig import Rig

COLORS = "RYB"
SKIPPED_SLIT, SPARE_DIP = -2.0, -3.0  # log scores
ROUGH_SIGMAS, ROUGH_LINES = 3.0, 6


def name_slits(dips: Dips, colors: Float[np.ndarray, "2 lines most 3"], rig: Rig) -> Int[np.ndarray, "lines most"]:
    """Which slit each dip is, -1 for none: the best match in order of the colour pairs on each line."""
    pairs = np.array([[COLORS.index(letter) for letter in slit.name] for slit in rig.projector.slits])
    return _name(dips.found, colors[0], colors[1], pairs)


@njit(cache=True)
def _name(count, inside, outside, pairs):
    """Ordered matching by dynamic programming, a line at a time; a slit may be hidden, a dip may be no slit."""
    n_lines, most = inside.shape[0], inside.shape[1]
    n_slits = pairs.shape[0]
    out = np.full((n_lines, most), -1, dtype=np.int64)
    best = np.empty((most + 1, n_slits + 1))
    came = np.empty((most + 1, n_slits + 1), dtype=np.int64)
    for k in range(n_lines):
        m = count[k]
        for i in range(m + 1):
            best[i, 0], came[i, 0] = i * SPARE_DIP, 1
        for j in range(n_slits + 1):
            best[0, j], came[0, j] = j * SKIPPED_SLIT, 2
        for i in range(1, m + 1):
            for j in range(1, n_slits + 1):
                best[i, j], came[i, j] = best[i - 1, j] + SPARE_DIP, 1
                if best[i, j - 1] + SKIPPED_SLIT > best[i, j]:
                    best[i, j], came[i, j] = best[i, j - 1] + SKIPPED_SLIT, 2
                taken = inside[k, i - 1, pairs[j - 1, 0]] + outside[k, i - 1, pairs[j - 1, 1]]
                if best[i - 1, j - 1] + taken > best[i, j]:
                    best[i, j], came[i, j] = best[i - 1, j - 1] + taken, 0
        i, j = m, n_slits
        while i > 0 and j > 0:
            if came[i, j] == 0:
                out[k, i - 1] = j - 1
                i, j = i - 1, j - 1
            elif came[i, j] == 1:
                i -= 1
            else:
                j -= 1
    return out


def usual(slit: Int[np.ndarray, "lines most"], dips: Dips, settings: DecodeSettings) -> Int[np.ndarray, "lines most"]:
    """Drop what is no slit by its look: the shadow that a defect's rim throws.

    It is much wider, narrower or shallower than the same slit elsewhere; how much is seen from the slit itself, where
    its print is rough or the light weak.
    """
    line, place = np.nonzero(slit >= 0)
    log_width, depth = np.log(dips.width_px[line, place]), _depth(dips, line, place)
    most = np.log(settings.width_ratio), 1 - settings.depth_share
    out = slit.copy()
    out[line, place] = np.where(_unusual(slit[line, place], log_width, depth, *most), -1, slit[line, place])
    return out


def whole(
    slit: Int[np.ndarray, "lines most"], dips: Dips, slits: int, settings: DecodeSettings
) -> Int[np.ndarray, "lines most"]:
    """Drop what a defect's rim splits: a slit partly on the wall before it and partly on the floor beyond its shadow.

    Its edges lie on different walls, and the place halfway between them on neither. It is wider by the shadow, in a
    row of lines, which tells it from a rough print that makes single lines as wide.
    """
    log_width = by_line(slit, np.log(dips.width_px), slits)
    known = np.isfinite(log_width)
    beside = 2 * settings.pooled_lines + 1
    total, share = (
        uniform_filter1d(part, beside, mode="wrap") for part in (np.where(known, log_width, 0.0), 1.0 * known)
    )
    split = np.zeros(known.shape, dtype=bool)
    for k in np.flatnonzero(known.any(axis=1)):
        pooled = total[k, known[k]] / share[k, known[k]]
        split[k, known[k]] = pooled - np.median(pooled) > np.log(settings.width_ratio)
    line, place = np.nonzero(slit >= 0)
    out = slit.copy()
    out[line, place] = np.where(split[slit[line, place], line], -1, slit[line, place])
    return out


@njit(cache=True)
def _unusual(which, log_width, depth, most_log_wide, most_shallow_share):
    """Which places differ more in width, or are shallower, than places of the same slit usually do."""
    out = np.zeros(which.size, dtype=np.bool_)
    for j in range(which.max() + 1 if which.size else 0):
        mine = np.flatnonzero(which == j)
        if mine.size == 0:
            continue
        wide = np.abs(log_width[mine] - np.median(log_width[mine]))
        usual_depth = np.median(depth[mine])
        shallow = usual_depth - depth[mine]
        most_wide = max(most_log_wide, ROUGH_SIGMAS * MAD_TO_SIGMA * np.median(wide))
        most_shallow = max(most_shallow_share * usual_depth, ROUGH_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(shallow)))
        out[mine] = (wide > most_wide) | (shallow > most_shallow)
    return out


def _depth(dips: Dips, line: Int[np.ndarray, "n"], place: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """How much darker each dip is than the darker of the bands beside it, as a share of that."""
    inside, floor, outside = (dips.rgb[line, place, part].sum(axis=1) for part in range(3))
    return 1.0 - floor / np.maximum(np.minimum(inside, outside), 1.0)


def by_line(slit: Int[np.ndarray, "lines most"], radius_px: np.ndarray, slits: int) -> Float[np.ndarray, "slits lines"]:
    """Where each slit was seen on each line, px from the picture's centre; NaN where it was not."""
    line, place = np.nonzero(slit >= 0)
    out = np.full((slits, len(slit)), np.nan)
    out[slit[line, place], line] = radius_px[line, place]
    return out


def _spread_of(change: Float[np.ndarray, "slits n"]) -> Float[np.ndarray, "slits"]:
    """Robust standard deviation of each row's known values; 0 of a row without."""
    known = [row[np.isfinite(row)] for row in change]
    return np.array([MAD_TO_SIGMA * float(np.median(np.abs(row))) if row.size else 0.0 for row in known])


def jump_px(radius_px: Float[np.ndarray, "slits lines"], least_px: float) -> Float[np.ndarray, "slits"]:
    """How far each slit may move from line to line: as far as its own roughness makes it."""
    return np.maximum(ROUGH_SIGMAS * _spread_of(np.diff(radius_px)), least_px)


@njit(cache=True)
def supported(slit, radius, count, lines, tolerance):
    """Keep what at least two of the nearest lines on either side show too, at nearly the same radius."""
    n_lines, most = slit.shape
    out = np.full((n_lines, most), -1, dtype=np.int64)
    needed = min(2, lines)
    for k in range(n_lines):
        for i in range(count[k]):
            if slit[k, i] < 0:
                continue
            support = 0
            for step in range(-lines, lines + 1):
                other = (k + step) % n_lines
                if step == 0:
                    continue
                reach = tolerance[slit[k, i]] * abs(step)
                for j in range(count[other]):
                    if slit[other, j] == slit[k, i] and abs(radius[other, j] - radius[k, i]) <= reach:
                        support += 1
                        break
            if support >= needed:
                out[k, i] = slit[k, i]
    return out


def roughness_px(radius_px: Float[np.ndarray, "slits lines"]) -> Float[np.ndarray, "slits"]:
    """How far each slit's places scatter about those some lines to either side: noise and the slide's print alike."""
    beside = 0.5 * (np.roll(radius_px, ROUGH_LINES, axis=1) + np.roll(radius_px, -ROUGH_LINES, axis=1))
    return _spread_of(radius_px - beside) / np.sqrt(1.5)
