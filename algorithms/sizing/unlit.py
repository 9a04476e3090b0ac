"""Places of the map where no wall can be: so deep that no light falls there, or seen once where others saw wall."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from algorithms.large_arrays import pieces
from algorithms.robust import MAD_TO_SIGMA
from algorithms.sizing.background import seen_medians
from algorithms.types import WallMap

BLOCK_MM = 200.0  # whose medians are taken for the bore
REACH_MM = 2.0  # along the wall: what lies so near should agree
WIDE_MM = 4.0, 10.0  # and one that stands alone on its line has none so near; where cells are seen once, it takes more
SPIKE, SPIKE_SHARE = 3, 0.6  # nor has a floor places with so many times fewer points, of whose depth it is so much
AGREE_SHARE = 0.85  # of a place's depth: what is so deep agrees with it
FLOOR_CELLS = 5  # a line that sees a floor has so many cells' usual points of it within 4 mm, and fewer that are none
MARGIN_MM, MARGIN_SIGMAS = 0.1, 3.0  # of how far the block's cells scatter


class Heard(NamedTuple):
    """What one line of the map says of a depth at a row.

    Points that are as deep near it, points of wall that stands in its light, whether what is so deep there is a stray,
    and whether the line sees a floor so deep.
    """

    alike: int
    against: int
    stray: bool
    floor: bool


def drop_unlit(wall: WallMap, steepest_light_rad: float) -> None:
    """Empty the cells of a map that hold false slits alone, in place.

    Light comes from the scan's beginning, as steep as the cell's own points have it, or (in a map that does not know)
    as the widest half angle: wall that was seen before a place and stands in its light says that the place is none,
    unless more points beside it say that it is. Nor is one that fewer points saw than see the usual cell, where
    others near it along the pipe are shallower and none as deep; nor one that stands out of a floor which far more saw.
    All are what a decoder makes of a shadow's end, or of light that comes out of the wall beside where it went in.
    A place beside a line that sees a floor as deep stays: the defect's side runs between the two.
    """
    cell = wall.cell_z_mm
    block, *reaches = (round(length / cell) for length in (max(BLOCK_MM, cell), REACH_MM, *WIDE_MM))
    slope = wall.light_slope
    if slope is None:
        slope = np.broadcast_to(np.float32(np.tan(steepest_light_rad)), wall.count.shape)
    whole = wall.radius_mm, wall.spread_mm, wall.sigma_mm, wall.count
    for part in pieces(*whole, slope, rows=block):
        for first in range(part.start, part.stop, block):
            last = min(first + block, part.stop)
            level = seen_medians(wall.radius_mm, first, last)
            false = unlit(wall.radius_mm, level, wall.count, slope, (first, last), cell, tuple(reaches))
            for values in whole[:3]:
                values[false] = np.nan
            wall.count[false] = 0


@njit(cache=True, error_model="numpy")
def unlit(radius, level, count, slope, rows, cell_mm, reaches):
    """Columns and rows of the false cells in a stretch of rows."""
    around, (reach, wide, wider) = radius.shape[0], reaches
    some = count[:, rows[0] : rows[1]].ravel()
    some = some[some > 0]
    if some.size == 0:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    usual, off = np.median(some), np.empty(some.size)
    wide = wide if usual > 1 else wider
    n = 0
    for i in range(around):
        for j in range(rows[0], rows[1]):
            if count[i, j] > 0:
                off[n] = abs(radius[i, j] - level[i])
                n += 1
    margin = MARGIN_MM + MARGIN_SIGMAS * MAD_TO_SIGMA * np.median(off)
    column, row = np.empty(some.size, dtype=np.int64), np.empty(some.size, dtype=np.int64)
    n = 0
    for i in range(around):
        for j in range(rows[0], rows[1]):
            depth, rise = radius[i, j] - level[i], cell_mm * slope[i, j]  # that light gains from row to row
            # a row is as wide as its cells: wall at the end of one, and a floor at the beginning of the next but one
            if not depth > 2.0 * rise + margin:
                continue
            alike, against, stray = 0, 0, False
            for m in (i - 1, i, i + 1 if i + 1 < around else 0):
                own = heard(radius[m], level[m], count[m], j, depth, rise, margin, usual, (reach, wide))
                if own.floor and m != i:
                    break
                alike, against, stray = alike + own.alike, against + own.against, stray or (own.stray and m == i)
            else:
                if stray or against >= alike:
                    column[n], row[n] = i, j
                    n += 1
    return column[:n], row[:n]


@njit(cache=True, error_model="numpy")
def heard(radius, level, count, j, depth, rise, margin, usual, reaches):
    """What a line says of wall so deep at a row: a `Heard`."""
    (reach, wide), along = reaches, radius.size
    alike, cells, agree, beside, spike, floor, against = 0, 0, 0, 0, 0, 0, 0
    for k in range(max(j - wide, 0), min(j + wide + 1, along)):
        if count[k] == 0:
            continue
        off = radius[k] - level
        if off >= AGREE_SHARE * depth:
            cells += 1
            agree += count[k]
            alike += count[k] if abs(k - j) <= reach else 0
        else:
            beside += count[k]
        if off > SPIKE_SHARE * depth:
            spike += count[k]
        elif off > margin:
            floor += count[k]
    if alike == 0:  # beyond a defect's side, say
        return Heard(0, 0, False, False)
    for k in range(max(j - int(np.ceil(depth / rise)), 0), j):
        if radius[k] - level < depth - (j - k + 1) * rise - margin:
            against += count[k]
    stray = (cells == 1 and agree < usual and agree < beside) or SPIKE * spike <= floor
    return Heard(alike, against, stray, agree >= max(beside, FLOOR_CELLS * usual) and against < alike and not stray)
