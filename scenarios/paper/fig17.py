"""Fig. 17 of the paper: pockets that take 75, 50 and 25 % of the wall, as the map shows them."""

from __future__ import annotations

from pathlib import Path

from scenarios.paper.one_figure import Part, Row, paint, run_figure
from scenarios.paper.sized_scan import Report, SizedScan
from scenarios.report.canvas import VERMILION, drawing, to_picture
from scenarios.report.plain_rows import text_table
from scenarios.run import RunFailed

HALF_ARC_MM, BESIDE_MM = 40.0, 25.0
COLUMNS = {
    "wall_loss_pct": "true loss %",
    "measured_loss_pct": "measured %",
    "length_error_mm": "length error mm",
    "width_error_mm": "width error mm",
    "depth_error_mm": "depth error mm",
}


def words(rows: list[Row]) -> str:
    """The sizes for a terminal."""
    return text_table(rows, COLUMNS, "Fig. 17: 70 x 35 mm pockets of falling depth, sized blind")


def make(scan: SizedScan) -> tuple[list[Row], bytes]:
    """Rows and picture.

    Raises:
        RunFailed: when a pocket was not found.
    """
    from matplotlib.patches import Rectangle

    pipe, found = scan.scan.truth.pipe, scan.found
    pairs = scan.pairs()
    if len(pairs) < len(pipe.features):
        raise RunFailed(f"{len(pairs)} of {len(pipe.features)} pockets were found")
    rows: list[Row] = []
    with drawing(3.0, 13.0) as figure:
        every = figure.subplots(1, len(pairs), sharey=True)
        for axes, (feature, defect) in zip(every, pairs, strict=True):
            true = feature.size(pipe.bore_radius_mm)
            loss = 100 * true.depth_mm / pipe.wall_mm
            rows.append(
                {
                    "wall_loss_pct": loss,
                    "measured_loss_pct": defect.wall_loss_pct,
                    "length_error_mm": defect.length_mm - true.length_mm,
                    "width_error_mm": defect.width_mm - true.width_mm,
                    "depth_error_mm": defect.depth_mm - true.depth_mm,
                }
            )
            reach = true.length_mm / 2 + BESIDE_MM
            z = feature.distance_mm - reach, feature.distance_mm + reach
            part = Part(found.wall, feature.clock_deg, HALF_ARC_MM, z, pipe.bore_radius_mm)
            shown = paint(axes, part, part.of(found.deviation_mm), pipe.wall_mm)
            arc = float(feature.arc_mm(defect.theta_rad, pipe.bore_radius_mm))
            corner = defect.start_mm, arc - defect.width_mm / 2
            axes.add_patch(Rectangle(corner, defect.length_mm, defect.width_mm, fill=False, edgecolor=VERMILION))
            axes.set_title(f"{loss:.0f} % of the wall\nmeasured {defect.wall_loss_pct:.1f} %")
        figure.colorbar(shown, ax=every, label="depth (mm)", fraction=0.02)
        return rows, to_picture(figure, "", "").file


def run_fig17(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[Row]:
    """Scan and draw."""
    return run_figure("fig17", "paper-wall-loss", [f"sensing.fidelity={fidelity}"], make, seed, out, workers, progress)
