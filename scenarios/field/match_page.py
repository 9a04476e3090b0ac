"""Two scans of one pipe: figures, table and page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.document import BadInput
from scenarios.field.match import SAME_BORE_MM, SEEN_ENOUGH, SIZES, Matching, match_runs, table, words
from scenarios.provenance import write_versions
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLUE, VERMILION, Picture, drawing, to_picture
from scenarios.report.plain_rows import write_rows
from scenarios.run_folder import run_folder

FOOTER = (
    "Lengths in millimetres, clock positions in h:mm; places are the earlier scan's. A change is "
    "the later size less the earlier one, with its 95 % interval from what each scan states of itself."
)
WEAK = "This alignment is weak: check that the pairs below are the same defects."


def write_match(before: Path, after: Path, out: Path) -> Matching:
    """Match two run folders into a folder: `match.csv`, `match.json`, `report.html`.

    Raises:
        BadInput: when a run cannot be read, the two are not one pipe's, or the folder cannot be written.
    """
    found = match_runs(before, after)
    bores = found.before.bore_radius_mm, found.after.bore_radius_mm
    if abs(bores[0] - bores[1]) > SAME_BORE_MM:
        raise BadInput([f"{after}: bore of {bores[1]:.1f} mm radius; {before} has {bores[0]:.1f} mm: not one pipe"])
    with run_folder(out) as folder:
        write_rows(table(found), folder / "match")
        (folder / "match.json").write_text(json.dumps(figures(found), indent=1, allow_nan=False) + "\n")
        (folder / "report.html").write_text(_page(found), encoding="utf-8")
        write_versions(folder)
    return found


def figures(found: Matching) -> dict[str, Any]:
    """All of it for other programs."""
    laid = found.laid
    return {
        "before": str(found.before.folder),
        "after": str(found.after.folder),
        "offset_mm": round(laid.offset_mm, 3),
        "turn_deg": round(float(np.degrees(laid.turn_rad)), 3),
        "pairs": len(laid.pairs),
        "spread_mm": None if np.isnan(laid.spread_mm) else round(laid.spread_mm, 3),
        "alignment_sure": laid.sure,
        "alignment": laid.words,
        "defects": table(found),
    }


def _page(found: Matching) -> str:
    rows = table(found)
    changed = any(row.fate in ("new", "gone") or row.growth["depth"].verdict == "grown" for row in _judged(found))
    laid = found.laid
    sections = [
        Section(
            "How the scans lie over each other",
            [f"The later scan is moved by {laid.words}.", *([] if laid.sure else [WEAK])],
        ),
        Section("Change of depth", ["Where depth is a least one, no interval is stated."], (), _pictures(found)),
        Section(
            "Defects",
            [
                f"A defect is gone, or new, only where the other scan saw at least {100 * SEEN_ENOUGH:.0f} % of its "
                "place; elsewhere nothing is said of it."
            ],
            _shown(rows),
        ),
    ]
    lead = f"Before: {found.before.folder.name}; after: {found.after.folder.name}."
    return calibration_page("The same pipe twice", lead, words(found), laid.sure and not changed, sections, FOOTER)


def _judged(found: Matching) -> list:
    return [row for row in found.rows if row.growth or row.fate in ("new", "gone")]


def _shown(rows: list[dict[str, Any]]) -> list[list[str]]:
    if not rows:
        return [["No defect in either scan"]]
    head = ["Defect", "Distance mm", "Clock", "What became of it", *(f"{name} mm" for name in SIZES), "Remark"]
    return [head, *([*_place(row), *(_size(row, name) for name in SIZES), row["remark"]] for row in rows)]


def _place(row: dict[str, Any]) -> list[str]:
    return [str(row["defect"]), f"{row['distance_mm']:.1f}", row["clock"], row["fate"]]


def _size(row: dict[str, Any], name: str) -> str:
    before, after = row[f"{name}_before_mm"], row[f"{name}_after_mm"]
    if row["fate"] != "paired":
        return f"{after if before is None else before:.2f}"
    low, high = row[f"{name}_change_low_mm"], row[f"{name}_change_high_mm"]
    interval = "no interval" if low is None else f"{low:+.2f} to {high:+.2f}"
    return f"{before:.2f} → {after:.2f} ({interval}): {row[f'{name}_verdict']}"


def _pictures(found: Matching) -> list[Picture]:
    paired = [(n, row.growth["depth"]) for n, row in enumerate(found.rows, start=1) if row.growth]
    if not paired:
        return []
    with drawing(max(2.4, 0.35 * len(paired) + 1.4)) as figure:
        axes = figure.subplots()
        for place, (_, growth) in enumerate(paired):
            color = VERMILION if growth.verdict == "grown" else BLUE
            half = growth.half_width_mm
            axes.errorbar(growth.change_mm, place, xerr=half, fmt="o" if half else "x", color=color, capsize=4)
        axes.axvline(0, color="#777777", linewidth=1)
        axes.set_yticks(range(len(paired)), [f"defect {n}" for n, _ in paired])
        axes.set_ylim(len(paired) - 0.5, -0.5)
        axes.set_xlabel("change of depth (mm)")
        axes.set_title("Change of depth with its 95 % interval")
        return [
            to_picture(
                figure,
                "Change of each paired defect's depth, with its interval",
                "Orange: grown beyond what is open of both scans. A cross has no interval.",
            )
        ]
