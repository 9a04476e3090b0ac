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
CURVED_OPEN = 0.12  # of what a rounded floor rises within two cells: smoothing takes up to a quarter of it, or none
LAG = 2
STRAYS = 3  # so many cells may be deeper than the deepest
LEVELS, LEVELS_TAKEN, LEAST_LEVEL = (0.3, 0.8), 6, 0.7  # of the deepest: where the area of a defect is taken
CONE_CELLS = (1.3, 1.7)  # run of a cone's sides that smoothing takes from its tip; a bowl's would be longer
CONE_BOWL = (0.94, 1.0)  # the end of a bowl over the deepest cells: within them, it is none
STRAIGHT = 0.08  # of a line's mean: what is off it by more is no cone
TIP_OPEN = 0.35  # of what is missing of a tip, one standard deviation
SMALL_CONE_CELLS = (4.0, 7.0)  # radius: in so small a cone smoothing lowers the sides themselves,
TIP_SHORT = (0.9, 0.2)  # and their lines end short of the tip by so much of what is missing of it
SMOOTHED_CELLS = 9  # cells that share their points' noise
LARGE_CELLS = 20 * SMOOTHED_CELLS  # in a smaller defect a few cells may be its tip
RUN_MM = 3.0  # a floor stays level for so long behind a shadow
LEVEL_SHARE = 0.07  # of the depth: a floor that drops by less over that run is level
BORE_STD_MM = 0.018  # the local bore, from which depth is counted


class Floor(NamedTuple):
    """The deepest place, its standard deviation, and whether light reached it: if not, the depth is a least one.

    `cone` is how like a cone the defect is, 0 to 1.
    """

    depth_mm: float
    std_mm: float
    seen: bool
    cone: float = 0.0


def visible_depth_mm(length_mm: float, steepest_light_rad: float) -> float:
    """How deep light can reach in a defect of a length whose near side is steep; deeper floors stay in the dark."""
    return length_mm * float(np.tan(steepest_light_rad))


def floor_of(
    deviation: Float[np.ndarray, "around along"],
    inside: Bool[np.ndarray, "around along"],
    firm: Bool[np.ndarray, "around along"],
    blunt: Bool[np.ndarray, "around along"],
    noise: Float[np.ndarray, "around along"],
    cell_mm: tuple[float, float],
    lit: bool = True,
) -> Floor:
    """The depth of one defect in a window of the map, by those of its cells that are firm, and sharp if enough are.

    A cone or bowl is told by all of them. Cells are so long and so wide. Where it is known not to be `lit`, the depth
    is a least one.
    """
    sharp = firm & ~blunt
    near = sharp if np.count_nonzero(sharp) >= LARGE_CELLS else firm
    near = near & (deviation > NEAR_DEEPEST_SHARE * _deepest_mm(deviation[near]))
    depths, sigma = deviation[near], float(np.median(noise[near]))
    middle, top = np.percentile(depths, [50, DEEPEST_PERCENTILE])
    seen = lit and _is_seen(deviation, firm, float(top), sigma, cell_mm[0])
    # what noise adds to a percentile: all of it on a flat floor, less where the floor, with its rim, itself varies
    scatter = max(float(np.std(depths)), sigma)
    added = PERCENTILE_SIGMAS * sigma**2 / scatter
    independent = max(0.1 * depths.size / SMOOTHED_CELLS, 1.0)
    std = np.sqrt(sigma**2 / independent + BORE_STD_MM**2)
    if not seen:
        return Floor(float(top - added), float(np.hypot(std, added)), False)
    lost = CELL_LOSS * max(_lost_mm(deviation, near & (deviation >= top)) - sigma, 0.0)
    above = ABOVE_PERCENTILE * max(top - middle - PERCENTILE_SIGMAS * sigma, 0.0)
    open_ = max(LOSS_OPEN * (lost + above), CURVED_OPEN * _curved_mm(deviation, near & (deviation >= top)))
    depth, tip = float(top - added + lost + above), _tip_of(deviation[inside], cell_mm)
    # two guesses, a bowl's and a cone's: what each leaves open, and how far they are apart
    share, apart = tip.share, tip.depth_mm - depth
    variance = (1 - share) * open_**2 + share * (TIP_OPEN * tip.lost_mm) ** 2 + share * (1 - share) * apart**2
    return Floor(depth + share * apart, float(np.sqrt(std**2 + variance)), True, share)


class Tip(NamedTuple):
    """Where a cone would end, how far that is beyond the deepest cells, and how like a cone the defect is, 0 to 1."""

    depth_mm: float
    lost_mm: float
    share: float


def _tip_of(depths: Float[np.ndarray, "n"], cell_mm: tuple[float, float]) -> Tip:
    """The tip that a defect's area at several depths leads to, if it is pointed.

    The root of a cone's area falls evenly with depth, the area of a bowl itself does; and smoothing takes from a tip
    what the sides fall over a cell or two, where a bowl, taken for a cone, would be far deeper than its deepest cells.
    """
    deepest = min(_deepest_mm(depths), float(np.sort(depths)[-min(STRAYS, depths.size)]))
    levels = np.linspace(max(LEVELS[0] * deepest, float(depths.min())), LEVELS[1] * deepest, LEVELS_TAKEN)
    area = np.sum(depths > levels[:, None], axis=1) * cell_mm[0] * cell_mm[1]
    if levels[0] > LEAST_LEVEL * deepest or area[-1] == area[0]:
        return Tip(deepest, 0.0, 0.0)
    tip, run, off = _end_of(levels, np.sqrt(area / np.pi))
    bowl, _, _ = _end_of(levels, area)
    if off > STRAIGHT:  # a pit in a pocket's floor, say
        return Tip(deepest, 0.0, 0.0)
    lost, run_cells = tip - deepest, run / np.sqrt(cell_mm[0] * cell_mm[1])
    share = np.interp(lost * run_cells, CONE_CELLS, (1.0, 0.0)) * np.interp(bowl / deepest, CONE_BOWL, (1.0, 0.0))
    short = lost * np.interp(tip * run_cells, SMALL_CONE_CELLS, TIP_SHORT)
    return Tip(float(tip + short), lost, float(share))


def _end_of(levels: Float[np.ndarray, "levels"], size: Float[np.ndarray, "levels"]) -> tuple[float, float, float]:
    """Where a straight line through sizes at several depths comes to nothing, how fast it falls, how far off they are.

    The last is a share of their mean.
    """
    per_mm, at_surface = np.polyfit(levels, size, 1)
    off = float(np.std(size - per_mm * levels - at_surface) / np.mean(size))
    return float(-at_surface / per_mm), float(-per_mm), off


def _curved_mm(deviation: Float[np.ndarray, "around along"], deepest: Bool[np.ndarray, "around along"]) -> float:
    """By how much a floor rises within two cells of its deepest ones, on the side where it rises least, either way."""
    rises = []
    for turned, cells in ((deviation, deepest), (deviation.T, deepest.T)):
        wide = np.pad(turned, ((LAG, LAG), (0, 0)), constant_values=np.nan)
        beside = np.fmax(wide[: -2 * LAG], wide[2 * LAG :])
        rise = (turned - beside)[cells]
        rises.append(float(np.median(rise[np.isfinite(rise)])) if np.isfinite(rise).any() else 0.0)
    return max(*rises, 0.0)


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
