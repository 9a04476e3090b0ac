"""How deep a defect is, freed of what noise and smoothing do to a largest value, and whether its floor was lit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from algorithms.sizing.background import smooth_from
from algorithms.sizing.edges import GAP_MM

# The largest depth, but not one cell's luck: near the top of those cells that come close to the deepest one, which
# are the whole of a flat floor and the tip of a cone.
NEAR_DEEPEST_SHARE, DEEPEST_PERCENTILE = 0.8, 90.0
PERCENTILE_SIGMAS = 1.2816  # how far that percentile lies above the mean of a flat floor's noise
ABOVE_PERCENTILE = 0.375  # a bowl's depths are even over its area: a quarter of median to percentile lies beyond it
CELL_LOSS = 2.4  # a cell's own median takes a part again of what the smoothing over nine cells takes
LOSS_OPEN = 0.9  # of such a correction, one standard deviation
SMOOTHED_CELLS = 9  # cells that share their points' noise
LARGE_CELLS = 20 * SMOOTHED_CELLS  # in a smaller defect a few cells may be its tip
RUN_MM = 3.0  # a floor stays level for so long behind a shadow
LEVEL_SHARE = 0.07  # of the depth: a floor that drops by less over that run is level
BORE_STD_MM = 0.025  # the local bore, from which depth is counted


class Floor(NamedTuple):
    """The deepest place, its standard deviation, and whether light reached it: if not, the depth is a least one."""

    depth_mm: float
    std_mm: float
    seen: bool


def visible_depth_mm(length_mm: float, steepest_light_rad: float) -> float:
    """How deep light can reach in a defect of a length whose near side is steep; deeper floors stay in the dark."""
    return length_mm * float(np.tan(steepest_light_rad))


def floor_of(
    deviation: Float[np.ndarray, "around along"],
    inside: Bool[np.ndarray, "around along"],
    blunt: Bool[np.ndarray, "around along"],
    noise: Float[np.ndarray, "around along"],
    cell_mm: float,
) -> Floor:
    """The depth of one defect in a window of the map, by its sharp cells where there are enough."""
    sharp = inside & ~blunt
    near = sharp if np.count_nonzero(sharp) >= LARGE_CELLS else inside
    near = near & (deviation > NEAR_DEEPEST_SHARE * _deepest_mm(deviation[near]))
    depths, sigma = deviation[near], float(np.median(noise[near]))
    middle, top = np.percentile(depths, [50, DEEPEST_PERCENTILE])
    seen = _is_seen(deviation, inside, float(top), sigma, cell_mm)
    # what noise adds to a percentile: all of it on a flat floor, less where the floor, with its rim, itself varies
    scatter = max(float(np.std(depths)), sigma)
    added = PERCENTILE_SIGMAS * sigma**2 / scatter
    independent = max(0.1 * depths.size / SMOOTHED_CELLS, 1.0)
    std = np.sqrt(sigma**2 / independent + BORE_STD_MM**2)
    if not seen:
        return Floor(float(top - added), float(np.hypot(std, added)), False)
    lost = CELL_LOSS * max(_lost_mm(deviation, near & (deviation >= top)) - sigma, 0.0)
    above = ABOVE_PERCENTILE * max(top - middle - PERCENTILE_SIGMAS * sigma, 0.0)
    return Floor(float(top - added + lost + above), float(np.hypot(std, LOSS_OPEN * (lost + above))), True)


def _deepest_mm(depths: Float[np.ndarray, "n"]) -> float:
    """The largest depth that is no stray: of a large defect, one that as many cells come close to as are smoothed over.

    Fewer are a place too small to be told from a few points that were taken for another slit, at the rim of a shadow.
    """
    ordered = np.sort(depths)[::-1]
    first = 0
    while depths.size - first >= LARGE_CELLS:
        close = int(np.count_nonzero(ordered[first:] > NEAR_DEEPEST_SHARE * ordered[first]))
        if close >= SMOOTHED_CELLS:
            break
        first += close
    return float(ordered[first])


def _lost_mm(deviation: Float[np.ndarray, "around along"], deepest: Bool[np.ndarray, "around along"]) -> float:
    """What smoothing took from a tip or a narrow groove: as much as smoothing once more takes."""
    again = np.full(deviation.shape, np.nan)
    smooth_from(deviation, np.zeros(deviation.shape[0]), 0, deviation.shape[1], again)
    return float(np.median(deviation[deepest] - again[deepest]))


def _is_seen(
    deviation: Float[np.ndarray, "around along"],
    inside: Bool[np.ndarray, "around along"],
    depth: float,
    sigma: float,
    cell_mm: float,
) -> bool:
    """Whether the deepest place is no mere end of what light reached.

    Where the deepest cells begin right behind a shadow and rise from there without a level run, light fell on the far
    side alone, and the floor lies deeper in the shadow.
    """
    level = max(LEVEL_SHARE * depth, 3 * sigma)
    gap, run = max(round(GAP_MM / cell_mm), 1), max(round(RUN_MM / cell_mm), 2)
    said = []
    for line in np.flatnonzero((inside & (deviation >= depth - level)).any(axis=1)):
        first = int(np.flatnonzero(inside[line] & (deviation[line] >= depth - level))[0])
        behind = deviation[line, max(first - gap - 1, 0) : first]
        shadowed = not np.isfinite(behind).any() or np.isnan(behind[-1])
        beyond = deviation[line, first + run : first + 2 * run]
        beyond = beyond[np.isfinite(beyond)]
        said.append(not shadowed or bool(beyond.size and beyond[0] >= depth - 2 * level))
    return bool(np.mean(said) >= 0.5) if said else False
