"""Fig. 14 of the paper: map, histogram with its clusters, and the cells beyond each; beside it the blind threshold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenarios.equations import err_pct
from scenarios.oracle import cluster_means, group_err_pct
from scenarios.paper.one_figure import Part, Row, paint, run_figure
from scenarios.paper.sized_scan import Report, SizedScan
from scenarios.report.canvas import BLUE, VERMILION, drawing, to_picture
from scenarios.report.plain_rows import text_table

HALF_ARC_MM, BESIDE_MM = 45.0, 30.0
DRAWN = 3  # candidates


def words(rows: list[Row]) -> str:
    """The candidates for a terminal."""
    columns = {"threshold": "threshold", "depth_mm": "mm", "err_pct": "Err (Eq. 29) %", "chosen": "chosen by"}
    return text_table(rows, columns, "Fig. 14: thresholds from the histogram's clusters, and the blind sizes")


def make(scan: SizedScan) -> tuple[list[Row], bytes]:
    """Rows and picture.

    Raises:
        RunFailed: when the defect was not found.
    """
    pipe, found = scan.scan.truth.pipe, scan.found
    feature, defect = scan.first()
    true = feature.size(pipe.bore_radius_mm)
    means = cluster_means(found)
    errs = [group_err_pct(pipe, feature, found, mean) for mean in means]
    best = int(np.argmin(errs))
    rows: list[Row] = [
        {
            "threshold": f"M{k + 1}",
            "depth_mm": float(mean),
            "err_pct": float(err) if np.isfinite(err) else None,
            "chosen": "the true size (oracle)" if k == best else "",
        }
        for k, (mean, err) in enumerate(zip(means, errs, strict=True))
    ]
    blind = err_pct(defect.length_mm, defect.width_mm, true.length_mm, true.width_mm)
    rows.append({"threshold": "half depth", "depth_mm": defect.depth_mm / 2, "err_pct": blind, "chosen": "blind"})
    return rows, _picture(scan, rows, best)


def _picture(scan: SizedScan, rows: list[Row], best: int) -> bytes:
    pipe, found = scan.scan.truth.pipe, scan.found
    feature = pipe.features[0]
    size = feature.size(pipe.bore_radius_mm)
    reach = size.length_mm / 2 + BESIDE_MM
    z = feature.distance_mm - reach, feature.distance_mm + reach
    part = Part(found.wall, feature.clock_deg, HALF_ARC_MM, z, pipe.bore_radius_mm)
    depth = part.of(found.deviation_mm)
    last = len(rows) - 2
    shown = sorted({0, best, last})[:DRAWN]
    with drawing(6.4, 13.0) as figure:
        grid = figure.subplots(2, 3)
        image = paint(grid[0, 0], part, depth, size.depth_mm)
        figure.colorbar(image, ax=grid[0, 0], label="depth (mm)", fraction=0.04)
        grid[0, 0].set_title("(a) Cylindrical defect map")
        _histogram(grid[0, 1], found.deviation_mm, rows)
        blind = rows[-1]
        _binary(grid[0, 2], part, depth > blind["depth_mm"], f"Blind, half depth: Err {blind['err_pct']:.2f} %")
        for axes, k in zip(grid[1], shown, strict=False):
            row = rows[k]
            said = "no defect" if row["err_pct"] is None else f"Err {row['err_pct']:.1f} %"
            label = " (oracle)" if k == best else ""
            title = f"(c) {row['threshold']} = {row['depth_mm']:.2f} mm: {said}{label}"
            _binary(axes, part, depth > row["depth_mm"], title)
        for axes in grid[1][len(shown) :]:
            axes.set_visible(False)
        return to_picture(figure, "", "").file


def _histogram(axes: Any, deviation: np.ndarray, rows: list[Row]) -> None:
    axes.hist(deviation[np.isfinite(deviation)], bins=120, color=BLUE)
    for row in rows[:-1]:
        axes.axvline(row["depth_mm"], color="#777777", linewidth=0.8)
    axes.axvline(rows[-1]["depth_mm"], color=VERMILION, linestyle="--", label="half of the measured depth")
    axes.plot([], [], color="#777777", label="means of the clusters")
    axes.set_yscale("log")
    axes.set_xlabel("depth (mm)")
    axes.set_ylabel("cells (log axis)")
    axes.set_title("(b) Histogram of the map")
    axes.legend()


def _binary(axes: Any, part: Part, deep: np.ndarray, title: str) -> None:
    paint(axes, part, deep.astype(float), 1.0)
    axes.set_title(title)


def run_fig14(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[Row]:
    """Scan and draw."""
    return run_figure("fig14", "paper-robot", [f"sensing.fidelity={fidelity}"], make, seed, out, workers, progress)
