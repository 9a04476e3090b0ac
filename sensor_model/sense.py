"""Truth in, recording out: every frame drawn (or its slit pixels found), the IMU and the encoders logged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float, UInt8
from pydantic import Field, field_validator

from sensor_model.encoders import EncoderNoise, measure_encoders, with_missed_counts
from sensor_model.imu import ImuNoise, measure_imu
from sensor_model.optics import AnyOptics, Optics, wall_name
from sensor_model.points import AnyPointNoise, PointNoise, measured_noises, see_slits
from sensor_model.recording import SLIT_PIXELS_SUFFIX, NominalPipe, write_frame_list, write_logs, write_slit_pixels
from sensor_model.rig import Rig
from sensor_model.settings import Settings
from sensor_model.stamps import Timing, stamps_and_exposures_s
from sensor_model.streams import stream
from sensor_model.workers import spread
from twin.pipe import Pipe
from twin.truth import Truth

Fidelity = Literal["picture", "raycast", "points"]
DEFAULT_NOISE = "default"


class Sensing(Settings):
    """How the sensor sees: by which fidelity, how often, and with which errors."""

    fidelity: Fidelity = "picture"
    frame_rate_hz: Annotated[float, Field(gt=0.1, le=240)] = 15.0
    optics: AnyOptics = Optics()
    points: AnyPointNoise = PointNoise()
    """Or the name of a measured noise; `default` is that of pictures of the very wall, where there is one."""
    imu: ImuNoise = ImuNoise()
    encoders: EncoderNoise = EncoderNoise()
    timing: Timing = Timing()

    @field_validator("points", mode="before")
    @classmethod
    def _of_the_wall(cls, points: Any, info: Any) -> Any:
        optics = info.data.get("optics")
        wall = wall_name(optics) if points == DEFAULT_NOISE and optics is not None else None
        return wall if wall in measured_noises() else points


def without_effect(sensing: Sensing) -> str:
    """Which optics are stated, but only pictures show them: a sentence for whoever asked for `points`, else nothing."""
    if sensing.fidelity != "points":
        return ""
    default, optics = Optics(), sensing.optics
    unseen = [
        name
        for name in Optics.model_fields
        if name not in ("glass", "water") and getattr(optics, name) != getattr(default, name)
    ]
    if not unseen:
        return ""
    return (
        f"sensing.fidelity points draws no picture, so these of sensing.optics have no effect: {', '.join(unseen)}; "
        "of the light it knows glass and water, and the rest by sensing.points alone"
    )


def sense(
    truth: Truth,
    true_rig: Rig,
    nominal_rig: Rig,
    nominal_pipe: NominalPipe,
    sensing: Sensing,
    seed: int,
    folder: Path,
    workers: int = 1,
    peaks_kb: dict[int, int] | None = None,
) -> Iterator[int]:
    """Write what a robot would have written, and yield the number of frames done as it goes.

    The true rig makes the measurements; nominal rig and pipe go with the recording. `cam0/data.csv` comes last.

    Raises:
        ValueError: when rig and truth do not fit together.
    """
    imu = measure_imu(truth, true_rig.imu, sensing.imu, stream(seed, "imu"), stream(seed, "attitude"))
    encoders = measure_encoders(truth, true_rig.wheels, sensing.encoders)
    logs = np.hstack([imu.gyro_rad_s, imu.acceleration_m_s2])
    counts = with_missed_counts(encoders.counts, sensing.encoders.missed_share, stream(seed, "encoders"))
    write_logs(folder, nominal_rig, nominal_pipe, imu.stamp_ns, logs, imu.q_world_imu_wxyz, encoders.stamp_ns, counts)

    times, exposed = stamps_and_exposures_s(truth, sensing.frame_rate_hz, sensing.timing, stream(seed, "stamps"))
    poses = truth.pose_at(exposed.ravel()).reshape(*exposed.shape, 4, 4)
    stamps = np.round(times * 1e9).astype(np.int64)
    (folder / "cam0" / "data").mkdir(parents=True, exist_ok=True)
    suffix = SLIT_PIXELS_SUFFIX if sensing.fidelity == "points" else ".png"
    jobs = [
        (truth.pipe, pose, true_rig, sensing, seed, index, folder / "cam0" / "data" / f"{stamp}{suffix}")
        for index, (pose, stamp) in enumerate(zip(poses, stamps, strict=True))
    ]
    # slit pixels are found faster than a worker starts
    finished = spread(write_frame, jobs, 1 if sensing.fidelity == "points" else workers, peaks_kb)
    yield from (done for done, _ in enumerate(finished, start=1))
    write_frame_list(folder, stamps, suffix)


def write_frame(
    pipe: Pipe,
    T_pipe_camera: Float[np.ndarray, "poses 4 4"],
    rig: Rig,
    sensing: Sensing,
    seed: int,
    index: int,
    file: Path,
) -> None:
    """Make one frame and write it: a PNG, exposed while the camera is at each of these poses, or the slit pixels."""
    middle = T_pipe_camera[len(T_pipe_camera) // 2]
    optics = sensing.optics
    if sensing.fidelity == "points":
        rng = stream(seed, "points", index)
        seen = see_slits(pipe, middle, rig, sensing.points, rng, optics.glass, optics.water, index)
        write_slit_pixels(file, seen)
        return
    from sensor_model.daylight import daylight
    from sensor_model.focus import nearness_per_mm
    from sensor_model.image_formation import expose

    if sensing.fidelity == "picture":
        from sensor_model.drawing import draw
    else:
        from sensor_model.raycast import draw
    linear = np.stack([draw(pipe, pose, rig, optics) for pose in T_pipe_camera]).mean(axis=0)
    if optics.daylight.level > 0:
        time_s = index / sensing.frame_rate_hz
        linear += daylight(pipe, middle, rig.camera, optics.wall_reflectance, optics.daylight, time_s)
    nearness = nearness_per_mm(pipe, middle, rig.camera, optics)
    picture = expose(linear, optics, stream(seed, "picture", index), rig.camera, nearness)
    file.write_bytes(png(picture))


def png(picture: UInt8[np.ndarray, "height width 3"]) -> bytes:
    """An RGB picture as PNG."""
    import cv2

    # Huffman coding alone: a noisy picture has no repeats to find, and it is the fastest and the smallest here; and one
    # filter for all rows: to choose row by row takes twice as long, for a file that is smaller by a thirtieth
    how = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    how += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    return cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), how)[1].tobytes()
