"""One way out for whatever a folder holds: a study's tables, or a run in the formats that other tools open."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from scenarios.document import BadInput, nearest
from scenarios.field.run_formats import export_run
from scenarios.study.export import Format as StudyFormat
from scenarios.study.export import export as write_tables
from scenarios.study.ledger import FILE as LEDGER


def export(folder: Path, to: str | None, out: Path | None) -> list[Path]:
    """Write a study or a run in a format; returns what was written.

    Raises:
        BadInput: for a format that there is not, a folder that is neither, or a place that cannot be written.
    """
    if (folder / LEDGER).is_file():
        return _export_study(folder, to or "csv", out)
    if not any((folder / part).exists() for part in ("run.json", "rig.yaml", "reconstruction")):
        raise BadInput([f"{folder}: no study is there, and no run; give a folder that `study`, `run` or `replay` made"])
    return [export_run(folder, to or "", out)]


def _export_study(folder: Path, to: str, out: Path | None) -> list[Path]:
    from scenarios.study.conduct import opened

    formats = {name: name for name in get_args(StudyFormat)}
    if to not in formats:
        raise BadInput([f"--to: got {to}; a study goes to {', '.join(formats)}{nearest(to, tuple(formats))}"])
    if out is not None:
        raise BadInput(["-o: the tables of a study are written into its own folder"])
    with opened(folder) as ledger:
        return write_tables(ledger, folder, formats[to])
