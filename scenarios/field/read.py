"""Any log as a recording folder of our own layout, whatever it was: one reader a kind of log, found by a look at it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from scenarios.document import BadInput
from scenarios.field.bag_files import is_bag
from scenarios.field.read_bag import read_bag
from scenarios.field.read_video import is_video, read_video
from scenarios.field.told import Told
from scenarios.run import Report
from sensor_model.recording import BadRecording, Recording, open_recording, refuse_link
from sensor_model.rig import save_settings

LOGS = ("imu0", "orientation0", "encoders0", "cam0")


class Reader(NamedTuple):
    """One kind of log: how it is known, and `read(log, told, target, progress)`, which gives remarks about it."""

    knows: Callable[[Path], bool]
    read: Callable[[Path, Told, Path, Report], list[str]]


def read_log(log: Path, told: Told, target: Path, progress: Report) -> tuple[Recording, list[str]]:
    """Have a log as a recording in a new folder; what its reader has to remark comes with it.

    Raises:
        BadInput: when there is no such log, or nothing can be made of it.
    """
    if not log.exists():
        raise BadInput([f"{log}: no such log; give a recording, a ROS 2 bag, an .mcap file or a video"])
    reader = next((reader for reader in READERS.values() if reader.knows(log)), None)
    if reader is None:
        raise BadInput([f"{log}: got no log that is known; give one of: {', '.join(READERS)}"])
    try:
        remarks = reader.read(log, told, target, progress)
        return open_recording(target), remarks
    except BadRecording as error:
        source = log / "recording" if (log / "recording").is_dir() else log
        raise BadInput([str(error).replace(str(target), str(source))]) from error


def is_recording(log: Path) -> bool:
    """Whether a folder is a recording, or holds one."""
    return any((folder / sensor).is_dir() for sensor in LOGS for folder in (log, log / "recording"))


def read_recording(log: Path, told: Told, target: Path, progress: Report) -> list[str]:
    """Our own layout: the files are linked where the disk can, and copied where not."""
    source = log / "recording" if (log / "recording").is_dir() else log
    target.mkdir(parents=True)
    for name, settings in (("rig.yaml", told.rig), ("pipe.yaml", told.pipe)):
        if settings is not None:
            save_settings(settings, target / name)
        else:
            _bring(source / name, target / name)
    for sensor in LOGS:
        _bring(source / sensor / "data.csv", target / sensor / "data.csv")
    names = open_recording(target).frame_files
    for done, name in enumerate(names, start=1):
        if (source / name).exists():  # a missing frame is the health's to name
            _bring(source / name, target / name)
        progress("read", done, len(names))
    return []


def _bring(source: Path, target: Path) -> None:
    """One file of a log, without a copy where that can be."""
    refuse_link(source)
    if not source.is_file():
        raise BadRecording(f"{source}: missing")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:  # another disk, or one that has no links
        shutil.copyfile(source, target)


READERS = {
    "a recording folder": Reader(is_recording, read_recording),
    "a ROS 2 bag or an .mcap file": Reader(is_bag, read_bag),
    "a video with its CSV files": Reader(is_video, read_video),
}
