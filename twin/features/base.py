"""What every feature of a wall says of itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from sensor_model.geometry import wrap_rad
from sensor_model.settings import ClockDeg, Settings

ROW_LENGTH = 10
CENTER_Z, CENTER_THETA, HALF_BOX_Z, HALF_BOX_ARC, FIRST_OWN = range(5)


class TrueSize(NamedTuple):
    """A feature's exact size: axial length and arc width at half the largest depth, and that depth."""

    length_mm: float
    width_mm: float
    depth_mm: float


class Feature(Settings):
    """A place in the wall. `distance_mm` is the axial position of its centre, `clock_deg` its middle around the wall.

    A family gives `size` (what a perfect measurement would say) and `row`: the numbers that its compiled `depth_mm`
    reads, after four that every family shares (centre z, centre theta, and the half extents outside which it is zero).
    """

    distance_mm: float
    clock_deg: ClockDeg = 0.0
    depth_mm: float = Field(gt=0)

    def size(self, inner_radius_mm: float) -> TrueSize:
        """True length, width and largest depth."""
        raise NotImplementedError

    def arc_mm(self, theta_rad: np.ndarray | float, inner_radius_mm: float) -> np.ndarray:
        """Signed distance around the wall from the feature's middle, clockwise."""
        return np.asarray(wrap_rad(theta_rad - np.radians(self.clock_deg)) * inner_radius_mm)

    def _own(self) -> tuple[float, float, tuple[float, ...]]:
        """Half extents in z and arc, mm, then the family's own numbers."""
        raise NotImplementedError

    def row(self) -> np.ndarray:
        """The feature as the compiled wall reads it."""
        half_z, half_arc, own = self._own()
        row = np.zeros(ROW_LENGTH)
        row[:FIRST_OWN] = self.distance_mm, np.radians(self.clock_deg), half_z, half_arc
        row[FIRST_OWN : FIRST_OWN + len(own)] = own
        return row
