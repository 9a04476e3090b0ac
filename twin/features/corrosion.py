"""A corroded patch: a random field of pits that run into each other, fading out towards an oval outline."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from twin.features.base import FIRST_OWN, Feature, TrueSize, shape_of

GRID_MM = 0.05
HALF_LENGTH, HALF_WIDTH, SCALE, GRAIN, SEED, SHIFT_Z, SHIFT_ARC = range(FIRST_OWN, FIRST_OWN + 7)


class Corrosion(Feature):
    """A patch whose depth is random: `grain_mm` is the distance over which it changes, `seed` which patch it is.

    `length_mm` and `width_mm` are those of the oval outside which the wall is whole, and `depth_mm` is the deepest
    place's. The true size is that of all that is at least half as deep, and its middle is the feature's.
    """

    kind: Literal["corrosion"] = "corrosion"
    length_mm: Annotated[float, Field(gt=0, le=300)]
    width_mm: Annotated[float, Field(gt=0, le=300)]
    grain_mm: Annotated[float, Field(ge=2)] = 8.0
    seed: Annotated[int, Field(ge=0, lt=2**20)] = 0

    @model_validator(mode="after")
    def _smooth(self) -> Corrosion:
        most = 0.5 * min(self.length_mm, self.width_mm)
        if self.depth_mm > most:
            raise ValueError(f"depth_mm must be at most half of the smaller side, {most} mm, or the patch is a hole")
        if self.grain_mm < self.depth_mm / 3:
            raise ValueError(
                f"grain_mm must be at least a third of depth_mm, {self.depth_mm / 3:.3g} mm, or it has cliffs"
            )
        return self

    def size(self, inner_radius_mm: float) -> TrueSize:  # noqa: ARG002  the same in every bore
        """True extents at half depth, and depth."""
        return _shape(self.length_mm, self.width_mm, self.depth_mm, self.grain_mm, self.seed)[0]

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        _, z, arc, scale = _shape(self.length_mm, self.width_mm, self.depth_mm, self.grain_mm, self.seed)
        half_z, half_arc = self.length_mm / 2, self.width_mm / 2
        return half_z + abs(z), half_arc + abs(arc), (half_z, half_arc, scale, self.grain_mm, float(self.seed), z, arc)


@lru_cache(maxsize=256)
def _shape(length: float, width: float, depth: float, grain: float, seed: int) -> tuple[TrueSize, float, float, float]:
    """Size, the middle of its extents from the oval's, and what scales the field to the stated depth."""
    row = np.zeros(FIRST_OWN + 7)
    row[FIRST_OWN:] = length / 2, width / 2, 1.0, grain, seed, 0.0, 0.0
    z, arc = (np.arange(-side / 2 - GRID_MM, side / 2 + 2 * GRID_MM, GRID_MM) for side in (length, width))
    field = _depths(z, arc, row)
    scale = depth / float(field.max())
    return (*shape_of(field * scale, z, arc), scale)


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
    rho2 = (dz / row[HALF_LENGTH]) ** 2 + (arc / row[HALF_WIDTH]) ** 2
    if rho2 >= 1.0:
        return 0.0
    seed = np.int64(row[SEED])
    coarse = _noise(dz / row[GRAIN], arc / row[GRAIN], seed)
    fine = _noise(2.0 * dz / row[GRAIN], 2.0 * arc / row[GRAIN], seed + 1)
    return row[SCALE] * (1.0 - rho2) ** 2 * (0.25 + 0.55 * coarse + 0.2 * fine)


@njit(cache=True, error_model="numpy")
def _noise(x, y, seed):
    """A smooth field between 0 and 1: numbers that hang on the corners of a grid, run together in between."""
    i, k = np.floor(x), np.floor(y)
    u, v = x - i, y - k
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    i, k = np.int64(i), np.int64(k)
    low = (1.0 - u) * _corner(i, k, seed) + u * _corner(i + 1, k, seed)
    high = (1.0 - u) * _corner(i, k + 1, seed) + u * _corner(i + 1, k + 1, seed)
    return (1.0 - v) * low + v * high


@njit(cache=True, error_model="numpy", forceinline=True)
def _corner(i, k, seed):
    """The number at one corner, scrambled from where it is."""
    mask = np.int64(0xFFFFFFFF)
    h = (i * np.int64(374761393) + k * np.int64(668265263) + seed * np.int64(362437)) & mask
    h = ((h ^ (h >> np.int64(13))) * np.int64(1274126177)) & mask
    h = ((h ^ (h >> np.int64(15))) * np.int64(1103515245)) & mask
    return np.float64((h ^ (h >> np.int64(16))) & np.int64(0xFFFF)) / 65535.0
