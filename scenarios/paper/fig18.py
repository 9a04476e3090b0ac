"""Fig. 18 of the paper: scratches of different shape and depth, true beside measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.paper.one_figure import Part, Row, paint, run_figure
from scenarios.paper.sized_scan import Report, SizedScan
from scenarios.report.canvas import drawing, to_picture
from scenarios.report.plain_rows import text_table

BESIDE_MM = 12.0
COLUMNS = {
    "scratch": "scratch",
    "length_mm": "length mm",
    "found_length_mm": "measured",
    "width_mm": "width mm",
    "found_width_mm": "measured",
    "depth_mm": "depth mm",
    "found_depth_mm": "measured",
    "disposition": "disposition",
}


def words(rows: list[Row]) -> str:
    """The sizes for a terminal."""
    return text_table(rows, COLUMNS, "Fig. 18: scratches, sized blind on a map of 0.25 degree cells")


def make(scan: SizedScan) -> tuple[list[Row], bytes]:
    """Rows and picture; a scratch that was missed has no measured sizes."""
    pipe, found = scan.scan.truth.pipe, scan.found
    pairs = {feature.distance_mm: defect for feature, defect in scan.pairs()}
    rows: list[Row] = []
    deepest = max(feature.size(pipe.bore_radius_mm).depth_mm for feature in pipe.features)
    with drawing(7.6, 13.0) as figure:
        grid = figure.subplots(2, len(pipe.features), squeeze=False)
        for k, feature in enumerate(pipe.features):
            true, defect = feature.size(pipe.bore_radius_mm), pairs.get(feature.distance_mm)
            row: Row = {"scratch": k + 1, **true._asdict()}
            if defect is not None:
                row |= {f"found_{name}": getattr(defect, name) for name in ("length_mm", "width_mm", "depth_mm")}
            rows.append(row | {"disposition": defect.disposition if defect else "missed"})
            reach = max(true.length_mm, true.width_mm) / 2 + BESIDE_MM
            z = feature.distance_mm - reach, feature.distance_mm + reach
            part = Part(found.wall, feature.clock_deg, reach, z, pipe.bore_radius_mm)
            theta = found.wall.theta_rad[part.around]
            depth = pipe.radius(theta[:, None], part.z_mm[None, :]) - pipe.bore_radius_mm
            paint(grid[0, k], part, np.asarray(depth), deepest)
            shown = paint(grid[1, k], part, part.of(found.deviation_mm), deepest)
            grid[0, k].set_title(f"Scratch {k + 1}, true: {true.depth_mm:.1f} mm deep")
            measured = "missed" if defect is None else f"measured: {defect.depth_mm:.2f} mm deep"
            grid[1, k].set_title(f"Scratch {k + 1}, {measured}")
        figure.colorbar(shown, ax=grid, label="depth (mm)", fraction=0.02)
        return rows, to_picture(figure, "", "").file


def run_fig18(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[Row]:
    """Scan and draw."""
    return run_figure("fig18", "paper-scratches", [f"sensing.fidelity={fidelity}"], make, seed, out, workers, progress)
