"""The wall seen so far as a thinned cloud in the pipe frame, kept only about where the camera is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field

from sensor_model.settings import Settings

HALF_KEYS = 1 << 20  # cells on either side of the origin, along each axis: three of them fit into 63 bits
LINE_SHARE = 0.1  # a neighbourhood narrower than this share of its length has no plane
EDGE_SHARE = 0.5  # nor has one whose middle lies off the point by more than this share of its length


class CloudSettings(Settings):
    """How finely the cloud is kept, how far from the camera along the pipe, and what a normal is made of."""

    voxel_mm: Annotated[float, Field(gt=0.05, le=50)] = 3.0
    behind_mm: Annotated[float, Field(gt=0, le=5000)] = 50.0
    ahead_mm: Annotated[float, Field(gt=0, le=5000)] = 400.0
    neighbours: Annotated[int, Field(ge=5, le=500)] = 60
    neighbours_within_mm: Annotated[float, Field(gt=0, le=500)] = 40.0


@dataclass
class GrowingCloud:
    """One mean point a voxel, sorted by the voxel's key; `normal` is NaN where the neighbours make no plane."""

    settings: CloudSettings
    key: Int[np.ndarray, "m"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    total_mm: Float[np.ndarray, "m 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    count: Float[np.ndarray, "m"] = field(default_factory=lambda: np.zeros(0))
    normal: Float[np.ndarray, "m 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    tree: Any = None

    @property
    def points_mm(self) -> Float[np.ndarray, "m 3"]:
        """The mean points."""
        return self.total_mm / self.count[:, None]


def voxel_keys(xyz_mm: Float[np.ndarray, "n 3"], voxel_mm: float) -> Int[np.ndarray, "n"]:
    """One whole number for each point's voxel."""
    cell = np.floor(xyz_mm / voxel_mm).astype(np.int64) + HALF_KEYS
    return (cell[:, 0] * (2 * HALF_KEYS) + cell[:, 1]) * (2 * HALF_KEYS) + cell[:, 2]


def thinned(xyz_mm: Float[np.ndarray, "n 3"], voxel_mm: float) -> Float[np.ndarray, "m 3"]:
    """The mean point of every voxel."""
    _, total, count = _gathered(voxel_keys(xyz_mm, voxel_mm), xyz_mm, np.ones(len(xyz_mm)))
    return total / count[:, None]


def _gathered(
    key: Int[np.ndarray, "n"], total_mm: Float[np.ndarray, "n 3"], count: Float[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m 3"], Float[np.ndarray, "m"]]:
    """Rows of one key as one row of sums, sorted by key."""
    keys, row = np.unique(key, return_inverse=True)
    sums = [np.bincount(row, weights=total_mm[:, axis], minlength=keys.size) for axis in range(3)]
    return keys, np.column_stack(sums), np.bincount(row, weights=count, minlength=keys.size)


def add_to_cloud(
    cloud: GrowingCloud, xyz_pipe_mm: Float[np.ndarray, "n 3"], camera_z_mm: float
) -> Bool[np.ndarray, "m"]:
    """Put points into the cloud and let go of what lies far from the camera; returns which voxels are new."""
    from scipy.spatial import cKDTree

    s = cloud.settings
    key = np.concatenate([cloud.key, voxel_keys(xyz_pipe_mm, s.voxel_mm)])
    ones = np.ones(len(xyz_pipe_mm))
    keys, total, count = _gathered(
        key, np.concatenate([cloud.total_mm, xyz_pipe_mm]), np.concatenate([cloud.count, ones])
    )
    normal = np.full((keys.size, 3), np.nan)
    normal[np.searchsorted(keys, cloud.key)] = cloud.normal
    fresh = ~np.isin(keys, cloud.key, assume_unique=True)
    z = total[:, 2] / count
    near = (z > camera_z_mm - s.behind_mm) & (z < camera_z_mm + s.ahead_mm)
    cloud.key, cloud.total_mm, cloud.count, cloud.normal = keys[near], total[near], count[near], normal[near]
    cloud.tree = cKDTree(cloud.points_mm, balanced_tree=False, compact_nodes=False) if near.any() else None
    return fresh[near]


def refresh_normals(cloud: GrowingCloud, fresh: Bool[np.ndarray, "m"]) -> None:
    """Normals by the principal axes of the nearest neighbours, where new voxels came and among their neighbours."""
    points, neighbours, reach_mm = cloud.points_mm, cloud.settings.neighbours, cloud.settings.neighbours_within_mm
    if not fresh.any() or len(points) < neighbours:
        return
    _, around = cloud.tree.query(points[fresh], neighbours, distance_upper_bound=reach_mm)
    stale = np.unique(np.append(around, np.flatnonzero(fresh)))
    stale = stale[stale < len(points)]
    distance, around = cloud.tree.query(points[stale], neighbours, distance_upper_bound=reach_mm)
    off = np.vstack([points, np.zeros(3)])[around] - points[stale][:, None]
    cloud.normal[stale] = _normals(off, np.isfinite(distance))


def _normals(off_mm: Float[np.ndarray, "n k 3"], there: Bool[np.ndarray, "n k"]) -> Float[np.ndarray, "n 3"]:
    """The direction in which neighbours scatter least, by their offsets; NaN where they lie along a line.

    And at an edge of what was seen: there the neighbours of a curved wall lie on a chord of it, not on its tangent.
    """
    weight = there / there.sum(axis=1, keepdims=True)
    middle = np.einsum("nk,nki->ni", weight, off_mm)
    spread = (off_mm - middle[:, None]) * np.sqrt(weight)[:, :, None]
    extent2, axes = np.linalg.eigh(np.swapaxes(spread, 1, 2) @ spread)
    flat = extent2[:, 1] > LINE_SHARE**2 * extent2[:, 2]
    inside = np.sum(middle**2, axis=1) < EDGE_SHARE**2 * extent2[:, 2]
    return np.where((flat & inside)[:, None], axes[:, :, 0], np.nan)


def near_cloud(cloud: GrowingCloud, xyz_pipe_mm: Float[np.ndarray, "n 3"], reach_mm: float) -> Bool[np.ndarray, "n"]:
    """Points with a point of the cloud within reach."""
    if cloud.tree is None:
        return np.zeros(len(xyz_pipe_mm), dtype=bool)
    return np.isfinite(cloud.tree.query(xyz_pipe_mm, distance_upper_bound=reach_mm)[0])
