"""What the figures of sizes share: a scan, a folder, and the unrolled wall around a defect."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from algorithms.types import WallMap
from scenarios.load import load_scenario
from scenarios.paper.folder import paper_folder
from scenarios.paper.sized_scan import Report, SizedScan, sized_scan
from scenarios.report.canvas import hatch_unseen
from scenarios.report.plain_rows import write_rows
from sensor_model.geometry import wrap_rad

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

Row = dict[str, Any]
COLOR_MAP = "cividis"


def run_figure(
    name: str,
    base: str,
    changes: list[str],
    make: Callable[[SizedScan], tuple[list[Row], bytes]],
    seed: int | None,
    out: Path,
    workers: int,
    progress: Report,
) -> list[Row]:
    """Scan a scenario, and write a figure's rows and picture into a folder.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when the scan fails, or shows nothing to draw.
    """
    scenario = load_scenario(base, changes, seed)
    with paper_folder(name, scenario, out) as folder:
        rows, picture = make(sized_scan(scenario, workers, progress))
        write_rows(rows, folder / name)
        (folder / f"{name}.png").write_bytes(picture)
    return rows


class Part:
    """A part of the unrolled wall: cells around a clock position, between two distances."""

    def __init__(self, wall: WallMap, clock_deg: float, half_arc_mm: float, z_mm: tuple[float, float], bore_mm: float):
        arc = np.asarray(wrap_rad(wall.theta_rad - np.radians(clock_deg))) * bore_mm
        around = np.flatnonzero(np.abs(arc) <= half_arc_mm)
        self.around = around[np.argsort(arc[around])]
        self.along = np.flatnonzero((wall.z_mm >= z_mm[0]) & (wall.z_mm <= z_mm[1]))
        self.arc_mm, self.z_mm = arc[self.around], wall.z_mm[self.along]

    def of(self, values: np.ndarray) -> np.ndarray:
        """A map, cut to the part."""
        return values[np.ix_(self.around, self.along)]


def paint(
    axes: Axes, part: Part, depth_mm: Float[np.ndarray, "around along"], high_mm: float, colors: str = COLOR_MAP
) -> QuadMesh:
    """A part of the wall by its depth; what was not seen is hatched."""
    axes.grid(visible=False)
    hatch_unseen(axes)
    shown = axes.pcolormesh(
        part.z_mm, part.arc_mm, np.ma.masked_invalid(depth_mm), cmap=colors, vmin=0, vmax=high_mm, shading="nearest"
    )
    axes.set_aspect("equal")
    axes.set_xlabel("distance (mm)")
    axes.set_ylabel("arc, clockwise (mm)")
    return shown
