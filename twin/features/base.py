"""What every feature of a wall says of itself."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.geometry import wrap_rad
from sensor_model.settings import ClockDeg, Settings

ROW_LENGTH = 14
CENTER_Z, CENTER_THETA, HALF_BOX_Z, HALF_BOX_ARC, FIRST_OWN = range(5)


class TrueSize(NamedTuple):
    """A feature's exact size: axial length and arc width at half the largest depth, and that depth (inward: height)."""

    length_mm: float
    width_mm: float
    depth_mm: float


def shape_of(
    depth_mm: Float[np.ndarray, "z arc"], z_mm: Float[np.ndarray, "z"], arc_mm: Float[np.ndarray, "arc"]
) -> tuple[TrueSize, float, float]:
    """Size of a shape that has no closed form, from its depth on a fine grid; and the middle of its extents."""
    deepest = float(depth_mm.max())
    z_from, z_to = _ends(depth_mm.max(axis=1) - deepest / 2, z_mm)
    arc_from, arc_to = _ends(depth_mm.max(axis=0) - deepest / 2, arc_mm)
    size = TrueSize(z_to - z_from, arc_to - arc_from, deepest)
    return size, (z_from + z_to) / 2, (arc_from + arc_to) / 2


def _ends(over: Float[np.ndarray, "n"], place_mm: Float[np.ndarray, "n"]) -> tuple[float, float]:
    """First and last zero of a profile, between the places of the grid."""
    inside = np.flatnonzero(over >= 0).tolist()

    def crossing(outside: int, within: int) -> float:
        share = over[outside] / (over[outside] - over[within])
        return float(place_mm[outside] + share * (place_mm[within] - place_mm[outside]))

    return crossing(inside[0] - 1, inside[0]), crossing(inside[-1] + 1, inside[-1])


class Feature(Settings):
    """A place in the wall. `distance_mm` is the axial position of its centre, `clock_deg` its middle around the wall.

    A family gives `size` (what a perfect measurement would say) and `row`: the numbers that its compiled `depth_mm`
    reads, after four that every family shares (centre z, centre theta, and the half extents outside which it is zero).
    Families that stand `inward` narrow the bore, and their depth is a height.
    """

    inward: ClassVar[bool] = False

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
