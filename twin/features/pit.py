"""A round pit: a spherical cap or a cone."""

from __future__ import annotations

from math import sqrt
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize


class Pit(Feature):
    """A round pit: `spherical` (a cap; hemispherical when depth is half the diameter) or `conical`.

    `diameter_mm` is that of the mouth; the true length and width are at half depth, and so smaller.
    """

    kind: Literal["pit"] = "pit"
    diameter_mm: Annotated[float, Field(gt=0)]
    shape: Literal["spherical", "conical"] = "spherical"

    @model_validator(mode="after")
    def _no_overhang(self) -> Pit:
        if self.shape == "spherical" and self.depth_mm > self.diameter_mm / 2:
            raise ValueError(f"depth_mm of a spherical pit is at most half its diameter, {self.diameter_mm / 2} mm")
        return self

    @property
    def _ball_radius_mm(self) -> float:
        return (self.diameter_mm**2 / 4 + self.depth_mm**2) / (2 * self.depth_mm)

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True size at half depth."""
        width = self.diameter_mm / 2
        if self.shape == "spherical":
            ball = self._ball_radius_mm
            width = 2 * sqrt(ball**2 - (ball - self.depth_mm / 2) ** 2)
        return TrueSize(width, width, self.depth_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        radius = self.diameter_mm / 2
        ball = self._ball_radius_mm if self.shape == "spherical" else 0.0
        return radius, radius, (radius, self.depth_mm, ball)


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):  # noqa: ARG001  one signature for all families
    """Depth at an axial and an arc distance from the centre, mm."""
    radius, depth, ball = row[FIRST_OWN], row[FIRST_OWN + 1], row[FIRST_OWN + 2]
    rho = np.hypot(dz, arc)
    if rho >= radius:
        return 0.0
    if ball > 0:
        return np.sqrt(ball * ball - rho * rho) - (ball - depth)
    return depth * (1.0 - rho / radius)
