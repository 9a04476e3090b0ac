"""The ray of every pixel, kept for as long as the camera is in use."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from sensor_model.geometry import fisheye_rays
from sensor_model.rig import Camera


@lru_cache(maxsize=2)
def camera_rays(camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """Unit ray of every pixel in the camera frame, float32."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    return fisheye_rays(np.stack([u, v], axis=-1), camera.intrinsics).astype(np.float32)
