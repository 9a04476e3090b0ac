"""Which wheels slip in this frame: each set of them is weighed as a hypothesis, and the likeliest is taken."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from sensor_model.settings import Settings

MOST_TOGETHER = 2  # wheels that are taken to slip in one frame for reasons of their own; beyond that, all do
STAYS = 0.9


class VotingSettings(Settings):
    """How rarely one wheel begins to slip in a frame, how rarely all do, and how fast a slipping rim may be.

    All are taken to slip for `all_at_most_s` in a row: so long the accelerometer alone can carry the robot on.
    """

    one_begins: Annotated[float, Field(gt=0, lt=0.5)] = 1e-3
    all_begin: Annotated[float, Field(gt=0, lt=0.5)] = 1e-5
    slip_speed_mm_s: Annotated[float, Field(gt=1)] = 60.0
    all_at_most_s: Annotated[float, Field(gt=0, le=10)] = 1.5


@cache
def hypotheses(wheels: int) -> Bool[np.ndarray, "sets wheels"]:
    """Every set of wheels that may slip at once: none, one, two, or all; the last row: all alike, as one motion."""
    sets = [chosen for k in range(min(MOST_TOGETHER, wheels - 1) + 1) for chosen in combinations(range(wheels), k)]
    table = np.zeros((len(sets) + 2, wheels), dtype=bool)
    for row, chosen in enumerate(sets):
        table[row, list(chosen)] = True
    table[-2:] = True
    return table


def slipping(
    innovation: Float[np.ndarray, "wheels"],
    spread: Float[np.ndarray, "wheels wheels"],
    variance: Float[np.ndarray, "wheels"],
    before: Bool[np.ndarray, "wheels"],
    named: Bool[np.ndarray, "wheels"],
    settings: VotingSettings,
    all_may: bool = True,
) -> Bool[np.ndarray, "wheels"]:
    """The likeliest set of slipping wheels.

    Args:
        innovation: rolling speeds less what the filter expects of them, mm/s.
        spread: covariance of what it expects.
        variance: of each wheel's own noise.
        before: those that slipped in the last frame, which tends to go on.
        named: those under alarm, which slip until the alarm is over.
        settings: how rare slip is.
        all_may: whether all may slip together; not for longer than the accelerometer can bridge.
    """
    sets = hypotheses(innovation.size)
    sets = sets[~(named & ~sets).any(axis=1)]
    own = variance + sets * settings.slip_speed_mm_s**2
    covariance = spread + own[:, None, :] * np.eye(innovation.size)
    covariance[-1] = spread + np.diag(variance) + settings.slip_speed_mm_s**2
    misfit = np.einsum("i,kij,j->k", innovation, np.linalg.inv(covariance), innovation)
    begins = np.where(before, STAYS, settings.one_begins)
    prior = np.log(np.where(sets, begins, 1 - begins)).sum(axis=1)
    # a wheel under alarm explains a jerk that the accelerometer did not foresee: then the others are to be believed
    prior[-2:] = -np.inf if named.any() or not all_may else np.log(STAYS if before.all() else settings.all_begin)
    return sets[np.argmax(prior - 0.5 * (misfit + np.linalg.slogdet(covariance)[1]))]


def outvoted(slips: Bool[np.ndarray, "wheels"], variance: np.ndarray, settings: VotingSettings) -> np.ndarray:
    """The wheels' variances with those of the slipping ones opened so wide that they say next to nothing."""
    return variance + slips * (100 * settings.slip_speed_mm_s) ** 2
