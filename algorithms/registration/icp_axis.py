"""Registration by ICP with the pipe's axis as a constraint: it may only move along the axis and turn about it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from algorithms.registration import cylinder
from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.fusion import fuse
from algorithms.registration.icp import IcpSettings, begin, grow, is_first, iterate, own_alignment
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import inverse

__all__ = ["IcpAxisSettings", "align", "begin", "grow"]

ALONG = [2, 5]  # z and roll, in the order of `Alignment.information`


class IcpAxisSettings(IcpSettings):
    """The ICP's settings; the first frame can only be placed by the cylinder."""

    kind: Literal["icp-axis"] = "icp-axis"  # type: ignore[assignment]
    start: Literal["cylinder"] = "cylinder"


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: IcpAxisSettings) -> Alignment:
    """Centre and tilt from the cylinder fit, z and roll from the wall seen so far.

    The other way, all six from the ICP with a pull towards the nominal cylinder, was not taken: centre and tilt would
    inherit the cloud's errors, and a wrong nominal radius would pull to the side on which the strut hides the wall.
    """
    n = points.sigma_mm.size
    across = cylinder.align(points, wall, replace(prior, information=np.zeros((6, 6))), CylinderSettings())
    if not across.converged:
        return failed(prior, n, across.reason)
    if is_first(wall.seen, points, prior, settings.correspondence_mm):
        return fuse(prior, across)
    settled = iterate(wall.seen, points, across.T_pipe_camera, settings, ALONG)
    if settled.reason:
        return failed(prior, n, settled.reason)
    T_pipe_camera = settled.T_pipe_camera
    along = own_alignment(wall.seen, points, T_pipe_camera, settings)
    if not along.converged:
        return failed(prior, n, along.reason)
    information = _turned(across.information, T_pipe_camera @ inverse(across.T_pipe_camera)) + _along_only(along)
    return fuse(prior, replace(across, T_pipe_camera=T_pipe_camera, information=information))


def _turned(information: Float[np.ndarray, "6 6"], T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6 6"]:
    """The information of a pose that was turned with all it was seen by."""
    R = block_diag(T[:3, :3], T[:3, :3])
    return R @ information @ R.T


def _along_only(own: Alignment) -> Float[np.ndarray, "6 6"]:
    """What an alignment claims of moving along the pipe's axis and turning about it, all else held."""
    x, y = own.T_pipe_camera[:2, 3]
    motions = np.array([[0.0, 0, 1, 0, 0, 0], [-y, x, 0, 0, 0, 1]])  # turning about the axis swings the camera
    information = np.zeros((6, 6))
    information[np.ix_(ALONG, ALONG)] = motions @ own.information @ motions.T
    return information
