"""How near the wall is to the camera in every pixel, by which a lens blurs it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sensor_model.camera_rays import camera_rays
from sensor_model.optics import Optics
from sensor_model.rig import Camera
from sensor_model.wall_rays import near_wall, wall_ranges_mm
from twin.pipe import Pipe


def nearness_per_mm(
    pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], camera: Camera, optics: Optics
) -> Float[np.ndarray, "h w"] | None:
    """One over the distance of the wall in every pixel, as `expose` takes it; None where defocus does not go by it.

    Along straight lines, whatever glass and water do; 0 where a ray never meets the wall.
    """
    if optics.focus_mm == 0 or optics.defocus_px == 0:
        return None
    rays, eye = camera_rays(camera), tuple(T_pipe_camera[:3, 3].tolist())
    flat = rays.reshape(-1, 3).astype(float) @ T_pipe_camera[:3, :3].T
    ranges = wall_ranges_mm(near_wall(pipe, eye[2]), eye, flat)
    return np.nan_to_num(1 / ranges).astype(np.float32).reshape(rays.shape[:2])
