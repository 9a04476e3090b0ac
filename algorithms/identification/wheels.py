"""What the encoders tell of each other: how far each wheel goes for what it counts, which is dead, how they slip."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from algorithms.identification.estimate import BLOCKS, Quantity, Unknown, blocks_of, of_blocks
from algorithms.robust import spread
from sensor_model.recording import Recording

DEAD_SHARE = 0.1  # a wheel that rolls less than this of what the others roll
LEAST_TRAVEL_MM = 20.0
CONSENSUS_S = 0.5
JOLT_SPREADS = 6.0  # a stretch so far from the others holds a slip of that wheel alone


@dataclass(frozen=True)
class WheelFigures:
    """Scales beside the mean of the live wheels (shares; how much further each goes than it counts), and what is dead.

    `disagreement_mm` is the RMS by which the wheels' ways differ in a tenth of a second once scaled.
    """

    scale: tuple[Quantity, ...]
    dead: Bool[np.ndarray, "wheels"]
    disagreement_mm: Quantity


def rolled_mm(recording: Recording) -> Float[np.ndarray, "k wheels"]:
    """The way that each wheel rolled since the start of the log, at every stamp of the encoders."""
    wheels = recording.rig.wheels
    return recording.counts / wheels.counts_per_turn * np.pi * np.array(wheels.diameters_mm)  # Eq. 25


def wheel_figures(rolled_mm: Float[np.ndarray, "k wheels"], step_s: float, count_mm: float) -> WheelFigures:
    """From the way that each wheel rolled at each of its stamps, so many seconds apart, in counts of so many mm."""
    way = np.abs(np.diff(rolled_mm, axis=0)).sum(axis=0)
    dead = way < DEAD_SHARE * np.median(way)
    count = rolled_mm.shape[1]
    if float(np.median(way)) < LEAST_TRAVEL_MM or np.count_nonzero(~dead) < 2:
        words = f"the wheels rolled {np.median(way):.1f} mm; {LEAST_TRAVEL_MM:g} mm by two live wheels are needed"
        return WheelFigures((Unknown(words),) * count, dead, Unknown(words))
    live = rolled_mm[:, ~dead]
    # stretches of equal way, so that a stop is none of them
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(live.mean(axis=1))))])
    edges = np.searchsorted(along, np.linspace(0, along[-1], 2 * BLOCKS + 1)[1:-1])
    edges = np.concatenate([[0], edges, [len(live) - 1]])
    parts = np.array([np.abs(np.diff(live[a : b + 1], axis=0)).sum(axis=0) for a, b in pairwise(edges.tolist())])
    ratio = parts.mean(axis=1, keepdims=True) / parts - 1
    # a stretch begins and ends somewhere within a count
    fine = count_mm / float(np.mean(parts))
    calm = np.abs(ratio - np.median(ratio, axis=0)) <= JOLT_SPREADS * np.maximum([spread(r) for r in ratio.T], fine)
    calm = calm.all(axis=1)  # a wheel that slips shifts the mean for all
    found, scales = iter(ratio[calm].T), np.zeros(count)
    steps = fine * np.sqrt(1 / 6 / max(int(calm.sum()), 1))
    scale: list[Quantity] = []
    for wheel in range(count):
        if dead[wheel]:
            scale.append(Unknown("the wheel stands while the others roll"))
            continue
        quantity = of_blocks(next(found), "the wheels against each other, by stretches of way", float(steps))
        scale.append(quantity)
        scales[wheel] = getattr(quantity, "value", 0.0)
    return WheelFigures(tuple(scale), dead, _disagreement(live * (1 + scales[~dead]), step_s))


def _disagreement(scaled_mm: Float[np.ndarray, "k wheels"], step_s: float) -> Quantity:
    """RMS of how the wheels' ways differ over a tenth of a second, by stretches of time."""
    stride = max(round(0.1 / step_s), 1)
    steps = np.diff(scaled_mm[::stride], axis=0)
    off = steps - steps.mean(axis=1, keepdims=True)
    rms = np.array([np.sqrt(np.mean(off[part] ** 2)) for part in blocks_of(off.shape[0])])
    return of_blocks(rms, "the scaled wheels against their mean, per 0.1 s")


def consensus_mm(
    rolled_mm: Float[np.ndarray, "k wheels"], figures: WheelFigures, step_s: float
) -> Float[np.ndarray, "k"]:
    """The way of the robot: over half a second that of its middle live wheel, scaled, and in between as all went.

    From sample to sample the middle one would not do: wheels that take turns add to it.
    """
    scales = np.array([getattr(one, "value", 0.0) for one in figures.scale])
    live = (rolled_mm * (1 + scales))[:, ~figures.dead]
    stride = max(round(CONSENSUS_S / step_s), 1)
    edges = np.append(np.arange(0, len(live) - 1, stride), len(live) - 1)
    went = np.diff(live[edges], axis=0)
    off = np.median(went, axis=1) - went.mean(axis=1)
    return (
        live.mean(axis=1)
        - live[0].mean()
        + np.interp(np.arange(len(live)), edges, np.concatenate([[0.0], np.cumsum(off)]))
    )
