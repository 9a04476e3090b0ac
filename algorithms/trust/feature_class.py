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
    a = unit_mm(wall_mm)
    L, W = length_mm, width_mm
    long, wide = L >= a, W >= a
    general = (L >= 3 * a) & (W >= 3 * a)
    elongated, broad = L >= 2 * W, W >= 2 * L  # L / W >= 2 and <= 0.5, free of a division's rounding
    return np.stack(
        [
            general,
            long & wide & (L < 6 * a) & (W < 6 * a) & ~elongated & ~broad & ~general,
            wide & (W < 3 * a) & elongated,
            long & (L < 3 * a) & broad,
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
