"""A recording that is still being written: its tables read as they grow, frames given once all of them have come by."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from stat import S_ISREG
from typing import NamedTuple

import numpy as np

from sensor_model.recording import (
    LARGEST_COUNT,
    LATEST_NS,
    SLIT_PIXELS_SUFFIX,
    BadRecording,
    Frame,
    NominalPipe,
    Recording,
    refuse_link,
)
from sensor_model.rig import QUATERNION_TOLERANCE, Rig, load_settings

END = "# end"
LONGEST_LINE = 4096
READ_BYTES = 2**20


@dataclass
class Tail:
    """One growing table: complete lines are taken as they come, each once."""

    path: Path
    offset: int = 0
    line: int = 0
    stamp_ns: int = -1
    ended: bool = False

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Stamps and fields of the lines that came since the last call.

        Raises:
            BadRecording: naming file and line.
        """
        try:
            stat = os.lstat(self.path)
        except FileNotFoundError:
            return
        refuse_link(self.path)
        if not S_ISREG(stat.st_mode):
            raise BadRecording(f"{self.path}: is no plain file")
        if stat.st_size <= self.offset:
            return
        with self.path.open("rb") as file:
            file.seek(self.offset)
            data = file.read(READ_BYTES)
        whole = data.rfind(b"\n") + 1
        if whole == 0 and len(data) > LONGEST_LINE:
            raise BadRecording(f"{self.path}:{self.line + 1}: a line of more than {LONGEST_LINE} bytes")
        self.offset += whole
        try:
            lines = data[:whole].decode().splitlines()
        except UnicodeDecodeError as error:
            raise BadRecording(f"{self.path}:{self.line + 1}: {error}") from error
        for row in csv.reader(lines):
            self.line += 1
            if row and row[0].startswith("#"):
                self.ended |= row[0].startswith(END)
            elif row:
                yield self._stamp(row[0]), row[1:]

    def _stamp(self, text: str) -> int:
        known = text.isascii() and text.isdigit() and len(text) <= len(str(LATEST_NS)) and int(text) <= LATEST_NS
        if not known or int(text) <= self.stamp_ns:
            raise BadRecording(f"{self.path}:{self.line}: stamp {text[:30]!r} does not come after {self.stamp_ns}")
        self.stamp_ns = int(text)
        return self.stamp_ns


@dataclass
class Series:
    """The latest of a table: numbers (`whole`: counts, `unit`: quaternions) from one row before what is needed."""

    tail: Tail
    columns: int
    whole: bool = False
    unit: bool = False
    stamps_ns: list[int] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)

    def read(self) -> bool:
        """Take in what came; whether anything did.

        Raises:
            BadRecording: naming file, line and value.
        """
        before = self.tail.line
        for stamp, row in self.tail.rows():
            where = f"{self.tail.path}:{self.tail.line}"
            try:
                values = [float(text) for text in row]
            except ValueError as error:
                raise BadRecording(f"{where}: {error}") from error
            if len(values) != self.columns or not np.isfinite(values).all():
                raise BadRecording(f"{where}: {row}; {self.columns} finite numbers are expected")
            if self.whole and any(value != round(value) or abs(value) > LARGEST_COUNT for value in values):
                raise BadRecording(f"{where}: {row}; whole counts up to {LARGEST_COUNT} are expected")
            if self.unit and abs(np.linalg.norm(values) - 1) > QUATERNION_TOLERANCE:
                raise BadRecording(f"{where}: a quaternion of length {np.linalg.norm(values):.3g}; 1 is expected")
            self.stamps_ns.append(stamp)
            self.values.append(values)
        return self.tail.line > before

    def forget(self, before_ns: int) -> None:
        """Let go of what comes before a time, but for the last row of it and never all."""
        first = int(np.searchsorted(self.stamps_ns, before_ns, side="right")) - 1
        first = min(first, len(self.stamps_ns) - 2)
        if first > 0:
            del self.stamps_ns[:first], self.values[:first]

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Stamps and rows."""
        return np.array(self.stamps_ns, dtype=np.int64), np.array(self.values).reshape(-1, self.columns)


class Due(NamedTuple):
    """A frame whose time has come: without its picture, and the file that has it."""

    frame: Frame
    file: Path


@dataclass
class LiveLog:
    """What is known of a growing recording, and where its next frame stands."""

    folder: Path
    rig: Rig
    pipe: NominalPipe
    frames: Tail
    imu: Series
    orientation: Series
    encoders: Series
    waiting: list[tuple[int, str]] = field(default_factory=list)
    before: tuple[int, str] | None = None
    given: int = 0

    @property
    def ended(self) -> bool:
        """Whether its writer said that it is whole."""
        return self.frames.ended


def open_live(folder: Path) -> LiveLog | None:
    """A recording as far as it is there; None while rig and pipe are not.

    Raises:
        BadRecording: for a rig or pipe that cannot be read.
    """
    if not all((folder / name).is_file() for name in ("rig.yaml", "pipe.yaml")):
        return None
    refuse_link(folder / "rig.yaml")
    refuse_link(folder / "pipe.yaml")
    try:
        rig, pipe = load_settings(Rig, folder / "rig.yaml"), load_settings(NominalPipe, folder / "pipe.yaml")
    except (OSError, ValueError) as error:
        raise BadRecording(f"{folder}: {error}") from error
    wheels = len(rig.wheels.diameters_mm)
    imu, orientation, encoders = (
        Series(Tail(folder / name / "data.csv"), columns, whole=name == "encoders0", unit=name == "orientation0")
        for name, columns in (("imu0", 6), ("orientation0", 4), ("encoders0", wheels))
    )
    return LiveLog(folder, rig, pipe, Tail(folder / "cam0" / "data.csv"), imu, orientation, encoders)


def read_more(log: LiveLog) -> bool:
    """Take in what was written since; whether anything was.

    Raises:
        BadRecording: naming file, line and value.
    """
    came = [series.read() for series in (log.imu, log.orientation, log.encoders)]
    for stamp, row in log.frames.rows():
        name = row[0].strip() if len(row) == 1 else ""
        if Path(name).name != name or Path(name).suffix not in (".png", SLIT_PIXELS_SUFFIX):
            raise BadRecording(f"{log.frames.path}:{log.frames.line}: {row}; a plain file name (png, npy) is expected")
        log.waiting.append((stamp, name))
        came.append(True)
    return any(came)


def next_due(log: LiveLog, at_end: bool) -> Due | None:
    """The next frame, once every other table goes past its stamp, or will not any more.

    What the other sensors say of it is then the same as in the finished recording.
    """
    if not log.waiting:
        return None
    stamp, name = log.waiting[0]
    logs = (log.imu, log.orientation, log.encoders)
    enough = all(len(series.stamps_ns) >= 2 for series in logs)
    if not enough or not (at_end or all(series.stamps_ns[-1] >= stamp for series in logs)):
        return None
    log.waiting.pop(0)
    shown = [*([log.before] if log.before else []), (stamp, name)]
    stamps = np.array([one for one, _ in shown], dtype=np.int64)
    files = tuple(f"cam0/data/{file}" for _, file in shown)
    (imu_at, imu), (attitude_at, attitude), (wheels_at, counts) = (series.arrays() for series in logs)
    window = Recording(
        log.folder,
        log.rig,
        log.pipe,
        stamps,
        files,
        imu_at,
        imu,
        attitude_at,
        attitude,
        wheels_at,
        counts.astype(np.int64),
    )
    frame = replace(window.frame(len(shown) - 1), index=log.given)
    for series in logs:
        series.forget(stamp)
    log.before, log.given = (stamp, name), log.given + 1
    return Due(frame, log.folder / files[-1])
