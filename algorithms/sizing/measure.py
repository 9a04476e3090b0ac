"""Defects from the wall map: cells beyond the threshold are joined, and each defect sized at half its own depth."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit
from pydantic import Field

from algorithms.robust import spread
from algorithms.sizing.thresholds import ThresholdSettings
from algorithms.types import Defect, WallMap
from sensor_model.geometry import wrap_rad
from sensor_model.recording import NominalPipe
from sensor_model.settings import Settings

# The largest depth, but not one cell's luck: near the top of those cells that come close to the deepest one, which
# are the whole of a flat floor and the tip of a cone.
NEAR_DEEPEST_SHARE, DEEPEST_PERCENTILE = 0.8, 90.0
GAP_CELLS = 2  # more unseen cells than this between wall and floor are a shadow
LOST_CELLS = 7  # over so many unseen cells nothing is drawn
EDGE_QUANTILE = 0.1  # an edge lies where this share of the lines begins; its outermost lines may be stray


class SizingSettings(Settings):
    """Threshold, the gap over which cells are joined, and the smallest defect that is called."""

    threshold: ThresholdSettings = ThresholdSettings()
    join_mm: Annotated[float, Field(ge=0, le=50)] = 3.0
    min_length_mm: Annotated[float, Field(ge=0)] = 3.0
    min_width_mm: Annotated[float, Field(ge=0)] = 3.0
    min_cells: Annotated[int, Field(ge=1)] = 10


class Extent(NamedTuple):
    """Both edges of a defect along one direction, mm, and the standard deviation of their distance."""

    start_mm: float
    end_mm: float
    std_mm: float


def segment(
    deep: Bool[np.ndarray, "around along"], wall: WallMap, inner_radius_mm: float, join_mm: float
) -> Int[np.ndarray, "around along"]:
    """Number the groups of deep cells, joined over small gaps and across 12 o'clock; 0 is no defect."""
    reach_z = int(join_mm / 2 / _cell_z(wall))
    reach_arc = int(join_mm / 2 / _cell_arc(wall, inner_radius_mm))
    return numbered(deep, reach_arc, reach_z)


@njit(cache=True, error_model="numpy")
def numbered(deep, reach_arc, reach_z):
    """Number the groups of cells whose surroundings, so many cells to each side, touch; the first axis is a ring."""
    around, along = deep.shape
    near = _widened(deep, reach_arc, reach_z)
    # each cell's group, and the lowest number that is known to be the same group
    label, same, groups = np.zeros((around, along), dtype=np.int64), np.zeros(deep.size + 1, dtype=np.int64), 0
    for i in range(around):
        for j in range(along):
            if not near[i, j]:
                continue
            if j > 0 and near[i, j - 1]:
                label[i, j] = label[i, j - 1]
            else:
                groups += 1
                label[i, j] = same[groups] = groups
            if i > 0:
                _join_beside(label, same, i, j, i - 1)
    for j in range(along):
        if near[around - 1, j]:
            _join_beside(label, same, around - 1, j, 0)
    number, count = np.zeros(groups + 1, dtype=np.int64), 0
    for k in range(1, number.size):
        first = _first_of(same, k)
        if first == k:
            count += 1
            number[k] = count
        number[k] = number[first]
    out = np.zeros((around, along), dtype=np.int64)
    for i in range(around):
        for j in range(along):
            if deep[i, j]:
                out[i, j] = number[label[i, j]]
    return out


@njit(cache=True, error_model="numpy")
def _widened(deep, reach_arc, reach_z):
    """Cells with a deep one within reach, along and around."""
    around, along = deep.shape
    line, near = np.zeros(along, dtype=np.bool_), np.zeros((around, along), dtype=np.bool_)
    for i in range(around):
        last, some = -1, False
        for j in range(along):
            if deep[i, j]:
                line[max(last + 1, j - reach_z) : j + reach_z + 1] = True
                last, some = min(j + reach_z, along - 1), True
        if some:
            for turn in range(-reach_arc, reach_arc + 1):
                near[(i + turn) % around] |= line
            line[:] = False
    return near


@njit(cache=True, error_model="numpy", forceinline=True)
def _join_beside(label, same, i, j, beside):
    """Make one group of a cell's and of those that touch it in another line, unless its neighbour before did so."""
    began = j > 0 and label[i, j - 1] > 0
    if label[beside, j] > 0:
        if not (began and label[beside, j - 1] > 0):
            _join(same, label[i, j], label[beside, j])
        return
    if not began and j > 0 and label[beside, j - 1] > 0:
        _join(same, label[i, j], label[beside, j - 1])
    if j + 1 < label.shape[1] and label[beside, j + 1] > 0:
        _join(same, label[i, j], label[beside, j + 1])


@njit(cache=True, error_model="numpy")
def _join(same, a, b):
    a, b = _first_of(same, a), _first_of(same, b)
    same[max(a, b)] = min(a, b)


@njit(cache=True, error_model="numpy")
def _first_of(same, k):
    """The lowest number of a group, to which the way there is shortened."""
    while same[k] != k:
        same[k] = same[same[k]]
        k = same[k]
    return k


def measure_defects(
    wall: WallMap,
    deviation_mm: Float[np.ndarray, "around along"],
    threshold_mm: Float[np.ndarray, "around along"],
    noise_mm: Float[np.ndarray, "around along"],
    pipe: NominalPipe,
    steepest_light_rad: float,
    settings: SizingSettings,
) -> tuple[Defect, ...]:
    """Every defect deeper than the threshold, in order of distance; `steepest_light_rad` is the widest half angle."""
    labels = segment(deviation_mm > threshold_mm, wall, pipe.inner_radius_mm, settings.join_mm)
    found = []
    for label in np.unique(labels[labels > 0]):
        defect = measure_one(wall, deviation_mm, labels == label, noise_mm, pipe, steepest_light_rad)
        big = defect.length_mm >= settings.min_length_mm and defect.width_mm >= settings.min_width_mm
        if big and defect.seen_cells >= settings.min_cells:
            found.append(defect)
    return tuple(sorted(found, key=lambda defect: defect.start_mm))


def measure_one(
    wall: WallMap,
    deviation_mm: Float[np.ndarray, "around along"],
    cells: Bool[np.ndarray, "around along"],
    noise_mm: Float[np.ndarray, "around along"],
    pipe: NominalPipe,
    steepest_light_rad: float,
) -> Defect:
    """Size one defect: depth over the background, then both extents at half of that depth."""
    turn = _turn_to_middle(wall, cells)
    deviation, inside, noise = (np.roll(part, turn, axis=0) for part in (deviation_mm, cells, noise_mm))

    depth = _largest_depth_mm(deviation[inside])
    floor = inside & (deviation > 0.5 * depth)
    columns, rows = np.flatnonzero(floor.any(axis=1)), np.flatnonzero(floor.any(axis=0))
    cell_z, cell_arc = _cell_z(wall), _cell_arc(wall, pipe.inner_radius_mm)

    shadow_cells_per_mm = 1 / (np.tan(steepest_light_rad) * cell_z)
    axial = _extent([_line(deviation[c], floor[c], depth / 2, shadow_cells_per_mm) for c in columns], cell_z)
    arc = _extent([_line(deviation[:, r], floor[:, r], depth / 2) for r in rows], cell_arc)
    cell_rad = 2 * np.pi / wall.theta_rad.size
    theta = wall.theta_rad[0] + ((arc.start_mm + arc.end_mm) / 2 / cell_arc - turn) * cell_rad
    box = deviation[columns[0] : columns[-1] + 1, rows[0] : rows[-1] + 1]
    level = deviation[floor]
    scanned = wall.scanned()
    return Defect(
        start_mm=float(wall.z_mm[0] + axial.start_mm),
        length_mm=axial.end_mm - axial.start_mm,
        width_mm=arc.end_mm - arc.start_mm,
        depth_mm=depth,
        theta_rad=float(np.mod(theta, 2 * np.pi)),
        wall_loss_pct=100 * depth / pipe.wall_thickness_mm,
        length_std_mm=axial.std_mm,
        width_std_mm=arc.std_mm,
        depth_std_mm=float(np.hypot(np.median(noise[floor]), np.std(level) / np.sqrt(level.size))),
        unseen_share=float(np.mean(~np.isfinite(box))),
        seen_cells=int(inside.sum()),
        cut_by_scan_end=bool(rows[0] <= scanned.start or rows[-1] >= scanned.stop - 1),
    )


def _turn_to_middle(wall: WallMap, cells: Bool[np.ndarray, "around along"]) -> int:
    """By how many cells to roll the wall so that a defect's middle is the map's, and it never crosses the seam."""
    columns = np.flatnonzero(cells.any(axis=1))
    middle = np.angle(np.exp(1j * wall.theta_rad[columns]).mean())
    return wall.theta_rad.size // 2 - int(np.argmin(np.abs(wrap_rad(wall.theta_rad - middle))))


def _largest_depth_mm(depths: Float[np.ndarray, "n"]) -> float:
    return float(np.percentile(depths[depths > NEAR_DEEPEST_SHARE * depths.max()], DEEPEST_PERCENTILE))


def _line(
    deviation: np.ndarray, floor: np.ndarray, level: float, shadow_cells_per_mm: float = 0.0
) -> tuple[float, float]:
    """Where one line of the map rises above a level and falls below it again, in cells.

    With a shadow, the line runs along the pipe and light comes from its beginning. Where no wall was seen beyond the
    defect (the scan's end, the strut's sector) it is taken to end with what was seen of it.
    """
    deep = np.flatnonzero(floor)
    seen = np.flatnonzero(np.isfinite(deviation))
    before, after = seen[seen < deep[0]], seen[seen > deep[-1]]
    first, last = int(deep[0]), int(deep[-1])
    wall = int(before[-1]) if before.size else first - LOST_CELLS
    shadow = deviation[first] * shadow_cells_per_mm
    if before.size and GAP_CELLS < first - wall < shadow + LOST_CELLS:
        start = _rim(wall, first, shadow)
    else:
        start = _crossing(deviation, wall, first, level)
    return start, _crossing(deviation, int(after[0]) if after.size else last + LOST_CELLS, last, level)


def _rim(wall: int, first_deep: int, shadow: float) -> float:
    """The rim of a defect whose floor begins in shadow, in cells.

    The rim lies behind the last wall that was seen, and one shadow's length before the first floor that was. A slit
    is seen only where the bands on both its sides are, which takes the same margin from either estimate, in opposite
    directions: their mean is the rim.
    """
    behind, before = wall + 0.5, first_deep - 0.5 - shadow
    return 0.5 * (behind + min(max(before, behind), first_deep - 0.5))


def _crossing(deviation: np.ndarray, outside: int, deep: int, level: float) -> float:
    """Place between a wall cell and a deep one at which the level is crossed, on a straight line between them."""
    if abs(outside - deep) >= LOST_CELLS:
        return deep + 0.5 * np.sign(outside - deep)
    low, high = deviation[outside], deviation[deep]
    share = np.clip((level - low) / (high - low), 0.0, 1.0) if high > low else 0.5
    return outside + share * (deep - outside)


def _extent(edges: list[tuple[float, float]], cell_mm: float) -> Extent:
    """Edges over all lines: a low quantile of where they begin, a high one of where they end."""
    start, end = np.array(edges).T
    start, end = start * cell_mm, end * cell_mm
    # half a cell of quantisation at each edge, and what the lines' scatter leaves after averaging
    scatter = [spread(edge) / np.sqrt(edge.size) for edge in (start, end)]
    std = float(np.sqrt(scatter[0] ** 2 + scatter[1] ** 2 + 2 * cell_mm**2 / 12))
    return Extent(float(np.quantile(start, EDGE_QUANTILE)), float(np.quantile(end, 1 - EDGE_QUANTILE)), std)


def _cell_z(wall: WallMap) -> float:
    return float(wall.z_mm[1] - wall.z_mm[0])


def _cell_arc(wall: WallMap, inner_radius_mm: float) -> float:
    return inner_radius_mm * 2 * np.pi / wall.theta_rad.size
