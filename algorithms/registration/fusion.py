"""Fusing two alignments of one frame: their information is added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from algorithms.types import Alignment
from sensor_model.geometry import transform


def fuse(prior: Alignment, measured: Alignment) -> Alignment:
    """The pose that best agrees with both, each by its information; the measured one's evidence is kept.

    To first order about the measured pose, which is exact where each knows what the other does not.
    """
    total = prior.information + measured.information
    gap = prior.information @ _difference(prior.T_pipe_camera, measured.T_pipe_camera)
    if not np.abs(gap / SCALE).max() > 1e-12 * np.abs(_scaled(total)).max():  # they agree where the prior knows
        return replace(measured, information=total)
    # directions that neither knows stay as measured: the pseudo-inverse moves nothing along them
    move = np.linalg.pinv(_scaled(total), hermitian=True, rcond=1e-15) @ (gap / SCALE) / SCALE
    R = Rotation.from_rotvec(move[3:]).as_matrix() @ measured.T_pipe_camera[:3, :3]
    return replace(measured, T_pipe_camera=transform(R, measured.T_pipe_camera[:3, 3] + move[:3]), information=total)


SCALE = np.array([1.0, 1.0, 1.0, 100.0, 100.0, 100.0])  # a radian moves the wall by about 100 mm


def _scaled(information: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    return information / np.outer(SCALE, SCALE)


def _difference(T_a: Float[np.ndarray, "4 4"], T_b: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6"]:
    """How b must move (mm, then rad about its own centre, pipe axes) to become a."""
    turn = Rotation.from_matrix(T_a[:3, :3] @ T_b[:3, :3].T).as_rotvec()
    return np.concatenate([T_a[:3, 3] - T_b[:3, 3], turn])


def covariance(information: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of an alignment; infinite variance where there is no information."""
    values, vectors = np.linalg.eigh(_scaled(information))
    known = values > 1e-12 * max(values[-1], 1e-300)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T / np.outer(SCALE, SCALE)
    blind = np.flatnonzero((np.abs(vectors[:, ~known]) > 1e-6).any(axis=1))
    inverse[blind, blind] = np.inf
    return inverse
