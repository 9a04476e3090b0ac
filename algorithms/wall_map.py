"""The wall map: points of all frames gathered on a (theta, z) grid, robustly; points are let go as the robot passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from numba import njit
from pydantic import Field

from algorithms.closed_blocks import KINDS, Cells, ClosedBlocks, keep, kept
from algorithms.large_arrays import pieces, room
from algorithms.robust import MAD_TO_SIGMA
from algorithms.types import Alignment, RingPoints, WallMap
from sensor_model.geometry import fast_arctan2
from sensor_model.recording import NominalPipe
from sensor_model.settings import Settings

INWARD_SHARE = 0.6  # what comes nearer to the axis than this share of the radius is no wall
# nor is what lies further outside than the wall is thick, and this for noise, or so many of its own deviations: of
# points on a floor as deep as the wall a nearer limit would take the outer ones alone, and make it shallower
OUTWARD_MM, OUTWARD_SIGMAS = 1.0, 2.0
WAITING = np.dtype([("cell", np.int32), ("radius", np.float32), ("weight", np.float32), ("slope", np.float32)])
MOST_WAITING = 2**20  # in all blocks: a robot that stands, or goes to and fro, must not fill the memory
MOST_EMPTY = 1000  # blocks
FEW = 40  # up to so many points are sorted fastest by moving each to its place


class MapSettings(Settings):
    """Cell size of the map, and how many rows of it are kept open for new points."""

    cell_z_mm: Annotated[float, Field(gt=0.05, le=20)] = 1.0
    cell_theta_deg: Annotated[float, Field(gt=0.05, le=10)] = 1.0
    block_mm: Annotated[float, Field(gt=10, le=1000)] = 100.0


@dataclass
class MapBuilder:
    """Points wait in blocks along z; a block behind all future points is reduced to cells and let go."""

    settings: MapSettings
    waiting: dict[int, list[np.ndarray]] = field(default_factory=dict)
    done: ClosedBlocks = field(default_factory=ClosedBlocks)
    held: int = 0
    """How many points wait."""

    @property
    def shape(self) -> tuple[int, int]:
        """Cells around, and cells along in one block."""
        return (
            max(round(360 / self.settings.cell_theta_deg), 1),
            max(round(self.settings.block_mm / self.settings.cell_z_mm), 1),
        )


def on_a_wall(points: RingPoints, T_pipe_camera: Float[np.ndarray, "4 4"], pipe: NominalPipe) -> Bool[np.ndarray, "n"]:
    """Points that lie where a wall can be: outside it are the false slits that shadows and mixed colours make."""
    outermost = pipe.inner_radius_mm + pipe.wall_thickness_mm
    limits = INWARD_SHARE * pipe.inner_radius_mm, outermost, OUTWARD_MM, OUTWARD_SIGMAS
    return _between(points.xyz_mm, points.direction, points.sigma_mm, T_pipe_camera, limits)


@njit(cache=True, error_model="numpy")
def _between(xyz_camera, direction, sigma_mm, T, limits):
    """Which points lie between two cylinders about the pipe's axis, but for their own deviation beyond the outer."""
    inside, (inner, outer, least_mm, sigmas) = np.empty(xyz_camera.shape[0], dtype=np.bool_), limits
    for i in range(inside.size):
        x, y, _ = _in_pipe(T, xyz_camera[i, 0], xyz_camera[i, 1], xyz_camera[i, 2], 1.0)
        lx, ly, _ = _in_pipe(T, direction[i, 0], direction[i, 1], direction[i, 2], 0.0)
        rho = np.sqrt(x * x + y * y)
        beyond = max(least_mm, sigmas * sigma_mm[i] * abs(lx * x + ly * y) / rho)
        inside[i] = inner < rho < outer + beyond
    return inside


@njit(cache=True, error_model="numpy", forceinline=True)
def _in_pipe(T, x, y, z, w):
    """A place (w = 1) or a direction (w = 0) in the pipe frame."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + w * T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + w * T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + w * T[2, 3],
    )


def add_points(builder: MapBuilder, points: RingPoints, kept: Bool[np.ndarray, "n"], alignment: Alignment) -> None:
    """Put one registered frame's points into the map, and close what lies behind all of them."""
    if not kept.any():
        return
    around, along = builder.shape
    first, ends, packed = _by_block(
        points.xyz_mm,
        points.direction,
        points.sigma_mm,
        kept,
        alignment.T_pipe_camera,
        (around, along, builder.settings.cell_z_mm),
    )
    for k, (begin, end) in enumerate(pairwise([0, *ends.tolist()])):
        if end > begin:
            builder.waiting.setdefault(first + k, []).append(
                packed[begin:end].copy()
            )  # a view would keep all of the frame
    builder.held += packed.size
    if builder.held > MOST_WAITING:
        _close(builder, max(builder.waiting, key=lambda b: sum(part.size for part in builder.waiting[b])))
    # one block of slack for the frames still to come; a hundredth of the points may be astray
    nearest = first + int(np.searchsorted(ends, 0.01 * packed.size, side="right")) - 1
    for b in [b for b in builder.waiting if b < nearest]:
        _close(builder, b)


@njit(cache=True, error_model="numpy")
def _by_block(xyz_camera, direction, sigma_mm, kept, T, grid):
    """The kept points as the map gathers them, block by block: the first block's number, and where each block ends.

    A point's weight is by its standard deviation across the wall.
    """
    around, along, cell_z_mm = grid
    n, k = np.count_nonzero(kept), 0
    block, packed, place = np.empty(n, dtype=np.int64), np.empty(n, dtype=WAITING), np.empty((kept.size, 5))
    # first all, which the processor does several at a time
    for i in range(kept.size):
        x, y, z = _in_pipe(T, xyz_camera[i, 0], xyz_camera[i, 1], xyz_camera[i, 2], 1.0)
        lx, ly, lz = _in_pipe(T, direction[i, 0], direction[i, 1], direction[i, 2], 0.0)
        rho = np.sqrt(x * x + y * y)
        slant = abs(lx * x + ly * y) / rho
        place[i, 4] = slant / lz if lz > 0.0 else np.inf
        place[i, 0] = np.floor(fast_arctan2(x, -y) / (2.0 * np.pi) * around)
        place[i, 1], place[i, 2] = np.floor(z / cell_z_mm), rho
        place[i, 3] = slant if slant > 0.05 else 0.05
    for i in range(kept.size):
        if not kept[i]:
            continue
        sigma = max(sigma_mm[i] * place[i, 3], 1e-3)
        column, row = int(place[i, 0]), int(place[i, 1])
        block[k] = row // along
        column = column + around if column < 0 else column - around if column >= around else column
        packed[k].cell = column * along + row - block[k] * along
        packed[k].radius, packed[k].weight, packed[k].slope = place[i, 2], 1.0 / (sigma * sigma), place[i, 4]
        k += 1
    first = block.min()
    ends = np.cumsum(np.bincount(block - first))
    if ends.size == 1:
        return first, ends, packed
    end, sorted_ = ends.copy(), np.empty(n, dtype=WAITING)
    for i in range(n - 1, -1, -1):
        end[block[i] - first] -= 1
        sorted_[end[block[i] - first]] = packed[i]
    return first, ends, sorted_


def shift_waiting(builder: MapBuilder, along_mm: float) -> tuple[float, float]:
    """Move all points that still wait, by whole cells; how far, and from where on along the pipe they lay."""
    _, along = builder.shape
    rows = round(along_mm / builder.settings.cell_z_mm)
    if not rows or not builder.waiting:
        return 0.0, np.inf
    before, builder.waiting = builder.waiting, {}
    for block, parts in sorted(before.items()):
        for points in parts:
            column, row = np.divmod(points["cell"], along)
            to_block, to_row = np.divmod(row + block * along + rows, along)
            moved = points.copy()
            moved["cell"] = column * along + to_row
            for b in np.unique(to_block).tolist():
                builder.waiting.setdefault(b, []).append(moved[to_block == b])
    return rows * builder.settings.cell_z_mm, min(before) * along * builder.settings.cell_z_mm


def _close(builder: MapBuilder, block: int) -> None:
    """Reduce a block's points to cells, and let them go."""
    cells = _cells(builder, block)
    builder.held -= sum(part.size for part in builder.waiting.pop(block))
    if cells is not None:
        keep(builder.done, block, cells)


def _cells(builder: MapBuilder, block: int) -> Cells | None:
    """A block's points as cells; those of one that was closed before are joined by their weights."""
    around, along = builder.shape
    before = kept(builder.done, block, builder.shape)
    if block not in builder.waiting:
        return before
    reduced = _reduce(np.concatenate(builder.waiting[block]), around * along)
    radius, spread, sigma, count, slope = (
        part.astype(kind).reshape(around, along) for part, kind in zip(reduced, KINDS, strict=True)
    )
    cells = radius, spread, sigma, count, slope
    return cells if before is None else _joined(before, cells)


def _joined(a: Cells, b: Cells) -> Cells:
    """Cells of both: the radius by the numbers of points, the larger of spreads, deviations and slopes."""
    count = a[3] + b[3]
    share = np.divide(b[3], count, out=np.zeros(count.shape), where=count > 0)
    radius = np.where(a[3] == 0, b[0], np.where(b[3] == 0, a[0], (1 - share) * a[0] + share * b[0]))
    return radius, np.fmax(a[1], b[1]), np.fmax(a[2], b[2]), count, np.fmax(a[4], b[4])


class MapTorn(ValueError):
    """The map would be empty for the most part: the distance leapt."""


def finish_map(builder: MapBuilder) -> WallMap:
    """Close all blocks and lay them end to end.

    Raises:
        MapTorn: when next to all of them would be empty.
    """
    _check_span(builder)
    around, along = builder.shape
    held = builder.waiting.keys() | builder.done.numbers
    blocks = range(min(held), max(held) + 1) if held else range(0)
    radius, spread, sigma, count, slope = whole = [room((around, len(blocks) * along), kind) for kind in KINDS]
    for part in pieces(*whole, rows=along):
        for row in range(part.start, part.stop, along):
            cells = _cells(builder, blocks[row // along]) or (np.nan, np.nan, np.nan, 0, np.nan)
            for laid, own in zip(whole, cells, strict=True):
                laid[:, row : row + along] = own
    builder.waiting, builder.done, builder.held = {}, ClosedBlocks(), 0
    theta = (np.arange(around) + 0.5) * 2 * np.pi / around
    z = (np.arange(len(blocks) * along) + (blocks[0] * along if blocks else 0) + 0.5) * builder.settings.cell_z_mm
    return WallMap(theta, z, radius, spread, sigma, count, slope)


def _check_span(builder: MapBuilder) -> None:
    held = builder.waiting.keys() | builder.done.numbers
    span = max(held) - min(held) + 1 if held else 0
    if span > MOST_EMPTY + 2 * len(held):
        low, high = (block * builder.settings.block_mm for block in (min(held), max(held) + 1))
        share_pct = 100 * len(held) / span
        raise MapTorn(
            f"the distance leapt: a map from {low:.0f} to {high:.0f} mm would hold points in {share_pct:.2g} %"
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _reduce(points, cells):
    """Weighted median, spread (MAD) and typical sigma of the radii in each cell, their count, and the steepest light.

    Points are records like `WAITING`, in any order. A slit's deviation grows with the square of its point's distance,
    which is no reason to believe a floor less than the wall beside it: a cell that a defect's side runs through would
    be wall too often, and the defect too narrow. So that is taken from the weights.
    """
    radius, spread, sigma = np.full(cells, np.nan), np.full(cells, np.nan), np.full(cells, np.nan)
    count, slope = np.zeros(cells, dtype=np.int64), np.full(cells, np.nan)
    for point in points:
        count[point.cell] += 1
        if not slope[point.cell] > point.slope:
            slope[point.cell] = point.slope
    place = np.cumsum(count) - count
    values, weights, precision = np.empty(points.size), np.empty(points.size), np.zeros(cells)
    for point in points:
        k = place[point.cell]
        values[k] = point.radius
        weights[k] = point.weight * values[k] ** 4
        precision[point.cell] += point.weight
        place[point.cell] += 1
    for cell in range(cells):
        if count[cell] == 0:
            continue
        begin, end = place[cell] - count[cell], place[cell]
        _sort_together(values, weights, begin, end)
        radius[cell] = _weighted_median(values, weights, begin, end)
        spread[cell] = MAD_TO_SIGMA * _median_distance(values, begin, end, radius[cell])
        sigma[cell] = 1.0 / np.sqrt(precision[cell] / count[cell])
    return radius, spread, sigma, count, slope


@njit(cache=True, error_model="numpy")
def _sort_together(values, weights, begin, end):
    """Sort a stretch by value, the weights with it."""
    if end - begin > FEW:
        order = begin + np.argsort(values[begin:end])
        values[begin:end], weights[begin:end] = values[order], weights[order]
        return
    for i in range(begin + 1, end):
        value, weight, k = values[i], weights[i], i
        while k > begin and values[k - 1] > value:
            values[k], weights[k] = values[k - 1], weights[k - 1]
            k -= 1
        values[k], weights[k] = value, weight


@njit(cache=True, error_model="numpy")
def _weighted_median(values, weights, begin, end):
    """The value of a sorted stretch with half of the weight on either side, halfway between two where it falls so."""
    half, total = 0.5 * np.sum(weights[begin:end]), 0.0
    for k in range(begin, end):
        total += weights[k]
        if total > half * (1.0 + 1e-12):
            return values[k]
        if total >= half * (1.0 - 1e-12) and k + 1 < end:
            return 0.5 * (values[k] + values[k + 1])
    return values[end - 1]


@njit(cache=True, error_model="numpy")
def _median_distance(values, begin, end, middle):
    """Median distance from a value between the ends of a sorted stretch: the largest is always at one of its ends."""
    n, low, high = end - begin, begin, end - 1
    upper, lower = 0.0, 0.0
    for _ in range(n - (n - 1) // 2):
        upper = lower
        if middle - values[low] > values[high] - middle:
            lower = middle - values[low]
            low += 1
        else:
            lower = values[high] - middle
            high -= 1
    return lower if n % 2 == 1 else 0.5 * (upper + lower)
