"""The way back over a filtered log (Rauch, Tung, Striebel): each frame's state by all that came before and after."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Past(NamedTuple):
    """One frame as the filter left it, and the step to the next; a state may grow or shrink on the way."""

    x: Float[np.ndarray, "n"]
    P: Float[np.ndarray, "n n"]
    F: Float[np.ndarray, "m n"]
    x_predicted: Float[np.ndarray, "m"]
    P_predicted: Float[np.ndarray, "m m"]


def smoothed(
    past: list[Past], x: Float[np.ndarray, "n"], P: Float[np.ndarray, "n n"], keep: int
) -> tuple[Float[np.ndarray, "frames keep"], Float[np.ndarray, "frames keep keep"]]:
    """The first `keep` states of every frame and their covariances, with what was learnt later.

    Written out rather than filterpy's, whose states are all of one length.
    """
    states, covariances = [x[:keep]], [P[:keep, :keep]]
    for one in reversed(past):
        # the gain P F^T P_predicted^-1; scaled, since mm and rad lie far apart
        scale = 1 / np.sqrt(np.diag(one.P_predicted).clip(1e-300))
        inverse = np.linalg.pinv(one.P_predicted * np.outer(scale, scale), rcond=1e-13, hermitian=True)
        gain = one.P @ one.F.T @ (inverse * np.outer(scale, scale))
        n = one.x_predicted.size  # what a frame adds to its state stands behind what was predicted
        x = one.x + gain @ (x[:n] - one.x_predicted)
        P = one.P + gain @ (P[:n, :n] - one.P_predicted) @ gain.T
        states.append(x[:keep])
        covariances.append(P[:keep, :keep])
    return np.array(states[::-1]), np.array(covariances[::-1])
