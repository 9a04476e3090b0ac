"""What stands inward of the bore: dents, and rings such as a weld or a joint's bead; no loss of wall."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from algorithms.robust import spread
from algorithms.types import INWARD, INWARD_RING, Defect, WallMap
from sensor_model.recording import NominalPipe

RING_SIGMAS = 6.0
LONGEST_RING_MM = 60.0  # what is longer is a narrower stretch of pipe
HEIGHT_STD_MM = 0.15  # of a ring's crest: what smoothing over three rows takes of one as narrow as a bead
LENGTH_STD_MM = 1.2  # of a ring: in pictures slits are lost on its far side


def as_inward(measured: Defect) -> Defect:
    """A height, measured as a depth is, said as what it is; it takes no wall and has no disposition by wall loss."""
    return replace(
        measured,
        wall_loss_pct=0.0,
        floor_seen=True,  # light comes from behind: the near side of what stands inward is lit
        volume_mm3=0.0,
        feature_class=INWARD,
        disposition="",
    )


def rings(
    wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], pipe: NominalPipe, least_mm: float
) -> Iterator[Defect]:
    """Every ring that stands inward all around, by the median of each row.

    Cell by cell it would be lost: where all of a row stands inward, its own spread passes for noise.
    """
    seen = np.isfinite(deviation_mm)
    rows = np.flatnonzero(seen.mean(axis=0) >= 0.5)
    if rows.size < 2:
        return
    height = -np.nanmedian(deviation_mm[:, rows], axis=0)
    threshold = max(least_mm, RING_SIGMAS * spread(height))
    over = np.flatnonzero(height > threshold)
    for run in np.split(over, np.flatnonzero(np.diff(over) > 1) + 1):
        if not run.size or run[0] == 0 or run[-1] == rows.size - 1:
            continue
        crest = float(height[run].max())
        begin, end = _half(height, run, crest / 2, -1), _half(height, run, crest / 2, 1)
        begin_mm, end_mm = (float(np.interp(at, np.arange(rows.size), wall.z_mm[rows])) for at in (begin, end))
        if end_mm - begin_mm > LONGEST_RING_MM:
            continue
        yield _ring(seen[:, rows[run]], begin_mm, end_mm - begin_mm, crest, pipe)


def _half(height: Float[np.ndarray, "rows"], run: np.ndarray, level: float, step: int) -> float:
    """Where the height crosses a level on one side of a run, between rows."""
    inside = run[height[run] >= level]
    at = int(inside[0] if step < 0 else inside[-1])
    beside = min(max(at + step, 0), height.size - 1)
    low, high = height[beside], height[at]
    return at + step * float(np.clip((high - level) / (high - low), 0.0, 1.0) if high > low else 0.5)


def _ring(seen: np.ndarray, start_mm: float, length_mm: float, height_mm: float, pipe: NominalPipe) -> Defect:
    """A ring: as wide as the bore goes round, its middle at 12 o'clock by custom."""
    return Defect(
        start_mm=start_mm,
        length_mm=length_mm,
        width_mm=2 * np.pi * pipe.inner_radius_mm,
        depth_mm=height_mm,
        theta_rad=0.0,
        wall_loss_pct=0.0,
        length_std_mm=LENGTH_STD_MM,
        width_std_mm=0.0,
        depth_std_mm=HEIGHT_STD_MM,
        unseen_share=float(1 - seen.mean()),
        seen_cells=int(seen.sum()),
        cut_by_scan_end=False,
        volume_mm3=0.0,
        feature_class=INWARD_RING,
    )
