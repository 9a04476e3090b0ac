"""One way out for whatever a folder holds: a study's tables, or a run in the formats that other tools open."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from scenarios.document import BadInput, nearest
from scenarios.field.export_bag import write_mcap, write_rosbag2
from scenarios.field.export_video import write_video
from scenarios.field.run_formats import FORMATS, Format, export_run
from scenarios.study.export import Format as StudyFormat
from scenarios.study.export import export as write_tables
from scenarios.study.ledger import FILE as LEDGER

# the log's formats; those of what was measured from it are in `run_formats`
RUN_FORMATS = {
    "mcap": Format(write_mcap, "recording.mcap"),
    "rosbag2": Format(write_rosbag2, "rosbag2"),
    "video": Format(write_video, "video"),
}


def export(folder: Path, to: str | None, out: Path | None) -> list[Path]:
    """Write a study or a run in a format; returns what was written.

    Raises:
        BadInput: for a format that there is not, a folder that is neither, or a place that cannot be written.
    """
    if (folder / LEDGER).is_file():
        return _export_study(folder, to or "csv", out)
    if not any((folder / part).exists() for part in ("run.json", "rig.yaml", "reconstruction")):
        raise BadInput([f"{folder}: no study is there, and no run; give a folder that `study`, `run` or `replay` made"])
    if to in FORMATS:
        return [export_run(folder, to, out)]
    return [_export_run(folder, _known("run", to or "", {**RUN_FORMATS, **FORMATS}), out)]


def _known(what: str, to: str, formats: dict[str, Any]) -> Any:
    """What stands under a format's name.

    Raises:
        BadInput: when nothing does.
    """
    if to not in formats:
        names = tuple(formats)
        raise BadInput([f"--to: got {to or 'nothing'}; a {what} goes to {', '.join(names)}{nearest(to, names)}"])
    return formats[to]


def _export_run(run: Path, chosen: Format, out: Path | None) -> Path:
    target = out or run / "export" / chosen.name
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput([f"{target.parent}: cannot be written: {error.strerror}"]) from error
    chosen.write(run, target)
    return target


def _export_study(folder: Path, to: str, out: Path | None) -> list[Path]:
    from scenarios.study.conduct import opened

    chosen = _known("study", to, {name: name for name in get_args(StudyFormat)})
    if out is not None:
        raise BadInput(["-o: the tables of a study are written into its own folder"])
    with opened(folder) as ledger:
        return write_tables(ledger, folder, chosen)
