"""A milled pocket: rectangular plan, flat floor, side walls that fall over a stated width."""

from __future__ import annotations

from math import cos
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize


class Pocket(Feature):
    """A milled pocket with a rectangular plan: the paper's defect (section 4.1).

    A `concentric` floor has the same radial depth everywhere; a `planar` one is flat, `depth_mm` under its middle, and
    so radially deeper at its sides. The side wall falls over `edge_width_mm`, rounded into rim and floor, and its half
    depth lies on the outline that length and width state.
    """

    kind: Literal["pocket"] = "pocket"
    length_mm: Annotated[float, Field(gt=0)]
    width_mm: Annotated[float, Field(gt=0)]
    floor: Literal["concentric", "planar"] = "concentric"
    edge_width_mm: Annotated[float, Field(gt=0)] = 2.0
    corner_radius_mm: Annotated[float, Field(ge=0)] = 3.0

    @model_validator(mode="after")
    def _edges_fit(self) -> Pocket:
        smaller = min(self.length_mm, self.width_mm)
        if self.edge_width_mm > smaller or 2 * self.corner_radius_mm > smaller:
            raise ValueError(f"edge_width_mm and twice corner_radius_mm must not exceed the smaller side, {smaller} mm")
        return self

    def size(self, inner_radius_mm: float) -> TrueSize:
        """True size; a planar floor is deepest at its sides."""
        depth = self.depth_mm
        if self.floor == "planar":
            half_angle = (self.width_mm - self.edge_width_mm) / 2 / inner_radius_mm
            depth = (inner_radius_mm + depth) / cos(half_angle) - inner_radius_mm
        return TrueSize(self.length_mm, self.width_mm, depth)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        half_edge = self.edge_width_mm / 2
        half_length, half_width = self.length_mm / 2, self.width_mm / 2
        own = (half_length, half_width, self.depth_mm, float(self.floor == "planar"), self.edge_width_mm)
        return half_length + half_edge, half_width + half_edge, (*own, self.corner_radius_mm)


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):
    """Depth at an axial and an arc distance from the centre, mm."""
    half_length, half_width, depth, planar = (
        row[FIRST_OWN],
        row[FIRST_OWN + 1],
        row[FIRST_OWN + 2],
        row[FIRST_OWN + 3],
    )
    edge_width, corner = row[FIRST_OWN + 4], row[FIRST_OWN + 5]
    along, across = abs(dz) - half_length + corner, abs(arc) - half_width + corner
    outside = np.hypot(max(along, 0.0), max(across, 0.0)) + min(max(along, across), 0.0) - corner
    t = min(max(0.5 - outside / edge_width, 0.0), 1.0)
    if planar > 0:
        depth = (inner_radius + depth) / np.cos(arc / inner_radius) - inner_radius
    return depth * t * t * (3.0 - 2.0 * t)
