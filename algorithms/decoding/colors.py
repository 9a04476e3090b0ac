"""The colours beside each dip, sorted into the frame's own three."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba import njit

from algorithms.decoding.dips import COLOR_GAP_PX, COLOR_SPAN_PX, Dips
from algorithms.decoding.settings import DecodeSettings

# where the three colours lie to begin with, as shares of red and blue in the light (the real sensor's, roughly)
FIRST_CHROMA = np.array([[0.50, 0.23], [0.34, 0.31], [0.20, 0.47]])
CHROMA_ROUNDS, CHROMA_STRIDE = 4, 4  # of every fourth band
FAR_CHROMA = 0.5  # no colour of ours
LEAST_SHARE = 0.5  # of the neighbouring lines must carry a slit on
MOST_MISSED = 2  # lines on end
LEAST_BAND_SHARE = 0.15  # of the other band's light, beyond the slit's own
CARRY_PX, CARRY_GAIN = 6.0, 0.4
LEAST_COLOR_SHARE = 0.03  # of the bands must show each colour, or there is no code to read
FOREIGN_COLOR = -8.0  # log score


def color_scores(dips: Dips, settings: DecodeSettings) -> Float[np.ndarray, "2 lines most 3"]:
    """Log score of each of the three colours, inside and outside of every dip.

    A band's colour is what it has beyond haze and light from the wall, whose level shows in the slits themselves; it
    is gathered along the slit, over so many lines either way. The three centres start where the sensor's colours are
    known to lie and move to the frame's own (k-means).
    """
    valid = np.isfinite(dips.radius_px)
    scores = np.zeros((2, *valid.shape, 3))
    rgb = np.stack([dips.inside_rgb, dips.floor_rgb, dips.outside_rgb])
    pooled, share = _along_slits(dips.found, dips.radius_px, rgb, settings.pooled_lines, CARRY_PX)
    bands = _beyond_floor(dips.found, dips.radius_px, dips.width_px, pooled, share >= LEAST_SHARE, dips.start_rgb)
    samples = np.concatenate([_chroma(bands[0][valid]), _chroma(bands[1][valid])])
    if samples.shape[0] == 0:
        return scores
    carried = np.tile(share[valid] >= LEAST_SHARE, 2)
    few = samples[carried][::CHROMA_STRIDE]
    centers, nearest = FIRST_CHROMA, np.zeros(0)
    for _ in range(CHROMA_ROUNDS):
        distances = _distances2(few, centers)
        nearest = np.where(distances.min(axis=1) < FAR_CHROMA**2, np.argmin(distances, axis=1), -1)
        centers = np.array(
            [np.median(few[nearest == c], axis=0) if (nearest == c).any() else centers[c] for c in range(3)]
        )
    if min(np.count_nonzero(nearest == c) for c in range(3)) < max(LEAST_COLOR_SHARE * nearest.size, 1):
        return np.full_like(scores, FOREIGN_COLOR)
    gap = min(float(np.sum((centers[a] - centers[b]) ** 2)) for a, b in ((0, 1), (0, 2), (1, 2)))
    score = -_distances2(samples, centers) / max(gap / 8, 1e-9)
    best = np.maximum(np.maximum(score[:, 0], score[:, 1]), score[:, 2])
    score = np.maximum(score - best[:, None], FOREIGN_COLOR)
    score[~carried | ~_lit(bands)[:, valid].ravel()] = FOREIGN_COLOR
    scores[:, valid] = score.reshape(2, -1, 3)
    return scores


def _chroma(rgb: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    """Shares of red and blue in a colour; a channel below nothing counts as none."""
    rgb = np.maximum(rgb, 0.0)
    total = np.maximum(rgb[..., 0] + rgb[..., 1] + rgb[..., 2], 1e-9)
    return np.stack([rgb[..., 0] / total, rgb[..., 2] / total], axis=-1)


def _lit(bands: Float[np.ndarray, "2 lines most 3"]) -> np.ndarray:
    """Whether each side of a dip is a band: the foot of the light's inner edge is dark on one side."""
    light = bands[..., 0] + bands[..., 1] + bands[..., 2]
    return light > LEAST_BAND_SHARE * light[::-1]


@njit(cache=True)
def _along_slits(count, radius, rgb, lines, tolerance):
    """Colours of each dip averaged over the dips that carry it on along the neighbouring lines; share of such lines."""
    n_lines, most = radius.shape
    pooled = np.zeros((3, n_lines, most, 3))
    share = np.ones((n_lines, most))
    for k in range(n_lines):
        for i in range(count[k]):
            for part in range(3):
                for c in range(3):
                    pooled[part, k, i, c] = rgb[part, k, i, c]
            found = 0
            for way in (-1, 1):
                at, missed = radius[k, i], 0
                for step in range(1, lines + 1):
                    other = (k + way * step) % n_lines
                    nearest, off = -1, tolerance
                    for j in range(count[other]):
                        if abs(radius[other, j] - at) <= off:
                            nearest, off = j, abs(radius[other, j] - at)
                    if nearest < 0:
                        missed += 1
                        if missed > MOST_MISSED:
                            break
                        continue
                    missed, found = 0, found + 1
                    at += CARRY_GAIN * (radius[other, nearest] - at)  # a jagged print jumps from line to line
                    for part in range(3):
                        for c in range(3):
                            pooled[part, k, i, c] += rgb[part, other, nearest, c]
            for part in range(3):
                for c in range(3):
                    pooled[part, k, i, c] /= found + 1
            if lines > 0:
                share[k, i] = found / (2.0 * lines)
    return pooled, share


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
                here = pooled[1, k, i, c]
                inner = pooled[1, k, before, c] if before >= 0 else start[k, c]
                gap = radius[k, i] - (radius[k, before] if before >= 0 else start[k, 3])
                bands[0, k, i, c] = pooled[0, k, i, c] - (here + (inner - here) * min(off / max(gap, 1.0), 1.0))
                level = here
                if after < count[k]:
                    step = (pooled[1, k, after, c] - here) / max(radius[k, after] - radius[k, i], 1.0)
                    level = here + step * min(off, radius[k, after] - radius[k, i])
                bands[1, k, i, c] = pooled[2, k, i, c] - level
    return bands


def _distances2(chroma: Float[np.ndarray, "n 2"], centers: Float[np.ndarray, "3 2"]) -> Float[np.ndarray, "n 3"]:
    """Squared distances written out: a sum over an axis of two is several times slower."""
    return (chroma[:, :1] - centers[:, 0]) ** 2 + (chroma[:, 1:] - centers[:, 1]) ** 2
