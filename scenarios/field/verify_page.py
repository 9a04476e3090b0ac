"""A spool's check as a table, a page and words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenarios.field.spool import read_spool
from scenarios.field.verify import Check, Figure, rows, verify
from scenarios.provenance import write_versions
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.plain_rows import write_rows
from scenarios.run_folder import run_folder

HEAD = ["Figure", "Measured", "Certified", "Allowed off", "Verdict", "Remark"]
FOOTER = (
    "Lengths in millimetres. A size may be off by the drift that the spool file lets pass and by what is open of both "
    "the measurement and the certificate (95 %)."
)


def write_check(log_or_run: Path, spool_file: Path, out: Path) -> Check:
    """Check into a folder: `verify.csv`, `verify.json`, `report.html`.

    Raises:
        BadInput: when spool or scan cannot be read, or the folder cannot be written.
    """
    check = verify(log_or_run, read_spool(spool_file))
    with run_folder(out) as folder:
        write_rows(rows(check), folder / "verify")
        (folder / "verify.json").write_text(json.dumps(figures(check), indent=1, allow_nan=False) + "\n")
        (folder / "report.html").write_text(_page(check), encoding="utf-8")
        write_versions(folder)
    return check


def figures(check: Check) -> dict[str, Any]:
    """All of it for other programs."""
    return {"spool": check.spool.name, "verdict": check.verdict, "figures": rows(check)}


def words(check: Check) -> str:
    """The outcome in one line."""
    every = (*check.rig, *check.sizing)
    outside = [figure.what for figure in every if figure.verdict == "outside"]
    if outside:
        return f"{check.spool.name}: OUTSIDE: {', '.join(outside)}."
    if check.verdict == "not judged":
        open_ = [figure.what for figure in check.sizing if figure.verdict == "not judged"]
        return f"{check.spool.name}: NOT JUDGED: {', '.join(open_)}. Nothing is outside."
    return f"{check.spool.name}: INSIDE: all {sum(f.verdict == 'inside' for f in every)} figures judged."


def _page(check: Check) -> str:
    sections = [
        Section("The rig", (), [HEAD, *map(_line, check.rig)]),
        Section(
            "Sizing",
            [f"The scan is laid over the certificate by {check.laid.words}."],
            [HEAD, *map(_line, check.sizing)],
        ),
    ]
    lead = f"Scan: {check.run.folder.name}. Spool: {check.spool.name}."
    return calibration_page(
        "Check in a reference spool", lead, words(check), check.verdict == "inside", sections, FOOTER
    )


def _line(figure: Figure) -> list[str]:
    def number(value: float | None) -> str:
        return "" if value is None else f"{value:.3f} {figure.unit}".strip()

    return [
        figure.what,
        number(figure.measured),
        number(figure.certified),
        number(figure.allowed),
        figure.verdict,
        figure.words,
    ]
