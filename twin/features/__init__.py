"""The feature families of a wall: one file each, one line here in the dictionary and one in the compiled chain."""

from __future__ import annotations

from typing import Annotated

from numba import njit
from pydantic import Field

from twin.features import corrosion, dent, hole, pit, pocket, scratch
from twin.features.base import Feature
from twin.features.corrosion import Corrosion
from twin.features.dent import Dent
from twin.features.hole import Hole
from twin.features.pit import Pit
from twin.features.pocket import Pocket
from twin.features.scratch import Scratch

FAMILIES: dict[str, type[Feature]] = {
    "pocket": Pocket,
    "pit": Pit,
    "scratch": Scratch,
    "corrosion": Corrosion,
    "dent": Dent,
    "hole": Hole,
}
CODES = {kind: code for code, kind in enumerate(FAMILIES)}

AnyFeature = Annotated[Pocket | Pit | Scratch | Corrosion | Dent | Hole, Field(discriminator="kind")]


@njit(cache=True, error_model="numpy", forceinline=True)
def feature_depth_mm(code, dz, arc, row, inner_radius):
    """Depth of one feature, mm, inward below zero; `code` counts the families in the dictionary's order."""
    if code == 0:
        return pocket.depth_mm(dz, arc, row, inner_radius)
    if code == 1:
        return pit.depth_mm(dz, arc, row, inner_radius)
    if code == 2:
        return scratch.depth_mm(dz, arc, row, inner_radius)
    if code == 3:
        return corrosion.depth_mm(dz, arc, row, inner_radius)
    if code == 4:
        return dent.depth_mm(dz, arc, row, inner_radius)
    return hole.depth_mm(dz, arc, row, inner_radius)
