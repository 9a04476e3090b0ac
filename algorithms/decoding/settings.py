"""The decoder's settings."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from sensor_model.settings import Settings


class DecodeSettings(Settings):
    """Settings of the decoder: lines around the picture's centre, what counts as a dark slit, what supports it."""

    azimuths: Annotated[int, Field(ge=36, le=7200)] = 720
    reach_px: Annotated[int, Field(ge=4, le=60)] = 16
    widest_reach_px: Annotated[int, Field(ge=4, le=60)] = 30
    min_contrast: Annotated[float, Field(gt=0, lt=1)] = 0.05
    noise_sigmas: Annotated[float, Field(ge=0)] = 5.0
    min_width_px: Annotated[float, Field(ge=0)] = 2.5
    max_width_px: Annotated[float, Field(gt=0)] = 36.0
    width_ratio: Annotated[float, Field(gt=1)] = 1.4
    depth_share: Annotated[float, Field(ge=0, lt=1)] = 0.3
    pooled_lines: Annotated[int, Field(ge=0, le=60)] = 8
    support_lines: Annotated[int, Field(ge=0, le=20)] = 2
    support_px: Annotated[float, Field(gt=0)] = 3.0
    edge_std_px: Annotated[float, Field(ge=0)] = 0.15
