"""Light that falls in at the pipe's open end: on the wall, into the camera, and row by row where a lamp flickers."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field

from sensor_model.camera_rays import camera_rays
from sensor_model.rig import Camera
from sensor_model.settings import Settings
from twin.pipe import Pipe


class Daylight(Settings):
    """Light at the end that the camera looks at; `level` 0 is a closed pipe."""

    level: Annotated[float, Field(ge=0)] = 0.0
    """Radiance of what lies outside; 1 is a white wall at the reference distance that faces the projector."""
    flicker: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Depth of a lamp's flicker: bands across a rolling shutter's picture."""
    flicker_hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    row_us: Annotated[float, Field(ge=0, le=1000)] = 25.0
    """Time from one row of the picture to the next."""


def daylight(
    pipe: Pipe,
    T_pipe_camera: Float[np.ndarray, "4 4"],
    camera: Camera,
    reflectance: tuple[float, float, float],
    how: Daylight,
    time_s: float,
) -> Float[np.ndarray, "h w 3"]:
    """What to add to the drawn picture, linear light; the wall is taken as round, without its features."""
    rows_s = time_s + np.arange(camera.height_px) * how.row_us * 1e-6
    level = how.level * (1 + how.flicker * np.sin(2 * np.pi * how.flicker_hz * rows_s))
    seen = _seen(camera_rays(camera), T_pipe_camera, pipe.bore_radius_mm, pipe.end_mm)
    wall = np.where(seen[..., None] < 1, np.array(reflectance), 1.0)
    return (level[:, None, None] * seen[..., None] * wall).astype(np.float32)


@njit(cache=True, error_model="numpy")
def _seen(rays, T, radius, end):
    """Share of the outside's light that each pixel gets: 1 outside, on the wall what an open disc lights of it."""
    height, width, _ = rays.shape
    out = np.zeros((height, width), dtype=np.float32)
    c = T[0, 3] ** 2 + T[1, 3] ** 2 - radius**2
    for row in range(height):
        for col in range(width):
            x, y, z = rays[row, col, 0], rays[row, col, 1], rays[row, col, 2]
            dx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
            dy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
            dz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
            a, b = dx * dx + dy * dy, T[0, 3] * dx + T[1, 3] * dy
            reach = (-b + np.sqrt(b * b - a * c)) / max(a, 1e-12)
            inward = (end - T[2, 3] - reach * dz) / (2.0 * radius)
            if inward <= 0.0:
                out[row, col] = 1.0
            else:  # form factor of the end's disc, seen from the wall of a cylinder
                out[row, col] = (inward * inward + 0.5) / np.sqrt(inward * inward + 1.0) - inward
    return out
