"""What the wheel encoders say: the way that each wheel rolled (Eq. 25)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sensor_model.rig import Rig


def wheel_distances_mm(counts: Float[np.ndarray, "wheels"], rig: Rig) -> Float[np.ndarray, "wheels"]:
    """Distance rolled by each wheel since the start of the log."""
    turns = counts / rig.wheels.counts_per_turn
    return turns * np.pi * np.array(rig.wheels.diameters_mm)  # Eq. 25
