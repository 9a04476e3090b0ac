"""A round hole through the wall, which returns no light; a pinhole where it is small."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize


class Hole(Feature):
    """A round hole: `depth_mm` is the wall's thickness, which all of it is missing; the pipe must not be backed.

    Its side falls over `edge_width_mm`, half of it at the stated diameter.
    """

    kind: Literal["hole"] = "hole"
    diameter_mm: Annotated[float, Field(gt=0)]
    edge_width_mm: Annotated[float, Field(gt=0)] = 2.0

    @model_validator(mode="after")
    def _edge_fits(self) -> Hole:
        if self.edge_width_mm > self.diameter_mm:
            raise ValueError(f"edge_width_mm must not exceed the diameter, {self.diameter_mm} mm")
        return self

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True size at half the wall."""
        return TrueSize(self.diameter_mm, self.diameter_mm, self.depth_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        reach = (self.diameter_mm + self.edge_width_mm) / 2
        return reach, reach, (self.diameter_mm / 2, self.depth_mm, self.edge_width_mm)


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):  # noqa: ARG001  one signature for all families
    """Depth at an axial and an arc distance from the centre, mm."""
    t = min(max(0.5 - (np.hypot(dz, arc) - row[FIRST_OWN]) / row[FIRST_OWN + 2], 0.0), 1.0)
    return row[FIRST_OWN + 1] * t * t * (3.0 - 2.0 * t)
