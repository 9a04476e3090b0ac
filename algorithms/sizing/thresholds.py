"""Blind choices of the depth above which a cell belongs to a defect: one function and one line each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.settings import Settings

MIN_LEVELS = 16  # fewer different values make no histogram


class ThresholdSettings(Settings):
    """Which rule, and its figures: the smallest depth worth calling, and how far above the map's noise."""

    rule: Literal["noise", "otsu"] = "noise"
    noise_sigmas: Annotated[float, Field(gt=1)] = 6.0
    min_depth_mm: Annotated[float, Field(gt=0)] = 0.4


def by_noise(
    deviation_mm: Float[np.ndarray, "around along"],  # noqa: ARG001  one signature for all rules
    noise_mm: Float[np.ndarray, "around along"],
    settings: ThresholdSettings,
) -> Float[np.ndarray, "around along"]:
    """So many standard deviations of the wall map's own noise in each cell."""
    return np.maximum(settings.noise_sigmas * noise_mm, settings.min_depth_mm)


def by_otsu(
    deviation_mm: Float[np.ndarray, "around along"],
    noise_mm: Float[np.ndarray, "around along"],
    settings: ThresholdSettings,
) -> Float[np.ndarray, "around along"]:
    """The first of two levels that part what rises above the noise in three (multi-Otsu), never below the noise."""
    from skimage.filters import threshold_multiotsu

    floor = by_noise(deviation_mm, noise_mm, settings)
    raised = deviation_mm[np.nan_to_num(deviation_mm, nan=-np.inf) > floor / 2]
    if np.unique(raised).size < MIN_LEVELS:
        return floor
    return np.maximum(float(threshold_multiotsu(raised, classes=3)[0]), floor)


THRESHOLDS: dict[str, Callable[..., Float[np.ndarray, "around along"]]] = {"noise": by_noise, "otsu": by_otsu}
