"""The dimension classes of the Pipeline Operators Forum: a feature's shape by its length and width alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

CLASSES = (
    "general",
    "pitting",
    "axial grooving",
    "circumferential grooving",
    "pinhole",
    "axial slotting",
    "circumferential slotting",
)
LEAST_UNIT_MM = 10.0
NOTE = "informative: the classes are the Pipeline Operators Forum's for metal loss in steel, here applied to plastic"


def unit_mm(wall_mm: float) -> float:
    """A, the unit of the classes: the wall's thickness, at least 10 mm."""
    if not (np.isfinite(wall_mm) and wall_mm > 0):
        raise ValueError(f"a wall of {wall_mm} mm is not greater than 0")
    return max(wall_mm, LEAST_UNIT_MM)


def membership(
    length_mm: Float[np.ndarray, "n"], width_mm: Float[np.ndarray, "n"], wall_mm: float
) -> Bool[np.ndarray, "classes n"]:
    """Which class each size is in, rule by rule (POF 100, specifications for in-line inspection, Table 2.1 and Fig. 2).

    The rules part all sizes: each is in one class. Length is axial, width circumferential.

    Raises:
        ValueError: for a size that is not finite and greater than 0.
    """
    for name, size in (("length", length_mm), ("width", width_mm)):
        if not (np.isfinite(size).all() and np.all(size > 0)):
            raise ValueError(f"every {name} must be finite and greater than 0 mm")
    length, width = length_mm / unit_mm(wall_mm), width_mm / unit_mm(wall_mm)
    long, wide = length >= 1, width >= 1
    general = (length >= 3) & (width >= 3)
    # L / W >= 2 and <= 0.5
    elongated, broad = length >= 2 * width, width >= 2 * length
    return np.stack(
        [
            general,
            long & wide & (length < 6) & (width < 6) & ~elongated & ~broad & ~general,
            wide & (width < 3) & elongated,
            long & (length < 3) & broad,
            ~long & ~wide,
            long & ~wide,
            ~long & wide,
        ]
    )


def feature_class(
    length_mm: Float[np.ndarray, "n"], width_mm: Float[np.ndarray, "n"], wall_mm: float
) -> Int[np.ndarray, "n"]:
    """The class of each size, as its place in `CLASSES`."""
    return np.argmax(membership(length_mm, width_mm, wall_mm), axis=0)
