"""One frame of a log as its worker sees it: the slits found in it, and how its picture was exposed."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from algorithms.decode import decode
from algorithms.method import Method
from algorithms.types import FrameResult, RingPoints
from scenarios.field.travel import Travel, travel_on
from scenarios.run import opened
from sensor_model.recording import BadRecording, SlitPixels, read_frame
from sensor_model.rig import Rig

BRIGHT, BLACK = 250, 8  # of 255: a channel that is full, and a pixel without light
EVERY_PX = 4  # either way, which is enough for exposure, and to know a picture again
SECTORS = 72
NO_SLITS = SlitPixels(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0))


class Look(NamedTuple):
    """What a frame showed. Shares and level (0 to 1) are NaN without a picture; `fault`: why it cannot be read."""

    seen: SlitPixels
    digest: bytes
    level: float = float("nan")
    full_share: float = float("nan")
    black_share: float = float("nan")
    fault: str = ""


def look_at(folder: str, index: int, method: Method) -> Look:
    """Look at one frame of a recording."""
    recording = opened(folder)
    return look(recording.folder / recording.frame_files[index], index, recording.rig, method)


def look(file: Path, index: int, rig: Rig, method: Method) -> Look:
    """Read and decode one frame; one that cannot be read shows nothing, and says why."""
    try:
        content = read_frame(file, rig)
    except (BadRecording, OSError) as error:
        return Look(NO_SLITS, b"", fault=str(error))
    if isinstance(content, SlitPixels):
        return Look(content, _digest(content.pixel))
    some = np.ascontiguousarray(content[::EVERY_PX, ::EVERY_PX])
    return Look(decode(content, rig, method.decode, index), _digest(some), *_exposure(some))


def _digest(values: np.ndarray) -> bytes:
    return blake2b(np.ascontiguousarray(values).data, digest_size=8).digest()


def _exposure(some: UInt8[np.ndarray, "height width 3"]) -> tuple[float, float, float]:
    """Mean level, share of pixels with a full channel, share of black ones."""
    brightest = np.maximum(np.maximum(some[..., 0], some[..., 1]), some[..., 2])
    return float(some.mean() / 255), float((brightest >= BRIGHT).mean()), float((brightest <= BLACK).mean())


@dataclass(frozen=True)
class Watched:
    """What was gathered frame by frame: exposure, and what the rings said before their points went into the map.

    `ring_off_mm` is the median distance of each slit's points from the fitted wall, NaN where there are none;
    `sectors` the share of all slits found in each sector of the picture, clockwise from its top, summed over frames.
    """

    digest: list[bytes]
    fault: list[str]
    exposure: list[tuple[float, float, float]]
    ring_off_mm: list[Float[np.ndarray, "slits"]]
    slits: list[Float[np.ndarray, "slits"]]
    sectors: Float[np.ndarray, "sectors"]
    noise_scale: list[float]
    travel: Travel


def begin_watch(rig: Rig) -> Watched:
    """Nothing was seen yet."""
    return Watched([], [], [], [], [], np.zeros(SECTORS), [], Travel(len(rig.projector.slits)))


def watch(watched: Watched, frame: Look, result: FrameResult, rig: Rig, azimuths: int) -> None:
    """Take one frame in."""
    slits = len(rig.projector.slits)
    watched.digest.append(frame.digest)
    watched.fault.append(frame.fault)
    watched.exposure.append((frame.level, frame.full_share, frame.black_share))
    watched.ring_off_mm.append(_ring_off_mm(result, slits))
    if result.alignment.converged:
        travel_on(watched.travel, kept_points(result), result.alignment)
    watched.noise_scale.append(result.alignment.noise_scale)
    watched.slits.append(np.bincount(frame.seen.slit, minlength=slits) / azimuths)
    middle = np.array([rig.camera.cx_px, rig.camera.cy_px])
    out = frame.seen.pixel - middle
    turn = np.mod(np.arctan2(out[:, 0], -out[:, 1]) / (2 * np.pi), 1.0)
    sector = np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1)
    watched.sectors[:] += np.bincount(sector, minlength=SECTORS) * SECTORS / (azimuths * slits)


def kept_points(result: FrameResult) -> RingPoints:
    """The points of a frame that lie where a wall can be."""
    points, kept = result.points, result.kept
    return RingPoints(
        *(part[kept] for part in (points.xyz_mm, points.ring, points.pixel, points.direction, points.sigma_mm))
    )


def _ring_off_mm(result: FrameResult, slits: int) -> Float[np.ndarray, "slits"]:
    """How far outside the fitted wall each slit's points lie, in the middle."""
    off, T = np.full(slits, np.nan), result.alignment.T_pipe_camera
    if not result.alignment.converged:
        return off
    place = result.points.xyz_mm @ T[:2, :3].T + T[:2, 3]
    out_mm = np.hypot(place[:, 0], place[:, 1]) - result.alignment.radius_mm
    for slit in range(slits):
        of_slit = result.kept & (result.points.ring == slit)
        if of_slit.any():
            off[slit] = np.median(out_mm[of_slit])
    return off
