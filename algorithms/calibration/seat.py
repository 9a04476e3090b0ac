"""How the projector sits, from pictures of one clean pipe: its axis, which mounting anew tilts, with a free radius."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import PipeView, axis_of
from sensor_model.geometry import cone_frame
from sensor_model.rig import Rig

TILT_STD_RAD, APEX_STD_MM, ANGLE_STD_RAD = 0.01, 1.0, np.radians(0.1)  # how far a seat may be from the calibrated one
ALIKE_POINTS = 20.0  # neighbours on a jagged slit that err alike count as one
SCALE_MM = 1.0  # residuals beyond this count less
MOST_POINTS = 3000  # of a picture


class Seen(NamedTuple):
    """Rays of one picture's slit pixels and the slit of each."""

    ray: Float[np.ndarray, "n 3"]
    slit: Int[np.ndarray, "n"]


def fit_seat(views: Sequence[PipeView], rig: Rig) -> Rig:
    """The rig whose projector's axis, side step and half angles make one radius of all the pictures.

    How far the apex lies behind the camera stays as it is: with a free radius it is the scale of everything.

    Raises:
        CannotCalibrate: for fewer than two pictures; one pipe seen from one place leaves the axis open.
    """
    from scipy.optimize import least_squares

    if len(views) < 2:
        raise CannotCalibrate(f"{len(views)} pictures with a pipe in them; at least 2 are needed, from unlike places")
    seen = [_seen(view) for view in views]
    slits = len(rig.projector.slits)
    start = np.zeros(4 + slits)
    places = np.concatenate([axis_of(view) for view in views])
    first = np.concatenate([start, places, [float(np.mean([view.alignment.radius_mm for view in views]))]])
    prior = np.concatenate([[TILT_STD_RAD] * 2, [APEX_STD_MM] * 2, [ANGLE_STD_RAD] * slits])

    def misfit(unknowns: np.ndarray) -> np.ndarray:
        apex, axis, half = _projector(rig, unknowns[: 4 + slits])
        parts = [unknowns[: 4 + slits] / prior]
        for k, one in enumerate(seen):
            place = unknowns[4 + slits + 4 * k : 8 + slits + 4 * k]
            residual = _radii(_on_cones(one, apex, axis, half), place) - unknowns[-1]
            off = residual / SCALE_MM
            thinned = one.slit.size / views[k].points.ring.size
            # the square of this is a loss that grows only linearly far out
            parts.append(np.sqrt(2 * (np.sqrt(1 + off**2) - 1) / (ALIKE_POINTS * thinned)))
        return np.concatenate(parts)

    found = least_squares(misfit, first, x_scale="jac")
    apex, axis, half = _projector(rig, found.x[: 4 + slits])
    moved = tuple(
        slit.model_copy(update={"half_angle_deg": float(np.degrees(angle))})
        for slit, angle in zip(rig.projector.slits, half, strict=True)
    )
    update = {"apex_mm": tuple(apex.tolist()), "axis": tuple(axis.tolist()), "slits": moved}
    return rig.model_copy(update={"projector": rig.projector.model_copy(update=update)})


def _seen(view: PipeView) -> Seen:
    xyz, slit = view.points.xyz_mm[view.right], view.points.ring[view.right]
    every = max(slit.size // MOST_POINTS, 1)
    ray = xyz / np.linalg.norm(xyz, axis=1)[:, None]
    return Seen(ray[::every], slit[::every])


def _projector(rig: Rig, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    axis = cone_frame(np.array(rig.projector.axis)) @ np.array([change[0], change[1], 1.0])
    apex = np.array(rig.projector.apex_mm) + np.array([change[2], change[3], 0.0])
    return apex, axis / np.linalg.norm(axis), rig.projector.slit_half_angles_rad + change[4:]


def _on_cones(seen: Seen, apex: np.ndarray, axis: np.ndarray, half: np.ndarray) -> Float[np.ndarray, "n 3"]:
    """Where rays leave their cones: the larger root of ((t w - A) . a)^2 = cos^2 |t w - A|^2 that lies ahead."""
    c2 = np.cos(half[seen.slit]) ** 2
    w_a, a_apex, w_apex = seen.ray @ axis, apex @ axis, seen.ray @ apex
    a, b = w_a**2 - c2, -2 * (w_a * a_apex - c2 * w_apex)
    root = np.sqrt(np.maximum(b * b - 4 * a * (a_apex**2 - c2 * (apex @ apex)), 0.0))
    return seen.ray * ((-b - root) / (2 * a))[:, None]


def _radii(xyz_mm: np.ndarray, place: np.ndarray) -> Float[np.ndarray, "n"]:
    axis = np.array([place[2], place[3], 1.0])
    axis /= np.linalg.norm(axis)
    off = xyz_mm - np.array([place[0], place[1], 0.0])
    return np.linalg.norm(off - (off @ axis)[:, None] * axis, axis=1)
