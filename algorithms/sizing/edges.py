"""Where a defect begins and ends: line by line of the map between its cells, then the outermost of all lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from algorithms.robust import spread

GAP_MM = 2.0  # more unseen wall than this between wall and floor is a shadow
LOST_MM = 7.0  # over so much unseen wall nothing is drawn
PLACE_OPEN_MM = 0.08  # of a side, however small the cells: the sensor's roll and place, which many lines share
UNSEEN_OPEN = 0.1  # of the unseen cells between wall and floor: what is open of an edge's place among them
NOISE_OPEN_MM, LEAST_STEP_MM = 0.06, 0.6  # over the step of a side: what the map's noise leaves open of it, in cells
CELL_SHARE = 0.14  # of a cell: the least by which lines scatter
NEAR_SIGMAS = 2.0  # lines within so many standard deviations of the outermost edge belong to it
STRAIGHT_SHARE, STRAIGHT_LINES = 0.5, 6  # where more than this share of so many lines does, the side is straight
SAME_CELL = 1.0  # cells: a cell that a side runs through is sometimes wall, sometimes floor
MOST_WORN = 0.8  # cells
STRAY_SHARE = 0.15  # of all lines: so many may be stray
STRAY_SIGMAS, STRAY_STEPS = 2.0, 4.0  # apart by more than so much noise, and so many steps from line to line
TIP_SHARE = 0.25  # of the step from line to line: where between two lines a tip lies
END_LINES = 2.0  # by so many lines a slanted groove may run on beyond its last: smoothing wears off its ends
RIM_SHARE = 0.3  # of the level: a side wall that has risen so far is near its rim
RIM_OPEN = 0.3  # of a cell: the least that a shadow leaves open of a rim's place
SHADOW_SHARE = 0.5  # of a shadow's depth: what lies less deep behind a gap lies in no shadow
SMOOTHED_CELLS = 0.6  # by which the median of three cells widens a side wall
LAG = 2  # lines so far apart share no cell of the smoothing's three


class Edges(NamedTuple):
    """Both edges of a defect on every line, in cells, and what is open of each, one standard deviation in cells."""

    start: Float[np.ndarray, "lines"]
    end: Float[np.ndarray, "lines"]
    start_std: Float[np.ndarray, "lines"]
    end_std: Float[np.ndarray, "lines"]


class Extent(NamedTuple):
    """Both edges of a defect along one direction, mm, and the standard deviation of their distance."""

    start_mm: float
    end_mm: float
    std_mm: float


def edges_of(
    deviation: Float[np.ndarray, "lines cells"],
    floor: Bool[np.ndarray, "lines cells"],
    level: float,
    cell_mm: float,
    shadow_mm_per_mm: float = 0.0,
) -> Edges:
    """Where each line that has floor rises above a level and falls below it again.

    With a shadow, lines run along the pipe and light comes from their beginning. Where no wall was seen beyond the
    defect (the scan's end, the strut's sector) it is taken to end with what was seen of it.
    """
    lines = np.flatnonzero(floor.any(axis=1))
    wall, lost = [_wall_beside(deviation[k], floor[k]) for k in lines], LOST_MM / cell_mm
    ends = np.array([_crossing(deviation[k], w[3], w[2], level, lost) for k, w in zip(lines, wall, strict=True)])
    shadow = shadow_mm_per_mm / cell_mm
    # the lit side wall tells how far beyond its rim a side wall reaches this level; the shadowed one is like it
    foot = _foot(deviation, lines, wall, level, lost) if shadow > 0 else 0.0
    starts = []
    for k, (before, first, _, _) in zip(lines, wall, strict=True):
        reach = deviation[k, first] * shadow
        if before >= 0 and first - before > GAP_MM / cell_mm and _is_shadow(deviation[k], before, first, shadow):
            starts.append(_rim(before, first, reach, foot, level * shadow))
        else:
            starts.append(_crossing(deviation[k], before, first, level, lost))
    start, start_std = np.array(starts).T
    return Edges(start, ends[:, 0], start_std, ends[:, 1])


def _wall_beside(deviation: np.ndarray, floor: np.ndarray) -> tuple[int, int, int, int]:
    """Of one line: the last seen cell before the floor, the floor's first and last, the first seen one after; or -1."""
    deep, seen = np.flatnonzero(floor), np.flatnonzero(np.isfinite(deviation))
    first, last = int(deep[0]), int(deep[-1])
    k, m = int(np.searchsorted(seen, first)), int(np.searchsorted(seen, last, side="right"))
    return int(seen[k - 1]) if k > 0 else -1, first, last, int(seen[m]) if m < seen.size else -1


def _foot(deviation: np.ndarray, lines: np.ndarray, wall: list, level: float, lost: float) -> float:
    """How far, in cells, the lit side wall runs from the level to near its rim: the median of all lines."""
    runs = []
    for k, (_, _, last, after) in zip(lines, wall, strict=True):
        if after < 0 or after - last >= lost:
            continue
        outside, deep = after, last
        while outside + 1 < deviation.shape[1] and deviation[k, outside] > RIM_SHARE * level:
            deep, outside = outside, outside + 1
        if np.isfinite(deviation[k, outside]) and np.isfinite(deviation[k, deep]):
            rim = _crossing(deviation[k], outside, deep, RIM_SHARE * level, lost)[0]
            runs.append(rim - _crossing(deviation[k], after, last, level, lost)[0])
    return max(float(np.median(runs)) - SMOOTHED_CELLS, 0.0) if runs else 0.0


def _is_shadow(deviation: np.ndarray, wall: int, first: int, shadow: float) -> bool:
    """Whether the floor behind a gap is as deep as where light that passes the gap's beginning falls on it.

    A gap in front of a shallower place is no shadow: too few points fell there. One longer than its floor's depth
    throws has wall and floor beside it that no slit was found on: what is open of the rim says so.
    """
    return bool((deviation[first] - deviation[wall]) * shadow > SHADOW_SHARE * (first - wall - 1))


def _rim(wall: int, first_deep: int, shadow: float, foot: float, furthest: float) -> tuple[float, float]:
    """The edge of a defect whose floor begins in shadow, in cells.

    The rim lies behind the last wall that was seen, and one shadow's length before the first floor that was. A slit
    is seen only where the bands on both its sides are, which takes the same margin from either estimate, in opposite
    directions: their mean is the rim, and how far they are apart is what is open of it. A side wall that slopes lies
    a foot further in, but not where the light would have shown it.
    """
    behind, last = wall + 0.5, first_deep - 0.5
    before = min(max(last - shadow, behind), last)
    edge = max(0.5 * (behind + before), behind + min(foot, furthest))
    return edge, RIM_OPEN + 0.5 * (before - behind) / np.sqrt(3)


def _crossing(deviation: np.ndarray, outside: int, deep: int, level: float, lost: float) -> tuple[float, float]:
    """Place between a wall cell and a deep one at which the level is crossed, on a straight line between them.

    Half a cell beyond the deep one, and open, where no wall was seen near it.
    """
    if outside < 0 or abs(outside - deep) >= lost:
        return deep + 0.5 * np.sign(outside - deep), lost / 2
    low, step = deviation[outside], deviation[deep] - deviation[outside]
    share = np.clip((level - low) / step, 0.0, 1.0) if step > 0 else 0.5
    apart = abs(deep - outside)
    noise = apart * (NOISE_OPEN_MM / max(LEAST_STEP_MM, step))
    return outside + share * (deep - outside), float(np.hypot(UNSEEN_OPEN * (apart - 1), noise))


def extent_of(edges: Edges, cell_mm: float) -> Extent:
    """The outermost edges of all lines, and how well their distance is known."""
    start, start_std = _outermost(edges.start, edges.start_std)
    end, end_std = _outermost(-edges.end, edges.end_std)
    std_mm = np.sqrt((start_std**2 + end_std**2) * cell_mm**2 + 2 * PLACE_OPEN_MM**2)
    return Extent(start * cell_mm, -end * cell_mm, float(std_mm))


def _outermost(edge: Float[np.ndarray, "lines"], open_: Float[np.ndarray, "lines"]) -> tuple[float, float]:
    """Where the smallest of all edges lies, and its standard deviation.

    It is the mean of those lines that agree with it: a straight side gives all of its lines, so that noise moves it
    neither out nor in, and lines that see a cell which it runs through the other way do not either; a round or pointed
    one gives its tip.
    """
    noise = max(_line_noise(edge), CELL_SHARE, 0.5 * float(np.median(open_)))
    first = _first_supported(edge, noise)
    near = np.abs(edge - first) <= NEAR_SIGMAS * noise
    middle = float(np.median(edge))
    usual = np.abs(edge - middle) <= NEAR_SIGMAS * noise
    if edge.size >= STRAIGHT_LINES:
        if near.mean() > STRAIGHT_SHARE:  # the outermost of many is out by its noise
            near = np.abs(edge - np.median(edge[near])) <= NEAR_SIGMAS * noise
        elif usual.mean() > STRAIGHT_SHARE and middle - first < SAME_CELL and _is_level(edge):
            near = usual
    # not again: on the side of a slanted groove the lines near a mean lie ever further in
    place, lines = float(edge[near].mean()) if near.any() else first, max(int(near.sum()), 1)
    # the smoothing's median of nine takes a cell over its radius from a round tip, whose chord these lines are
    worn = min(8 * NEAR_SIGMAS * CELL_SHARE / lines**2, MOST_WORN)
    steps = TIP_SHARE * float(np.median(np.abs(np.diff(edge)))) if edge.size > 1 else 0.0
    if edge.size > 2 * LAG + 1 and (near[0] or near[-1]):
        course = abs(float(np.median(edge[-1 - LAG :]) - np.median(edge[: 1 + LAG]))) / (edge.size - 1 - LAG)
        steps = float(np.hypot(steps, END_LINES * course)) if course < 1 else steps
    known = noise**2 * min((LAG + 1) / lines, 1.0) + np.median(open_[near] if near.any() else open_) ** 2
    shifted = place - worn if edge.size > 1 else place  # a lone line tells nothing of a tip
    return shifted, float(np.sqrt(known + steps**2 + (0.5 * worn) ** 2))


def _is_level(edge: Float[np.ndarray, "lines"]) -> bool:
    """Whether both halves of a side's lines have it in the same place: it does not slant."""
    half = edge.size // 2
    return bool(abs(np.median(edge[:half]) - np.median(edge[half:])) <= CELL_SHARE)


def _first_supported(edge: Float[np.ndarray, "lines"], noise: float) -> float:
    """The smallest edge that is no stray: a line between two others, or a few that stand apart from all others.

    The first and the last line may be a tip, to which the others lead up.
    """
    if edge.size < 3:
        return float(edge.min())
    between = np.median(np.stack([edge[:-2], edge[1:-1], edge[2:]]), axis=0)
    ordered = np.sort(np.concatenate([edge[:1], between, edge[-1:]]))
    step = float(np.median(np.abs(np.diff(edge))))
    few = int(STRAY_SHARE * edge.size)
    apart = np.flatnonzero(np.diff(ordered[: few + 1]) > max(STRAY_SIGMAS * noise, STRAY_STEPS * step))
    return float(ordered[apart[-1] + 1 if apart.size else 0])


def _line_noise(edge: Float[np.ndarray, "lines"]) -> float:
    """How far lines scatter about their own course, in cells; 0 where there are too few to tell."""
    if edge.size < 3 * LAG + 1:
        return 0.0
    return spread(edge[2 * LAG :] - 2 * edge[LAG:-LAG] + edge[: -2 * LAG]) / float(np.sqrt(6))
