"""`pipetwin identify`: a log in, the scenario of its twin out, with a page; the truth is never read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8

from algorithms.identification.estimate import Estimate, Quantity
from algorithms.identification.identify import (
    Identified,
    identify_imu,
    identify_log,
    identify_pictures,
    imu_of,
    shaking,
)
from algorithms.identification.inertial import Imu
from algorithms.identification.scan import IDENTIFYING, walk
from algorithms.identification.wheels import rolled_mm
from algorithms.reconstruct import see
from scenarios.calibration.camera import page_of
from scenarios.calibration.in_pipe import read_for
from scenarios.calibration.pictures import ENDINGS, listed
from scenarios.document import BadInput
from scenarios.field.haze import haze
from scenarios.field.identify_page import identify_page
from scenarios.field.partial_logs import read_device_log, view_quantities, views_of
from scenarios.field.twin_of_log import JAG_OF_RMS, Given, drive_of, scenario_text, whole_cells
from scenarios.load import load_scenario
from scenarios.progress import Progress
from scenarios.run_folder import whole_file
from sensor_model.optics import Optics
from sensor_model.recording import SLIT_PIXELS_SUFFIX, BadRecording, NominalPipe, Recording, SlitPixels, open_recording
from sensor_model.rig import Rig

NOISE_PICTURES, HAZE_PICTURES = 6, 2
PARTIAL_PIPE = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
NAME = re.compile(r"[^A-Za-z0-9_.-]+")


class Identification(NamedTuple):
    """What came of a log: what was found, the IMU's samples where it has them, and what the scenario is made with."""

    found: Identified
    imu: Imu | None
    given: Given
    drive: dict[str, Any]


def identify(log: Path, rig: Rig | None, optics: Optics, out: Path, progress: Progress) -> dict[str, Any]:
    """Identify, write scenario and page, and give the figures.

    Args:
        log: a recording or a run, a folder of pictures (or one), or the IMU's own file.
        rig: the sensor; None takes the one that the recording carries.
        optics: the look whose other settings are kept.
        out: the scenario to write.
        progress: told of the frames.

    Raises:
        BadInput: for a log that cannot be read, or tells nothing.
    """
    done = identified(log, rig, optics, NAME.sub("-", out.stem).strip("-.")[:60] or "twin", progress)
    if not any(isinstance(one, Estimate) for one in done.found.quantities.values()):
        reasons = sorted({one.reason for one in done.found.quantities.values() if not isinstance(one, Estimate)})
        raise BadInput([f"{log}: nothing could be estimated: {'; '.join(reasons)}"])
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput([f"{out.parent}: cannot be made: {error.strerror}; choose another place with -o"]) from error
    text = scenario_text(done.given, done.found, done.drive)
    with whole_file(out) as work:
        work.write_text(text, encoding="utf-8")
        load_scenario(str(work), [], None)  # what we write reads back, or is not written
    with whole_file(page_of(out, "identify")) as work:
        work.write_text(identify_page(log, done.found, done.imu), encoding="utf-8")
    return figures_of(done.found)


def figures_of(found: Identified) -> dict[str, Any]:
    """All quantities as plain data."""
    out: dict[str, Any] = {name: plain(one) for name, one in found.quantities.items()}
    out["vibration"] = [
        {
            "from_hz": band.from_hz,
            "to_hz": band.to_hz,
            "acceleration_m_s2": [plain(one) for one in band.force_m_s2],
            "rate_deg_s": [plain(one.scaled(float(np.degrees(1)))) for one in band.rate_rad_s],
        }
        for band in found.bands
    ]
    out["said"] = list(found.said)
    return out


def plain(quantity: Quantity) -> dict[str, Any]:
    """A quantity as plain data."""
    held = asdict(quantity)
    return {key: value if not isinstance(value, float) or isfinite(value) else None for key, value in held.items()}


def identified(log: Path, rig: Rig | None, optics: Optics, name: str, progress: Progress) -> Identification:
    """Find out what kind of log it is, and identify what it holds.

    Raises:
        BadInput: as `identify`.
    """
    for folder in (log, log / "recording"):
        if (folder / "cam0" / "data.csv").exists() or (folder / "rig.yaml").exists():
            return _of_recording(folder, rig, optics, name, progress)
    if log.suffix.lower() == ".csv":
        return _of_imu(log, rig, name)
    if log.is_dir() or log.suffix.lower() in ENDINGS:
        return _of_pictures(log, rig, optics, name)
    raise BadInput([f"{log}: no log; give a recording or a run, a folder of pictures, or the IMU's CSV"])


def _of_recording(folder: Path, rig: Rig | None, optics: Optics, name: str, progress: Progress) -> Identification:
    try:
        recording = open_recording(folder)
    except BadRecording as error:
        raise BadInput([str(error)]) from error
    if rig is not None:
        recording = _with_rig(recording, rig)
    walked = walk(recording, seen_frames(recording, progress))
    found = identify_log(recording, walked)
    points = recording.frame_files[0].endswith(SLIT_PIXELS_SUFFIX)
    if not points:
        chosen = np.unique(np.linspace(0, len(recording) - 1, NOISE_PICTURES).round().astype(int)).tolist()
        pictures = [picture for i in chosen if (picture := recording[i].picture) is not None]
        found = replace(
            found, quantities=found.quantities | _picture_quantities(pictures, found, recording.rig, optics)
        )
    given = Given(name, recording.rig, recording.pipe, "points" if points else "picture", optics)
    way = found.way
    assert way is not None  # noqa: S101  a recording always has encoders
    return Identification(found, imu_of(recording, rolled_mm(recording)), given, drive_of(way, found.bands))


def _with_rig(recording: Recording, rig: Rig) -> Recording:
    """The recording seen by another rig of the same kind.

    Raises:
        BadInput: for one with another number of wheels.
    """
    wheels, expected = recording.counts.shape[1], len(rig.wheels.diameters_mm)
    if wheels != expected:
        raise BadInput([f"{recording.folder}: got {wheels} encoder wheels; the rig given has {expected}"])
    return replace(recording, rig=rig)


def seen_frames(recording: Recording, progress: Progress) -> Iterator[SlitPixels]:
    """The slit pixels of every frame, decoded where it is a picture.

    Raises:
        BadInput: for a frame that cannot be read.
    """
    for index in range(len(recording)):
        try:
            yield see(recording[index], recording.rig, IDENTIFYING)
        except BadRecording as error:
            raise BadInput([str(error)]) from error
        progress(f"measure {recording.folder.parent.name}", index + 1, len(recording))


def _picture_quantities(
    pictures: list[UInt8[np.ndarray, "height width 3"]], found: Identified, rig: Rig, optics: Optics
) -> dict[str, Quantity]:
    """Noise of pictures, and haze with the edges as jagged as they were found."""
    out = identify_pictures(pictures, optics.gamma)
    jag, cells = (found.quantities.get(name) for name in ("edge_jitter_deg", "edge_jitter_cells"))
    if isinstance(jag, Estimate) and isinstance(cells, Estimate):
        printed = {"slide_jag_deg": max(JAG_OF_RMS * jag.value, 0.0), "slide_jag_cells": whole_cells(cells.value)}
        optics = optics.model_copy(update=printed)
    middle = pictures[len(pictures) // 2 :] + pictures[: len(pictures) // 2]
    return out | {"haze": haze(middle[:HAZE_PICTURES], rig, optics)}


def _of_pictures(log: Path, rig: Rig | None, optics: Optics, name: str) -> Identification:
    if rig is None:
        raise BadInput([f"{log}: pictures alone; say with --rig which sensor took them"])
    pictures = [read_for(file, rig) for file in listed([log])]
    views = views_of(pictures, rig)
    found = Identified(view_quantities(views, rig), said=("Pictures alone: nothing is known of IMU, wheels and way.",))
    found = replace(found, quantities=found.quantities | _picture_quantities(pictures, found, rig, optics))
    given = Given(name, rig, PARTIAL_PIPE, "picture", optics)
    known = found.quantities
    offset = [
        one.value if isinstance(one := known.get(key), Estimate) else 0.0 for key in ("offset_x_mm", "offset_y_mm")
    ]
    drive = {"kind": "gantry", "stages": [{"to_mm": 100.0}], "offset_mm": [round(v, 3) for v in offset]}
    return Identification(found, None, given, drive)


def _of_imu(log: Path, rig: Rig | None, name: str) -> Identification:
    from sensor_model.rig import preset_rig

    imu, words = read_device_log(log)
    known = identify_imu(imu)
    if words:
        del known["accelerometer_bias_down_m_s2"]
    rig = rig or preset_rig()
    known["imu_rate_hz"] = Estimate(1 / imu.step_s, 1 / imu.step_s, 1 / imu.step_s, imu.time_s.size, "stamps")
    said = ("The IMU alone: nothing is known of pictures, wheels and way.", *([words] if words else []))
    bands = shaking(imu, rig.imu, known)
    given = Given(name, rig, PARTIAL_PIPE, "points", Optics())
    drive = {"kind": "gantry", "stages": [{"to_mm": 100.0}]}
    return Identification(Identified(known, bands, said=said), imu, given, drive)
