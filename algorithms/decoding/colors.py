"""The colours beside each dip, sorted into the frame's own three."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba import njit

from algorithms.decoding.dips import COLOR_GAP_PX, COLOR_SPAN_PX, Dips
from algorithms.decoding.settings import DecodeSettings

# the three colours on a white wall, as shares of red and blue in the light (the real sensor's, roughly)
WHITE_WALL_CHROMA = np.array([[0.50, 0.23], [0.34, 0.31], [0.20, 0.47]])
CODE_SHARE = np.array([6.0, 5.0, 5.0]) / 16  # of the bands beside the eight slits
CHROMA_ROUNDS, CHROMA_STRIDE = 4, 4  # of every fourth line
MUCH_CLIPPED = 0.2  # of the bands
LEAST_CHROMA = 0.01
FAR_CHROMA = 0.5  # no colour of ours
CLIPPED_LEVEL = 250.0  # of a channel that may be brighter than the picture can say
LEAST_SHARE = 0.5  # of the neighbouring lines must carry a slit on
MOST_MISSED = 2  # lines on end
LEAST_BAND_SHARE = 0.15  # of the other band's light, beyond the slit's own
CARRY_PX, CARRY_GAIN = 6.0, 0.4
LEAST_COLOR_SHARE = 0.03  # of the bands must show each colour, or there is no code to read
FOREIGN_COLOR = -8.0  # log score
# a band with less than this share of the usual one's light says little of the frame's colours, and of two dips with
# the same colours the slit is the one between the brighter bands; what is dark altogether costs no more than so much
WEAK_BAND, WEAK_SCORE, WEAKEST = 0.25, 0.5, 0.03


def color_scores(dips: Dips, settings: DecodeSettings) -> Float[np.ndarray, "2 lines most 3"]:
    """Log score of each of the three colours, inside and outside of every dip.

    A band's colour is what it has beyond haze and light from the wall, whose level shows in the slits themselves; it
    is gathered along the slit, over so many lines either way.
    """
    pooled, share = _along_slits(dips.found, dips.radius_px, dips.rgb, settings.pooled_lines, CARRY_PX)
    bands = _beyond_floor(dips.found, dips.radius_px, dips.width_px, pooled, share >= LEAST_SHARE, dips.start_rgb)
    some = slice(None, None, CHROMA_STRIDE)
    kept = np.tile(share[some] >= LEAST_SHARE, (2, 1, 1))
    few, levels = bands[:, some][kept], np.moveaxis(pooled[some, :, ::2], 2, 0)[kept]
    light = np.maximum(few.sum(axis=1), 0.0)
    if not light.any():
        return np.full(bands.shape, FOREIGN_COLOR)
    usual = float(np.sum(light**2) / np.sum(light))  # weighed by itself, as most dips may be no slits
    bright = light > WEAK_BAND * usual
    centers = frame_colors(few[bright], levels[bright])
    if centers is None:
        return np.full(bands.shape, FOREIGN_COLOR)
    return _scores(dips.found, bands, pooled, share, centers, WEAK_BAND * usual)


def frame_colors(bands: Float[np.ndarray, "n 3"], levels: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3 2"] | None:
    """Shares of red and blue in the frame's own three colours; None where it does not show each of them.

    A wall gives all colours the same factor in each channel (von Kries). The search starts from the colours on a white
    wall times what makes them, mixed as in the code, the frame's mean (gray world). Where much is clipped that mean is
    false, and a white wall another start: the one whose colours end further apart for their spread is believed.

    Args:
        bands: Colours of bands beyond their floor.
        levels: The same as the picture shows them, which tells what is clipped.
    """
    seen = np.maximum(bands, 0.0)
    seen = seen[:, ::2] / np.maximum(seen.sum(axis=1, keepdims=True), 1e-9)
    white = _log_ratios(WHITE_WALL_CHROMA)
    ratios = np.exp(white + _log_ratios(seen).mean(axis=0) - CODE_SHARE @ white)
    starts = [ratios / (1.0 + ratios.sum(axis=1, keepdims=True))]
    if np.mean(levels.max(axis=1) > CLIPPED_LEVEL) > MUCH_CLIPPED:
        starts.append(WHITE_WALL_CHROMA)
    found = [one for one in (_moved(start, bands, levels) for start in starts) if one is not None]
    return min(found, key=lambda one: one[1])[0] if found else None


def _moved(
    start: Float[np.ndarray, "3 2"], bands: Float[np.ndarray, "n 3"], levels: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 2"], float] | None:
    """Colours moved from a start to the frame's own (k-means), and their spread over their least distance."""
    centers, nearest = start.copy(), np.zeros(0)
    for _ in range(CHROMA_ROUNDS):
        chroma, off2 = _compared(bands, levels, centers)
        nearest = np.where(off2.min(axis=1) < FAR_CHROMA**2, np.argmin(off2, axis=1), -1)
        for c in range(3):
            if (nearest == c).any():
                centers[c] = [np.median(of[c][nearest == c]) for of in chroma]
    rarest = min(np.count_nonzero(nearest == c) for c in range(3))
    if rarest < max(LEAST_COLOR_SHARE * nearest.size, 1):
        return None
    return centers, float(off2.min(axis=1).mean() / max(_gap2(centers), 1e-9))


@njit(cache=True)
def _gap2(centers):
    """Least squared distance between two colours."""
    gap2 = 2.0
    for a in range(3):
        for b in range(a):
            gap2 = min(gap2, (centers[a, 0] - centers[b, 0]) ** 2 + (centers[a, 1] - centers[b, 1]) ** 2)
    return gap2


def _log_ratios(chroma: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Red and blue over green, as logarithms: a wall's reflectance only adds to them."""
    green = 1.0 - chroma.sum(axis=1, keepdims=True)
    return np.log(np.maximum(chroma, LEAST_CHROMA) / np.maximum(green, LEAST_CHROMA))


@njit(cache=True)
def _compared(bands, levels, centers):
    """Each band's shares of red and blue were it of each of the colours, and how far they lie from that, squared."""
    n = len(bands)
    chroma, off2 = np.empty((2, 3, n)), np.empty((n, 3))
    for i in range(n):
        for c in range(3):
            center = centers[c, 0], centers[c, 1]
            band, level = (bands[i, 0], bands[i, 1], bands[i, 2]), (levels[i, 0], levels[i, 1], levels[i, 2])
            red, blue = _chroma_as(band, level, center)
            chroma[0, c, i], chroma[1, c, i] = red, blue
            off2[i, c] = (red - center[0]) ** 2 + (blue - center[1]) ** 2
    return chroma, off2


@njit(cache=True)
def _chroma_as(band, level, center):
    """Shares of red and blue in a band, if it has a certain colour: what is clipped is as bright as that makes it."""
    red, green, blue = max(band[0], 0.0), max(band[1], 0.0), max(band[2], 0.0)
    share = center[0], 1.0 - center[0] - center[1], center[1]
    full_red, full_green, full_blue = level[0] > CLIPPED_LEVEL, level[1] > CLIPPED_LEVEL, level[2] > CLIPPED_LEVEL
    if full_red and full_green and full_blue:
        return share[0], share[2]
    if full_red or full_green or full_blue:
        known = (0.0 if full_red else red) + (0.0 if full_green else green) + (0.0 if full_blue else blue)
        of = (0.0 if full_red else share[0]) + (0.0 if full_green else share[1]) + (0.0 if full_blue else share[2])
        scale = known / max(of, 1e-9)
        red = max(red, scale * share[0]) if full_red else red
        green = max(green, scale * share[1]) if full_green else green
        blue = max(blue, scale * share[2]) if full_blue else blue
    total = max(red + green + blue, 1e-9)
    return red / total, blue / total


@njit(cache=True)
def _scores(count, bands, pooled, share, centers, least_light):
    """How well the colours beside each dip go with each of the three; the dark foot of a band is no band itself."""
    n_lines, most = share.shape
    out = np.full((2, n_lines, most, 3), FOREIGN_COLOR)
    scale = -1.0 / max(_gap2(centers) / 8, 1e-9)
    off2 = np.empty(3)
    for side in range(2):
        for k in range(n_lines):
            for i in range(count[k]):
                light = bands[side, k, i, 0] + bands[side, k, i, 1] + bands[side, k, i, 2]
                beyond = bands[1 - side, k, i, 0] + bands[1 - side, k, i, 1] + bands[1 - side, k, i, 2]
                if share[k, i] < LEAST_SHARE or not light > LEAST_BAND_SHARE * beyond:
                    continue
                band = bands[side, k, i, 0], bands[side, k, i, 1], bands[side, k, i, 2]
                level = pooled[k, i, 2 * side, 0], pooled[k, i, 2 * side, 1], pooled[k, i, 2 * side, 2]
                for c in range(3):
                    red, blue = _chroma_as(band, level, (centers[c, 0], centers[c, 1]))
                    off2[c] = (red - centers[c, 0]) ** 2 + (blue - centers[c, 1]) ** 2
                nearest2 = min(off2[0], off2[1], off2[2])
                weak = WEAK_SCORE * np.log(min(max(light / least_light, WEAKEST), 1.0))
                for c in range(3):
                    out[side, k, i, c] = max(scale * (off2[c] - nearest2), FOREIGN_COLOR) + weak
    return out


@njit(cache=True)
def _along_slits(count, radius, rgb, lines, tolerance):
    """Colours of each dip averaged over the dips that carry it on along the neighbouring lines; share of such lines.

    Nine colours at a time, as one row: inside, of the place itself, outside.
    """
    n_lines, most = radius.shape
    rows = rgb.reshape(n_lines * most, 9)
    pooled = np.zeros((n_lines * most, 9))
    share = np.zeros((n_lines, most))
    for k in range(n_lines):
        for i in range(count[k]):
            here, found = k * most + i, 0
            for c in range(9):
                pooled[here, c] = rows[here, c]
            for way in (-1, 1):
                at, missed, j = radius[k, i], 0, i
                for step in range(1, lines + 1):
                    other = (k + way * step) % n_lines
                    last = count[other] - 1
                    j = min(j, last)  # dips lie in order: the nearest is found downhill from the one before
                    while j < last and abs(radius[other, j + 1] - at) <= abs(radius[other, j] - at):
                        j += 1
                    while j > 0 and abs(radius[other, j - 1] - at) < abs(radius[other, j] - at):
                        j -= 1
                    if j < 0 or abs(radius[other, j] - at) > tolerance:
                        j = max(j, 0)
                        missed += 1
                        if missed > MOST_MISSED:
                            break
                        continue
                    missed, found = 0, found + 1
                    at += CARRY_GAIN * (radius[other, j] - at)  # a jagged print jumps from line to line
                    there = other * most + j
                    for c in range(9):
                        pooled[here, c] += rows[there, c]
            for c in range(9):
                pooled[here, c] /= found + 1
            share[k, i] = found / (2.0 * lines) if lines > 0 else 1.0
    return pooled.reshape(n_lines, most, 3, 3), share


@njit(cache=True)
def _beyond_floor(count, radius, width, pooled, anchor, start):
    """Colours inside and outside of each dip less the level between the floors of the dips that are slits."""
    n_lines, most = radius.shape
    bands = np.zeros((2, n_lines, most, 3))
    for k in range(n_lines):
        for i in range(count[k]):
            off = 0.5 * width[k, i] + COLOR_GAP_PX + 0.5 * COLOR_SPAN_PX
            before, after = i - 1, i + 1
            while before >= 0 and not anchor[k, before]:
                before -= 1
            while after < count[k] and not anchor[k, after]:
                after += 1
            for c in range(3):
                here = pooled[k, i, 1, c]
                inner = pooled[k, before, 1, c] if before >= 0 else start[k, c]
                gap = radius[k, i] - (radius[k, before] if before >= 0 else start[k, 3])
                bands[0, k, i, c] = pooled[k, i, 0, c] - (here + (inner - here) * min(off / max(gap, 1.0), 1.0))
                level = here
                if after < count[k]:
                    step = (pooled[k, after, 1, c] - here) / max(radius[k, after] - radius[k, i], 1.0)
                    level = here + step * min(off, radius[k, after] - radius[k, i])
                bands[1, k, i, c] = pooled[k, i, 2, c] - level
    return bands
