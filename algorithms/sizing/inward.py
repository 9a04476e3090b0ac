"""What stands inward of the bore: dents, and rings such as a weld or a joint's bead; no loss of wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from algorithms.types import INWARD, INWARD_RING, Defect
from sensor_model.recording import NominalPipe

HEIGHT_STD_MM = 0.15  # of a ring's crest: what smoothing over three rows takes of one as narrow as a bead
LENGTH_STD_MM = 1.2  # of a ring: in pictures slits are lost on its far side


def as_inward(measured: Defect, pipe: NominalPipe) -> Defect:
    """A height, measured as a depth is, said as what it is; it takes no wall and has no disposition by wall loss."""
    around = measured.width_mm >= 2 * np.pi * pipe.inner_radius_mm
    return replace(
        measured,
        wall_loss_pct=0.0,
        wall_loss_std_pct=0.0,
        floor_seen=True,  # light comes from behind: the near side of what stands inward is lit
        volume_mm3=0.0,
        length_std_mm=max(measured.length_std_mm, LENGTH_STD_MM * around),
        depth_std_mm=max(measured.depth_std_mm, HEIGHT_STD_MM * around),
        feature_class=INWARD_RING if around else INWARD,
        disposition="",
    )
