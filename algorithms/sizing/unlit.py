"""Places of the map where no wall can be: so deep that no light falls there, or seen once where others saw wall."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.large_arrays import pieces
from algorithms.robust import MAD_TO_SIGMA
from algorithms.sizing.background import seen_medians
from algorithms.types import WallMap

BLOCK_MM = 200.0  # whose medians are taken for the bore
REACH_MM = 2.0  # along the wall: what lies so near should agree
AGREE_SHARE = 0.75  # of a place's depth: what is so deep agrees with it
MARGIN_MM, MARGIN_SIGMAS = 0.1, 3.0  # of how far the block's cells scatter


def drop_unlit(wall: WallMap, steepest_light_rad: float) -> None:
    """Empty the cells of a map that hold false slits alone, in place.

    Light comes from the scan's beginning, no steeper than the widest half angle: wall that was seen before a place and
    stands in its light says that the place is none, unless more points beside it say that it is. Nor is one that fewer
    points saw than see the usual cell, where others near it along the pipe are shallower, and none as deep. Both are
    what a decoder makes of a shadow's end, or of light that comes out of the wall beside where it went in.
    """
    cell = wall.cell_z_mm
    block, reach, rise = (
        max(round(BLOCK_MM / cell), 1),
        round(REACH_MM / cell),
        cell * float(np.tan(steepest_light_rad)),
    )
    whole = wall.radius_mm, wall.spread_mm, wall.sigma_mm, wall.count
    for part in pieces(*whole, rows=block):
        for first in range(part.start, part.stop, block):
            last = min(first + block, part.stop)
            level = seen_medians(wall.radius_mm, first, last)
            false = unlit(wall.radius_mm, level, wall.count, (first, last), rise, reach)
            for values in whole[:3]:
                values[false] = np.nan
            wall.count[false] = 0


@njit(cache=True, error_model="numpy")
def unlit(radius, level, count, rows, rise, reach):
    """Columns and rows of the false cells in a stretch of rows; light gains a depth `rise` from row to row."""
    around, along = radius.shape
    some = count[:, rows[0] : rows[1]].ravel()
    some = some[some > 0]
    if some.size == 0:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    usual, off = np.median(some), np.empty(some.size)
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
            depth = radius[i, j] - level[i]
            # a row is as wide as its cells: wall at the end of one, and a floor at the beginning of the next but one
            if not depth > 2.0 * rise + margin:
                continue
            agree, beside, all_agree, against = 0, 0, 0, 0
            for m in (i - 1, i, i + 1 if i + 1 < around else 0):
                alike, other = 0, 0
                for k in range(max(j - reach, 0), min(j + reach + 1, along)):
                    if radius[m, k] - level[m] >= AGREE_SHARE * depth:
                        alike += count[m, k]
                    else:
                        other += count[m, k]
                if m == i:
                    agree, beside = alike, other
                if alike == 0:  # beyond a defect's side, say
                    continue
                all_agree += alike
                for k in range(max(j - int(np.ceil(depth / rise)), 0), j):
                    if radius[m, k] - level[m] < depth - (j - k + 1) * rise - margin:
                        against += count[m, k]
            lone = agree == count[i, j] and agree < usual and agree < beside
            if lone or against >= all_agree:
                column[n], row[n] = i, j
                n += 1
    return column[:n], row[:n]
