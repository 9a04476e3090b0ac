"""Fusing two alignments of one frame: their information is added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numba import njit
from scipy.spatial.transform import Rotation

from algorithms.types import Alignment
from sensor_model.geometry import transform


def fuse(prior: Alignment, measured: Alignment) -> Alignment:
    """The pose that best agrees with both, each by its information; the measured one's evidence is kept.

    To first order about the measured pose, which is exact where each knows what the other does not.
    """
    total = prior.information + measured.information
    scaled = _scaled(total)
    gap = prior.information @ _difference(prior.T_pipe_camera, measured.T_pipe_camera) / SCALE
    if not np.abs(gap).max() > 1e-12 * np.abs(scaled).max():  # they agree where the prior knows
        return replace(measured, information=total)
    # directions that neither knows stay as measured: the pseudo-inverse moves nothing along them
    move = np.linalg.pinv(scaled, hermitian=True, rcond=1e-15) @ gap / SCALE
    R = Rotation.from_rotvec(move[3:]).as_matrix() @ measured.T_pipe_camera[:3, :3]
    return replace(measured, T_pipe_camera=transform(R, measured.T_pipe_camera[:3, 3] + move[:3]), information=total)


SCALE = np.array([1.0, 1.0, 1.0, 100.0, 100.0, 100.0])  # a radian moves the wall by about 100 mm


SCALES = np.outer(SCALE, SCALE)


def _scaled(information: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    return information / SCALES


@njit(cache=True)
def _difference(T_a, T_b):
    """How b must move (mm, then rad about its own centre, pipe axes) to become a."""
    R = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R[i, j] += T_a[i, k] * T_b[j, k]
    out = np.empty(6)
    for k in range(3):
        out[k] = T_a[k, 3] - T_b[k, 3]
        out[3 + k] = 0.5 * (R[(k + 2) % 3, (k + 1) % 3] - R[(k + 1) % 3, (k + 2) % 3])
    sine, cosine = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if sine > 1e-12:
        out[3:] *= np.arctan2(sine, cosine) / sine
    elif cosine < 0.0:  # half a turn: the axis is what R leaves where it is
        k = int(np.argmax(np.diag(R)))
        for i in range(3):
            out[3 + i] = 0.5 * np.pi * (R[i, k] + (1.0 if i == k else 0.0)) / np.sqrt(0.5 * (R[k, k] + 1.0))
    return out


def covariance(information: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of an alignment; infinite variance where there is no information."""
    values, vectors = np.linalg.eigh(_scaled(information))
    known = values > 1e-12 * max(values[-1], 1e-300)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T / SCALES
    blind = np.flatnonzero((np.abs(vectors[:, ~known]) > 1e-6).any(axis=1))
    inverse[blind, blind] = np.inf
    return inverse
