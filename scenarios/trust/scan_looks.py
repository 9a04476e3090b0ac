"""Looks at targets from scans: every true defect of a study or of a folder of runs, found or missed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenarios.document import BadInput, shown
from scenarios.study.conduct import opened
from scenarios.study.gather import SIZED
from scenarios.study.ledger import DONE, FILE, STATES
from scenarios.trust.performance import target_rows
from scenarios.trust.runs import read_scan, targets_of

Row = dict[str, Any]
SIZE, HIT, TARGET = "true_depth_mm", "found", "target"


def looks_of(folder: Path, method: str | None = None) -> list[Row]:
    """A row a look: a study's (one method's of it), a run's, or those of all runs in a folder.

    Raises:
        BadInput: for a folder that holds neither, or a study of several methods without one named.
    """
    if (folder / FILE).is_file():
        return _of_study(folder, method)
    runs = [folder] if (folder / "truth").is_dir() else sorted(part.parent for part in folder.glob("*/truth"))
    if not runs:
        raise BadInput([f"{folder}: holds neither a study nor runs; `pipetwin study` and `pipetwin run` make them"])
    if method is not None:
        raise BadInput([f"--method: got {shown(method)}; {folder} holds runs, each with its own method"])
    scans = [read_scan(run) for run in runs]
    return [row for scan in scans for row in target_rows(targets_of(scan, scan.pipe, scan.seen_share)[0])]


def _of_study(folder: Path, method: str | None) -> list[Row]:
    with opened(folder) as ledger:
        known = tuple(ledger.about("methods"))
        if method is None and len(known) > 1:
            raise BadInput([f"{folder}: has the methods {', '.join(known)}; choose one with --method"])
        if method is not None and method not in known:
            raise BadInput([f"--method: got {shown(method)}; {folder} has {', '.join(known)}"])
        paths = ledger.about("identity")["paths"]
        rows = []
        for row in ledger.rows():
            if row.state != STATES[DONE] or row.method != (method or known[0]):
                continue
            factors = dict(zip(paths, row.values, strict=True))
            for number, sizes in enumerate(row.defects, start=1):
                true = dict(zip(("true_length_mm", "true_width_mm", SIZE), sizes, strict=False))
                target = f"{row.point}:{number}"  # another seed looks at the same one again
                rows.append({TARGET: target, "seed": str(row.seed), **factors, **true, HIT: int(len(sizes) == SIZED)})
    if not rows:
        raise BadInput([f"{folder}: no run is done, or none scanned a defect"])
    return rows
