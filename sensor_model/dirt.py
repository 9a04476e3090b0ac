"""Dirt on the tube before the camera: a dust film, a smudge, drops of condensation; the same in every picture."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.rig import Camera
from sensor_model.settings import ClockDeg, Settings

Share = Annotated[float, Field(ge=0, le=1)]
SPECK_PX = 3.0
DROP_PX, DROP_RIM_PX = 9.0, 1.5  # spacing of the drops, and how sharp their rims are
DROP_BLUR_PX = 7.0  # a drop is a small lens: what lies behind it is smeared over about its own size
SMUDGE_EDGE_DEG = 4.0


class Dirt(Settings):
    """What lies on the tube; each has a zero."""

    film: Share = 0.0
    """Share of the light that a dust film scatters widely; its specks take away a tenth of that, unevenly."""
    smudge: Share = 0.0
    """Share of the light that a greasy smudge smears."""
    smudge_clock_deg: ClockDeg = 120.0
    smudge_width_deg: Annotated[float, Field(gt=0, le=360)] = 40.0
    smudge_blur_px: Annotated[float, Field(gt=0, le=50)] = 6.0
    drops: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    """Share of the picture that drops of condensation cover."""
    pattern: Annotated[int, Field(ge=0)] = 0
    """Which drops and specks of dust: another number, other places."""


def seen_through(linear: Float[np.ndarray, "h w 3"], dirt: Dirt, camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """The picture as it is behind specks, smudge and drops; what the film scatters is haze, and left to that."""
    out = linear
    if dirt.film > 0:
        out = out * (1 - np.float32(0.1 * dirt.film) * _specks(camera, dirt.pattern))[..., None]
    if dirt.smudge > 0:
        out = _smeared(out, np.float32(dirt.smudge) * _smudged(camera, dirt), dirt.smudge_blur_px)
    if dirt.drops > 0:
        out = _smeared(out, _drops(camera, dirt.drops, dirt.pattern), DROP_BLUR_PX)
    return np.ascontiguousarray(out, dtype=np.float32)


def _smeared(linear: np.ndarray, share: np.ndarray, blur_px: float) -> np.ndarray:
    import cv2

    return linear + share[..., None] * (cv2.GaussianBlur(linear, (0, 0), blur_px) - linear)


@lru_cache(maxsize=2)
def _specks(camera: Camera, pattern: int) -> Float[np.ndarray, "h w"]:
    """How much lies where, 0 to about 3, on average 1."""
    return np.maximum(1 + _field(camera, pattern, 0, SPECK_PX), 0)


@lru_cache(maxsize=2)
def _drops(camera: Camera, share: float, pattern: int) -> Float[np.ndarray, "h w"]:
    """1 inside a drop, 0 beside it."""
    import cv2

    field = _field(camera, pattern, 1, DROP_PX)
    covered = (field > np.quantile(field, 1 - share)).astype(np.float32)
    return cv2.GaussianBlur(covered, (0, 0), DROP_RIM_PX)


def _field(camera: Camera, pattern: int, kind: int, grain_px: float) -> Float[np.ndarray, "h w"]:
    """Noise of unit standard deviation that stays alike over a grain."""
    import cv2

    rng = np.random.default_rng([pattern, kind])
    white = rng.standard_normal((camera.height_px, camera.width_px), dtype=np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), grain_px)
    return smooth / smooth.std()


@lru_cache(maxsize=2)
def _smudged(camera: Camera, dirt: Dirt) -> Float[np.ndarray, "h w"]:
    """1 in the smudge's sector of the tube, falling off at its edges."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float32)
    clock_deg = np.degrees(np.arctan2(u - camera.cx_px, camera.cy_px - v))
    off = np.abs((clock_deg - dirt.smudge_clock_deg + 180) % 360 - 180)
    return np.clip((dirt.smudge_width_deg / 2 - off) / SMUDGE_EDGE_DEG + 0.5, 0, 1).astype(np.float32)
