"""A dent: the wall pushed inward, without loss of material."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from twin.features.base import FIRST_OWN, Feature, TrueSize


class Dent(Feature):
    """A smooth dent, oval in plan: `depth_mm` is how far it stands inward, half of it at the stated length and width.

    Its height falls off as the square of a cosine, to nothing at twice its size. It takes no wall.
    """

    inward: ClassVar[bool] = True

    kind: Literal["dent"] = "dent"
    length_mm: Annotated[float, Field(gt=0, le=1000)]
    width_mm: Annotated[float, Field(gt=0, le=200)]

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True size; the depth is the height inward."""
        return TrueSize(self.length_mm, self.width_mm, self.depth_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        return self.length_mm, self.width_mm, (self.length_mm, self.width_mm, self.depth_mm)


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):  # noqa: ARG001  one signature for all families
    """Depth at an axial and an arc distance from the centre, mm: below zero, for it stands inward."""
    away = np.hypot(dz / row[FIRST_OWN], arc / row[FIRST_OWN + 1])
    if away >= 1.0:
        return 0.0
    return -row[FIRST_OWN + 2] * np.cos(0.5 * np.pi * away) ** 2
