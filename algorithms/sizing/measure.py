"""Defects from the wall map: each group of cells beyond the threshold is sized at half its own depth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import sqrt
from operator import itemgetter
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field

from algorithms.large_arrays import pieces
from algorithms.sizing.background import RowNoise, noise_mm
from algorithms.sizing.dark import is_dim, with_dark
from algorithms.sizing.depth import floor_of
from algorithms.sizing.disposition import disposition
from algorithms.sizing.edges import LOST_MM
from algorithms.sizing.inward import as_inward
from algorithms.sizing.outline import outline_of
from algorithms.sizing.segment import groups_along, reach_of
from algorithms.sizing.thresholds import THRESHOLDS, ThresholdSettings, threshold_mm
from algorithms.trust.feature_class import CLASSES, feature_class
from algorithms.types import Defect, WallMap
from sensor_model.recording import NominalPipe
from sensor_model.settings import Settings

ONCE_SHARE = 0.5  # of the usual number of points
FIRM_CELLS = 36  # of a defect: with fewer left all of them are taken
BLUNT = 1.5  # times the usual standard deviation of points: a cell that the innermost slits alone have seen
JOIN_SHARE = 0.5  # of the threshold: what is so deep between groups of cells beyond it makes them one
AROUND_SHARE = 0.95  # of the lines seen: crossed on so many, a groove goes around the pipe
TRAVEL_STD_SHARE = 0.003  # of a length: what wheels that slip or fall into the defect leave open of the travel


class SizingSettings(Settings):
    """Threshold, the gap over which cells are joined, the smallest defect that is called, and the user's limit.

    The smallest size is that of the cells beyond the threshold, not of what half of the depth leaves of them. Groups of
    cells nearer to each other than `join_mm` are one defect, which is sized at half its deepest part's depth: of a
    shallower part only what is deeper than that counts.
    """

    threshold: ThresholdSettings = ThresholdSettings()
    join_mm: Annotated[float, Field(ge=0, le=50)] = 3.0
    min_length_mm: Annotated[float, Field(ge=0)] = 1.0
    min_width_mm: Annotated[float, Field(ge=0)] = 1.0
    min_cells: Annotated[int, Field(ge=1)] = 10
    limit_pct: Annotated[
        float, Field(gt=0, le=100, description="Wall loss beyond which a defect's disposition is not acceptable.")
    ] = 10.0


class Window(NamedTuple):
    """A part of the map around one defect, turned so that it never crosses the seam."""

    deviation_mm: Float[np.ndarray, "around along"]
    noise_mm: Float[np.ndarray, "around along"]
    sigma_mm: Float[np.ndarray, "around along"]
    points: Int[np.ndarray, "around along"]
    inside: Bool[np.ndarray, "around along"]
    first_column: int
    first_row: int


class Called(NamedTuple):
    """What is called a defect: deviation (turned about, for what stands inward), noise by rows, and the threshold."""

    deviation_mm: Float[np.ndarray, "around along"]
    sign: float
    noise: RowNoise
    least_mm: float


def measure_defects(
    wall: WallMap,
    deviation_mm: Float[np.ndarray, "around along"],
    noise: RowNoise,
    pipe: NominalPipe,
    steepest_light_rad: float,
    settings: SizingSettings,
) -> tuple[Defect, ...]:
    """Every defect deeper than the threshold, and all that stands inward or returned no light, in order of distance.

    `steepest_light_rad` is the widest half angle. The map is gone over piece by piece, with what lies across their
    ends carried along, so that all comes out as if it had been looked at whole.
    """
    scanned = wall.scanned()
    parts = partial(_parts, wall, Called(deviation_mm, 1.0, noise, 0.0))
    least_mm = THRESHOLDS[settings.threshold.rule](parts, settings.threshold)

    def beyond(sign: float) -> list[Defect]:
        called = Called(deviation_mm, sign, noise, least_mm)
        windows = _windows(wall, called, pipe, steepest_light_rad, settings)
        found = [
            (order, measure_one(wall, scanned, window, pipe, steepest_light_rad, settings.limit_pct))
            for order, window in windows
        ]
        return [defect for _, defect in sorted(found, key=itemgetter(0))]

    inward = (as_inward(height, pipe) for height in beyond(-1.0))
    return with_dark(wall, scanned, (*beyond(1.0), *inward), pipe, steepest_light_rad)


def _parts(wall: WallMap, called: Called) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Deviation and noise of the map, piece by piece."""
    for part in pieces(called.deviation_mm, wall.sigma_mm, wall.count):
        yield called.sign * called.deviation_mm[:, part], noise_mm(called.noise, wall.sigma_mm[:, part], part)


def _windows(
    wall: WallMap, called: Called, pipe: NominalPipe, steepest_light_rad: float, settings: SizingSettings
) -> Iterator[tuple[tuple[int, int], Window]]:
    """A window on every group of cells beyond the threshold that is large enough, and the group's order."""

    def threshold(noise: np.ndarray) -> np.ndarray:
        return threshold_mm(noise, called.least_mm, settings.threshold)

    near = (deviation > JOIN_SHARE * threshold(noise) for deviation, noise in _parts(wall, called))
    reach = reach_of(wall, pipe.inner_radius_mm, settings.join_mm)
    deepest = pipe.wall_thickness_mm / np.tan(steepest_light_rad) + LOST_MM  # as far as a shadow can reach
    for order, columns, rows in groups_along(near, reach, settings.min_cells):
        noise = noise_mm(called.noise, wall.sigma_mm[columns, rows], rows)
        deep = called.sign * called.deviation_mm[columns, rows] > threshold(noise)
        if np.count_nonzero(deep) < settings.min_cells:
            continue
        window = _window(wall, called, columns[deep], rows[deep], deepest, pipe.inner_radius_mm)
        length, width = np.ptp(np.nonzero(window.inside), axis=1)[::-1] + 1
        width_mm = width * wall.cell_arc_mm(pipe.inner_radius_mm)
        if length * wall.cell_z_mm >= settings.min_length_mm and width_mm >= settings.min_width_mm:
            yield order, window


def _window(
    wall: WallMap,
    called: Called,
    columns: Int[np.ndarray, "n"],
    rows: Int[np.ndarray, "n"],
    margin_mm: float,
    inner_radius_mm: float,
) -> Window:
    """The cells of one group with so much wall on every side."""
    around, along = wall.radius_mm.shape
    middle = int(np.round(np.angle(np.exp(2j * np.pi * columns / around).mean()) / (2 * np.pi) * around))
    turned = (columns - middle + around // 2) % around - around // 2
    beside = int(np.ceil(margin_mm / wall.cell_arc_mm(inner_radius_mm)))
    first = max(int(turned.min()) - beside, -(around // 2))
    last = min(int(turned.max()) + beside, first + around - 1)
    ahead = int(np.ceil(margin_mm / wall.cell_z_mm))
    begin, end = max(int(rows.min()) - ahead, 0), min(int(rows.max()) + ahead + 1, along)
    taken = np.arange(middle + first, middle + last + 1) % around
    deviation, sigma = called.sign * called.deviation_mm[taken, begin:end], wall.sigma_mm[taken, begin:end]
    noise = noise_mm(called.noise, sigma, slice(begin, end))
    inside = np.zeros(deviation.shape, dtype=bool)
    inside[turned - first, rows - begin] = True
    return Window(deviation, noise, sigma, wall.count[taken, begin:end], inside, middle + first, begin)


def _firm(window: Window) -> Bool[np.ndarray, "around along"]:
    """The defect's cells without those that hardly any point saw, as it is with a slit astray; all, if few are left."""
    firm = window.inside & (window.points > ONCE_SHARE * np.median(window.points[window.points > 0]))
    return firm if np.count_nonzero(firm) >= max(FIRM_CELLS, 0.5 * np.count_nonzero(window.inside)) else window.inside


def measure_one(
    wall: WallMap, scanned: slice, window: Window, pipe: NominalPipe, steepest_light_rad: float, limit_pct: float
) -> Defect:
    """Size one defect: depth over the background, then both extents at half of that depth."""
    deviation, inside = window.deviation_mm, window.inside
    cell_z, cell_arc = wall.cell_z_mm, wall.cell_arc_mm(pipe.inner_radius_mm)
    blunt = window.sigma_mm > BLUNT * np.nanmedian(window.sigma_mm)
    firm = _firm(window)
    for lit in (True, False):
        depth = floor_of(deviation, inside, firm, blunt, window.noise_mm, (cell_z, cell_arc), lit)
        axial, arc, floor = outline_of(deviation, inside, blunt, depth, (cell_z, cell_arc), steepest_light_rad)
        columns, rows = np.flatnonzero(floor.any(axis=1)), np.flatnonzero(floor.any(axis=0))
        whole = np.arange(columns[0], columns[-1] + 1), np.arange(rows[0], rows[-1] + 1)
        shift = window.first_column, window.first_row
        if not depth.seen or not is_dim(wall, whole[0] + shift[0], whole[1] + shift[1], pipe.inner_radius_mm):
            break
    box = deviation[np.ix_(*whole)]
    turn = (window.first_column + (arc.start_mm + arc.end_mm) / 2 / cell_arc) * 2 * np.pi / wall.theta_rad.size
    # a sliver between unseen wall may come out shorter than the cells it is made of
    length, width = max(axial.end_mm - axial.start_mm, cell_z), max(arc.end_mm - arc.start_mm, cell_arc)
    width_std = arc.std_mm
    crossed = columns.size
    looked_at = int((wall.count[:, window.first_row + rows] > 0).any(axis=1).sum())
    if crossed >= max(AROUND_SHARE * looked_at, wall.theta_rad.size / 2):
        # as wide as the bore goes round, its middle at 12 o'clock by custom; what was not seen of it may be wall
        width, turn = 2 * np.pi * pipe.inner_radius_mm, -float(wall.theta_rad[0])
        width_std = 0.5 * (wall.theta_rad.size - crossed) * cell_arc
    loss = 100 * depth.depth_mm / pipe.wall_thickness_mm
    loss_std = float(np.hypot(100 * depth.std_mm, loss * _wall_std_mm(pipe)) / pipe.wall_thickness_mm)
    first, last = window.first_row + rows[0], window.first_row + rows[-1]
    return Defect(
        start_mm=float(wall.z_mm[window.first_row] + axial.start_mm),
        length_mm=length,
        width_mm=width,
        depth_mm=depth.depth_mm,
        theta_rad=float(np.mod(wall.theta_rad[0] + turn, 2 * np.pi)),
        wall_loss_pct=loss,
        length_std_mm=float(np.hypot(axial.std_mm, TRAVEL_STD_SHARE * length)),
        width_std_mm=width_std,
        depth_std_mm=depth.std_mm,
        wall_loss_std_pct=loss_std,
        unseen_share=float(np.mean(~np.isfinite(box))),
        seen_cells=int(inside.sum()),
        cut_by_scan_end=bool(first <= scanned.start or last >= scanned.stop - 1),
        floor_seen=depth.seen,
        volume_mm3=_volume_mm3(deviation[inside], pipe.inner_radius_mm, cell_z * cell_arc),
        feature_class=CLASSES[int(feature_class(np.array([length]), np.array([width]), pipe.wall_thickness_mm)[0])],
        disposition=disposition(loss, loss_std, depth.seen, limit_pct),
    )


def _wall_std_mm(pipe: NominalPipe) -> float:
    """Standard deviation of a thickness that lies anywhere within its tolerance (JCGM 100, 4.3.7)."""
    return pipe.wall_thickness_mm * pipe.wall_tolerance_pct / 100 / sqrt(12)


def _volume_mm3(depths: Float[np.ndarray, "n"], inner_radius_mm: float, cell_mm2: float) -> float:
    """What is missing over the cells that were seen; a cell widens as the radius grows."""
    return float(np.sum(depths * (1 + depths / (2 * inner_radius_mm))) * cell_mm2)
