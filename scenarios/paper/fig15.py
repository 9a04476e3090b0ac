"""Fig. 15 of the paper: how a depth is found, from the map to the wall's section and the depth over its background."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.paper.one_figure import Part, Row, paint, run_figure
from scenarios.paper.sized_scan import Report, SizedScan
from scenarios.report.canvas import BLACK, BLUE, VERMILION, drawing, to_picture
from scenarios.report.plain_rows import text_table

HALF_ARC_MM, BESIDE_MM, LINE_MM = 45.0, 30.0, 3.0


def words(rows: list[Row]) -> str:
    """The depth for a terminal."""
    columns = {"what": "what", "mm": "mm", "std_mm": "+- (1 sigma)"}
    return text_table(rows, columns, "Fig. 15: the depth of one defect, from its own background")


def make(scan: SizedScan) -> tuple[list[Row], bytes]:
    """Rows and picture.

    Raises:
        RunFailed: when the defect was not found.
    """
    pipe, found = scan.scan.truth.pipe, scan.found
    feature, defect = scan.first()
    true = feature.size(pipe.bore_radius_mm)
    reach = true.length_mm / 2 + BESIDE_MM
    z = feature.distance_mm - reach, feature.distance_mm + reach
    part = Part(found.wall, feature.clock_deg, HALF_ARC_MM, z, pipe.bore_radius_mm)
    radius, depth = part.of(found.wall.radius_mm), part.of(found.deviation_mm)
    beside = np.abs(part.arc_mm) <= LINE_MM
    background = float(np.nanmedian((radius - depth)[beside]))
    rows: list[Row] = [
        {"what": "background B, the undamaged radius there", "mm": background, "std_mm": None},
        {"what": "depth, measured", "mm": defect.depth_mm, "std_mm": defect.depth_std_mm},
        {"what": "depth, true", "mm": true.depth_mm, "std_mm": None},
    ]
    with drawing(4.2, 14.0) as figure:
        left, middle, right = figure.subplots(1, 3)
        shown = paint(left, part, depth, true.depth_mm)
        figure.colorbar(shown, ax=left, label="depth (mm)", fraction=0.04)
        left.set_title("Cylindrical map; hatched: not seen")
        theta = np.radians(feature.clock_deg)
        middle.plot(part.z_mm, pipe.radius(theta, part.z_mm), color=BLACK, label="true wall")
        middle.plot(np.tile(part.z_mm, beside.sum()), radius[beside].ravel(), ".", color=BLUE, ms=3, label="map cells")
        middle.axhline(background, color=VERMILION, linestyle="--", label="background B")
        middle.set_title("Section along the pipe")
        middle.set_ylabel("radius (mm)")
        along = np.tile(part.z_mm, beside.sum())
        right.plot(along, depth[beside].ravel(), ".", color=BLUE, ms=3, label="map cells less B")
        right.axhline(defect.depth_mm, color=VERMILION, label=f"measured {defect.depth_mm:.2f} mm")
        right.axhline(true.depth_mm, color=BLACK, linestyle=":", label=f"true {true.depth_mm:.2f} mm")
        right.set_title("Depth below the background B")
        right.set_ylabel("depth (mm)")
        for axes in (middle, right):
            axes.set_xlabel("distance (mm)")
            axes.legend(loc="center")
            axes.invert_yaxis()
        return rows, to_picture(figure, "", "").file


def run_fig15(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[Row]:
    """Scan and draw."""
    return run_figure("fig15", "paper-robot", [f"sensing.fidelity={fidelity}"], make, seed, out, workers, progress)
