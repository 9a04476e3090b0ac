"""A straight scratch: a rounded groove along a line on the unrolled wall."""

from __future__ import annotations

from math import cos, radians, sin
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize


class Scratch(Feature):
    """A straight groove, straight on the unrolled wall, with a rounded section and rounded ends.

    `path_length_mm` runs from end to end and `width_mm` across, both at half depth; `heading_deg` turns it from axial
    (0) towards growing clock positions.
    """

    kind: Literal["scratch"] = "scratch"
    path_length_mm: Annotated[float, Field(gt=0)]
    width_mm: Annotated[float, Field(gt=0)]
    heading_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0

    @model_validator(mode="after")
    def _longer_than_wide(self) -> Scratch:
        if self.path_length_mm < self.width_mm:
            raise ValueError(f"path_length_mm must be at least width_mm, {self.width_mm}")
        return self

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True axial and arc extent at half depth."""
        line, turn = self.path_length_mm - self.width_mm, radians(self.heading_deg)
        return TrueSize(line * cos(turn) + self.width_mm, line * abs(sin(turn)) + self.width_mm, self.depth_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        half_line, turn = (self.path_length_mm - self.width_mm) / 2, radians(self.heading_deg)
        along, across = half_line * cos(turn), half_line * sin(turn)
        own = (along, across, half_line, self.width_mm, self.depth_mm)
        return along + self.width_mm, abs(across) + self.width_mm, own


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):  # noqa: ARG001  one signature for all families
    """Depth at an axial and an arc distance from the centre, mm."""
    end_z, end_arc, half_line = row[FIRST_OWN], row[FIRST_OWN + 1], row[FIRST_OWN + 2]
    width, depth = row[FIRST_OWN + 3], row[FIRST_OWN + 4]
    t = 0.0
    if half_line > 0:
        t = min(max((dz * end_z + arc * end_arc) / (half_line * half_line), -1.0), 1.0)
    rho = np.hypot(dz - t * end_z, arc - t * end_arc)
    if rho >= width:
        return 0.0
    return depth * np.cos(0.5 * np.pi * rho / width) ** 2
