"""The projector's cones of light: one axis, a half angle for each slit, one apex or one each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from algorithms.calibration.failure import CannotCalibrate
from sensor_model.geometry import cone_frame, transform
from sensor_model.rig import Projector


@dataclass(frozen=True)
class Cones:
    """Apex of each slit (the same for all where they share it), the axis, half angles; NaN of a slit not seen."""

    apex_mm: Float[np.ndarray, "slits 3"]
    axis: Float[np.ndarray, "3"]
    half_angle_rad: Float[np.ndarray, "slits"]

    @property
    def T_camera_projector(self) -> Float[np.ndarray, "4 4"]:
        """Projector frame, as the rig has it."""
        return transform(cone_frame(self.axis), self.apex_mm[0])


def cones_of(projector: Projector) -> Cones:
    """The cones that a rig states."""
    apex = [slit.apex_mm or projector.apex_mm for slit in projector.slits]
    return Cones(np.array(apex), projector.T_camera_projector[:3, 2], projector.slit_half_angles_rad)


def excess_rad(xyz_mm: Float[np.ndarray, "n 3"], slit: Int[np.ndarray, "n"], cones: Cones) -> Float[np.ndarray, "n"]:
    """By how much further out than its slit's cone the light to each point goes."""
    return excess_and_slopes(xyz_mm, slit, cones)[0]


def excess_and_slopes(xyz_mm: np.ndarray, slit: np.ndarray, cones: Cones) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same, how it changes as the point moves (rad/mm), and the unit vectors away from the axis."""
    to = xyz_mm - cones.apex_mm[slit]
    along = to @ cones.axis
    outward = to - along[:, None] * cones.axis
    across = np.linalg.norm(outward, axis=1)
    outward /= np.maximum(across, 1e-12)[:, None]
    range2 = across**2 + along**2
    by_point = (along[:, None] * outward - across[:, None] * cones.axis) / range2[:, None]
    return np.arctan2(across, along) - cones.half_angle_rad[slit], by_point, outward


def with_cones(projector: Projector, cones: Cones, own_apex: bool = False) -> Projector:
    """The projector that has these cones, smooth; the light around its slits goes along with them.

    Raises:
        CannotCalibrate: where they are no projector's.
    """
    degrees = np.degrees(cones.half_angle_rad)
    slits = tuple(
        slit.model_copy(
            update={
                "half_angle_deg": float(angle),
                "apex_mm": tuple(apex.tolist()) if own_apex else None,
                "jag_deg": (),
            }
        )
        for slit, angle, apex in zip(projector.slits, degrees, cones.apex_mm, strict=True)
    )
    shift = degrees[[0, -1]] - [projector.slits[0].half_angle_deg, projector.slits[-1].half_angle_deg]
    update = {
        "apex_mm": tuple((cones.apex_mm.mean(axis=0) if own_apex else cones.apex_mm[0]).tolist()),
        "axis": tuple(cones.axis.tolist()),
        "slits": slits,
        "inner_half_angle_deg": float(projector.inner_half_angle_deg + shift[0]),
        "outer_half_angle_deg": float(projector.outer_half_angle_deg + shift[1]),
    }
    try:
        return projector.model_copy(update=update)
    except ValueError as error:  # slits that cross, or half angles no projector has
        raise CannotCalibrate(f"the cones found are no projector's: half angles {np.round(degrees, 2)}") from error
