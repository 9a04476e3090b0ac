"""Which cells are one defect: those beyond the threshold, joined over small gaps and across 12 o'clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Int
from numba import njit

from algorithms.types import WallMap


def segment(
    deep: Bool[np.ndarray, "around along"], wall: WallMap, inner_radius_mm: float, join_mm: float
) -> Int[np.ndarray, "around along"]:
    """Number the groups of deep cells, joined over small gaps and across 12 o'clock; 0 is no defect."""
    reach_z = int(join_mm / 2 / wall.cell_z_mm)
    reach_arc = int(join_mm / 2 / wall.cell_arc_mm(inner_radius_mm))
    return numbered(deep, reach_arc, reach_z)


def groups(labels: Int[np.ndarray, "around along"], fewest: int = 1) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Columns (around) and rows (along) of the cells of every group that has so many."""
    cells = np.flatnonzero(labels)
    of = labels.ravel()[cells]
    large = np.bincount(of)[of] >= fewest
    cells, of = cells[large], of[large]
    order = np.argsort(of, kind="stable")
    for part in np.split(cells[order], np.flatnonzero(np.diff(of[order])) + 1):
        if part.size:
            yield part // labels.shape[1], part % labels.shape[1]


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
