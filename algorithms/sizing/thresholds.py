"""Blind choices of the depth above which a cell belongs to a defect: one function and one line each.

A rule says the least depth that is called anywhere, mm. It may look at the whole map, piece by piece, as often as it
likes; each piece is the deviation of its cells and their noise, mm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.settings import Settings

MIN_LEVELS = 16  # fewer different values make no histogram
LEVELS = 256  # of the histogram
Parts = Callable[[], Iterator[tuple[Float[np.ndarray, "around _"], Float[np.ndarray, "around _"]]]]


class ThresholdSettings(Settings):
    """Which rule, and its figures: the smallest depth worth calling, and how far above the map's noise."""

    rule: Literal["noise", "otsu"] = "noise"
    noise_sigmas: Annotated[float, Field(gt=1)] = 6.0
    min_depth_mm: Annotated[float, Field(gt=0)] = 0.4


def threshold_mm(
    noise_mm: Float[np.ndarray, "*cells"], least_mm: float, settings: ThresholdSettings
) -> Float[np.ndarray, "*cells"]:
    """What each cell must exceed: so many standard deviations of its own noise, and what the rule asks of all."""
    return np.maximum(least_mm, np.maximum(settings.noise_sigmas * noise_mm, settings.min_depth_mm))


def by_noise(parts: Parts, settings: ThresholdSettings) -> float:  # noqa: ARG001  one signature for all rules
    """The map's own noise in each cell says it all."""
    return settings.min_depth_mm


def by_otsu(parts: Parts, settings: ThresholdSettings) -> float:
    """The first of two levels that part what rises above the noise in three (multi-Otsu)."""
    from skimage.filters import threshold_multiotsu

    def raised() -> Iterator[Float[np.ndarray, "n"]]:
        for deviation, noise in parts():
            floor = threshold_mm(noise, settings.min_depth_mm, settings)
            yield deviation[np.nan_to_num(deviation, nan=-np.inf) > floor / 2]

    few, ends = np.zeros(0), (np.inf, -np.inf)
    for some in raised():
        few = np.unique(np.concatenate([few, some]))
        ends = min([ends[0], *few[:1]]), max([ends[1], *few[-1:]])
        few = few[:MIN_LEVELS]
    if few.size < MIN_LEVELS:
        return settings.min_depth_mm
    every = [np.histogram(some, LEVELS, ends) for some in raised()]
    count, edges = sum(count for count, _ in every), every[0][1]
    levels = threshold_multiotsu(hist=(count / np.sum(count), (edges[:-1] + edges[1:]) / 2), classes=3)
    return float(levels[0])


THRESHOLDS: dict[str, Callable[[Parts, ThresholdSettings], float]] = {"noise": by_noise, "otsu": by_otsu}
