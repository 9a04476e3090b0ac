"""Table 4 of the paper: the depth of pockets that take less and less of the wall, beside the paper's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenarios.equations import depth_quality_pct
from scenarios.load import load_scenario
from scenarios.paper.folder import paper_folder
from scenarios.paper.printed import TABLE_4_ESTIMATE_MM, TABLE_4_LOSS_PCT, TABLE_4_QUALITY_PCT
from scenarios.paper.sized_scan import Report, SizedScan, sized_scan
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run import RunFailed

Row = dict[str, Any]
SCANS = 3
LEAST_QUALITY_PCT = {75.0: 97.0, 50.0: 95.0, 25.0: 90.0}
MOST_BIAS_MM = 0.1
COLUMNS = {
    "wall_loss_pct": "wall loss %",
    "depth_mm": "depth mm",
    "estimate_mm": "estimated mm",
    "worst_error_mm": "worst error mm",
    "floors_not_seen": "floor not seen",
    "quality_pct": "quality %",
    "paper_estimate_mm": "paper's estimate",
    "paper_quality_pct": "paper's quality %",
    "verdict": "asked",
}


def rows_of(scans: list[SizedScan]) -> list[Row]:
    """A row a depth, over all scans.

    Raises:
        RunFailed: when a pocket was not found.
    """
    pipe = scans[0].scan.truth.pipe
    printed = {
        loss: (mm, pct)
        for loss, mm, pct in zip(TABLE_4_LOSS_PCT, TABLE_4_ESTIMATE_MM, TABLE_4_QUALITY_PCT, strict=True)
    }
    rows = []
    for feature in pipe.features:
        true = feature.size(pipe.bore_radius_mm).depth_mm
        loss = round(100 * true / pipe.wall_mm, 6)
        found = [defect for scan in scans for own, defect in scan.pairs() if own == feature]
        if len(found) < len(scans):
            raise RunFailed(f"{loss:g} % wall loss: found in {len(found)} of {len(scans)} scans")
        depths = np.array([defect.depth_mm for defect in found])
        quality, bias = depth_quality_pct(depths, np.full(depths.size, true)), float(depths.mean() - true)
        paper = printed.get(loss, (None, None))
        rows.append(
            {
                "wall_loss_pct": loss,
                "depth_mm": true,
                "estimate_mm": float(depths.mean()),
                "worst_error_mm": float(np.abs(depths - true).max()),
                "floors_not_seen": sum(not defect.floor_seen for defect in found),
                "quality_pct": quality,
                "paper_estimate_mm": paper[0],
                "paper_quality_pct": paper[1],
                "verdict": _verdict(loss, quality, bias),
            }
        )
    return rows


def _verdict(loss_pct: float, quality_pct: float, bias_mm: float) -> str:
    """What is asked of one depth, and whether it holds."""
    least = LEAST_QUALITY_PCT.get(loss_pct)
    held = abs(bias_mm) <= MOST_BIAS_MM and (least is None or quality_pct >= least)
    asked = f"bias {MOST_BIAS_MM:g} mm" if least is None else f"at least {least:g} %, bias {MOST_BIAS_MM:g} mm"
    return f"{asked}: {'holds' if held else 'does not hold'}"


def words(rows: list[Row]) -> str:
    """The table for a terminal."""
    title = f"Table 4: depth by wall loss, mean of {SCANS} scans (Eq. 32), sized blind; the paper's beside it"
    return text_table(rows, COLUMNS, title)


def run_table4(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[Row]:
    """Scan three times, with seeds that follow each other, and write the rows into a folder.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when a scan fails.
    """
    first = load_scenario("paper-wall-loss", [f"sensing.fidelity={fidelity}"], seed)
    with paper_folder("table4", first, out) as folder:
        seeds = range(first.seed, first.seed + SCANS)
        rows = rows_of([sized_scan(first.model_copy(update={"seed": s}), workers, progress) for s in seeds])
        write_rows(rows, folder / "table4")
    return rows
