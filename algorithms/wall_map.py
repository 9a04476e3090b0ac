"""The wall map: points of all frames gathered on a (theta, z) grid, robustly; points are let go as the robot passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from numba import njit
from pydantic import Field

from algorithms.robust import MAD_TO_SIGMA
from algorithms.types import Alignment, RingPoints, WallMap
from sensor_model.geometry import apply, wall_angle_rad
from sensor_model.recording import NominalPipe
from sensor_model.settings import Settings

INWARD_SHARE = 0.6  # what comes nearer to the axis than this share of the radius is no wall
OUTWARD_MM = 1.0  # nor is what lies further outside than the wall is thick, and this for noise


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
    done: dict[int, tuple[np.ndarray, ...]] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells around, and cells along in one block."""
        return (
            max(round(360 / self.settings.cell_theta_deg), 1),
            max(round(self.settings.block_mm / self.settings.cell_z_mm), 1),
        )


def on_a_wall(points: RingPoints, T_pipe_camera: Float[np.ndarray, "4 4"], pipe: NominalPipe) -> Bool[np.ndarray, "n"]:
    """Points that lie where a wall can be: outside it are the false slits that shadows and mixed colours make."""
    xyz = apply(T_pipe_camera, points.xyz_mm)
    rho = np.hypot(xyz[:, 0], xyz[:, 1])
    outermost = pipe.inner_radius_mm + pipe.wall_thickness_mm + OUTWARD_MM
    return (rho > INWARD_SHARE * pipe.inner_radius_mm) & (rho < outermost)


def add_points(builder: MapBuilder, points: RingPoints, kept: Bool[np.ndarray, "n"], alignment: Alignment) -> None:
    """Put one registered frame's points into the map, and close what lies behind all of them."""
    if not kept.any():
        return
    around, along = builder.shape
    xyz = apply(alignment.T_pipe_camera, points.xyz_mm[kept])
    light = points.direction[kept] @ alignment.T_pipe_camera[:3, :3].T
    rho = np.hypot(xyz[:, 0], xyz[:, 1])
    across = np.abs(np.sum(light[:, :2] * xyz[:, :2], axis=1)) / rho
    sigma = np.maximum(points.sigma_mm[kept] * np.maximum(across, 0.05), 1e-3)
    row = np.floor(xyz[:, 2] / builder.settings.cell_z_mm).astype(np.int64)
    column = np.floor(wall_angle_rad(xyz[:, 0], xyz[:, 1]) / (2 * np.pi) * around).astype(np.int64) % around
    block, row_in_block = np.divmod(row, along)
    packed = np.column_stack([column * along + row_in_block, rho, sigma**-2]).astype(np.float32)
    for b in np.unique(block):
        builder.waiting.setdefault(int(b), []).append(packed[block == b])
    nearest = int(np.percentile(block, 1)) - 1  # one block of slack for the frames still to come
    for b in [b for b in builder.waiting if b < nearest]:
        _close(builder, b)


def _close(builder: MapBuilder, block: int) -> None:
    """Reduce a block's points to cells; a block that was closed before is joined by its weights."""
    around, along = builder.shape
    points = np.concatenate(builder.waiting.pop(block))
    order = np.argsort(points[:, 0], kind="stable")
    reduced = _reduce(points[order].astype(np.float64), around * along)
    kinds = (np.float64, np.float32, np.float32, np.int32)
    cells = tuple(part.astype(kind).reshape(around, along) for part, kind in zip(reduced, kinds, strict=True))
    if block in builder.done:
        cells = _joined(builder.done[block], cells)
    builder.done[block] = cells


def _joined(a: tuple[np.ndarray, ...], b: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Cells of both: the radius by the numbers of points, the larger of spreads and deviations."""
    count = a[3] + b[3]
    share = np.divide(b[3], count, out=np.zeros(count.shape), where=count > 0)
    radius = np.where(a[3] == 0, b[0], np.where(b[3] == 0, a[0], (1 - share) * a[0] + share * b[0]))
    return radius, np.fmax(a[1], b[1]), np.fmax(a[2], b[2]), count


def finish_map(builder: MapBuilder) -> WallMap:
    """Close all blocks and lay them end to end."""
    for block in list(builder.waiting):
        _close(builder, block)
    around, along = builder.shape
    blocks = range(min(builder.done), max(builder.done) + 1) if builder.done else range(0)
    nothing = np.full((around, along), np.nan)
    empty = (nothing, nothing.astype(np.float32), nothing.astype(np.float32), np.zeros((around, along), np.int32))
    parts = [builder.done.get(b, empty) for b in blocks] or [tuple(part[:, :0] for part in empty)]
    radius, spread, sigma, count = (np.concatenate([part[k] for part in parts], axis=1) for k in range(4))
    builder.done.clear()  # laid end to end they are here twice
    theta = (np.arange(around) + 0.5) * 2 * np.pi / around
    z = (np.arange(len(blocks) * along) + (blocks[0] * along if blocks else 0) + 0.5) * builder.settings.cell_z_mm
    return WallMap(theta, z, radius, spread, sigma, count)


@njit(cache=True)
def _reduce(points: Float[np.ndarray, "n 3"], cells: int):
    """Weighted median, spread (MAD) and typical sigma of the radii in each cell, and their count.

    Rows are (cell, radius, weight), sorted by cell.
    """
    radius, spread, sigma = np.full(cells, np.nan), np.full(cells, np.nan), np.full(cells, np.nan)
    count = np.zeros(cells, dtype=np.int64)
    n = points.shape[0]
    first = 0
    while first < n:
        last = first
        while last < n and points[last, 0] == points[first, 0]:
            last += 1
        values, weights = points[first:last, 1].copy(), points[first:last, 2]
        cell = int(points[first, 0])
        radius[cell] = _weighted_median(values, weights)
        spread[cell] = MAD_TO_SIGMA * np.median(np.abs(values - radius[cell]))
        sigma[cell] = 1.0 / np.sqrt(np.mean(weights))
        count[cell] = last - first
        first = last
    return radius, spread, sigma, count


@njit(cache=True)
def _weighted_median(values, weights):
    """The value with half of the weight on either side, halfway between two where it falls between."""
    order = np.argsort(values)
    half = 0.5 * np.sum(weights)
    total = 0.0
    for k in range(order.size):
        total += weights[order[k]]
        if total > half * (1.0 + 1e-12):
            return values[order[k]]
        if total >= half * (1.0 - 1e-12) and k + 1 < order.size:
            return 0.5 * (values[order[k]] + values[order[k + 1]])
    return values[order[-1]]
