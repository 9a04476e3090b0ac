"""A recording as a video without loss (FFV1 in mkv), with stamps, IMU, attitude and encoders as CSV files beside it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from scenarios.document import BadInput
from scenarios.field.place import recording_in
from scenarios.field.read_video import ATTITUDE, ENCODERS, IMU, STAMPS
from sensor_model.recording import open_recording

BESIDE = {IMU: "imu0/data.csv", ATTITUDE: "orientation0/data.csv", ENCODERS: "encoders0/data.csv"}
TEXTS = ("rig.yaml", "pipe.yaml")


def export_video(run: Path, target: Path) -> None:
    """Write a run's recording as a folder with a video and its tables.

    Raises:
        BadInput: when there is no recording, it has no pictures, or the folder cannot be written.
    """
    import cv2

    recording = open_recording(recording_in(run))
    if not all(name.endswith(".png") for name in recording.frame_files):
        raise BadInput([f"{recording.folder}: its frames are slit pixels; a video needs pictures (or give --to mcap)"])
    camera, step_s = recording.rig.camera, float(np.median(np.diff(recording.frame_stamps_ns))) / 1e9
    target.mkdir()
    size, code = (camera.width_px, camera.height_px), cv2.VideoWriter_fourcc(*"FFV1")  # type: ignore[attr-defined]
    video = cv2.VideoWriter(str(target / "video.mkv"), cv2.CAP_FFMPEG, code, 1 / step_s, size)
    if not video.isOpened():
        raise BadInput([f"{target}: this OpenCV writes no FFV1 video; give --to mcap"])
    for index in range(len(recording)):
        picture = recording[index].picture
        assert picture is not None  # noqa: S101  a PNG has one
        video.write(np.ascontiguousarray(picture[:, :, ::-1]))
    video.release()
    lines = "\n".join(map(str, recording.frame_stamps_ns.tolist()))
    (target / STAMPS).write_text(f"#timestamp [ns]\n{lines}\n")
    for name, source in {**BESIDE, **{text: text for text in TEXTS}}.items():
        shutil.copyfile(recording.folder / source, target / name)
