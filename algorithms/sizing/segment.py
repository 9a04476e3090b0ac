"""Which cells are one defect: those beyond the threshold, joined over small gaps and across 12 o'clock."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from numba import njit

from algorithms.types import WallMap


class Group(NamedTuple):
    """The cells of one group, their columns (around) and rows (along), line after line.

    `order` is the first line, and the first row on it, that the group's cells have within their reach.
    """

    order: tuple[int, int]
    columns: Int[np.ndarray, "n"]
    rows: Int[np.ndarray, "n"]


def reach_of(wall: WallMap, inner_radius_mm: float, join_mm: float) -> tuple[int, int]:
    """How many cells around and along each cell reaches, for gaps of so many mm to be joined."""
    return int(join_mm / 2 / wall.cell_arc_mm(inner_radius_mm)), int(join_mm / 2 / wall.cell_z_mm)


def segment(
    deep: Bool[np.ndarray, "around along"], wall: WallMap, inner_radius_mm: float, join_mm: float
) -> Int[np.ndarray, "around along"]:
    """Number the groups of deep cells, joined over small gaps and across 12 o'clock; 0 is no defect."""
    return numbered(deep, *reach_of(wall, inner_radius_mm, join_mm))


def groups_along(
    masks: Iterable[Bool[np.ndarray, "around _"]], reach: tuple[int, int], fewest: int, lost_before: int = 0
) -> Iterator[Group]:
    """Every group of so many cells, as it ends, of a map that comes a piece after the other along the pipe.

    The groups are those of the whole map, wherever pieces meet; what may go on in the next one is carried along. Of
    a group that reaches further back than `lost_before` most cells are not kept: as the strut's sector, it may be as
    long as the pipe.
    """
    far = 2 * reach[1] + 1  # cells further apart along the pipe belong together by others between them only
    carried, last, end, around = np.zeros((3, 0), dtype=np.int64), None, 0, 0
    for mask in masks:
        both = mask if last is None else np.hstack([last, mask])
        cells = _all_cells(carried, numbered(both, *reach), both.shape[1] - mask.shape[1], end)
        around, end, last = len(mask), end + mask.shape[1], both[:, -far:]
        near_end = cells[1] >= end - far
        goes_on = _has(cells[2], near_end)
        yield from _groups(cells[:, ~goes_on], fewest, reach, around)
        kept = goes_on & (~_has(cells[2], cells[1] < lost_before) | near_end | (cells[1] < lost_before))
        carried = cells[:, kept]
    yield from _groups(carried, fewest, reach, around)


def _all_cells(
    carried: Int[np.ndarray, "3 n"], labels: Int[np.ndarray, "around along"], known: int, end: int
) -> Int[np.ndarray, "3 m"]:
    """Column, row and group of the carried cells and of the new ones, which follow as many rows as are known."""
    columns, rows = np.nonzero(labels[:, known:])
    new = np.stack([columns, rows + end, labels[columns, rows + known]])
    cells, most = np.hstack([carried, new]), labels.max(initial=0)
    again = carried[1] >= end - known
    carried_as, here_as = carried[2, again], labels[carried[0, again], carried[1, again] - end + known]
    same = np.arange(most + 1 + carried[2].max(initial=0) + 1)
    _join_all(same, most + 1 + carried_as, here_as)
    cells[2, : carried.shape[1]] += most + 1
    cells[2] = same[cells[2]]
    return cells


def _has(of: Int[np.ndarray, "n"], which: Bool[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """The cells of those groups that have one of these."""
    some = np.zeros(of.max(initial=0) + 1, dtype=bool)
    some[of[which]] = True
    return some[of]


def _groups(cells: Int[np.ndarray, "3 n"], fewest: int, reach: tuple[int, int], around: int) -> Iterator[Group]:
    """The groups of so many cells, given by column, row and group."""
    cells = cells[:, np.bincount(cells[2])[cells[2]] >= fewest]
    cells = cells[:, np.lexsort((cells[1], cells[0], cells[2]))]
    for columns, rows, _ in np.split(cells, np.flatnonzero(np.diff(cells[2])) + 1, axis=1):
        if columns.size:
            lines = (columns[:, None] + np.arange(-reach[0], reach[0] + 1)) % around
            on_first = (lines == lines.min()).any(axis=1)
            yield Group((int(lines.min()), max(int(rows[on_first].min()) - reach[1], 0)), columns, rows)


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
def _join_all(same, one, other):
    """Make one group of each two, and let every number lead to the lowest of its group."""
    for k in range(one.size):
        _join(same, one[k], other[k])
    for k in range(same.size):
        same[k] = _first_of(same, k)


@njit(cache=True, error_model="numpy")
def _first_of(same, k):
    """The lowest number of a group, to which the way there is shortened."""
    while same[k] != k:
        same[k] = same[same[k]]
        k = same[k]
    return k
