"""The pipe's diameter and how oval it is, from the wall map of a scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.identification.estimate import BLOCKS, Estimate, Quantity, Unknown, of_blocks, t_factor
from algorithms.robust import spread
from algorithms.types import WallMap

LEAST_COLUMNS, LEAST_SEEN = 8, 0.5
TRIMS, CUT = 4, 3.0
INDEPENDENT_PLACES = 100  # of a slide's print around one slit


class Bore(NamedTuple):
    """Inner diameter (mm), ovality (largest less smallest diameter over the mean, %), and where it is widest (rad)."""

    diameter_mm: Quantity
    ovality_pct: Quantity
    widest_rad: Quantity


def bore(wall: WallMap, radius_mm: Float[np.ndarray, "registered"], rough_mm: float, slits: int) -> Bore:
    """The radius by the frames' own cylinders; each stretch of the map fitted with a circle, its shift, and an oval.

    Args:
        wall: the map.
        radius_mm: of the frames.
        rough_mm: how far a frame's points scatter about their cylinder; a fixed pattern of the slide shifts all alike.
        slits: by which they were seen.
    """
    scanned = wall.scanned()
    columns = np.arange(wall.z_mm.size)[scanned]
    if columns.size < LEAST_COLUMNS:
        return Bore(
            *(Unknown(f"{columns.size} columns of the wall map were seen well; {LEAST_COLUMNS} are needed"),) * 3
        )
    fits = np.array([_oval(wall, part) for part in np.array_split(columns, BLOCKS)])
    fits = fits[np.isfinite(fits).all(axis=1)]
    # a tenth of the print's scatter is left by the mean over all places
    shared = rough_mm / np.sqrt(slits * INDEPENDENT_PLACES)
    parts = np.array([part.mean() for part in np.array_split(radius_mm, BLOCKS) if part.size])
    radius = of_blocks(parts, f"the frames' cylinders in {BLOCKS} stretches; the scale is the rig's", shared)
    if isinstance(radius, Unknown):
        return Bore(radius, radius, radius)
    mean, n = fits[:, 3:].mean(axis=0), len(fits)
    own = fits[:, 3:].std(axis=0, ddof=1).max() / np.sqrt(n)
    half = t_factor(n - 1) * float(np.hypot(own, np.sqrt(2) * shared))
    size = float(np.hypot(*mean))
    pct = 200 / radius.value
    words = f"twice around the bore, wall map in {BLOCKS} stretches"
    ovality = Estimate(pct * size, pct * max(size - half, 0.0), pct * (size + half), n, words)
    if size < half:
        return Bore(radius.scaled(2.0), ovality, Unknown("the bore is not seen to be oval"))
    turn, off = float(np.arctan2(mean[1], mean[0]) / 2 % np.pi), float(np.arcsin(half / size) / 2)
    return Bore(radius.scaled(2.0), ovality, Estimate(turn, turn - off, turn + off, n, words))


def _oval(wall: WallMap, columns: np.ndarray) -> Float[np.ndarray, "5"]:
    """Radius, shift (cosine, sine) and oval (cosine, sine of twice the angle) of a stretch, defects cut off."""
    known = wall.count[:, columns] > 0
    radius = np.where(known, wall.radius_mm[:, columns], np.nan)
    seen = known.mean(axis=1) >= LEAST_SEEN
    if np.count_nonzero(seen) < wall.theta_rad.size / 2:
        return np.full(5, np.nan)
    profile, theta = np.nanmedian(radius[seen], axis=1), wall.theta_rad[seen]
    A = np.column_stack([np.ones(theta.size), *(f(k * theta) for k in (1, 2) for f in (np.cos, np.sin))])
    kept = np.abs(profile - np.median(profile)) < max(5 * spread(profile), 0.1)
    for _ in range(TRIMS):
        fit = np.linalg.lstsq(A[kept], profile[kept], rcond=None)[0]
        off = profile - A @ fit
        kept = np.abs(off) < CUT * max(spread(off[kept]), 1e-3)
    return fit
