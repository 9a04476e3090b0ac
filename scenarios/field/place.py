"""Where in a folder the recording lies."""

from __future__ import annotations

from pathlib import Path

from scenarios.document import BadInput


def recording_in(folder: Path) -> Path:
    """The recording of a run, or the folder itself where it is one.

    Raises:
        BadInput: when there is none.
    """
    inside = folder / "recording"
    found = inside if inside.is_dir() else folder
    if not (found / "rig.yaml").is_file():
        raise BadInput([f"{folder}: holds no recording; give a folder that `pipetwin run` made, or a recording"])
    return found
