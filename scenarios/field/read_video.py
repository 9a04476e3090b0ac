"""A video with its CSV files beside it as a recording: stamps, IMU, encoders in the recording's own columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from scenarios.calibration.rig_file import read_settings
from scenarios.document import BadInput
from scenarios.field.attitude import attitude_without_device
from scenarios.field.told import Told, needed
from scenarios.run import Report
from sensor_model.recording import NominalPipe, read_csv, refuse_link, write_frame_list, write_logs
from sensor_model.rig import Camera, Rig
from sensor_model.sense import png

VIDEOS = (".mp4", ".mkv", ".avi", ".mov")
STAMPS, IMU, ATTITUDE, ENCODERS = "stamps.csv", "imu.csv", "orientation.csv", "encoders.csv"


def is_video(log: Path) -> bool:
    """Whether it is a video, or a folder with one."""
    return _video(log) is not None


def _video(log: Path) -> Path | None:
    if log.is_dir():
        found = [path for path in sorted(log.iterdir()) if path.suffix.lower() in VIDEOS]
        return found[0] if len(found) == 1 else None
    return log if log.suffix.lower() in VIDEOS else None


def read_video(log: Path, told: Told, target: Path, progress: Report) -> list[str]:
    """Write a video and the files beside it as a recording.

    Raises:
        BadInput: when the video cannot be read, or does not have as many frames as there are stamps.
        BadRecording: naming file, line and value of a CSV file.
    """
    video = _video(log)
    assert video is not None  # noqa: S101  the reader was chosen for it
    refuse_link(video)
    if not video.is_file():  # a pipe would be waited for
        raise BadInput([f"{video}: is no plain file; a video is expected"])
    beside = video.parent
    rig, pipe = needed(_beside(told, beside), log)
    stamps, _ = read_csv(beside / STAMPS, 0)
    imu_stamps, imu = read_csv(beside / IMU, 6)
    encoder_stamps, counts = read_csv(beside / ENCODERS, len(rig.wheels.diameters_mm))
    remarks = []
    if (beside / ATTITUDE).exists():
        attitude_stamps, attitude = read_csv(beside / ATTITUDE, 4)
    else:
        attitude_stamps, attitude = imu_stamps, attitude_without_device(imu_stamps, imu)
        remarks.append("no attitude in the log: made from gyroscope and accelerometer, so its heading drifts")
    whole = np.rint(counts).astype(np.int64)
    write_logs(target, rig, pipe, imu_stamps, imu, attitude, encoder_stamps, whole, attitude_stamps)
    (target / "cam0" / "data").mkdir(parents=True)
    number = 0
    for number, picture in enumerate(_pictures(video, rig.camera), start=1):
        if number > stamps.size:
            break
        (target / "cam0" / "data" / f"{stamps[number - 1]}.png").write_bytes(png(picture))
        progress("read", number, stamps.size)
    if number != stamps.size:
        has = f"more than {stamps.size}" if number > stamps.size else str(number)
        raise BadInput([f"{video}: {has} frames that can be read; {beside / STAMPS} has {stamps.size} stamps"])
    write_frame_list(target, stamps, ".png")
    return remarks


def _beside(told: Told, folder: Path) -> Told:
    """What files beside the video say of rig and pipe, where the operator does not."""
    rig, pipe = folder / "rig.yaml", folder / "pipe.yaml"
    return told._replace(
        rig=told.rig or (read_settings(Rig, rig) if rig.is_file() else None),
        pipe=told.pipe or (read_settings(NominalPipe, pipe) if pipe.is_file() else None),
    )


def _pictures(video: Path, camera: Camera) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """The frames of a video as RGB, one at a time.

    Raises:
        BadInput: when it is no video of the rig's camera.
    """
    import cv2

    stream = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    try:
        size = int(stream.get(cv2.CAP_PROP_FRAME_WIDTH)), int(stream.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if not stream.isOpened() or size != (camera.width_px, camera.height_px):
            got = f"frames of {size[0]} x {size[1]} px" if stream.isOpened() else "nothing that can be read as a video"
            raise BadInput([f"{video}: got {got}; the rig's camera has {camera.width_px} x {camera.height_px}"])
        while True:
            more, picture = stream.read()
            if not more:
                return
            if picture.shape != (camera.height_px, camera.width_px, 3):
                raise BadInput([f"{video}: got a frame of {picture.shape[1]} x {picture.shape[0]} px in its midst"])
            yield np.ascontiguousarray(picture[:, :, ::-1])
    finally:
        stream.release()
