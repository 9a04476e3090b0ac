"""The projector's cones of light through 3-D points of each slit: one axis, a half angle each, one apex or one each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from algorithms.robust import MAD_TO_SIGMA
from sensor_model.rig import Projector, Rig, Slit

MIN_POINTS = 20  # of one slit
ROBUST_SIGMAS, MAD_ROUNDS = 3.0, 2
TILT, FIRST_ANGLE = slice(3, 5), 5


class ConesNotFound(ValueError):
    """No projector can be made of these points; the message says why."""


class ConeFit(NamedTuple):
    """A projector, and what the points say of it: standard deviations, and their scatter about the cones (RMS)."""

    projector: Projector
    apex_std_mm: tuple[float, float, float]
    axis_std_deg: tuple[float, float]
    half_angle_std_deg: tuple[float, ...]
    rms_mm: float
    points: int


def fit_cones(points_by_slit: Sequence[Float[np.ndarray, "_ 3"]], start: Rig, own_apex: bool = False) -> ConeFit:
    """Robust least-squares cones with a shared axis through the points (camera frame) of each slit.

    They share an apex too, or each has its own: what a glass tube makes of one apex.

    A point counts by its distance from the camera: the error of a pixel is an angle. `start` needs to be right to some
    degrees and some centimetres. What all points of one picture err by (a board's place) the standard deviations leave
    out.

    Raises:
        ConesNotFound: with the reason.
    """
    xyz, slit = _checked(points_by_slit, start.projector)
    weight = np.median(np.linalg.norm(xyz, axis=1)) / np.linalg.norm(xyz, axis=1)
    R = start.projector.T_camera_projector[:3, :3]
    x = np.concatenate([start.projector.apex_mm, [0.0, 0.0], start.projector.slit_half_angles_rad])
    if own_apex:
        x = np.concatenate([x, np.tile(start.projector.apex_mm, len(start.projector.slits) - 1)])
    scale = np.inf
    for _ in range(1 + MAD_ROUNDS):  # all alike first, then what lies further off than its scale allows counts less
        loss, f_scale = ("soft_l1", ROBUST_SIGMAS * scale) if np.isfinite(scale) else ("linear", 1.0)
        found = least_squares(
            lambda x: weight * _beyond_mm(x, xyz, slit, R),
            x,
            lambda x: weight[:, None] * _jacobian(x, xyz, slit, R),
            loss=loss,
            f_scale=f_scale,
            x_scale="jac",
        )
        x, scale = (
            found.x,
            max(MAD_TO_SIGMA * float(np.median(np.abs(weight * _beyond_mm(found.x, xyz, slit, R)))), 1e-9),
        )
    if not found.success:
        raise ConesNotFound(f"the fit of the cones did not settle: {found.message}")
    beyond_mm = _beyond_mm(x, xyz, slit, R)
    J = weight[:, None] * _jacobian(x, xyz, slit, R)
    return _concluded(x, R, start.projector, _covariance(J, weight * beyond_mm, ROBUST_SIGMAS * scale), beyond_mm)


def _covariance(J: Float[np.ndarray, "n terms"], residual_mm: Float[np.ndarray, "n"], f_scale: float) -> np.ndarray:
    """Huber's sandwich, which needs no point to be as exact as another; points are taken as independent."""
    part = 1.0 / np.sqrt(1.0 + (residual_mm / f_scale) ** 2)  # of a point's residual, what soft_l1 lets count
    H = np.linalg.inv((J * part[:, None] ** 3).T @ J)
    pulled = J * (part * residual_mm)[:, None]
    return H @ (pulled.T @ pulled) @ H


def _checked(
    points_by_slit: Sequence[Float[np.ndarray, "_ 3"]], projector: Projector
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """All points, and the slit of each."""
    if len(points_by_slit) != len(projector.slits):
        raise ConesNotFound(f"points of {len(points_by_slit)} slits; the rig has {len(projector.slits)}")
    for slit, points in zip(projector.slits, points_by_slit, strict=True):
        if len(points) < MIN_POINTS:
            raise ConesNotFound(f"slit {slit.name}: {len(points)} points; at least {MIN_POINTS} are needed")
        if not np.isfinite(points).all():
            raise ConesNotFound(f"slit {slit.name}: points that are not finite")
    sizes = [len(points) for points in points_by_slit]
    return np.concatenate(list(points_by_slit)), np.repeat(np.arange(len(sizes)), sizes)


def _axis(x: Float[np.ndarray, "terms"], R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The axis that two slopes state, in the camera frame; `R` has the starting axis for its z."""
    return R @ np.array([x[3], x[4], 1.0]) / np.sqrt(1.0 + x[3] ** 2 + x[4] ** 2)


def _apex_terms(x: Float[np.ndarray, "terms"], slits: int) -> Int[np.ndarray, "slits 3"]:
    """Which terms are each slit's apex: the first three for all, or those and three more for each further slit."""
    further = np.maximum(np.arange(slits) - 1, 0) * 3 + FIRST_ANGLE + slits
    first = np.where(np.arange(slits) == 0, 0, further) if x.size > FIRST_ANGLE + slits else np.zeros(slits, dtype=int)
    return first[:, None] + np.arange(3)


def _from_apex(x, xyz, slit, R):
    """Along the axis, across it, and the unit vector across, of the line from the apex to each point."""
    axis = _axis(x, R)
    line = xyz - x[_apex_terms(x, int(slit[-1]) + 1)[slit]]
    along = line @ axis
    outward = line - along[:, None] * axis
    across = np.linalg.norm(outward, axis=1)
    return along, across, outward / np.maximum(across, 1e-12)[:, None]


def _beyond_mm(x, xyz, slit, R):
    """How far each point lies outside its cone, square to it."""
    along, across, _ = _from_apex(x, xyz, slit, R)
    alpha = x[FIRST_ANGLE + slit]
    return across * np.cos(alpha) - along * np.sin(alpha)


def _jacobian(x, xyz, slit, R):
    """How that changes with apex, slopes of the axis, and half angles."""
    along, across, outward = _from_apex(x, xyz, slit, R)
    alpha = x[FIRST_ANGLE + slit]
    sine, cosine = np.sin(alpha), np.cos(alpha)
    J = np.zeros((len(xyz), x.size))
    terms = _apex_terms(x, int(slit[-1]) + 1)[slit]
    np.put_along_axis(J, terms, sine[:, None] * _axis(x, R) - cosine[:, None] * outward, axis=1)
    # the axis turns towards the point: it comes nearer to the axis, and further along it
    turned = -(cosine * along + sine * across)[:, None] * outward
    length2 = 1.0 + x[3] ** 2 + x[4] ** 2
    J[:, TILT] = turned @ R[:, :2] / np.sqrt(length2)
    J[np.arange(len(xyz)), FIRST_ANGLE + slit] = -(across * sine + along * cosine)
    return J


def _concluded(x, R, start: Projector, covariance, beyond_mm) -> ConeFit:
    count = len(start.slits)
    std, angles = np.sqrt(np.diag(covariance)), np.degrees(x[FIRST_ANGLE : FIRST_ANGLE + count])
    terms, own = _apex_terms(x, count), x.size > FIRST_ANGLE + count
    apexes = x[terms]
    slits = tuple(
        Slit(name=slit.name, half_angle_deg=float(angle), apex_mm=tuple(apex.tolist()) if own else None)
        for slit, angle, apex in zip(start.slits, angles, apexes, strict=True)
    )
    middle = tuple(np.mean(apexes, axis=0).tolist()) if own else tuple(apexes[0].tolist())
    changed = {"apex_mm": middle, "axis": tuple(_axis(x, R).tolist()), "slits": slits}
    try:
        projector = start.model_copy(update=changed)
    except ValueError as error:  # slits that cross, or half angles no projector has
        raise ConesNotFound(f"the cones found are no projector's: half angles {np.round(angles, 2)}") from error
    return ConeFit(
        projector,
        tuple(std[terms].max(axis=0).tolist()),
        tuple(np.degrees(std[TILT]).tolist()),
        tuple(np.degrees(std[FIRST_ANGLE : FIRST_ANGLE + count]).tolist()),
        float(np.sqrt(np.mean(beyond_mm**2))),
        beyond_mm.size,
    )
