"""What a run's folder holds of the truth, read back and looked at before it is believed."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from scenarios.document import BadInput
from scenarios.found_run import LARGEST_MAP_BYTES, read_arrays
from twin.pipe import Pipe
from twin.truth import ARRAYS, Truth, WheelLog

LARGEST_PIPE_BYTES = 64_000_000
WIDTHS = {"position_mm": 3, "q_pipe_camera_wxyz": 4, "acceleration_mm_s2": 3, "angular_velocity_camera_rad_s": 3}
WHEEL_ARRAYS = tuple(field.name for field in fields(WheelLog))
UNIT_TOLERANCE = 0.01


def read_truth(folder: Path) -> Truth:
    """Read what `twin.truth.save_truth` wrote.

    Raises:
        BadInput: naming file, array and what is expected.
    """
    pipe, wheels = _read_pipe(folder / "pipe.json"), folder / "wheels.npz"
    held = _rows(folder / "truth.npz", tuple(ARRAYS))
    if (np.abs(np.linalg.norm(held["q_pipe_camera_wxyz"], axis=1) - 1) > UNIT_TOLERANCE).any():
        raise BadInput([f"{folder / 'truth.npz'}: q_pipe_camera_wxyz: quaternions of length 1 are expected"])
    log = WheelLog(**_rows(wheels, WHEEL_ARRAYS)) if wheels.is_file() else None
    return Truth(pipe=pipe, wheels=log, **held)


def _read_pipe(file: Path) -> Pipe:
    try:
        if not file.is_file():
            raise BadInput([f"{file}: is no plain file"])
        if file.stat().st_size > LARGEST_PIPE_BYTES:
            raise BadInput([f"{file}: is larger than {LARGEST_PIPE_BYTES / 1e6:g} MB"])
        return Pipe.model_validate_json(file.read_bytes())
    except ValidationError as error:
        faults = [(".".join(map(str, fault["loc"])) or "the file", fault["msg"]) for fault in error.errors()]
        raise BadInput([f"{file}: {where}: {words}" for where, words in faults]) from error
    except OSError as error:
        raise BadInput([f"{file}: cannot be read: {error.strerror}"]) from error


def _rows(file: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Arrays with a row for each of `time_s`, all finite; times ascend."""
    held = read_arrays(file, names, LARGEST_MAP_BYTES)
    time_s = held["time_s"]
    if time_s.ndim != 1 or time_s.size < 2 or not (np.isfinite(time_s).all() and (np.diff(time_s) > 0).all()):
        raise BadInput([f"{file}: time_s: must be at least 2 finite numbers, each beyond the last"])
    for name, values in held.items():
        width = WIDTHS.get(name, values.shape[-1] if values.ndim == 2 else "wheels")
        if name != "time_s" and values.shape != (time_s.size, width):
            raise BadInput([f"{file}: {name}: got shape {values.shape}; ({time_s.size}, {width}) goes with time_s"])
        if not np.isfinite(values).all():
            raise BadInput([f"{file}: {name}: finite numbers are expected"])
    return held
