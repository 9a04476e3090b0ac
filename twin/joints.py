"""Joints, debris and changes of the bore: what a wheel meets on the wall that is no defect of it."""

from __future__ import annotations

from math import pi
from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from sensor_model.settings import ClockDeg, Settings
from twin.features.base import CENTER_THETA, CENTER_Z, FIRST_OWN, HALF_BOX_ARC, HALF_BOX_Z, ROW_LENGTH

JOINT, DEBRIS, TAPER = -1, -2, -3  # beside the codes of the features, which count from zero
BEYOND_END_MM = 1000.0

Length = Annotated[float, Field(gt=0, le=200)]


class Joint(Settings):
    """Two pipes meet: a gap all around, a bead that stands inward, or a bead with a gap in its middle.

    Both fall off smoothly (as the square of a cosine, at half height over the stated length), for edges sharper than
    2 mm trap wheels.
    """

    distance_mm: float
    gap_mm: Length = 4.0
    gap_depth_mm: Annotated[float, Field(ge=0, le=20)] = 0.0
    bead_mm: Length = 8.0
    bead_height_mm: Annotated[float, Field(ge=0, le=20)] = 0.0

    @model_validator(mode="after")
    def _is_there(self) -> Joint:
        if self.gap_depth_mm == self.bead_height_mm == 0:
            raise ValueError("a joint needs gap_depth_mm or bead_height_mm")
        return self

    def row(self) -> np.ndarray:
        """The joint as the compiled wall reads it."""
        row = np.zeros(ROW_LENGTH)
        row[[CENTER_Z, CENTER_THETA]] = self.distance_mm, 0.0
        row[[HALF_BOX_Z, HALF_BOX_ARC]] = max(self.gap_mm, self.bead_mm), 1e9
        row[FIRST_OWN : FIRST_OWN + 4] = self.gap_mm, self.gap_depth_mm, self.bead_mm, self.bead_height_mm
        return row


class Debris(Settings):
    """A round lump on the wall, lying fast; its height falls off as the square of a cosine, half at its diameter."""

    distance_mm: float
    clock_deg: ClockDeg = 180.0
    diameter_mm: Length
    height_mm: Annotated[float, Field(gt=0, le=40)]

    def row(self) -> np.ndarray:
        """The lump as the compiled wall reads it."""
        row = np.zeros(ROW_LENGTH)
        row[[CENTER_Z, CENTER_THETA]] = self.distance_mm, self.clock_deg * pi / 180
        row[[HALF_BOX_Z, HALF_BOX_ARC]] = self.diameter_mm, self.diameter_mm
        row[FIRST_OWN : FIRST_OWN + 2] = self.diameter_mm, self.height_mm
        return row


class Taper(Settings):
    """The bore widens, or narrows below zero, by so much from one place to another, smoothly, and stays so."""

    from_mm: float
    to_mm: float
    radius_change_mm: Annotated[float, Field(ge=-50, le=50)]

    @model_validator(mode="after")
    def _is_gentle(self) -> Taper:
        if self.to_mm - self.from_mm < 2 * abs(self.radius_change_mm):
            raise ValueError("to_mm must lie beyond from_mm by at least twice radius_change_mm, or wheels are trapped")
        return self

    def row(self, end_mm: float) -> np.ndarray:
        """The change as the compiled wall reads it, on to the end of the pipe."""
        row = np.zeros(ROW_LENGTH)
        beyond = max(end_mm, self.to_mm) + BEYOND_END_MM
        row[[CENTER_Z, HALF_BOX_Z]] = (self.from_mm + beyond) / 2, (beyond - self.from_mm) / 2
        row[HALF_BOX_ARC] = 1e9
        row[FIRST_OWN : FIRST_OWN + 2] = self.to_mm - self.from_mm, self.radius_change_mm
        return row


@njit(cache=True, error_model="numpy", forceinline=True)
def obstacle_depth_mm(code, dz, arc, row):
    """Depth of a joint, debris or taper at an axial and an arc distance from its middle, mm; inward below zero."""
    if code == TAPER:
        share = min((dz + row[HALF_BOX_Z]) / row[FIRST_OWN], 1.0)
        return row[FIRST_OWN + 1] * share * share * (3.0 - 2.0 * share)
    if code == JOINT:
        return row[FIRST_OWN + 1] * _bell(dz, row[FIRST_OWN]) - row[FIRST_OWN + 3] * _bell(dz, row[FIRST_OWN + 2])
    return -row[FIRST_OWN + 1] * _bell(np.hypot(dz, arc), row[FIRST_OWN])


@njit(cache=True, error_model="numpy", forceinline=True)
def _bell(distance, width):
    """One in the middle, a half at half the width to either side, zero from the width on."""
    if abs(distance) >= width:
        return 0.0
    return np.cos(0.5 * np.pi * distance / width) ** 2
