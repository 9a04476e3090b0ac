"""Places from which no light returned though the wall around them was seen: holes, or floors that lie too deep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from algorithms.large_arrays import pieces
from algorithms.sizing.edges import LOST_MM
from algorithms.sizing.segment import groups_along, reach_of
from algorithms.types import NO_LIGHT, THROUGH, Defect, WallMap
from sensor_model.geometry import wrap_rad
from sensor_model.recording import NominalPipe

LEAST_CELLS = 5  # nearly all are fewer: cells between rings
LEAST_MM = 2.5  # both ways
SURE_MM = 5.0  # both ways: a smaller dark place may be cells that no ring happened to hit, unless
LEAST_EVIDENCE = 30.0  # it is so unlikely (minus the logarithm) by how many cells of its rows are dark within
BESIDE_MM = 10.0  # of it; and
ROUND = 2.0  # it is no longer than so many times its width, for rings that cross leave long ones
FILLED = 0.5  # of its box, as a round hole fills it: rings that cross leave slanted lines between them
WIDEST_RAD = np.pi / 2  # a wider one is a lost stretch of the scan, or the strut's sector
AROUND_MM, AROUND_SEEN = 10.0, 0.8  # so much of the wall before and beyond a dark place must have been seen
LEAST_POINTS = 2  # in such a cell (or, for a small place, in the mean): with one, gaps are those of a few rings
NEAR_MM = 6.0  # a measured defect so near to it is what makes it dark: a shadow begins at the rim, a size at half depth
DIM_SHARE = 0.6  # of the wall's points: a floor that slits light has as many, but for its shadow
DIM_NEAR_MM, DIM_FAR_MM = 8.0, 21.0  # where the wall beside it begins and ends that is compared
THROUGH_STD_MM = 0.025  # of a depth that is the wall's thickness: the bore's own


class Dark(NamedTuple):
    """A dark place on the wall: where it begins, how long and how wide it is, and its middle."""

    start_mm: float
    length_mm: float
    width_mm: float
    theta_rad: float


def with_dark(
    wall: WallMap, scanned: slice, defects: tuple[Defect, ...], pipe: NominalPipe, steepest_light_rad: float
) -> tuple[Defect, ...]:
    """The defects, with what dark places say: some go through the wall, and others are dark places alone.

    Over a dark place longer than any shadow within the wall light must have met a floor, had there been one: the wall
    is gone. A shorter one, with no defect beside it, is told as what it is: no light returned. One beside a defect
    whose floor was seen, or beside what stands inward, is its shadow.
    """
    longest = pipe.wall_thickness_mm / float(np.tan(steepest_light_rad)) + 2 * LOST_MM
    every = list(defects)
    for _, dark in sorted(_places(wall, scanned, pipe), key=itemgetter(0)):
        beside = [k for k, defect in enumerate(every) if _touch(dark, defect, pipe)]
        if any(every[k].inward or every[k].floor_seen for k in beside):
            continue
        gone = dark.length_mm > longest
        if not beside:
            every.append(_alone(dark, gone, pipe))
        elif gone:
            every[beside[0]] = _through(every[beside[0]], dark, pipe)
    return tuple(sorted(every, key=lambda defect: defect.start_mm))


def is_dim(wall: WallMap, columns: Int[np.ndarray, "c"], rows: Int[np.ndarray, "r"], inner_radius_mm: float) -> bool:
    """Whether a box of the map has far fewer points than the wall beside it, on the same rows.

    Then what depth it shows is that of its lips, and of strays: a hole, or a floor that no slit lit, lies between.
    """
    cell, around = wall.cell_arc_mm(inner_radius_mm), wall.theta_rad.size
    reach = np.arange(max(round(DIM_NEAR_MM / cell), 1), max(round(DIM_FAR_MM / cell), 1) + 1)
    beside = wall.count[np.ix_(np.concatenate([columns[0] - reach, columns[-1] + reach]) % around, rows)]
    beside = beside[beside.any(axis=1)]  # the strut's sector tells nothing
    inside = wall.count[np.ix_(columns % around, rows)]
    return bool(beside.size) and bool(inside.mean() < DIM_SHARE * beside.mean())


def _places(wall: WallMap, scanned: slice, pipe: NominalPipe) -> Iterator[tuple[tuple[int, int], Dark]]:
    """Every dark place with wall before, beyond and beside it that was looked at closely, and its group's order."""
    cell_z, cell_arc, around = wall.cell_z_mm, wall.cell_arc_mm(pipe.inner_radius_mm), wall.theta_rad.size
    near = max(round(AROUND_MM / cell_z), 1)
    unseen = (~(wall.count[:, part] > 0) for part in pieces(wall.count))
    touching = reach_of(wall, pipe.inner_radius_mm, 0.0)
    for order, columns, rows in groups_along(unseen, touching, LEAST_CELLS, scanned.start + near):
        first, last = int(rows.min()), int(rows.max())
        center = round(float(np.angle(np.exp(2j * np.pi * columns / around).mean())) / (2 * np.pi) * around)
        turned = (columns - center + around // 2) % around - around // 2
        length, cells = (last - first + 1) * cell_z, int(np.ptp(turned)) + 1
        shorter, longer = sorted((length, cells * cell_arc))
        if shorter < LEAST_MM:
            continue
        if cells * 2 * np.pi / around > WIDEST_RAD or columns.size < FILLED * cells * (last - first + 1):
            continue
        if first - near < scanned.start or last + near >= scanned.stop:
            continue
        box = np.arange(turned.min(), turned.max() + 1) + center
        ends = [wall.count[np.ix_(box % around, np.arange(at, at + near))] for at in (first - near, last + 1)]
        reach = np.arange(1, max(round(BESIDE_MM / cell_arc), 1) + 1)
        beside = wall.count[
            np.ix_(np.concatenate([box[0] - reach, box[-1] + reach]) % around, np.arange(first, last + 1))
        ]
        dark = (np.sum(beside == 0, axis=0) + 0.5) / (len(beside) + 1)
        unlikely = -float(np.log(dark)[rows - first].sum()) >= LEAST_EVIDENCE and longer <= ROUND * shorter
        rim = beside[[0, reach.size]]
        closely = min(np.mean(part >= LEAST_POINTS) for part in (rim, *ends)) >= AROUND_SEEN
        if (shorter >= SURE_MM and closely) or (unlikely and min(part.mean() for part in ends) >= LEAST_POINTS):
            middle = 2 * np.pi * (center + (turned.min() + turned.max()) / 2) / around
            theta = float(np.mod(wall.theta_rad[0] + middle, 2 * np.pi))
            yield order, Dark(float(wall.z_mm[first] - cell_z / 2), length, cells * cell_arc, theta)


def _touch(dark: Dark, defect: Defect, pipe: NominalPipe) -> bool:
    """Whether a defect lies within reach of a dark place."""
    end = min(dark.start_mm + dark.length_mm, defect.end_mm)
    apart_z = max(dark.start_mm, defect.start_mm) - end
    arc = abs(float(wrap_rad(dark.theta_rad - defect.theta_rad))) * pipe.inner_radius_mm
    return apart_z <= NEAR_MM and arc - (dark.width_mm + defect.width_mm) / 2 <= NEAR_MM


def _alone(dark: Dark, gone: bool, pipe: NominalPipe) -> Defect:
    """A dark place with no defect beside it."""
    plain = Defect(
        start_mm=dark.start_mm,
        length_mm=dark.length_mm,
        width_mm=dark.width_mm,
        depth_mm=0.0,
        theta_rad=dark.theta_rad,
        wall_loss_pct=0.0,
        length_std_mm=LOST_MM / 2,
        width_std_mm=LOST_MM / 4,
        depth_std_mm=0.0,
        wall_loss_std_pct=0.0,
        unseen_share=1.0,
        seen_cells=0,
        cut_by_scan_end=False,
        floor_seen=False,
        volume_mm3=0.0,
        feature_class=NO_LIGHT,
        disposition="undecided",
    )
    return _through(plain, dark, pipe) if gone else plain


def _through(defect: Defect, dark: Dark, pipe: NominalPipe) -> Defect:
    """A defect whose dark place shows that the wall is gone: as large as that place, as deep as the wall."""
    return replace(
        defect,
        start_mm=dark.start_mm,
        length_mm=dark.length_mm,
        width_mm=dark.width_mm,
        theta_rad=dark.theta_rad,
        depth_mm=pipe.wall_thickness_mm,
        wall_loss_pct=100.0,
        length_std_mm=LOST_MM / 2,
        width_std_mm=LOST_MM / 4,
        depth_std_mm=THROUGH_STD_MM,
        wall_loss_std_pct=0.0,  # light fell out through it, however thick the wall
        floor_seen=False,
        feature_class=THROUGH,
        disposition="reject",
    )
