"""How long and how wide a defect is at half of its depth, and what that depth leaves open of either."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter

from algorithms.sizing.depth import LARGE_CELLS, Floor
from algorithms.sizing.edges import Extent, edges_of, extent_of

OPEN_MM = 0.05  # a depth known better moves no edge
CONE_OPEN_MM = 1.0  # of a cone's length: half of it lies in its own shadow, and few lines cross it near its middle
PARTWAY_SHARE = 0.9  # of the level: so near to it a place is neither wall nor floor
NEAR_CELLS = 7  # around and along


class Outline(NamedTuple):
    """Both extents of a defect, and its cells deeper than the level at which they were taken."""

    axial: Extent
    arc: Extent
    floor: Bool[np.ndarray, "around along"]


def outline_of(
    deviation: Float[np.ndarray, "around along"],
    inside: Bool[np.ndarray, "around along"],
    blunt: Bool[np.ndarray, "around along"],
    depth: Floor,
    cell_mm: tuple[float, float],
    steepest_light_rad: float,
) -> Outline:
    """The outline at half of a depth; cells are so long and so wide; `blunt` are those the innermost slits alone saw.

    A depth that is open moves the level, and on sides that slope the edges with it: by how much, a second outline says.
    """
    most = 0.5 * float(deviation[inside].max())
    level = 0.5 * depth.depth_mm
    if level >= 2 * most:  # of single spikes smoothing is thought to have taken most: none is as high as half of that
        level = most
    # along the pipe the innermost slits are several cells wide, and blur a rim into a slope: the others tell its place
    partway = np.abs(deviation - level) < PARTWAY_SHARE * level
    sharp = np.where(partway & (blunt | _mostly(blunt, partway)), np.nan, deviation)
    outline = _at(deviation, sharp, inside, level, cell_mm, steepest_light_rad)
    open_mm = float(np.hypot(outline.axial.std_mm, CONE_OPEN_MM * depth.cone))
    outline = outline._replace(axial=outline.axial._replace(std_mm=open_mm))
    higher = level + 0.5 * depth.std_mm
    if depth.std_mm < OPEN_MM or higher >= 2 * most:
        return outline
    other = _at(deviation, sharp, inside, higher, cell_mm, steepest_light_rad)
    return outline._replace(axial=_opened(outline.axial, other.axial), arc=_opened(outline.arc, other.arc))


def _mostly(blunt: Bool[np.ndarray, "around along"], of: Bool[np.ndarray, "around along"]) -> np.ndarray:
    """Where most of these cells nearby are blunt: among those one that the second slit shows, too, is as false."""
    near = [uniform_filter(cells.astype(np.float32), NEAR_CELLS, mode="constant") for cells in (blunt & of, of)]
    return near[0] > 0.5 * near[1]


def _at(
    deviation: np.ndarray,
    sharp: np.ndarray,
    inside: np.ndarray,
    level: float,
    cell_mm: tuple[float, float],
    steepest_light_rad: float,
) -> Outline:
    floor, (length, width) = inside & (deviation > level), cell_mm
    seen = sharp if np.count_nonzero(floor & (sharp > level)) >= LARGE_CELLS else deviation
    shadow = 1 / float(np.tan(steepest_light_rad))
    axial = extent_of(edges_of(seen, floor & (seen > level), level, length, shadow), length)
    return Outline(axial, extent_of(edges_of(deviation.T, floor.T, level, width), width), floor)


def _opened(extent: Extent, other: Extent) -> Extent:
    moved = (extent.end_mm - extent.start_mm) - (other.end_mm - other.start_mm)
    return extent._replace(std_mm=float(np.hypot(extent.std_mm, moved)))
