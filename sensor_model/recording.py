"""The recording: synchronised pictures, IMU and encoders in the EuRoC/ASL folder layout, whoever wrote it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int, UInt8
from pydantic import Field, field_validator
from scipy.spatial.transform import Rotation, Slerp

from sensor_model.rig import QUATERNION_TOLERANCE, AnySettings, Rig, load_settings, save_settings
from sensor_model.settings import Settings

MAX_FILE_BYTES = 64 * 2**20
MAX_LOG_BYTES = 2**30
STAMP_DIGITS, LATEST_NS = 19, 2**63 - 1  # a present-day stamp has 19 digits
SLIT_PIXELS_SUFFIX = ".npy"
RGB_8_BIT = b"\x08\x02"
SLIT_PIXEL = np.dtype([("pixel", "<f8", (2,)), ("slit", "<i8"), ("sigma_px", "<f8")])
LARGEST_COUNT = 2**53  # beyond it a double does not hold every whole number
FURTHEST_PX, SMALLEST_SIGMA_PX = 1e6, 1e-9  # beyond them squares lose all meaning
FURTHEST_MM = 1e9  # along a pipe
LATE_S = 0.2  # how far a frame may lie outside the other sensors' logs
COLUMNS = {
    "imu0": "w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
    "orientation0": "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
}


class BadRecording(ValueError):
    """A recording that cannot be read; the message names file, line and value."""


class NominalPipe(Settings):
    """What the operator knows of the pipe before the scan, from its standard and the job's papers."""

    inner_radius_mm: Annotated[float, Field(gt=5, le=10_000)]
    wall_thickness_mm: Annotated[float, Field(gt=0, le=10_000)]
    launch_mm: Annotated[float, Field(ge=-FURTHEST_MM, le=FURTHEST_MM)] = 0.0
    """Where along the pipe the camera stands as the log begins."""
    wall_tolerance_pct: Annotated[float, Field(ge=0, le=100)] = 12.0
    """By how much the wall may be thicker than that: a standard states the least one (ASTM D1785 and D2513: 12 %)."""
    joints_mm: tuple[Annotated[float, Field(ge=-FURTHEST_MM, le=FURTHEST_MM)], ...] = Field(
        default=(), max_length=10_000
    )
    """Where along the pipe its joints are by the as-built papers, in order; `featured` ties the distance to them."""
    joints_std_mm: Annotated[float, Field(gt=0)] = 1.0
    """How exact those papers are."""

    @field_validator("joints_mm")
    @classmethod
    def _in_order(cls, joints_mm: tuple[float, ...]) -> tuple[float, ...]:
        for k, (before, here) in enumerate(pairwise(joints_mm)):
            if here <= before:
                raise ValueError(f"joint {k + 1}, at {here:g} mm, comes after the one at {before:g} mm; must ascend")
        return joints_mm


@dataclass(frozen=True)
class SlitPixels:
    """Places in one picture where a slit's centre line was seen, sorted by slit and then azimuth.

    `slit` counts from the innermost; `sigma_px` is the standard deviation across the slit.
    """

    pixel: Float[np.ndarray, "n 2"]
    slit: Int[np.ndarray, "n"]
    sigma_px: Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Frame:
    """One exposure, either a picture (RGB) or its slit pixels, and what the other sensors said.

    Attitude and counts are interpolated to the stamp; `imu` holds the samples (rad/s, m/s2) since the last frame.
    """

    index: int
    stamp_ns: int
    picture: UInt8[np.ndarray, "height width 3"] | None
    slit_pixels: SlitPixels | None
    q_world_imu_wxyz: Float[np.ndarray, "4"]
    counts: Float[np.ndarray, "wheels"]
    imu_stamps_ns: Int[np.ndarray, "samples"]
    imu: Float[np.ndarray, "samples 6"]


@dataclass(frozen=True)
class Recording:
    """A log on disk, read frame by frame; small enough parts (IMU, encoders) are held."""

    folder: Path
    rig: Rig
    pipe: NominalPipe
    frame_stamps_ns: Int[np.ndarray, "frames"]
    frame_files: tuple[str, ...]
    imu_stamps_ns: Int[np.ndarray, "n"]
    imu: Float[np.ndarray, "n 6"]
    orientation_stamps_ns: Int[np.ndarray, "m"]
    q_world_imu_wxyz: Float[np.ndarray, "m 4"]
    encoder_stamps_ns: Int[np.ndarray, "k"]
    counts: Int[np.ndarray, "k wheels"]

    def __len__(self) -> int:
        return len(self.frame_files)

    @cached_property
    def _attitudes_wxyz(self) -> Float[np.ndarray, "frames 4"]:
        """The attitude at every frame."""
        stamps = self.orientation_stamps_ns
        rotations = Slerp(stamps / 1e9, Rotation.from_quat(self.q_world_imu_wxyz[:, [1, 2, 3, 0]]))
        return rotations(np.clip(self.frame_stamps_ns, stamps[0], stamps[-1]) / 1e9).as_quat()[:, [3, 0, 1, 2]]

    @cached_property
    def _frame_counts(self) -> Float[np.ndarray, "frames wheels"]:
        """The encoders' counts at every frame."""
        wheels = [np.interp(self.frame_stamps_ns, self.encoder_stamps_ns, wheel) for wheel in self.counts.T]
        return np.stack(wheels, axis=1)

    def __getitem__(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            IndexError: past the last frame.
            BadRecording: for a picture that cannot be read or has the wrong size.
        """
        frame, content = self.frame(index), read_frame(self.folder / self.frame_files[index], self.rig)
        if isinstance(content, SlitPixels):
            return replace(frame, slit_pixels=content)
        return replace(frame, picture=content)

    def frame(self, index: int) -> Frame:
        """One frame without its picture: its stamp and what the other sensors said.

        Raises:
            IndexError: past the last frame.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        stamp_ns = int(self.frame_stamps_ns[index])
        attitude, counts = self._attitudes_wxyz[index], self._frame_counts[index]
        since = int(self.frame_stamps_ns[index - 1]) if index > 0 else -1
        span = slice(*np.searchsorted(self.imu_stamps_ns, [since, stamp_ns], side="right"))
        return Frame(index, stamp_ns, None, None, attitude, counts, self.imu_stamps_ns[span], self.imu[span])


def read_frame(file: Path, rig: Rig) -> UInt8[np.ndarray, "height width 3"] | SlitPixels:
    """What one frame's file holds: an RGB picture, or slit pixels.

    Raises:
        BadRecording: for a file that cannot be read, or a picture of the wrong size.
    """
    if file.suffix == SLIT_PIXELS_SUFFIX:
        return _read_slit_pixels(file, len(rig.projector.slits))
    _check_frame_file(file)
    expected = (rig.camera.height_px, rig.camera.width_px)
    # the header first: a small file can unpack to a huge picture
    size, colours = _png_head(file)
    if size != expected:
        raise BadRecording(f"{file}: picture of {size} rows, columns; the rig's camera has {expected}")
    picture = _read_rgb(file) if colours == RGB_8_BIT else _read_any(file)
    if picture is None or picture.shape[:2] != expected:
        raise BadRecording(f"{file}: not a picture that can be read")
    return picture


def _read_rgb(file: Path) -> UInt8[np.ndarray, "height width 3"]:
    """What cameras write, in a third of the time that OpenCV takes."""
    from kornia_rs.io import read_image_png_u8

    try:
        return read_image_png_u8(str(file), "rgb")
    except Exception as error:  # it raises no other kind
        raise BadRecording(f"{file}: not a picture that can be read: {error}") from error


def _read_any(file: Path) -> UInt8[np.ndarray, "height width 3"] | None:
    import cv2

    return cv2.imread(str(file), cv2.IMREAD_COLOR_RGB)


def _check_frame_file(file: Path) -> None:
    refuse_link(file)
    if not file.is_file():
        raise BadRecording(f"{file}: missing frame, named in {file.parent.parent / 'data.csv'}")
    size = file.stat().st_size
    if size > MAX_FILE_BYTES:
        raise BadRecording(f"{file}: {size} bytes; at most {MAX_FILE_BYTES}")


def _png_head(file: Path) -> tuple[tuple[int, int], bytes]:
    """Rows and columns that a PNG's header states, and its bits and colours.

    Raises:
        BadRecording: when it is no PNG, or one of its parts promises more than the file holds, which is made room for.
    """
    held, at = file.stat().st_size, 8
    with file.open("rb", buffering=0) as png:
        head = png.read(26)
        if len(head) < 26 or head[:8] != b"\x89PNG\r\n\x1a\n" or head[12:16] != b"IHDR":
            raise BadRecording(f"{file}: not a picture that can be read: no PNG")
        while at < held:
            png.seek(at)
            promised = int.from_bytes(png.read(4), "big")
            at += 12 + promised
            if at > held:
                raise BadRecording(f"{file}: not a picture that can be read: {promised} bytes promised, {held} in all")
    return (int.from_bytes(head[20:24], "big"), int.from_bytes(head[16:20], "big")), head[24:]


def write_slit_pixels(file: Path, seen: SlitPixels) -> None:
    """Write the slit pixels of one frame: an .npy of rows."""
    rows = np.empty(seen.slit.size, dtype=SLIT_PIXEL)
    rows["pixel"], rows["slit"], rows["sigma_px"] = seen.pixel, seen.slit, seen.sigma_px
    np.save(file, rows, allow_pickle=False)


def _read_slit_pixels(file: Path, slits: int) -> SlitPixels:
    """Slit pixels of one frame, checked before anything compiled, which looks at no bounds, reads them."""
    rows = _read_rows(file)
    pixel, slit, sigma = (np.ascontiguousarray(rows[name]) for name in ("pixel", "slit", "sigma_px"))
    if not (
        (np.abs(pixel) <= FURTHEST_PX).all() and (sigma <= FURTHEST_PX).all() and (sigma >= SMALLEST_SIGMA_PX).all()
    ):
        allowed = f"finite, at most {FURTHEST_PX:g}, sigma_px positive, at least {SMALLEST_SIGMA_PX:g}"
        raise BadRecording(f"{file}: pixels and sigma_px must be {allowed}")
    if slit.size and not 0 <= slit.min() <= slit.max() < slits:
        raise BadRecording(f"{file}: slits from {slit.min()} to {slit.max()}; the rig has 0 to {slits - 1}")
    return SlitPixels(pixel, slit, sigma)


def _read_rows(file: Path) -> np.ndarray:
    """Rows of `SLIT_PIXEL` as they are in a file; what its header promises is looked at before it is believed."""
    _check_frame_file(file)
    data = file.read_bytes()
    known = OWN_HEADER.match(data)  # numpy's own reader takes ten times as long
    count, start = (int(known[1]), known.end()) if known else _read_header(file, data)
    if count * SLIT_PIXEL.itemsize != len(data) - start:
        held = f"{len(data) - start} bytes held"
        raise BadRecording(f"{file}: {count} rows of {SLIT_PIXEL.itemsize} bytes promised, {held}")
    return np.frombuffer(data, dtype=SLIT_PIXEL, offset=start)


def _read_header(file: Path, data: bytes) -> tuple[int, int]:
    """Number of rows that an .npy's header promises, and where they begin."""
    text = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(text) != (1, 0):
            raise ValueError("version 1.0 of the format is expected")
        shape, _, dtype = np.lib.format.read_array_header_1_0(text)
    except Exception as error:  # the header is read as Python's literals are, which raise whatever they trip over
        raise BadRecording(f"{file}: not a frame of slit pixels: {error}") from error
    if dtype != SLIT_PIXEL or len(shape) != 1:
        raise BadRecording(f"{file}: shape {shape} of {dtype}; (n,) of {SLIT_PIXEL} is expected")
    return shape[0], text.tell()


def _own_header() -> re.Pattern[bytes]:
    """What numpy writes before rows of `SLIT_PIXEL`, whatever their number."""
    text = io.BytesIO()
    np.lib.format.write_array_header_1_0(text, np.lib.format.header_data_from_array_1_0(np.zeros(7, SLIT_PIXEL)))
    before, after = text.getvalue().split(b"(7,)")
    return re.compile(re.escape(before) + rb"\((\d{1,9}),\)" + re.escape(after.rstrip()) + rb" *\n")


OWN_HEADER = _own_header()


def _write_csv(path: Path, header: str, stamps_ns: np.ndarray, columns: np.ndarray, fmt: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    form = ",".join(["%d", *[fmt] * columns.shape[1]])
    rows = zip(stamps_ns.tolist(), columns.tolist(), strict=True)
    lines = [f"#timestamp [ns],{header}", *(form % (stamp, *row) for stamp, row in rows)]
    path.write_text("\n".join(lines) + "\n")


def write_logs(
    folder: Path,
    rig: Rig,
    pipe: NominalPipe,
    imu_stamps_ns: Int[np.ndarray, "n"],
    imu: Float[np.ndarray, "n 6"],
    q_world_imu_wxyz: Float[np.ndarray, "m 4"],
    encoder_stamps_ns: Int[np.ndarray, "k"],
    counts: Int[np.ndarray, "k wheels"],
    orientation_stamps_ns: Int[np.ndarray, "m"] | None = None,
) -> None:
    """Write the rig, the nominal pipe and everything but the frames; attitudes come with the IMU unless said when."""
    folder.mkdir(parents=True, exist_ok=True)
    save_settings(rig, folder / "rig.yaml")
    save_settings(pipe, folder / "pipe.yaml")
    _write_csv(folder / "imu0" / "data.csv", COLUMNS["imu0"], imu_stamps_ns, imu, "%.9g")
    of_attitude = imu_stamps_ns if orientation_stamps_ns is None else orientation_stamps_ns
    _write_csv(folder / "orientation0" / "data.csv", COLUMNS["orientation0"], of_attitude, q_world_imu_wxyz, "%.9g")
    wheels = ",".join(f"wheel{i} [counts]" for i in range(counts.shape[1]))
    _write_csv(folder / "encoders0" / "data.csv", wheels, encoder_stamps_ns, counts, "%d")


def write_frame_list(folder: Path, stamps_ns: Int[np.ndarray, "frames"], suffix: str) -> tuple[str, ...]:
    """Write `cam0/data.csv`, last, so that a recording without it is seen to be unfinished."""
    names = [f"{stamp}{suffix}" for stamp in stamps_ns]
    (folder / "cam0" / "data").mkdir(parents=True, exist_ok=True)
    rows = "\n".join(f"{stamp},{name}" for stamp, name in zip(stamps_ns, names, strict=True))
    (folder / "cam0" / "data.csv").write_text(f"#timestamp [ns],filename\n{rows}\n")
    return tuple(f"cam0/data/{name}" for name in names)


def read_csv(path: Path, columns: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and numbers of one sensor's file.

    Raises:
        BadRecording: naming file, line and value.
    """
    stamps: list[int] = []
    rows: list[list[float]] = []
    for line, row in _csv_rows(path):
        columns = columns or len(row) - 1
        try:
            values = [float(v) for v in row[1:]]
        except ValueError as error:
            raise BadRecording(f"{path}:{line}: {error}; a stamp in ns and {columns} numbers are expected") from None
        if len(values) != columns or not all(map(isfinite, values)):
            raise BadRecording(f"{path}:{line}: {row[1:]}; {columns} finite numbers are expected")
        stamps.append(_stamp_ns(path, line, row[0], stamps))
        rows.append(values)
    if len(stamps) < 2:
        raise BadRecording(f"{path}: {len(stamps)} rows; at least 2 are needed")
    return np.array(stamps, dtype=np.int64), np.array(rows)


def open_recording(folder: Path) -> Recording:
    """Open a log; frames are read when asked for.

    Raises:
        BadRecording: naming file, line and value.
    """
    rig = _read_settings(Rig, folder / "rig.yaml")
    pipe = _read_settings(NominalPipe, folder / "pipe.yaml")
    imu_stamps, imu = read_csv(folder / "imu0" / "data.csv", 6)
    orientation_stamps, q = read_csv(folder / "orientation0" / "data.csv", 4)
    encoder_stamps, counts = read_csv(folder / "encoders0" / "data.csv", len(rig.wheels.diameters_mm))
    lengths = np.linalg.norm(q, axis=1)
    if (np.abs(lengths - 1) > QUATERNION_TOLERANCE).any():
        row = int(np.argmax(np.abs(lengths - 1)))
        where = f"{folder / 'orientation0' / 'data.csv'}: at stamp {orientation_stamps[row]}"
        raise BadRecording(f"{where}: a quaternion of length {lengths[row]:.3g}; 1 is expected")
    odd = np.argwhere((counts != np.rint(counts)) | (np.abs(counts) > LARGEST_COUNT))
    if odd.size:
        row, wheel = odd[0]
        where = f"{folder / 'encoders0' / 'data.csv'}: at stamp {encoder_stamps[row]}: wheel {wheel + 1}"
        raise BadRecording(f"{where}: {counts[row, wheel]:g}; whole counts up to {LARGEST_COUNT} are expected")
    stamps, files = _read_frame_list(folder)
    for name, log in (("imu0", imu_stamps), ("orientation0", orientation_stamps), ("encoders0", encoder_stamps)):
        outside = stamps[(stamps < log[0] - LATE_S * 1e9) | (stamps > log[-1] + LATE_S * 1e9)]
        if outside.size:
            covered = f"{folder / name / 'data.csv'} goes from {log[0]} to {log[-1]} ns"
            raise BadRecording(f"{covered}; it says nothing of {outside.size} frames, the first at {outside[0]} ns")
    return Recording(
        folder,
        rig,
        pipe,
        stamps,
        files,
        imu_stamps,
        imu,
        orientation_stamps,
        q,
        encoder_stamps,
        counts.astype(np.int64),
    )


def _read_settings(kind: type[AnySettings], path: Path) -> AnySettings:
    refuse_link(path)
    try:
        return load_settings(kind, path)
    except (OSError, ValueError) as error:
        raise BadRecording(f"{path}: {error}") from error


def _read_frame_list(folder: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    path = folder / "cam0" / "data.csv"
    if not path.is_file():
        raise BadRecording(f"{path}: missing (it is written last: the recording may be unfinished)")
    stamps: list[int] = []
    files: list[str] = []
    for line, row in _csv_rows(path):
        name = row[1].strip() if len(row) == 2 else ""
        if Path(name).name != name or Path(name).suffix not in (".png", SLIT_PIXELS_SUFFIX):
            raise BadRecording(f"{path}:{line}: {row}; a stamp in ns and a plain file name (png, npy) are expected")
        stamps.append(_stamp_ns(path, line, row[0], stamps))
        files.append(f"cam0/data/{name}")
    return np.array(stamps, dtype=np.int64), tuple(files)


def refuse_link(path: Path) -> None:
    """A log from elsewhere may name no file outside its folder.

    Raises:
        BadRecording: for a symbolic link.
    """
    if path.is_symlink() or path.parent.is_symlink():
        raise BadRecording(f"{path}: a symbolic link; the files of a log must lie in its own folder")


def _csv_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and fields of a log, without its comments.

    Raises:
        BadRecording: for a file that is missing, too large, or no text.
    """
    refuse_link(path)
    if not path.is_file():
        raise BadRecording(f"{path}: missing")
    if path.stat().st_size > MAX_LOG_BYTES:
        raise BadRecording(f"{path}: {path.stat().st_size} bytes; at most {MAX_LOG_BYTES}")
    line = 0
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for line, row in enumerate(csv.reader(file), start=1):
                if row and not row[0].startswith("#"):
                    yield line, row
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadRecording(f"{path}:{line + 1}: {error}") from error


def _stamp_ns(path: Path, line: int, text: str, before: list[int]) -> int:
    """A stamp that comes after the last one."""
    if not (text.isascii() and text.isdigit() and len(text) <= STAMP_DIGITS and int(text) <= LATEST_NS):
        raise BadRecording(f"{path}:{line}: {text!r}; a stamp in ns, at most {STAMP_DIGITS} digits, is expected")
    if before and int(text) <= before[-1]:
        raise BadRecording(f"{path}:{line}: stamp {text} does not come after {before[-1]}")
    return int(text)
