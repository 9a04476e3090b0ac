"""What the camera's own processor makes of a picture: colour filter, denoising, sharpening, JPEG."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from sensor_model.settings import Settings

DENOISE_PX, SHARPEN_PX = 1.5, 1.5


class Processing(Settings):
    """The camera's own processing, in its order; it acts on the 8 bits of each channel."""

    color_filter: bool = False
    """Each pixel sees one colour (RGGB); the others come from its neighbours."""
    denoise_levels: Annotated[float, Field(ge=0, le=100)] = 0.0
    """Neighbours that differ by less than this are averaged (a bilateral filter); 0: none are."""
    sharpen: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Share of what differs from the surroundings that is added once more."""
    jpeg_quality: Annotated[int, Field(ge=0, le=100)] = 0
    """As JPEG has it, 100 being best; 0: no JPEG."""


def processed(picture: UInt8[np.ndarray, "h w 3"], how: Processing) -> UInt8[np.ndarray, "h w 3"]:
    """The picture as the camera hands it out, RGB."""
    import cv2

    if how.color_filter:
        picture = _interpolated(picture)
    if how.denoise_levels > 0:
        picture = cv2.bilateralFilter(picture, 0, how.denoise_levels, DENOISE_PX)
    if how.sharpen > 0:
        soft = cv2.GaussianBlur(picture, (0, 0), SHARPEN_PX)
        picture = cv2.addWeighted(picture, 1 + how.sharpen, soft, -how.sharpen, 0)
    if how.jpeg_quality > 0:
        coded = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, how.jpeg_quality])[1]
        picture = np.ascontiguousarray(np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))[..., ::-1])
    return picture


def _interpolated(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Red at even rows and columns, blue at odd ones, green between; the rest as OpenCV's bilinear filter fills it."""
    import cv2

    mosaic = picture[..., 1].copy()
    mosaic[::2, ::2] = picture[::2, ::2, 0]
    mosaic[1::2, 1::2] = picture[1::2, 1::2, 2]
    return cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2RGB)
