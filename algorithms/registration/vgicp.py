"""Registration by voxelised GICP (small_gicp) against the wall seen so far: one normal distribution a voxel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from algorithms.registration.first_frame import BEYOND_SHARE, Start, place_first
from algorithms.registration.gicp import RESTS_MM, RESTS_RAD, cannot, concluded, prepared
from algorithms.registration.growing_cloud import CloudSettings, voxel_keys
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import apply
from sensor_model.settings import Settings


class VgicpSettings(Settings):
    """Settings of VGICP and of its voxel map, which forgets voxels that no frame has touched for a while."""

    kind: Literal["vgicp"] = "vgicp"
    start: Start = "cylinder"
    cloud: CloudSettings = CloudSettings()
    map_voxel_mm: Annotated[float, Field(gt=0.1, le=100)] = 5.0
    forget_after_frames: Annotated[int, Field(ge=1, le=10_000)] = 100
    correspondence_mm: Annotated[float, Field(gt=0, le=100)] = 10.0
    iterations: Annotated[int, Field(ge=1, le=1000)] = 50
    min_matched_share: Annotated[float, Field(gt=0, lt=1)] = 0.3


@dataclass
class VoxelMap:
    """small_gicp's map, which is made when the first frame comes."""

    settings: VgicpSettings
    voxels: Any = None


def begin(settings: VgicpSettings) -> VoxelMap:
    """A map of nothing yet."""
    return VoxelMap(settings)


def grow(seen: VoxelMap, points: RingPoints, alignment: Alignment) -> None:
    """Put a registered frame into the map."""
    import small_gicp

    s = seen.settings
    if seen.voxels is None:
        seen.voxels = small_gicp.GaussianVoxelMap(s.map_voxel_mm)
        seen.voxels.set_lru(horizon=s.forget_after_frames, clear_cycle=10)
    cloud, _ = prepared(points, alignment.T_pipe_camera, s.cloud)
    seen.voxels.insert(cloud)


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: VgicpSettings) -> Alignment:
    """The pose that lays the planes about the points onto the voxels' distributions; from the prior's pose."""
    if reason := cannot(points):
        return failed(prior, points.sigma_mm.size, reason)
    seen: VoxelMap | None = wall.seen
    if seen is None or _in_a_voxel(seen, apply(prior.T_pipe_camera, points.xyz_mm)).mean() < BEYOND_SHARE:
        return place_first(points, wall, prior, settings.start)
    import small_gicp

    source, _ = prepared(points, prior.T_pipe_camera, settings.cloud)
    found = small_gicp.align(
        seen.voxels,
        source,
        max_correspondence_distance=settings.correspondence_mm,
        num_threads=1,
        max_iterations=settings.iterations,
        rotation_epsilon=RESTS_RAD,
        translation_epsilon=RESTS_MM,
    )
    matched = _in_a_voxel(seen, apply(found.T_target_source @ prior.T_pipe_camera, points.xyz_mm))
    return concluded(found, points, prior, matched, settings.min_matched_share)


def _in_a_voxel(seen: VoxelMap, xyz_pipe_mm: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Points in a voxel that holds something: a voxel's mean lies in it."""
    if seen.voxels is None:
        return np.zeros(len(xyz_pipe_mm), dtype=bool)
    size = seen.settings.map_voxel_mm
    known = voxel_keys(seen.voxels.voxel_points()[:, :3], size)
    return np.isin(voxel_keys(xyz_pipe_mm, size), known)
