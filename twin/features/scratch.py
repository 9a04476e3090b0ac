"""A scratch: a rounded groove along a line on the unrolled wall, of even or falling depth, with or without a branch."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize, shape_of

GRID_MM = 0.05
# places of a scratch's own numbers in its row
END_Z, END_ARC, HALF_LINE, WIDTH, DEPTH, END_DEPTH, BRANCH_Z, BRANCH_ARC, SHIFT_Z, SHIFT_ARC = range(
    FIRST_OWN, FIRST_OWN + 10
)


class Scratch(Feature):
    """A groove, straight on the unrolled wall (a helix in space), with a rounded section and rounded ends.

    `path_length_mm` runs from end to end and `width_mm` across, both at half depth; `heading_deg` turns it from axial
    (0) towards growing clock positions. With `end_depth_mm` the depth falls evenly to that at its further end (the
    clockwise one, where it runs around). A branch leaves the middle at its own heading, as deep and wide as the
    scratch is there. What is not even has its size, and so its middle, where it is at least half as deep as at most.
    """

    kind: Literal["scratch"] = "scratch"
    path_length_mm: Annotated[float, Field(gt=0, le=2000)]
    width_mm: Annotated[float, Field(gt=0)]
    heading_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    end_depth_mm: Annotated[float, Field(ge=0)] | None = None
    branch_length_mm: Annotated[float, Field(ge=0, le=500)] = 0.0
    branch_heading_deg: Annotated[float, Field(ge=-180, le=180)] = 45.0

    @model_validator(mode="after")
    def _longer_than_wide(self) -> Scratch:
        if self.path_length_mm < self.width_mm:
            raise ValueError(f"path_length_mm must be at least width_mm, {self.width_mm}")
        if self.end_depth_mm is not None and self.end_depth_mm > self.depth_mm:
            raise ValueError(f"end_depth_mm must be at most depth_mm, {self.depth_mm}: depth falls from the first end")
        return self

    @property
    def _even(self) -> bool:
        return self.end_depth_mm in (None, self.depth_mm) and self.branch_length_mm == 0

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True axial and arc extent at half depth."""
        if not self._even:
            return _uneven(self)[0]
        line, turn = self.path_length_mm - self.width_mm, radians(self.heading_deg)
        return TrueSize(line * cos(turn) + self.width_mm, line * abs(sin(turn)) + self.width_mm, self.depth_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        half_z, half_arc, own = self._in_place()
        if self._even:
            return half_z, half_arc, own
        _, z, arc = _uneven(self)
        return half_z + abs(z), half_arc + abs(arc), (*own[:-2], z, arc)

    def _in_place(self) -> tuple[float, float, tuple[float, ...]]:
        """Half extents and own numbers of the scratch about the middle of its line."""
        half_line, turn = (self.path_length_mm - self.width_mm) / 2, radians(self.heading_deg)
        along, across = half_line * cos(turn), half_line * sin(turn)
        fork = radians(self.branch_heading_deg)
        branch = self.branch_length_mm * cos(fork), self.branch_length_mm * sin(fork)
        end_depth = self.depth_mm if self.end_depth_mm is None else self.end_depth_mm
        own = (along, across, half_line, self.width_mm, self.depth_mm, end_depth, *branch, 0.0, 0.0)
        half_z = max(along, abs(branch[0])) + self.width_mm
        return half_z, max(abs(across), abs(branch[1])) + self.width_mm, own


@lru_cache(maxsize=256)
def _uneven(scratch: Scratch) -> tuple[TrueSize, float, float]:
    """Size, and the middle of its extents from the middle of its line."""
    half_z, half_arc, own = scratch._in_place()
    row = np.array([0.0, 0.0, half_z, half_arc, *own])
    z = np.arange(-half_z - GRID_MM, half_z + 2 * GRID_MM, GRID_MM)
    arc = np.arange(-half_arc - GRID_MM, half_arc + 2 * GRID_MM, GRID_MM)
    return shape_of(_depths(z, arc, row), z, arc)


@njit(cache=True, error_model="numpy")
def _depths(z, arc, row):
    out = np.empty((z.size, arc.size))
    for i in range(z.size):
        for k in range(arc.size):
            out[i, k] = depth_mm(z[i], arc[k], row, 0.0)
    return out


@njit(cache=True, error_model="numpy", forceinline=True)
def depth_mm(dz, arc, row, inner_radius):  # noqa: ARG001  one signature for all families
    """Depth at an axial and an arc distance from the centre, mm."""
    dz, arc = dz + row[SHIFT_Z], arc + row[SHIFT_ARC]
    end_z, end_arc, half_line, width = row[END_Z], row[END_ARC], row[HALF_LINE], row[WIDTH]
    t = 0.0
    if half_line > 0:
        t = min(max((dz * end_z + arc * end_arc) / (half_line * half_line), -1.0), 1.0)
    rho = np.hypot(dz - t * end_z, arc - t * end_arc)
    depth = row[DEPTH] + 0.5 * (1.0 + t) * (row[END_DEPTH] - row[DEPTH]) if row[END_DEPTH] != row[DEPTH] else row[DEPTH]
    deep = depth * np.cos(0.5 * np.pi * rho / width) ** 2 if rho < width else 0.0
    reach2 = row[BRANCH_Z] * row[BRANCH_Z] + row[BRANCH_ARC] * row[BRANCH_ARC]
    if reach2 > 0:
        t = min(max((dz * row[BRANCH_Z] + arc * row[BRANCH_ARC]) / reach2, 0.0), 1.0)
        rho = np.hypot(dz - t * row[BRANCH_Z], arc - t * row[BRANCH_ARC])
        if rho < width:
            deep = max(deep, 0.5 * (row[DEPTH] + row[END_DEPTH]) * np.cos(0.5 * np.pi * rho / width) ** 2)
    return deep
