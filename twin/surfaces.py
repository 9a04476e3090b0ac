"""What lies on the wall: stretches where wheels grip less, or creep more, than on the dry plastic."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from sensor_model.settings import Settings

# Friction as a share of the dry wall's: our choice within what is published for rubber on smooth plastics
# (0.5 to 0.8 dry, about two thirds of that with dust, half with water, a fifth with oil).
GRIP = {"dry": 1.0, "dusty": 0.65, "wet": 0.5, "oily": 0.2}
CREEP_SPEED_MM_S = 1.0  # slower than this, a wheel no longer creeps in proportion to its rolling


class Surface(Settings):
    """A stretch of the pipe by what lies on it.

    `creep_pct` is the slip of a rolling wheel, as a share of its rim's speed, as its pull reaches the friction limit;
    it grows in proportion to the pull, as a rubber tread's does. At zero only the solver's own softness is left.
    """

    from_mm: float
    to_mm: float
    state: Literal["dry", "dusty", "wet", "oily"] = "dry"
    creep_pct: Annotated[float, Field(ge=0, le=50)] = 0.0

    @model_validator(mode="after")
    def _has_a_length(self) -> Surface:
        if self.to_mm <= self.from_mm:
            raise ValueError(f"to_mm must lie beyond from_mm, {self.from_mm}")
        return self


def surface_rows(surfaces: tuple[Surface, ...]) -> np.ndarray:
    """Rows of from (mm), to (mm), grip and creep (shares), as `surface_at` reads them."""
    rows = [(s.from_mm, s.to_mm, GRIP[s.state], s.creep_pct / 100) for s in surfaces]
    return np.array(rows).reshape(-1, 4)


@njit(cache=True, error_model="numpy")
def surface_at(rows, z_mm):
    """Grip and creep at one place; of stretches that overlap the last one counts, and between them the wall is dry."""
    grip, creep = 1.0, 0.0
    for i in range(rows.shape[0]):
        if rows[i, 0] <= z_mm < rows[i, 1]:
            grip, creep = rows[i, 2], rows[i, 3]
    return grip, creep
