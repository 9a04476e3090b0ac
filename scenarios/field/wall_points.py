"""The seen cells of a wall map as points, for formats of point clouds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from scenarios.artefacts import deepest_shown_mm
from scenarios.found_run import FoundRun
from sensor_model.geometry import wall_direction


class WallPoints(NamedTuple):
    """Points in the pipe frame, each with its deviation from the local bore and a colour."""

    xyz_mm: Float[np.ndarray, "n 3"]
    deviation_mm: Float[np.ndarray, "n"]
    rgb: UInt8[np.ndarray, "n 3"]


def wall_points(run: FoundRun) -> WallPoints:
    """Every seen cell, as `cloud.ply` has it."""
    from matplotlib import colormaps

    around, along = np.nonzero(np.isfinite(run.deviation_mm))
    xyz = wall_direction(run.wall.theta_rad[around]) * run.wall.radius_mm[around, along][:, None]
    xyz[:, 2] = run.wall.z_mm[along]
    deviation = run.deviation_mm[around, along]
    rgb = (colormaps["cividis"](deviation / deepest_shown_mm(run.deviation_mm))[:, :3] * 255).astype(np.uint8)
    return WallPoints(xyz, deviation, rgb)
